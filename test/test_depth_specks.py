"""Runs and specks that are too small, against slow loops and known cases."""

from __future__ import annotations

import numpy as np
import pytest
from dense_rigs import Float32

from moire_sensor.depth_specks import BAND_ROWS, CONNECTED_PX, drop_slivers, drop_specks


def kept(disparity: Float32, least: int) -> Float32:
    found = disparity.copy()
    drop_specks(found, least)
    return found


def patchy(seed: int, shape: tuple[int, int]) -> Float32:
    """Patches that touch here and there, with holes; surfaces wind through many bands of rows."""
    rng = np.random.default_rng(seed)
    coarse = rng.choice([20.0, 20.6, 34.0, np.nan], size=(shape[0] // 2 + 1, shape[1] // 3 + 1), p=[0.4, 0.2, 0.3, 0.1])
    disparity = np.kron(coarse, np.ones((2, 3)))[: shape[0], : shape[1]] + rng.normal(0.0, 0.25, shape)
    disparity[rng.uniform(size=shape) < 0.05] = np.nan
    return disparity.astype(np.float32)


def slow_specks(disparity: Float32, least: int) -> Float32:
    """Surfaces flooded one by one."""
    result, seen = disparity.copy(), np.isnan(disparity)
    for start in map(tuple, np.argwhere(~seen)):
        if seen[start]:
            continue
        seen[start] = True
        surface, waiting = [start], [start]
        while waiting:
            y, x = waiting.pop()
            for at in ((y - 1, x), (y + 1, x), (y, x - 1), (y, x + 1)):
                inside = 0 <= at[0] < disparity.shape[0] and 0 <= at[1] < disparity.shape[1]
                if inside and not seen[at] and abs(disparity[at] - disparity[y, x]) <= CONNECTED_PX:
                    seen[at] = True
                    surface.append(at)
                    waiting.append(at)
        if len(surface) < least:
            result[tuple(np.array(surface).T)] = np.nan
    return result


@pytest.mark.parametrize("shape", [(3 * BAND_ROWS + 7, 61), (BAND_ROWS, 64), (5, 3), (1, 40), (40, 1)])
@pytest.mark.parametrize("least", [0, 2, 12, 150])
def test_specks_are_the_small_connected_surfaces(shape: tuple[int, int], least: int) -> None:
    disparity = patchy(3, shape)
    expected = slow_specks(disparity, least)
    np.testing.assert_array_equal(kept(disparity, least), expected)
    if least == 12 and shape[0] > BAND_ROWS and shape[1] > 1:
        assert 0.02 < (np.isnan(expected) & np.isfinite(disparity)).mean() < 0.9


def test_small_specks_go_and_surfaces_stay() -> None:
    disparity = np.full((60, 80), np.nan, dtype=np.float32)
    disparity[5:12, 5:12] = 30.0
    disparity[20:50, 10:70] = np.linspace(40.0, 52.0, 60)
    disparity[30:36, 30:36] = 90.0
    expected = disparity.copy()
    expected[5:12, 5:12] = expected[30:36, 30:36] = np.nan
    np.testing.assert_array_equal(kept(disparity, 60), expected)
    np.testing.assert_array_equal(kept(disparity, 7 * 7)[5:12, 5:12], 30.0)


def test_a_spiral_is_one_surface() -> None:
    """Its arms meet only at its middle, across all seams of the bands."""
    disparity = np.full((4 * BAND_ROWS, 4 * BAND_ROWS), np.nan, dtype=np.float32)
    for ring in range(0, 2 * BAND_ROWS - 2, 4):
        end = 4 * BAND_ROWS - ring
        disparity[ring, max(ring - 4, 0) : end] = disparity[ring:end, end - 1] = 25.0
        disparity[end - 1, ring:end] = disparity[ring + 4 : end, ring] = 25.0
    pixels = int(np.isfinite(disparity).sum())
    np.testing.assert_array_equal(kept(disparity, pixels), disparity)
    assert np.isnan(kept(disparity, pixels + 1)).all()


def test_an_empty_image_has_no_surfaces() -> None:
    assert np.isnan(kept(np.full((20, 30), np.nan, dtype=np.float32), 5)).all()


def without_slivers(line: Float32, least: int) -> Float32:
    """Runs of neighbours at most a pixel apart, cut out and weighed one by one."""
    apart = ~(np.abs(np.diff(line)) <= 1.0)
    runs = np.split(line, np.flatnonzero(apart) + 1)
    return np.concatenate([run if run.size >= least else np.full_like(run, np.nan) for run in runs])


@pytest.mark.parametrize("least", [0, 1, 2, 5, 100])
def test_slivers_are_the_short_runs(least: int) -> None:
    rng = np.random.default_rng(8)
    # Surfaces 1 to 12 px wide with holes, and runs that reach both borders.
    disparity = np.repeat(rng.uniform(20.0, 60.0, (30, 40)), rng.integers(1, 13, 40), axis=1).astype(np.float32)
    disparity += rng.uniform(-0.4, 0.4, disparity.shape).astype(np.float32)
    disparity[rng.uniform(size=disparity.shape) < 0.05] = np.nan
    expected = np.array([without_slivers(line, least) for line in disparity])
    drop_slivers(disparity, least)
    np.testing.assert_array_equal(disparity, expected)
    assert np.isfinite(expected).any() == (least < 100)
