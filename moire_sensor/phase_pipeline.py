"""The pipeline: images to phase, phase to fringe order, order to depth, for single shots and for shifted fringes."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from moire_sensor.depth_accord import FOREIGN_RAD, agreeing
from moire_sensor.depth_border import extend
from moire_sensor.depth_bridge import bridge
from moire_sensor.depth_check import drop_rivals
from moire_sensor.depth_confidence import confidence_of
from moire_sensor.depth_grey import approach_greys, check_greys, match_greys, measures_by_stereo, right_as_left
from moire_sensor.depth_hidden import drop_hidden
from moire_sensor.depth_phantom import drop_phantoms
from moire_sensor.depth_refine import Match, fringe_orders, refine
from moire_sensor.depth_ridge import sharpen
from moire_sensor.depth_rim import close_rims
from moire_sensor.depth_rows import Seen, all_rows
from moire_sensor.depth_seek import seek
from moire_sensor.depth_shot import drop_out_of_range, results
from moire_sensor.depth_specks import drop_slivers, drop_specks
from moire_sensor.depth_surface import along_surface
from moire_sensor.depth_views import orders_fail, patch_mismatch_rad
from moire_sensor.order_range import OrderRange
from moire_sensor.order_solver import OrderSolver
from moire_sensor.pattern import FringePattern
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage, solved_rows
from moire_sensor.phase_single import phase_from_single
from moire_sensor.phase_steps import StepFilter, phase_from_steps
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import StereoRig
from moire_sensor.scratch import scratch
from moire_sensor.settings import Settings
from moire_sensor.shot import Shot, Status

# Mismatch that shading, or motion between the steps, can put between the two phases of one point.
SHADING_SINGLE_RAD, SHADING_STEPS_RAD = 0.6, 0.3
# Lets the projector steady the start of a match by grey levels where shading moves the phases.
START_ALIGNMENT_PX = 0.15
# Runs shorter than this are accidents; from one window of a period, those shorter than this share of it.
SLIVER_PX, SLIVER_PERIODS = 3, 0.25
# Where the projector measures, the alignment of the pair matters less: the real hand has patches 0.22 rad off.
PROJECTOR_SLACK = 1.7
# A confidence below every limit.
NOT_BELIEVED = np.float32(-1.0)


@dataclass(frozen=True)
class Way:
    """How phases become depth, which differs between a single shot and phase steps.

    Attributes
    ----------
    single : whether one exposure gave the phases.
    shading_rad : mismatch that shading or motion can put between the two phases of one point.
    settings, max_mismatch_rad : of the least squares; the largest mismatch of a pixel that gets a disparity.
    least_run_px : shorter runs along a row are accidents.
    row_step : one row in so many is solved, those between continue the surfaces above and below.
    """

    single: bool
    shading_rad: float
    settings: Settings
    max_mismatch_rad: float
    least_run_px: int
    row_step: int


class PhasePipeline:
    """Depth for every pixel, from the phase of one exposure or of several shifted ones.

    Parameters
    ----------
    rig, pattern, depth_range_m, settings : as for :class:`moire_sensor.Reconstructor`.
    """

    def __init__(
        self, rig: StereoRig, pattern: FringePattern, depth_range_m: tuple[float, float], settings: Settings
    ) -> None:
        self.rig = rig
        self.pattern = pattern
        self.depth_range_m = depth_range_m
        self.settings = settings
        self._projector = ProjectorMap.build(rig, pattern)
        disparities = (float(rig.disparity_px(depth_range_m[1])), float(rig.disparity_px(depth_range_m[0])))
        middle = 0.5 * (disparities[0] + disparities[1])
        self._carriers = (
            Carrier.left(self._projector, rig.image_size, middle, settings.half_height_px),
            Carrier.right(self._projector, rig.image_size, middle, settings.half_height_px),
        )
        self._rad_per_px = float(np.median(np.abs(self._carriers[0].rad_per_px)))
        self._by_stereo = measures_by_stereo(self._carriers[0], self._projector)
        self._single, self._steps = self._ways()
        self._orders = OrderRange.build(self._projector, self._carriers[0], disparities)
        self._solver = OrderSolver(self._carriers, self._projector, self._orders, settings.jump_cost)

    def _ways(self) -> tuple[Way, Way]:
        """The ways of a single shot and of phase steps."""
        settings = self.settings
        # What goes wrong beside an edge between solved rows is mostly mended there (depth_border), but not where the
        # projector measures. Phase steps see single rows.
        row_step = min(settings.row_step, 2 * settings.half_height_px + 1)
        least_px = int(SLIVER_PERIODS * (2 * self._carriers[0].half_width_px))
        if not self._by_stereo:
            usual = settings, settings.max_mismatch_rad
            return (
                Way(True, SHADING_SINGLE_RAD, *usual, least_px, 1),
                Way(False, SHADING_STEPS_RAD, *usual, SLIVER_PX, 1),
            )
        # Where the pair measures, its misalignment cannot be told from depth; a single shot only starts from there.
        starting = replace(settings, alignment_px=min(settings.alignment_px, START_ALIGNMENT_PX))
        strict = replace(settings, alignment_px=0.0), settings.max_mismatch_steps_rad
        return (
            Way(True, SHADING_SINGLE_RAD, starting, settings.max_mismatch_rad, least_px, row_step),
            Way(False, SHADING_STEPS_RAD, *strict, SLIVER_PX, 1),
        )

    @property
    def window_px(self) -> int:
        """Columns of a single shot's window, a fringe period."""
        return 2 * self._carriers[0].half_width_px + 1

    def _buffers(self, *planes: int, name: str = "phases", row_step: int = 1) -> Float32:
        """Memory for images of one row in so many, (*planes, n, W)."""
        height, width = self._carriers[0].cos.shape
        shape = (*planes, solved_rows(height, row_step)[1], width)
        return scratch((name, shape), lambda: np.empty(shape, dtype=np.float32))

    def example(self, frame_count: int) -> npt.NDArray[np.uint8]:
        """Fringe images (n, H, W) that both cameras could see, to warm up the kernels."""
        cos = self._carriers[0].cos
        return np.broadcast_to((128.0 + 100.0 * cos).astype(np.uint8), (frame_count, *cos.shape))

    def from_single(self, left: Float32, right: Float32, first_step: int) -> Shot:
        """Depth of one exposure: images (H, W) float32, grey levels of 255."""
        step_rad = self.pattern.step_phases_rad[first_step % self.pattern.step_count]
        row_step = self._single.row_step
        buffers = self._buffers(2, 3, row_step=row_step)
        phases = (
            phase_from_single(left, self._carriers[0], step_rad, self.settings, buffers[0], row_step),
            phase_from_single(right, self._carriers[1], step_rad, self.settings, buffers[1], row_step),
        )
        return self._depth(phases, (left, right), self._single)

    def from_steps(self, left: Float32, right: Float32, first_step: int) -> Shot:
        """Depth of shifted exposures at the middle of their time: images (n, H, W) float32, grey levels of 255."""
        steps = StepFilter.build(self.pattern.step_phases_rad, first_step, left.shape[0])
        buffers = self._buffers(2, 6)
        phases = (
            phase_from_steps(left, self._carriers[0], steps, self.settings, buffers[0]),
            phase_from_steps(right, self._carriers[1], steps, self.settings, buffers[1]),
        )
        middle = left.shape[0] // 2
        return self._depth(phases, (left[middle], right[middle]), self._steps)

    def _depth(self, phases: tuple[PhaseImage, PhaseImage], greys: tuple[Float32, Float32], way: Way) -> Shot:
        """Choose the orders, let those that are refused give way to the next best, measure, and mend the borders."""
        label, margin = self._solver.solve(phases, greys, way.shading_rad)
        match = self._refine(label, phases, way)
        greys = (greys[0], right_as_left(greys[1], match.disparity_px, phases))
        drop_rivals(match.disparity_px, match.mismatch_rad, phases[0].amplitude, greys, phases[0].rows)
        match = self._refine(self._solver.second(label, match.disparity_px), phases, way, match)
        if way.single and self._by_stereo:
            match = approach_greys(match, greys, phases[0], self._carriers[0].half_width_px, self.settings)
        match, margin, seen = all_rows(match, margin, phases[0], self._buffers(6, name="all rows"))
        match = self._by_greys(match, seen, greys, way.single)
        drop_rivals(match.disparity_px, match.mismatch_rad, seen.amplitude, greys, np.arange(len(seen.amplitude)))
        if self._by_stereo:
            drop_slivers(match.disparity_px, way.least_run_px)
        drop_specks(match.disparity_px, self.settings.min_segment_px)
        if self._by_stereo:
            drop_phantoms(match, greys, seen.amplitude, self._projector, self.settings)
            half_width = self._carriers[0].half_width_px
            if way.single and seek(match, greys, seen, self._projector, self._orders, half_width, self.settings):
                # What was found may show that a strip beside it is a phantom.
                drop_phantoms(match, greys, seen.amplitude, self._projector, self.settings)
            extend(match, greys, seen, self._projector, self._rad_per_px, self.settings, way.row_step)
            sharpen(match, greys, seen.amplitude)
            bridge(match, greys, seen.amplitude, self._rad_per_px, self.settings)
            close_rims(match, greys[0], seen, self._projector, self.settings)
            drop_hidden(match.disparity_px)
            if way.single:
                drop_slivers(match.disparity_px, SLIVER_PX)
        return self._shot(phases, seen, match, margin)

    def _refine(
        self,
        label: npt.NDArray[np.int8],
        phases: tuple[PhaseImage, PhaseImage],
        way: Way,
        match: Match | None = None,
    ) -> Match:
        """Disparities of the chosen orders from the phases of all views, NaN where the phases disagree."""
        return refine(
            label, phases, self._carriers, self._projector, self._orders, way.settings, way.max_mismatch_rad, match,
            self._buffers(4, name="match", row_step=phases[0].row_step),
        )  # fmt: skip

    def _by_greys(self, match: Match, seen: Seen, greys: tuple[Float32, Float32], single: bool) -> Match:
        """Disparities of a single shot measured, those of phase steps checked, by the grey levels of both views.

        Where the projector measures, the views of the pair are too alike in place to tell anything new.
        """
        if not self._by_stereo:
            return match
        if single:
            half_width = self._carriers[0].half_width_px
            return match_greys(match, greys, seen.amplitude, half_width, self.settings)
        check_greys(match, greys, seen.amplitude, self.settings)
        return averaged(match, self.settings.half_mean_steps_px)

    def _shot(self, phases: tuple[PhaseImage, PhaseImage], seen: Seen, match: Match, margin: Float32) -> Shot:
        """The result: depth where there is a disparity in the range and the views agree."""
        drop_out_of_range(match.disparity_px, self.rig, self.depth_range_m)
        typical_rad, worst_rad = patch_mismatch_rad(match.signed_mismatch_rad, match.disparity_px)
        # Where the projector measures, alignment matters less.
        slack = 1.0 if self._by_stereo else PROJECTOR_SLACK
        views_fit = not typical_rad > slack * self.settings.max_typical_mismatch_rad
        believed = match if views_fit and not worst_rad > FOREIGN_RAD else agreeing(match, views_fit)
        if orders_fail(believed, phases, self._carriers, self._projector, self._orders):
            views_fit = False
            match.disparity_px.fill(np.nan)
        confidence = confidence_of(match.disparity_px, match, margin)
        if believed is not match:
            confidence[np.isnan(believed.disparity_px)] = NOT_BELIEVED
        depth, sigma, disparity, status = results(
            (match.disparity_px, match.sigma_px, confidence),
            seen.status,
            self.rig,
            self.settings.min_confidence,
            Status.OCCLUDED if views_fit else Status.AMBIGUOUS,
        )
        return Shot(
            depth_m=depth,
            depth_sigma_m=sigma,
            disparity_px=disparity,
            fringe_order=fringe_orders(disparity, self._projector),
            confidence=confidence,
            status=status,
            background=seen.background,
            typical_mismatch_rad=typical_rad,
        )


def averaged(match: Match, half_px: int) -> Match:
    """Disparities averaged over 2 n + 1 rows and columns of their own surface; as given for n = 0."""
    if half_px == 0:
        return match
    mean = along_surface(match.disparity_px, half_px, half_px)
    return replace(match, disparity_px=mean, sigma_px=match.sigma_px / np.float32(2 * half_px + 1))
