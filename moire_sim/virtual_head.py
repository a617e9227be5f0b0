"""The virtual head: fringe images of a scene, with the truth."""

from __future__ import annotations

from dataclasses import dataclass, field
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import SettingsError
from moire_sensor.paper_rig import PROJECTOR_SIZE, paper_rig
from moire_sensor.pattern import FringePattern
from moire_sensor.rig import StereoRig
from moire_sim.capture import Grey, HeadCapture, stacked
from moire_sim.device_view import DeviceView
from moire_sim.errors import SimulatorError
from moire_sim.exposure import exposed, noise_generator
from moire_sim.fringe_image import Image, Light, dark_picture, fringe_picture
from moire_sim.joint_motion import PAN_JOINT, TILT_JOINT, JointLimit
from moire_sim.scenes import scene_bodies
from moire_sim.still_view import StillView, still_view

if TYPE_CHECKING:
    from moire_sim.render_geometry import GeometryRenderer

Array = npt.NDArray[np.float64]
CACHED_PICTURES = 32


@dataclass(frozen=True)
class HeadOptions:
    """How the head lights and sees.

    Attributes
    ----------
    light : light and lens.
    noise : standard deviation of the camera noise, 8-bit grey levels, 0 to 50.
    bits : 8 (uint8) or 16 (uint16, full range).
    projector_size : (width, height) of the projector's image, pixels.
    """

    light: Light = field(default_factory=Light)
    noise: float = 1.5
    bits: int = 8
    projector_size: tuple[int, int] = PROJECTOR_SIZE

    def __post_init__(self) -> None:
        if not 0.0 <= self.noise <= 50.0:
            raise SettingsError(f"noise is {self.noise}; it must be 0 to 50 grey levels")
        if self.bits not in (8, 16):
            raise SettingsError(f"bits is {self.bits}; it must be 8 or 16")


class VirtualHead:
    """A head before a scene; use it in a ``with`` statement.

    Parameters
    ----------
    scene : name from :func:`moire_sim.scene_names`, options after a colon: ``"flat_board:distance_m=0.8"``.
    seed : of the noise; exposure n of camera c (0 left, 1 right) draws from ``default_rng((seed, n, c))``.
    rig : default the paper's.
    options : light, lens, noise and bits.

    Raises
    ------
    SceneError
        An unknown scene or option.
    SimulatorError
        pybullet is not installed.
    """

    def __init__(
        self,
        scene: str = "flat_board",
        seed: int = 0,
        rig: StereoRig | None = None,
        options: HeadOptions | None = None,
    ) -> None:
        if seed < 0:
            raise SettingsError(f"seed is {seed}; it must be 0 or more")
        bodies = scene_bodies(scene)
        self.scene, self.seed = scene, seed
        self.rig = rig or paper_rig()
        self.options = options or HeadOptions()
        self._views = tuple(
            DeviceView.of(projection, size)
            for projection, size in (
                (self.rig.P_left, self.rig.image_size),
                (self.rig.P_right, self.rig.image_size),
                (self.rig.P_projector, self.options.projector_size),
            )
        )
        self._still: StillView | None = None
        self._pictures: dict[tuple[FringePattern | None, int], tuple[Image, Image]] = {}
        self._next_exposure = 0
        self._pan_tilt_rad = (0.0, 0.0)
        self._renderer = open_renderer()(bodies)

    def __enter__(self) -> VirtualHead:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the simulator; calling it again does nothing."""
        self._renderer.close()

    def capture(self, pattern: FringePattern, exposure_index: int | None = None) -> HeadCapture:
        """Take all steps of a pattern, one exposure each.

        ``exposure_index`` is the first exposure's, which chooses its noise; by default exposures count on from 0.
        """
        first = self._next_exposure if exposure_index is None else exposure_index
        pairs = [self.expose(pattern, step, first + step) for step in range(pattern.step_count)]
        self._next_exposure = first + pattern.step_count
        still = self._look()
        return HeadCapture(
            stacked([left for left, _ in pairs]),
            stacked([right for _, right in pairs]),
            still.depth_m,
            still.covisible,
            still.left.lit,
            self.rig,
            pattern,
        )

    def expose(self, pattern: FringePattern, step: int = 0, exposure_index: int = 0) -> tuple[Grey, Grey]:
        """Left and right image (H, W) of one exposure of step ``step``."""
        return self._with_noise(self._ideal(pattern, step % pattern.step_count), exposure_index)

    def ambient(self, exposure_index: int = 0) -> tuple[Grey, Grey]:
        """Left and right image (H, W) of one exposure with the projector off."""
        return self._with_noise(self._ideal(None, 0), exposure_index)

    @property
    def depth_m(self) -> npt.NDArray[np.float32]:
        """True depth (H, W), z in the left optical frame; NaN where nothing is seen."""
        return self._look().depth_m

    @property
    def covisible(self) -> npt.NDArray[np.bool_]:
        """Pixels (H, W) of the left view that are lit by the projector and seen by both cameras."""
        return self._look().covisible

    @property
    def lit(self) -> npt.NDArray[np.bool_]:
        """Pixels (H, W) of the left view that are lit by the projector."""
        return self._look().left.lit

    @property
    def pan_tilt_rad(self) -> tuple[float, float]:
        """Pan (positive to the left) and tilt (positive down), radians."""
        return self._pan_tilt_rad

    @property
    def joint_limits(self) -> dict[str, JointLimit]:
        """What pan and tilt can do, by joint name."""
        return self._renderer.joint_limits()

    @property
    def frames(self) -> dict[str, Array]:
        """Pose (4, 4) of each frame of the head in ``head_base_link``, for TF.

        The right and the projector's optical frame follow the rig, which is the URDF's unless another was given.
        """
        poses = self._renderer.frames()
        left = poses["head_left_optical_frame"]
        for name, view in zip(("right", "projector"), self._views[1:], strict=True):
            poses[f"head_{name}_optical_frame"] = left @ np.linalg.inv(view.device_from_left)
        return poses

    def set_head(self, pan_rad: float, tilt_rad: float) -> None:
        """Turn the head; the next exposure renders anew if it moved.

        Raises
        ------
        SettingsError
            An angle outside the joint's limits.
        """
        for name, angle in ((PAN_JOINT, pan_rad), (TILT_JOINT, tilt_rad)):
            limit = self.joint_limits[name]
            if not limit.low_rad <= angle <= limit.high_rad:
                raise SettingsError(
                    f"{name} was given {angle} rad; it must be {limit.low_rad:g} to {limit.high_rad:g}"
                )
        if (pan_rad, tilt_rad) != self._pan_tilt_rad:
            self._renderer.set_joints(pan_rad, tilt_rad)
            self._pan_tilt_rad = (pan_rad, tilt_rad)
            self._still = None
            self._pictures.clear()

    def _look(self) -> StillView:
        if self._still is None:
            self._still = still_view(self._renderer, self.rig, self._views)
        return self._still

    def _ideal(self, pattern: FringePattern | None, step: int) -> tuple[Image, Image]:
        key = (pattern, step)
        if key not in self._pictures:
            if len(self._pictures) >= CACHED_PICTURES:
                del self._pictures[next(iter(self._pictures))]
            still, light = self._look(), self.options.light
            left, right = (
                dark_picture(side, light) if pattern is None else fringe_picture(side, pattern, step, light)
                for side in (still.left, still.right)
            )
            self._pictures[key] = (left, right)
        return self._pictures[key]

    def _with_noise(self, pair: tuple[Image, Image], exposure_index: int) -> tuple[Grey, Grey]:
        left, right = (
            exposed(image, self.options.noise, noise_generator(self.seed, exposure_index, camera), self.options.bits)
            for camera, image in enumerate(pair)
        )
        return left, right


def open_renderer() -> type[GeometryRenderer]:
    """Import the renderer, or raise SimulatorError saying how to get pybullet."""
    try:
        from moire_sim.render_geometry import GeometryRenderer
    except ModuleNotFoundError as error:
        if error.name != "pybullet":
            raise
        raise SimulatorError(
            "the virtual head needs pybullet, which is not installed; run make setup, or pip install pybullet "
            "(Python 3.11) or pybullet-arm64 (Python 3.12 and 3.13)"
        ) from error
    return GeometryRenderer
