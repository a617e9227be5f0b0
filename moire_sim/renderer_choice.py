"""Which renderer draws the geometry: TinyRenderer, which is everywhere, or EGL, which is quicker where it works."""

from __future__ import annotations

import subprocess
import sys
from functools import cache
from typing import Literal

from moire_sensor.errors import SettingsError
from moire_sim.errors import SimulatorError

Renderer = Literal["tiny", "egl", "auto"]
RENDERERS: tuple[Renderer, ...] = ("tiny", "egl", "auto")
TRY = "from moire_sim.render_geometry import egl_depth_m; assert abs(egl_depth_m() - 1.0) < 1e-4"
TIMEOUT_S = 60.0


def uses_egl(renderer: str) -> bool:
    """Decide whether to render by EGL; ``"auto"`` does where it works.

    Raises
    ------
    SettingsError
        An unknown renderer.
    SimulatorError
        ``"egl"`` where it does not work.
    """
    if renderer not in RENDERERS:
        raise SettingsError(f"renderer is {renderer!r}; choose one of {', '.join(RENDERERS)}")
    if renderer == "tiny":
        return False
    works = egl_works()
    if renderer == "egl" and not works:
        raise SimulatorError(
            "EGL does not render here; use tiny, or install EGL and a driver (Debian: libegl1, libgl1-mesa-dri)"
        )
    return works


@cache
def egl_works() -> bool:
    """Try EGL, once a process, in a process of its own: without a driver pybullet's plug-in ends the one it is in."""
    try:
        done = subprocess.run([sys.executable, "-c", TRY], capture_output=True, check=False, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0
