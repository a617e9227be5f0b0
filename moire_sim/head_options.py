"""How the virtual head lights and sees."""

from __future__ import annotations

from dataclasses import dataclass, field

from moire_sensor.errors import SettingsError
from moire_sensor.paper_rig import PROJECTOR_SIZE
from moire_sim.fringe_image import Light
from moire_sim.optics import IDEAL, REAL, Optics

BITS = (8, 12, 16)
# Two cameras and a projector.
MOST_PROCESSES = 3


@dataclass(frozen=True)
class HeadOptions:
    """How the head lights and sees.

    Attributes
    ----------
    light : light and lens.
    noise : standard deviation of the cameras' noise without light, 8-bit grey levels, 0 to 50.
    bits : 8 (uint8), 12 or 16 (uint16, white at 4095 or 65535).
    projector_size : (width, height) of the projector's image, pixels.
    optics : flaws of projector, lenses, cameras and surfaces; ideal by default.
    renderer : ``"tiny"``, ``"egl"``, or ``"auto"`` for EGL where it works; EGL is quicker, its depth is good to 0.1 mm.
    render_processes : processes that render what moves, 1 to 3; 0: as many as help on this machine.
    """

    light: Light = field(default_factory=Light)
    noise: float = 1.5
    bits: int = 8
    projector_size: tuple[int, int] = PROJECTOR_SIZE
    optics: Optics = IDEAL
    renderer: str = "tiny"
    render_processes: int = 1

    def __post_init__(self) -> None:
        if not 0.0 <= self.noise <= 50.0:
            raise SettingsError(f"noise is {self.noise}; it must be 0 to 50 grey levels")
        if self.bits not in BITS:
            raise SettingsError(f"bits is {self.bits}; it must be 8, 12 or 16")
        if not 0 <= self.render_processes <= MOST_PROCESSES:
            raise SettingsError(f"render_processes is {self.render_processes}; it must be 0 to {MOST_PROCESSES}")


# With photon noise, what is left of the noise is that of reading a pixel: 6 electrons.
PRESETS = {"clean": HeadOptions(), "realistic": HeadOptions(light=Light(ambient=30.0), noise=0.15, optics=REAL)}


def preset(name: str) -> HeadOptions:
    """Return the options of a preset, ``"clean"`` or ``"realistic"``; raises SettingsError for another name."""
    if name not in PRESETS:
        raise SettingsError(f"optics is {name!r}; choose one of {', '.join(PRESETS)}")
    return PRESETS[name]
