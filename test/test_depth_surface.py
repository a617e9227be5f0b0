"""Means along the surface: the kernels against a loop, and what they must leave alone."""

from __future__ import annotations

import numpy as np
import pytest
from dense_rigs import Float32

from moire_sensor.depth_surface import OFF_PLANE_PX, along_surface, mean_along_columns, mean_along_rows


def surfaces(seed: int, shape: tuple[int, int]) -> Float32:
    """Two rough sloped surfaces with holes, and single pixels that lie elsewhere."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(shape, dtype=float)
    disparity = np.where(x + 0.3 * y < 0.5 * shape[1], 40.0 + 0.2 * x, 60.0 - 0.1 * y) + rng.normal(0.0, 0.25, shape)
    disparity[rng.uniform(size=shape) < 0.05] += 7.0
    disparity[rng.uniform(size=shape) < 0.1] = np.nan
    return disparity.astype(np.float32)


def slow_mean(line: Float32, reach: int) -> Float32:
    """Mean of every value (n,) of a line and its pairs on the plane."""
    mean = np.empty_like(line)
    for x, middle in enumerate(line):
        aways = range(1, min(reach, x, line.size - 1 - x) + 1)
        pairs = [np.float32(0.5) * (line[x - away] + line[x + away]) for away in aways]
        mean[x] = np.mean([middle, *(pair for pair in pairs if abs(pair - middle) < OFF_PLANE_PX)], dtype=float)
    return mean


@pytest.mark.parametrize("shape", [(24, 60), (60, 24), (1, 1), (2, 3), (3, 40), (40, 2)])
@pytest.mark.parametrize("reach", [0, 1, 8])
def test_means_are_those_of_the_slow_loop(shape: tuple[int, int], reach: int) -> None:
    disparity = surfaces(1, shape)
    rows, columns = np.empty_like(disparity), np.empty_like(disparity)
    mean_along_rows(disparity, reach, rows)
    mean_along_columns(disparity, reach, columns)
    # Sums of 17 values near 50 px in float32: 17 roundings of 2^-24 relative.
    np.testing.assert_allclose(rows, [slow_mean(line, reach) for line in disparity], rtol=2e-6)
    np.testing.assert_allclose(columns.T, [slow_mean(line, reach) for line in disparity.T], rtol=2e-6)


def test_both_directions_are_taken_in_turn() -> None:
    disparity = surfaces(2, (30, 40))
    rows = np.array([slow_mean(line, 6) for line in disparity])
    expected = np.array([slow_mean(line, 3) for line in rows.T]).T
    np.testing.assert_allclose(along_surface(disparity, 6, 3), expected, rtol=4e-6)


@pytest.mark.parametrize(("along", "across"), [(0.0, 0.0), (0.4, -0.3), (-1.7, 0.9)])
def test_a_plane_stays_as_it_is(along: float, across: float) -> None:
    y, x = np.indices((40, 60), dtype=float)
    plane = (30.0 + along * x + across * y).astype(np.float32)
    # float32 at up to 150 px has steps of 1.5e-5 px.
    np.testing.assert_allclose(along_surface(plane, 8, 7), plane, atol=3e-5)


def test_unknown_pixels_stay_unknown_and_no_other_becomes_so() -> None:
    disparity = surfaces(3, (40, 60))
    mean = along_surface(disparity, 8, 7)
    np.testing.assert_array_equal(np.isnan(mean), np.isnan(disparity))
    assert np.isnan(along_surface(np.full((9, 9), np.nan, dtype=np.float32), 8, 7)).all()


@pytest.mark.parametrize("jump", [1.5, 4.0, -20.0])
def test_surfaces_are_never_mixed_across_a_jump(jump: float) -> None:
    """Whatever lies beyond the edge, the pixels of this surface get the same mean, to the bit."""
    rng = np.random.default_rng(4)
    y, x = np.indices((40, 60))
    beyond = (x > 30) | (y > 25)
    here = (50.0 + 0.1 * x + rng.normal(0.0, 0.05, x.shape)).astype(np.float32)
    means = [along_surface(np.where(beyond, other, here).astype(np.float32), 8, 7) for other in (here + jump, np.nan)]
    np.testing.assert_array_equal(means[0][~beyond], means[1][~beyond])
    turned = along_surface(np.where(beyond, here, here + jump).astype(np.float32), 8, 7)
    alone = along_surface(np.where(beyond, here, np.nan).astype(np.float32), 8, 7)
    np.testing.assert_array_equal(turned[beyond], alone[beyond])


def test_noise_is_averaged() -> None:
    """White noise on a plane, away from the borders: down by the root of 17 x 15 values."""
    rng = np.random.default_rng(5)
    disparity = (40.0 + rng.normal(0.0, 0.05, (120, 160))).astype(np.float32)
    scatter = along_surface(disparity, 8, 7)[8:-8, 9:-9].std()
    # Some 60 independent windows tell a standard deviation to 9 %.
    assert scatter == pytest.approx(0.05 / np.sqrt(17.0 * 15.0), rel=0.3)
