"""The virtual head: fringe images of a scene, with the truth."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import SettingsError
from moire_sensor.paper_rig import paper_rig
from moire_sensor.pattern import FringePattern
from moire_sensor.rectify import RectifiedPair
from moire_sensor.rig import StereoRig
from moire_sim.camera_chip import CameraChip
from moire_sim.camera_lens import rectification
from moire_sim.capture import Grey, HeadCapture, stacked
from moire_sim.device_view import DeviceView
from moire_sim.head_options import HeadOptions
from moire_sim.ideal_pictures import IdealPictures
from moire_sim.joint_motion import PAN_JOINT, TILT_JOINT, JointLimit
from moire_sim.moment import Moment
from moire_sim.open_renderer import open_renderer, processes_to_render
from moire_sim.real_look import RealLook
from moire_sim.real_pictures import RealPictures
from moire_sim.renderer_choice import uses_egl
from moire_sim.scenes import load_scene
from moire_sim.still_view import StillView, still_view

Array = npt.NDArray[np.float64]


class VirtualHead:
    """A head before a scene; use it in a ``with`` statement.

    Parameters
    ----------
    scene : name from :func:`moire_sim.scene_names` or a YAML, URDF or SDF file; options after a colon:
        ``"flat_board:distance_m=0.8"``.
    seed : of the noise; exposure n of camera c (0 left, 1 right) draws from ``default_rng((seed, n, c))``.
    rig : default the paper's.
    options : light, noise, bits and the flaws of the optics; ``preset("realistic")`` has them all.

    Raises
    ------
    SceneError
        An unknown scene or option, or a file that is no scene.
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
        stage = load_scene(scene)
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
        self._ideal = IdealPictures(self._look, self.options, seed)
        self._next_exposure = 0
        self._moves, self._base_moves = stage.moves, stage.head_motion is not None
        self._time_s = 0.0
        self._moment = Moment()
        self.uses_egl = uses_egl(self.options.renderer)
        self.render_processes = processes_to_render(self.options.render_processes)
        self._renderer = open_renderer(stage, self.uses_egl, self.render_processes)
        self._renderer.go_to(self._moment)
        self._base_at_start = self._renderer.world_from_base
        self._real: RealPictures | None = None
        if not self.options.optics.is_ideal or any(body.finish is not None for body in stage.bodies):
            self._real = self._real_pictures(RealLook(
                self._renderer, self.rig, self._views, self.options.optics, stage.bodies
            ))

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
        """Take all steps of a pattern, one exposure each, while nothing moves.

        ``exposure_index`` is the first exposure's, which chooses its noise; by default exposures count on from 0. The
        images are those of the cameras: where they have lenses, ``rectification`` brings them to the rig's.
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

    def expose(
        self,
        pattern: FringePattern | None,
        step: int = 0,
        exposure_index: int = 0,
        joints_after: Callable[[float], tuple[float, float]] | None = None,
    ) -> tuple[Grey, Grey]:
        """Left and right image (H, W) of one exposure of step ``step``; without a pattern the projector is off.

        ``joints_after`` tells pan and tilt so many seconds after the middle of the exposure, where a mirror's sweep
        (``optics.sweep_ms``) takes time and the head turns meanwhile.
        """
        step = step_of(pattern, step)
        if self._real is None:
            return self._ideal.expose(pattern, step, exposure_index)

        def way(offset_s: float) -> Moment:
            joints = joints_after(offset_s) if joints_after and offset_s else self.pan_tilt_rad
            return Moment(*joints, self._moment.time_s + offset_s if self._moves else 0.0)

        images = self._real.expose(pattern, step, exposure_index, self._time_s, way)
        self._renderer.go_to(self._moment)
        return images

    def prepare(self, pattern: FringePattern | None, step: int = 0, exposure_index: int = 0) -> None:
        """Make an exposure ahead of its time, which :meth:`expose` returns if it is the next asked for.

        What moves until then makes it void. Real optics, the light of which varies, prepare nothing.
        """
        if self._real is None:
            self._ideal.prepare(pattern, step_of(pattern, step), exposure_index)

    def ambient(self, exposure_index: int = 0) -> tuple[Grey, Grey]:
        """Left and right image (H, W) of one exposure with the projector off."""
        return self.expose(None, exposure_index=exposure_index)

    @property
    def rectification(self) -> RectifiedPair:
        """What brings the cameras' images to the rig's, as a driver learns it from the camera infos."""
        return rectification(self.rig, self.options.optics)

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
        return self._moment.pan_rad, self._moment.tilt_rad

    @property
    def moves(self) -> bool:
        """True where something in the scene, or the head's base, moves over time."""
        return self._moves

    @property
    def base_moves(self) -> bool:
        """True where the scene moves the head's base."""
        return self._base_moves

    @property
    def world_from_base(self) -> Array:
        """Pose (4, 4) of ``head_base_link`` now, in that of ``head_base_link`` at time 0 in a scene that moves it."""
        return np.asarray(np.linalg.inv(self._base_at_start) @ self._renderer.world_from_base)

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
        self._go_to(Moment(pan_rad, tilt_rad, self._moment.time_s))

    def set_time(self, time_s: float) -> None:
        """Move everything that moves to where it is at a time in seconds; lamps swing with it, too."""
        self._time_s = time_s
        if self._moves:
            self._go_to(Moment(*self.pan_tilt_rad, time_s))

    def _go_to(self, moment: Moment) -> None:
        if moment != self._moment:
            self._renderer.go_to(moment)
            self._moment = moment
            self._still = None
            self._ideal.clear()

    def _real_pictures(self, look: RealLook) -> RealPictures:
        options = self.options
        chips = [
            CameraChip.of(options.optics, options.noise, options.bits, self.rig.image_size, self.seed, camera)
            for camera in (0, 1)
        ]
        return RealPictures(look, options.optics, options.light, chips, self.seed, options.projector_size[0])

    def _look(self) -> StillView:
        if self._still is None:
            self._still = still_view(self._renderer, self.rig, self._views)
        return self._still


def step_of(pattern: FringePattern | None, step: int) -> int:
    """Which of a pattern's steps an exposure shows; 0 where the projector is off."""
    return step % pattern.step_count if pattern else 0
