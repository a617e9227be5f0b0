"""The pipeline: images to phase, phase to fringe order, order to depth."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from moire_sensor.depth_check import drop_misfits, is_unique, without_specks
from moire_sensor.depth_confidence import confidence_of
from moire_sensor.depth_patch import measures_by_stereo, rematch, right_as_left
from moire_sensor.depth_refine import Match, fringe_orders, refine
from moire_sensor.depth_views import orders_fail, typical_mismatch_rad
from moire_sensor.errors import ImageError, SettingsError
from moire_sensor.order_cost import OrderRange, order_costs
from moire_sensor.order_path import best_orders, next_orders, path_costs
from moire_sensor.pattern import FringePattern
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.phase_single import phase_from_single
from moire_sensor.phase_steps import StepFilter, phase_from_steps
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import StereoRig
from moire_sensor.settings import Settings
from moire_sensor.shot import Shot, Status

METHODS = ("dense", "phase_shift")
# Mismatch that shading, or motion between the steps, can put between the two phases of one point.
SHADING_RAD = {"dense": 0.6, "phase_shift": 0.3}
RANGE_MARGIN = 0.02
# Where the projector measures, the alignment of the pair matters less: the real hand has patches 0.22 rad off.
PROJECTOR_SLACK = 1.7
DEFAULT_DEPTH_RANGE_M = (0.5, 2.0)
Images = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


class Reconstructor:
    """Depth from fringe images of one rig and pattern.

    Parameters
    ----------
    rig : the rectified pair and its projector.
    pattern : the projected fringes.
    depth_range_m : nearest and farthest depth that can occur, metres; the fewer periods in it, the surer the order.
    method : ``"dense"`` (one exposure) or ``"phase_shift"`` (N >= 3 exposures).
    saturation_level : grey level of a saturated pixel, 255 for 8 bit, e.g. 4095 for 12 bit in uint16.
    settings : tuning; the defaults serve all rigs.

    Raises
    ------
    SettingsError
        An unknown method, a depth range that is empty or not positive, or fringes too fine or too coarse for the
        images.
    PatternError
        Fewer than three steps for ``"phase_shift"``.
    """

    def __init__(
        self,
        rig: StereoRig,
        pattern: FringePattern,
        depth_range_m: tuple[float, float] = DEFAULT_DEPTH_RANGE_M,
        method: str = "dense",
        saturation_level: float = 255.0,
        settings: Settings | None = None,
    ) -> None:
        check_choices(depth_range_m, method, saturation_level)
        self.rig = rig
        self.pattern = pattern
        self.depth_range_m = (float(depth_range_m[0]), float(depth_range_m[1]))
        self.method = method
        self.settings = settings or Settings()
        self._scale = np.float32(255.0 / saturation_level)
        self._projector = ProjectorMap.build(rig, pattern)
        disparities = (float(rig.disparity_px(depth_range_m[1])), float(rig.disparity_px(depth_range_m[0])))
        middle = 0.5 * (disparities[0] + disparities[1])
        rows = self.settings.half_height_px
        self._carriers = (
            Carrier.left(self._projector, rig.image_size, middle, rows),
            Carrier.right(self._projector, rig.image_size, middle, rows),
        )
        self._orders = OrderRange.build(self._projector, self._carriers[0], disparities)
        if method == "phase_shift":
            StepFilter.build(pattern.step_phases_rad, 0, self.frames_needed)

    @property
    def frames_needed(self) -> int:
        """Frames of one result: 1, or for N steps N + 1 made odd, so that a frame lies in the middle."""
        steps = self.pattern.step_count
        return 1 if self.method == "dense" else steps + 1 + steps % 2

    def warm_up(self) -> None:
        """Compile or load every kernel, so that the first real frame is as fast as the rest."""
        width, height = self.rig.image_size
        columns = np.broadcast_to(self._carriers[0].cos, (self.frames_needed, height, width))
        images = (128.0 + 100.0 * columns).astype(np.uint8)
        images = images[0] if self.method == "dense" else images
        self.reconstruct(images, images)

    def reconstruct(self, left: Images, right: Images, first_step: int = 0) -> Shot:
        """Reconstruct the depth that the left camera sees.

        Parameters
        ----------
        left, right : uint8 or uint16, (H, W) for ``"dense"``, (n, H, W) with n >= steps for ``"phase_shift"``.
        first_step : step of the pattern that the first frame carries; frame i carries (first_step + i) mod steps.

        Raises
        ------
        ImageError
            Images of another shape, type or number.
        """
        images = [self._checked(name, image) for name, image in (("left", left), ("right", right))]
        if images[0].shape != images[1].shape:
            raise ImageError(f"{len(left)} left frames came with {len(right)} right ones; give as many of each")
        phases = self._measure_phases(images, first_step)
        middle = images[0].shape[0] // 2
        greys = (images[0][middle], images[1][middle])
        shading_rad = SHADING_RAD[self.method]
        cost = order_costs(*phases, greys, self._carriers, self._projector, self._orders, shading_rad)
        total = path_costs(cost, phases[0].offset_rad, self.settings.jump_cost)
        label, margin = best_orders(total, phases[0].offset_rad)
        first = self._refine(label, phases)
        greys = (greys[0], right_as_left(greys[1], first.disparity_px, phases))
        match = self._rematch(first, phases, greys)
        refused = self._refused(label, match, phases, greys)
        second = self._refine(next_orders(total, label, refused), phases)
        match = merged(match, self._rematch(second, phases, greys), refused)
        keep = ~self._refused(label, match, phases, greys)
        return self._shot(phases, match, margin, keep)

    def _refine(self, label: npt.NDArray[np.int8], phases: tuple[PhaseImage, PhaseImage]) -> Match:
        """Disparities of the chosen orders from the phases of all views."""
        return refine(label, phases, self._carriers, self._projector, self._orders, self.settings)

    def _rematch(
        self, match: Match, phases: tuple[PhaseImage, PhaseImage], greys: tuple[Float32, Float32]
    ) -> Match:
        """Doubtful disparities matched by grey levels; NaN where phases or grey levels do not fit."""
        if measures_by_stereo(self._carriers[0], self._projector):
            rematch(match, greys, phases[0].amplitude, self._carriers[0], self.settings)
        drop_misfits(match, self.settings.max_mismatch_rad)
        return match

    def _refused(
        self,
        label: npt.NDArray[np.int8],
        match: Match,
        phases: tuple[PhaseImage, PhaseImage],
        greys: tuple[Float32, Float32],
    ) -> npt.NDArray[np.bool_]:
        """Pixels with a phase whose order cannot stay: no match, its right pixel taken, or a speck."""
        unique = is_unique(match.disparity_px, match.mismatch_rad, phases[0].amplitude, greys)
        disparity = np.where(unique, match.disparity_px, np.float32(np.nan))
        return (label >= 0) & ~np.isfinite(without_specks(disparity, self.settings.min_segment_px))

    def _checked(self, name: str, image: Images) -> Float32:
        """Images as float32 (n, H, W), grey levels scaled to 255 at saturation."""
        width, height = self.rig.image_size
        single = self.method == "dense"
        allowed = f"({height}, {width})" if single else f"(n, {height}, {width}) with n >= {self.pattern.step_count}"
        array = np.asarray(image)
        frames = array[None] if single else array
        if frames.ndim != 3 or frames.shape[1:] != (height, width) or frames.shape[0] < self._fewest_frames:
            raise ImageError(f"the {name} images have shape {array.shape}; method {self.method!r} needs {allowed}")
        if array.dtype not in (np.uint8, np.uint16):
            raise ImageError(f"the {name} images are {array.dtype}; give uint8 or uint16 grey levels")
        return frames.astype(np.float32) * self._scale

    @property
    def _fewest_frames(self) -> int:
        return 1 if self.method == "dense" else self.pattern.step_count

    def _measure_phases(self, images: list[Float32], first_step: int) -> tuple[PhaseImage, PhaseImage]:
        steps_rad = self.pattern.step_phases_rad
        if self.method == "dense":
            step_rad = steps_rad[first_step % len(steps_rad)]
            left, right = (
                phase_from_single(image[0], carrier, step_rad, self.settings)
                for image, carrier in zip(images, self._carriers, strict=True)
            )
        else:
            steps = StepFilter.build(steps_rad, first_step, images[0].shape[0])
            left, right = (
                phase_from_steps(frames, carrier, steps, self.settings)
                for frames, carrier in zip(images, self._carriers, strict=True)
            )
        return left, right

    def _views_agree(
        self,
        phases: tuple[PhaseImage, PhaseImage],
        match: Match,
        keep: npt.NDArray[np.bool_],
        typical_rad: float,
    ) -> bool:
        """Whether rig, pattern and images fit each other; where the projector measures, alignment matters less."""
        by_stereo = measures_by_stereo(self._carriers[0], self._projector)
        limit = self.settings.max_typical_mismatch_rad * (1.0 if by_stereo else PROJECTOR_SLACK)
        if typical_rad > limit:
            return False
        return not orders_fail(match, keep, phases, self._carriers, self._projector, self._orders)

    def _shot(
        self, phases: tuple[PhaseImage, PhaseImage], match: Match, margin: Float32, keep: npt.NDArray[np.bool_]
    ) -> Shot:
        """The result: depth where the disparity is kept, lies in the range and the views as a whole agree."""
        depth = self.rig.depth_m(match.disparity_px)
        nearest, farthest = self.depth_range_m
        keep = keep & (depth >= nearest * (1.0 - RANGE_MARGIN)) & (depth <= farthest * (1.0 + RANGE_MARGIN))
        typical_rad = typical_mismatch_rad(match, keep)
        views_agree = self._views_agree(phases, match, keep, typical_rad)
        lost = Status.OCCLUDED if views_agree else Status.AMBIGUOUS
        keep &= views_agree
        depth[~keep] = np.nan
        disparity = np.where(keep, match.disparity_px, np.float32(np.nan))
        sigma = depth**2 / (self.rig.fx_px * self.rig.baseline_m) * match.sigma_px
        status = phases[0].status.copy()
        status[(status == Status.OK) & ~keep] = lost
        return Shot(
            depth_m=depth.astype(np.float32),
            depth_sigma_m=sigma.astype(np.float32),
            disparity_px=disparity,
            fringe_order=fringe_orders(disparity, self._projector),
            confidence=confidence_of(disparity, match, margin),
            status=status,
            background=phases[0].background,
            typical_mismatch_rad=typical_rad,
        )


def merged(first: Match, second: Match, where_second: npt.NDArray[np.bool_]) -> Match:
    """Take the second match at the pixels told."""
    return Match.of(
        np.where(where_second, second.disparity_px, first.disparity_px),
        np.where(where_second, second.sigma_px, first.sigma_px),
        np.where(where_second, second.signed_mismatch_rad, first.signed_mismatch_rad),
    )


def check_choices(depth_range_m: tuple[float, float], method: str, saturation_level: float) -> None:
    """Raise SettingsError for a choice that cannot work."""
    if method not in METHODS:
        raise SettingsError(f"method is {method!r}; it must be one of {', '.join(METHODS)}")
    nearest, farthest = depth_range_m
    if not (np.isfinite(farthest) and 0.0 < nearest < farthest):
        raise SettingsError(f"depth_range_m is {depth_range_m}; give (nearest, farthest) with 0 < nearest < farthest")
    if not (np.isfinite(saturation_level) and 1.0 <= saturation_level <= 65535.0):
        raise SettingsError(f"saturation_level is {saturation_level}; allowed is 1 to 65535 grey levels")
