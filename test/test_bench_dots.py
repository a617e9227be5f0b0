"""Random dots: drawn where the projector throws them, and measured by the block matchers."""

from __future__ import annotations

import numpy as np
import pytest

from moire_sim.analytic_scenes import AnalyticScene
from moire_sim.analytic_surfaces import Relief
from moire_sim.errors import SceneError
from moire_sim.fringe_image import Light
from moire_sim.random_dots import RandomDots
from moire_sim.score import score_depth
from tools.bench.accuracy import photograph, truth_of
from tools.bench.block_matching import BlockMatcher
from tools.bench.conditions import DEFAULT
from tools.bench.tasks import done


def test_signal_is_the_dot_averaged_over_the_footprint() -> None:
    pattern = RandomDots(3.0, size=(60, 30), seed=1)
    generator = np.random.default_rng(2)
    places = generator.uniform((-0.5, -0.5), (59.4, 29.4), (50, 2))
    fine = (np.arange(200) + 0.5) / 200.0 - 0.5
    for footprint_px in (1.0, 0.25):
        found = pattern.signal(places, footprint_px)
        for place, value in zip(places, found, strict=True):
            dots = (place[:, None] + fine * footprint_px + 0.5) // 3
            columns, rows = (np.clip(dots[axis], 0, limit).astype(int) for axis, limit in ((0, 19), (1, 9)))
            mean = pattern.dots[np.ix_(rows, columns)].mean()
            # The mean over 200 x 200 points is itself good to a point's width in each direction.
            assert value == pytest.approx(mean, abs=0.02)


def test_dots_are_as_many_as_asked_and_repeatable() -> None:
    pattern = RandomDots(2.0, bright_share=0.3)
    assert (pattern.dots > 0).mean() == pytest.approx(0.3, abs=0.005)
    assert np.array_equal(pattern.dots, RandomDots(2.0, bright_share=0.3).dots)
    assert pattern.step_count == 1


@pytest.mark.parametrize(("setting", "value"), [("dot_px", 0.5), ("dot_px", np.nan), ("bright_share", 1.0)])
def test_impossible_dots_are_refused(setting: str, value: float) -> None:
    with pytest.raises(SceneError, match=setting):
        RandomDots(**{setting: value})  # type: ignore[arg-type]


def test_both_cameras_see_the_same_dots_shifted_by_the_disparity() -> None:
    depth_m = 1250.0 * 0.094 / 117.0
    scene = AnalyticScene.of((Relief(depth_m),))
    left, right = scene.images(RandomDots(3.0), [Light(offset=80.0, blur_px=0.0)], noise=0.0)
    shift = round(float(scene.rig.disparity_px(depth_m)))
    # 117 px within 0.02 px; Lambert's cosine differs by less than 1 %. Beside dot borders 0.02 px are 3 grey levels.
    difference = np.abs(left[:, shift + 60 :].astype(float) - right[:, 60 : 640 - shift])
    assert np.percentile(difference, 99) <= 5.0
    assert left[:, shift + 60 :].std() > 50.0


@pytest.mark.parametrize("kind", ["StereoBM", "SGBM 3-way"])
def test_block_matchers_measure_a_plane_to_the_image_border(kind: str) -> None:
    scene = AnalyticScene.of((Relief(1.0, 0.1),))
    truth = truth_of(scene)
    matcher = BlockMatcher(kind, 9, scene.rig, (0.5, 2.0))  # type: ignore[arg-type]
    left, right = photograph(scene, RandomDots(1.5), DEFAULT)
    score = score_depth(matcher.depth_m(matcher.build(), left, right), truth)
    assert score.completeness > 0.95
    assert score.outlier_share < 0.01
    # A quarter of a pixel, 2.1 mm at 1 m: OpenCV interpolates to 1/16 px with a pull towards whole pixels.
    assert score.median_error_mm < 2.1


def test_tasks_come_back_in_their_order() -> None:
    assert done([(sorted, ([2, 1],)), (list, ((3,),))], "sums") == [1, 2, 3]
