"""The paper's method: depth at the fringe edges of one exposure (sections 3.1 to 3.4)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.edge_candidates import CandidateRays, Candidates, period_px
from moire_sensor.edge_cost import Rules, matching_rules
from moire_sensor.edge_find import EdgeRows, bright_share, find_edges, room_for_edges
from moire_sensor.edge_grid import Grid, Limits, upper_quartile
from moire_sensor.edge_input import Image, check_image, check_numbers
from moire_sensor.edge_lanes import LANES
from moire_sensor.edge_light import Sums, room_for_light, window_px
from moire_sensor.edge_match import EdgeMatch, Tables, room_for_matches, room_for_work
from moire_sensor.edge_place import BINS
from moire_sensor.edge_points import EdgePoints, measure
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.edge_solve import solve_image
from moire_sensor.pattern import FringePattern
from moire_sensor.plain_image import Grey, as_plain
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import StereoRig
from moire_sensor.scratch import scratch
from moire_sensor.shot import Shot


@dataclass(frozen=True, eq=False)
class EdgeShot:
    """The exact ``points`` and the ``shot``, which holds each at the left pixel nearest to it and NaN elsewhere."""

    points: EdgePoints
    shot: Shot


@dataclass(frozen=True, eq=False)
class EdgeRoom:
    """Work memory of one frame."""

    left: EdgeRows
    right: EdgeRows
    candidates: Candidates
    match: EdgeMatch
    tables: Tables
    levels: Grey
    sums: Sums

    @classmethod
    def of(
        cls, image_size: tuple[int, int], dtype: npt.DTypeLike, rays: CandidateRays, rules: Rules, window_px: int
    ) -> EdgeRoom:
        """Memory for images (width, height) of a type."""
        left, right = (room_for_edges(image_size[::-1]) for _ in range(2))
        tables = room_for_work(left.x_px.shape[1], rays.number, rules.same_side_px, image_size[0])
        light = room_for_light(dtype, image_size[0], window_px)
        return cls(left, right, rays.room(right), room_for_matches(left), tables, *light)


class FringeEdges:
    """The paper's method for one rig and pattern.

    Parameters
    ----------
    depth_range_m : nearest and farthest depth that can occur, metres.
    saturation_level : grey level of a saturated pixel.

    Raises
    ------
    SettingsError
        A depth range that is empty or not positive, or a saturation level that is not.
    """

    def __init__(
        self,
        rig: StereoRig,
        pattern: FringePattern,
        depth_range_m: tuple[float, float],
        settings: EdgeSettings | None = None,
        saturation_level: float = 255.0,
    ) -> None:
        nearest, farthest = check_numbers(depth_range_m, saturation_level)
        self.rig = rig
        self.pattern = pattern
        self.settings = settings or EdgeSettings()
        self._saturation_level = saturation_level
        projector = ProjectorMap.build(rig, pattern)
        disparities = (float(rig.disparity_px(farthest)), float(rig.disparity_px(nearest)))
        self._period_px = period_px(projector, *rig.image_size, 0.5 * sum(disparities))
        self._rays = CandidateRays.build(projector, disparities, rig.image_size)
        self.rules = matching_rules(disparities, self._period_px, self.settings)
        scale, off_px = 255.0 / saturation_level, self.settings.same_side_periods * self._period_px
        unlit_below, min_run = 2.0 * self.settings.min_amplitude / scale, int(self.settings.min_run)
        window = window_px(self._period_px)
        self._limits = Limits(self._period_px, off_px, scale, saturation_level, unlit_below, window, min_run)

    def measure(self, left: Image, right: Image, first_step: int = 0) -> EdgeShot:
        """Measure depth at the fringe edges of one exposure; see :func:`fringe_edges`."""
        shot, room, step_rad = self._solve(left, right, first_step)
        points = measure(self.rig, room.left, room.right, room.candidates, room.match, step_rad)
        return EdgeShot(points, shot)

    def reconstruct(self, left: Image, right: Image, first_step: int = 0) -> Shot:
        """The shot of :meth:`measure` alone, which takes less time."""
        return self._solve(left, right, first_step)[0]

    def _solve(self, left: Image, right: Image, first_step: int) -> tuple[Shot, EdgeRoom, float]:
        """The shot, what led to it, and the phase added to the pattern."""
        for name, image in (("left", left), ("right", right)):
            check_image(name, image, self.rig)
        left, right = as_plain(left), as_plain(right)
        key = ("edges", self.rig.image_size, self._rays.number, self.rules.same_side_px, left.dtype)
        room = scratch(key, lambda: self.room(left.dtype))
        step_rad = self.pattern.step_phases_rad[first_step % self.pattern.step_count]
        self.find((left, right), room)
        return self.solve(left, step_rad, room), room, step_rad

    def find(self, images: tuple[Image, Image], room: EdgeRoom) -> None:
        """Find the edges of both images (section 3.3)."""
        scale = 255.0 / self._saturation_level
        find_edges(images, self.settings, scale, (room.left, room.right))

    def solve(self, left: Image, step_rad: float, room: EdgeRoom) -> Shot:
        """Points from the edges: candidates, correspondences (section 3.4), depth (equation 9) on the left pixels."""
        rays, lens = self._rays, (self.rig.fx_px * self.rig.baseline_m, self.rig.disparity_at_infinity_px)
        up_rad = rays.up_rad(bright_share((room.left, room.right)))
        grid, counts = Grid.of(left), np.zeros((LANES, BINS + 1), dtype=np.int64)
        solve_image(
            room.left, room.right, rays.projector, rays.ends, up_rad, step_rad, room.candidates, self.rules,
            *room.tables, room.match, left, self._limits, lens, step_rad / (2.0 * np.pi), room.levels, room.sums, grid,
            counts,
        )  # fmt: skip
        off_rad = 2.0 * np.pi / self._limits.period_px * self._limits.off_px
        return Shot(*grid, typical_mismatch_rad=off_rad * upper_quartile(counts))

    def room(self, dtype: npt.DTypeLike) -> EdgeRoom:
        """Return work memory of its own, to be kept between ``find`` and ``solve``, for images of a type."""
        return EdgeRoom.of(self.rig.image_size, dtype, self._rays, self.rules, self._limits.window_px)


def fringe_edges(
    left: Image,
    right: Image,
    rig: StereoRig,
    pattern: FringePattern,
    depth_range_m: tuple[float, float],
    settings: EdgeSettings | None = None,
    *,
    first_step: int = 0,
    saturation_level: float = 255.0,
) -> EdgeShot:
    """Measure depth at the fringe edges, as the paper does.

    Parameters
    ----------
    left, right : uint8 or uint16 (H, W), one exposure.
    depth_range_m : nearest and farthest depth that can occur, metres.
    first_step : step of the pattern that the exposure carries.
    saturation_level : grey level of a saturated pixel.

    Returns
    -------
    EdgeShot
        Its ``shot.confidence`` falls from 1 to 0 as the mismatch grows to the tolerance of the same-side test.
        ``shot.status`` is OK at points, UNLIT where there is no fringe, SATURATED, OCCLUDED at edges without a match,
        and AMBIGUOUS between edges and at edges that two fringe orders match.

    Raises
    ------
    ImageError
        Images of another shape or type.
    SettingsError
        A depth range that is empty or not positive, or a saturation level that is not.
    """
    return FringeEdges(rig, pattern, depth_range_m, settings, saturation_level).measure(left, right, first_step)
