"""Single-shot depth against exact truth, per scene and condition.

Limits are those of the method's aims at amplitude 70 and noise 1.5 (median 0.09 mm scaled to 1 m: the noise floor of a
single shot over 3.3 rows). Where a line says so, it is not at its aim, and the limit is what it reaches, plus a tenth.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest
from dense_rigs import (
    Float32,
    capture,
    dense_shot,
    negative_rig,
    outside_rig,
    scaled_rig,
    sensor,
)

from moire_sensor import Reconstructor, Settings, Shot, Status, StereoRig
from moire_sensor.paper_rig import paper_pattern
from moire_sim.analytic_scenes import analytic_capture, analytic_scene_names
from moire_sim.capture import HeadCapture
from moire_sim.score import near_edges, score
from tools.bench.confidence import error_by_sigma, trust_counts


@dataclass(frozen=True)
class Limits:
    """Aims; shares 0 to 1, the median in millimetres scaled to 1 m, away from edges."""

    completeness: float = 0.98
    outliers: float = 0.005
    outliers_away: float = 0.0002
    median_mm: float = 0.09
    ghosts: float = 0.005


LIMITS = {
    # The aim for poles.
    "thin_poles": Limits(completeness=0.93, outliers=0.02),
}
# What a condition may cost, as factors on (share without depth, outliers, median): three times by the aims.
CONDITIONS: dict[str, tuple[dict[str, float], float]] = {
    "noise_4": ({"noise": 4.0}, 3.0),
    "blur_1.6": ({"blur_px": 1.6}, 3.0),
    "amplitude_20": ({"amplitude": 20.0}, 3.5),
    "gamma_2.2": ({"gamma": 2.2}, 3.0),
}


def check(shot: Shot, seen: HeadCapture, limits: Limits, factor: float = 1.0) -> None:
    found = score(shot, seen)
    assert found.completeness >= 1.0 - factor * (1.0 - limits.completeness)
    assert found.outlier_share <= factor * limits.outliers
    assert found.outlier_share_away <= factor * limits.outliers_away
    assert found.median_error_mm_away <= factor * limits.median_mm
    assert found.ghost_share <= limits.ghosts * factor


@pytest.mark.parametrize("name", analytic_scene_names())
def test_every_scene(name: str) -> None:
    check(dense_shot(name), capture(name), LIMITS.get(name, Limits()))


def test_every_third_row_solved_is_as_good_on_stairs() -> None:
    seen = capture("stairs")
    shot = Reconstructor(seen.rig, seen.pattern, settings=Settings(row_step=3)).reconstruct(seen.left, seen.right)
    check(shot, seen, Limits())


@pytest.mark.parametrize("condition", CONDITIONS)
@pytest.mark.parametrize("name", ["plane_1000", "tilt_0.5", "small_plate"])
def test_conditions(name: str, condition: str) -> None:
    options, factor = CONDITIONS[condition]
    check(dense_shot(name, **options), capture(name, **options), LIMITS.get(name, Limits()), factor)


@pytest.mark.parametrize("name", ["plane_1000", "small_plate"])
def test_square_fringes(name: str) -> None:
    check(dense_shot(name, waveform="square"), capture(name, waveform="square"), LIMITS.get(name, Limits()), 3.0)


@pytest.mark.parametrize("name", ["plane_600", "small_plate", "cylinder_and_box"])
def test_texture(name: str) -> None:
    check(dense_shot(name, texture=0.3), capture(name, texture=0.3), Limits(), 3.0)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        *((name, {}) for name in ("plane_600", "plane_1000", "plane_1500", "tilt_0.5", "tilt_rows_0.5")),
        *((name, options) for name in ("plane_1000", "tilt_0.5") for options in ({"noise": 4.0}, {"amplitude": 20.0})),
    ],
)
def test_sigma_is_the_error_on_planes(name: str, options: dict[str, float]) -> None:
    assert error_by_sigma(dense_shot(name, **options), capture(name, **options)) == pytest.approx(1.0, abs=0.2)


def test_sigma_knows_texture_and_sharp_fringes() -> None:
    """Their errors are no noise; without their share, sigma was 1.7 to 2 times too small."""
    textured = error_by_sigma(dense_shot("stairs", texture=0.3), capture("stairs", texture=0.3))
    square = error_by_sigma(dense_shot("stairs", waveform="square"), capture("stairs", waveform="square"))
    assert (textured, square) == pytest.approx((1.0, 1.0), abs=0.2)


def test_confidence_is_calibrated() -> None:
    """At most 0.05 % of the confident pixels are off, on the poles alone, too; 90 % of the right ones are confident."""
    counts = {name: trust_counts(dense_shot(name), capture(name)) for name in analytic_scene_names()}
    for sure, off, _, _ in (counts["thin_poles"], np.sum(list(counts.values()), axis=0)):
        assert off <= 0.0005 * sure
    assert all(sure >= 0.9 * right for _, _, right, sure in counts.values())
    assert all((dense_shot(name).confidence[np.isnan(dense_shot(name).depth_m)] == 0.0).all() for name in counts)


def test_depths_of_little_confidence_are_left_unknown() -> None:
    """They are told apart from what one camera does not see, and all others stay as they are."""
    seen = capture("stairs")
    rig, pattern, pair = seen.rig, seen.pattern, (seen.left, seen.right)
    everything, sure = (
        Reconstructor(rig, pattern, settings=Settings(min_confidence=least)).reconstruct(*pair) for least in (0.0, 0.5)
    )
    doubtful = np.isfinite(everything.depth_m) & (everything.confidence < np.float32(0.5))
    assert doubtful.sum() > 1000
    assert (sure.status[doubtful] == Status.AMBIGUOUS).all()
    np.testing.assert_array_equal(sure.depth_m, np.where(doubtful, np.float32(np.nan), everything.depth_m))
    np.testing.assert_array_equal(sure.confidence, np.where(doubtful, np.float32(0.0), everything.confidence))
    np.testing.assert_array_equal(everything.status == Status.OK, np.isfinite(everything.depth_m))


def test_orders_are_those_of_the_points() -> None:
    for name in ("plane_1000", "tilt_0.5", "small_plate"):
        shot, seen = dense_shot(name), capture(name)
        columns = seen.rig.projector_pixels(seen.rig.points(seen.depth_m))[..., 0]
        known = np.isfinite(shot.depth_m) & ~near_edges(seen) & seen.covisible
        part = columns / seen.pattern.period_px + 0.5
        # 0.02 of a period (0.13 rad) is forty times the phase noise.
        clear = known & (np.abs(part - np.rint(part)) > 0.02)
        np.testing.assert_array_equal(shot.fringe_order[clear], seen.pattern.order_at(columns)[clear])


@pytest.mark.parametrize(
    ("make_rig", "range_m"), [(outside_rig, (0.7, 1.6)), (negative_rig, (0.5, 2.0))], ids=["outside", "negative"]
)
@pytest.mark.parametrize("name", ["plane_1000", "small_plate"])
def test_other_rigs(name: str, make_rig: type[StereoRig], range_m: tuple[float, float]) -> None:
    """A projector upside down 200 mm outside a 40 mm pair of unlike centres; disparities that are all negative."""
    rig = make_rig()
    seen = analytic_capture(name, paper_pattern(), rig=rig)
    sensor = Reconstructor(rig, paper_pattern(), range_m)
    shot = sensor.reconstruct(seen.left, seen.right)
    # Not at their aims, with the small plate: 0.72 % off (away from edges 0.44 %) where the projector stands outside,
    # whose pair of 40 mm tells orders apart badly; 0.74 % ghosts with the negative rig, on wall that the right image
    # does not show.
    check(shot, seen, Limits(outliers=0.008, outliers_away=0.0048, ghosts=0.0082))
    assert (np.nanmax(shot.disparity_px) < 0.0) == (make_rig is negative_rig)


def test_twelve_bit_images_are_as_good() -> None:
    """uint16 with saturation 4095: the same depth as 8 bit, less its rounding (0.29 grey levels against noise 1.5)."""
    seen = capture("plane_1000", bits=16)
    left, right = ((image // 16).astype(np.uint16) for image in (seen.left, seen.right))
    assert left.max() > 255
    shot = Reconstructor(seen.rig, seen.pattern, saturation_level=4095.0).reconstruct(left, right)
    check(shot, seen, Limits())


def test_depth_scales_with_the_rig() -> None:
    """The same images seen by a rig 1.5 times as large: 1.5 times the depth, to float32."""
    seen = capture("small_plate")
    large = Reconstructor(scaled_rig(1.5), seen.pattern, (0.75, 3.0)).reconstruct(seen.left, seen.right)
    plain = dense_shot("small_plate")
    np.testing.assert_allclose(large.depth_m, 1.5 * plain.depth_m, rtol=2e-5)
    np.testing.assert_allclose(large.depth_sigma_m, 1.5 * plain.depth_sigma_m, rtol=1e-3)


def test_phase_of_the_pattern_does_not_matter() -> None:
    """Fringes shifted by 1 rad: the same depth within the noise of both, and as many pixels."""
    pattern = replace(paper_pattern(), phase_rad=1.0)
    seen = analytic_capture("plane_1000", pattern, seed=1)
    shifted = Reconstructor(seen.rig, pattern).reconstruct(seen.left, seen.right)
    plain = dense_shot("plane_1000")
    apart_mm = np.abs(shifted.depth_m - plain.depth_m) * 1e3
    assert np.nanmedian(apart_mm) <= math.sqrt(2.0) * 0.09
    assert abs(np.isfinite(shifted.depth_m).mean() - np.isfinite(plain.depth_m).mean()) < 0.002


def test_moving_the_step_moves_nothing() -> None:
    """One exposure of four: whichever step it carries, told by first_step, gives the same depth within noise."""
    seen = capture("plane_1000", 4)
    dense = Reconstructor(seen.rig, seen.pattern)
    depths: list[Float32] = [dense.reconstruct(seen.left[n], seen.right[n], n).depth_m for n in range(4)]
    for depth in depths[1:]:
        assert np.nanmedian(np.abs(depth - depths[0])) * 1e3 <= math.sqrt(2.0) * 0.09


def test_same_images_same_bits() -> None:
    seen = capture("small_plate")
    again = sensor().reconstruct(seen.left, seen.right)
    fresh = Reconstructor(seen.rig, seen.pattern).reconstruct(seen.left, seen.right)
    for name in ("depth_m", "depth_sigma_m", "disparity_px", "fringe_order", "confidence", "status", "background"):
        expected = getattr(dense_shot("small_plate"), name)
        np.testing.assert_array_equal(getattr(again, name), expected)
        np.testing.assert_array_equal(getattr(fresh, name), expected)
