"""The paper's method: depth at the fringe edges of one exposure (sections 3.1 to 3.4)."""

from __future__ import annotations

from dataclasses import dataclass

from moire_sensor.edge_candidates import find_candidates, period_px
from moire_sensor.edge_find import bright_share, find_edges
from moire_sensor.edge_grid import on_left_grid
from moire_sensor.edge_input import Image, as_grey, check_numbers
from moire_sensor.edge_match import match_edges, matching_rules
from moire_sensor.edge_points import EdgePoints, measure
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.edge_spread import in_company, spread_rows
from moire_sensor.pattern import FringePattern
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.rig import StereoRig
from moire_sensor.shot import Shot


@dataclass(frozen=True, eq=False)
class EdgeShot:
    """The exact ``points`` and the ``shot``, which holds each at the left pixel nearest to it and NaN elsewhere."""

    points: EdgePoints
    shot: Shot


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
        ``shot.status`` is OK at points, UNLIT where there is no fringe, SATURATED, OCCLUDED at edges without a match
        and AMBIGUOUS between edges.

    Raises
    ------
    ImageError
        Images of another shape or type.
    SettingsError
        A depth range that is empty or not positive, or a saturation level that is not.
    """
    settings = settings or EdgeSettings()
    nearest, farthest = check_numbers(depth_range_m, saturation_level)
    pictures = [as_grey(name, image, rig, saturation_level) for name, image in (("left", left), ("right", right))]
    projector = ProjectorMap.build(rig, pattern)
    step_rad = pattern.step_phases_rad[first_step % pattern.step_count]
    disparities = (float(rig.disparity_px(farthest)), float(rig.disparity_px(nearest)))

    edges_l, edges_r = (find_edges(picture, settings) for picture in pictures)
    bright = bright_share((edges_l, edges_r))
    candidates = find_candidates(edges_r, projector, disparities, rig.image_size[0], step_rad, bright)
    period = period_px(projector, rig, 0.5 * sum(disparities))
    rules = matching_rules(disparities, period, settings)
    match = match_edges(edges_l, edges_r, candidates, rules, settings.rows)
    match = spread_rows(match, edges_l, edges_r, candidates, rules, settings)
    keep = in_company(match, candidates, settings.min_run)

    points = measure(rig, edges_l, edges_r, candidates, match, keep, step_rad)
    return EdgeShot(points, on_left_grid(points, pictures[0], edges_l, period, settings))
