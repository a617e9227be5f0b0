"""The parts of the search for narrow posts against slow loops, uncompiled: test_depth_seek.py runs them compiled."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from border_scene import PROJECTOR
from dense_rigs import Array, Float32

from moire_sensor import depth_seek_chain as chain
from moire_sensor import depth_seek_fit as fit
from moire_sensor import depth_seek_row as row
from moire_sensor import depth_seek_spread as spread
from moire_sensor.depth_claims import claim_nearest
from moire_sensor.depth_narrow import STEP_PX

MAP = PROJECTOR.packed()
SHARE = np.float32(0.7)
WIDTH = 160
NAN = np.float32(np.nan)


@pytest.fixture(autouse=True)
def uncompiled(monkeypatch: pytest.MonkeyPatch) -> None:
    """What the parts call, uncompiled, too."""
    for module, name in ((fit, "phases"), (fit, "added"), (fit, "solved"), (fit, "wrap"), (fit, "cos"), (row, "lower")):
        monkeypatch.setattr(module, name, getattr(module, name).py_func)
    monkeypatch.setattr(fit, "phase_of_disparity", fit.phase_of_disparity.py_func)


def fringes(x: Array, disparity_px: float, shade: Array) -> Float32:
    return np.float32(shade * (1.0 + SHARE * np.cos(PROJECTOR.phase_rad_at(x, np.zeros_like(x), disparity_px))))


def slow_fit(levels: Array, x: Array, disparity_px: float) -> tuple[float, float]:
    """What a shade that changes straight along the piece leaves over, in amplitudes, and the shade in its middle."""
    light = fringes(x, disparity_px, np.ones_like(x)).astype(float)
    turned = light * (x - x.mean()) / fit.HALF_PX
    weights, *_ = np.linalg.lstsq(np.stack([light, turned], axis=1), levels, rcond=None)
    left_over = levels - weights[0] * light - weights[1] * turned
    return float(np.sqrt(np.mean(left_over**2)) / (weights[0] * SHARE)), float(weights[0])


def test_differences_and_their_least_ones() -> None:
    rng = np.random.default_rng(0)
    left, piece = np.float32(rng.uniform(0.0, 200.0, (2, 60)))
    piece = piece[: fit.PIECE_PX]
    apart, least = np.empty(60 - fit.PIECE_PX + 1, dtype=np.float32), np.empty(60 - fit.PIECE_PX + 1, dtype=np.uint8)
    fit.fill_differences.py_func(left, piece, np.float32(np.inf), apart, least)
    expected = [np.sum((left[i : i + fit.PIECE_PX] - piece) ** 2) for i in range(apart.size)]
    np.testing.assert_allclose(apart, expected, rtol=1e-5)
    lows = [i for i in range(1, apart.size - 1) if apart[i] <= apart[i - 1] and apart[i] < apart[i + 1]]
    assert np.flatnonzero(least).tolist() == lows
    limit = np.float32(np.mean(sorted(parabola(apart, i)[1] for i in lows)[4:6]))
    fit.fill_differences.py_func(left, piece, limit, apart, least)
    assert np.flatnonzero(least).tolist() == [i for i in lows if parabola(apart, i)[1] <= limit]


def parabola(values: Float32, i: int) -> tuple[float, float]:
    """Place about i and value of the lowest point of the parabola through three values."""
    square, slope, value = np.polyfit([-1.0, 0.0, 1.0], values[i - 1 : i + 2].astype(float), 2)
    return -slope / (2.0 * square), value - slope**2 / (4.0 * square)


def test_the_least_difference_is_a_parabolas() -> None:
    values = np.array([(i - 2.3) ** 2 + 5.0 for i in range(5)], dtype=np.float32)
    assert fit.least_between.py_func(values, 2) == pytest.approx(0.3, abs=1e-4)
    assert parabola(values, 2) == pytest.approx((0.3, 5.0), abs=1e-4)


@pytest.mark.parametrize("offset_px", [0.0, 0.4, 3.0])
def test_fits_are_those_of_least_squares(offset_px: float) -> None:
    """Off by some pixels, views and fringes differ."""
    rng = np.random.default_rng(1)
    x = np.arange(float(WIDTH))
    shade = 90.0 - 0.3 * (x - 100.0)
    left = fringes(x, 62.0, shade) + np.float32(rng.normal(0.0, 1.0, WIDTH))
    right = fringes(x + 62.0, 62.0, shade - 0.3 * 62.0) + np.float32(rng.normal(0.0, 1.0, WIDTH))
    middle, disparity = 100, 62.0 + offset_px
    at = np.arange(middle - fit.HALF_PX, middle + fit.HALF_PX + 1.0)
    seen = np.interp(at - disparity, x, right)
    views, fringe, level = fit.fit_both.py_func(left, right, MAP, SHARE, middle, 0, np.float32(disparity))
    mean = 0.5 * (left[at.astype(int)] + seen)
    misfit, expected_level = slow_fit(mean, at, disparity)
    # float32 sums of nine squares of 100 grey levels: a hundredth of one.
    assert level == pytest.approx(expected_level, rel=1e-4)
    assert fringe == pytest.approx(misfit, abs=2e-3)
    apart = float(np.sqrt(np.mean((left[at.astype(int)] - seen) ** 2)))
    assert views == pytest.approx(apart / (expected_level * SHARE), rel=1e-3)
    one = fit.fit_one.py_func(left, MAP, SHARE, middle, np.float32(middle), 0, np.float32(disparity))
    assert one == pytest.approx(slow_fit(left[at.astype(int)], at, disparity)[0], abs=2e-3)


@pytest.mark.parametrize("at", [0, fit.HALF_PX - 1, WIDTH - fit.HALF_PX])
def test_pieces_that_a_view_does_not_hold_do_not_fit(at: int) -> None:
    flat = np.full(WIDTH, 90.0, dtype=np.float32)
    assert fit.fit_one.py_func(flat, MAP, SHARE, at, np.float32(at), 0, np.float32(10.0)) == fit.NO_FIT
    assert fit.fit_both.py_func(flat, flat, MAP, SHARE, at, 0, np.float32(0.0))[0] == fit.NO_FIT
    assert fit.fit_both.py_func(flat, flat, MAP, SHARE, 100, 0, np.float32(100.0 - at))[0] == fit.NO_FIT


def random_row(seed: int) -> Float32:
    rng = np.random.default_rng(seed)
    values = np.full(WIDTH, 20.0)
    for start in range(0, WIDTH - 20, 25):
        values[start : start + int(rng.integers(1, 24))] = rng.choice([np.nan, 20.0, 32.0, 47.0])
    return np.float32(values + rng.normal(0.0, 0.2, WIDTH))


def slow_left_over(sure: Float32, claims: Float32) -> list[int]:
    places = []
    for column in range(fit.HALF_PX, WIDTH - fit.HALF_PX - 1):
        known = np.flatnonzero(np.isfinite(claims))
        sides = [claims[k] for k in (known[known < column][-1:].tolist() + known[known > column][:1].tolist())]
        if np.isfinite(claims[column]) or np.isfinite(claims[[column - 1, column + 1]]).all():
            continue
        if sides:
            x = int(np.floor(column + min(sides)))
            if x + 1 >= WIDTH or (x >= 0 and np.nanmax([*sure[x : x + 2], -np.inf]) > min(sides) + STEP_PX):
                continue
        places.append(column)
    return places


@pytest.mark.parametrize("seed", range(5))
def test_what_nobody_explains_is_that_of_the_slow_loop(seed: int) -> None:
    line = random_row(seed)
    sure, claims, before, after = np.empty((4, WIDTH), dtype=np.float32)
    row.fill_sure.py_func(line, 12, sure)
    claims[:] = NAN
    claim_nearest.py_func(sure, claims)
    row.fill_sides.py_func(claims, before, after)
    breaks = [0, *(x for x in range(1, WIDTH) if not abs(line[x] - line[x - 1]) < STEP_PX), WIDTH]
    slow_sure, slow_claims = np.full((2, WIDTH), NAN)
    for start, end in itertools.pairwise(breaks):
        if end - start >= 12:
            slow_sure[start:end] = line[start:end]
    for x in np.flatnonzero(np.isfinite(slow_sure)):
        column = int(np.floor(np.float32(x) - slow_sure[x] + np.float32(0.5)))
        if 0 <= column < WIDTH:
            slow_claims[column] = np.nanmax([slow_claims[column], slow_sure[x]])
    np.testing.assert_array_equal(sure, slow_sure)
    np.testing.assert_array_equal(claims, slow_claims)
    places = np.empty(WIDTH, dtype=np.int64)
    count = row.fill_left_over.py_func(sure, claims, before, after, places)
    assert places[:count].tolist() == slow_left_over(sure, claims)


@pytest.mark.parametrize(
    ("weights", "number", "wall", "expected"),
    [((4.0, 1.0), 4.0, 0.5, 0), ((4.0, 2.5), 4.0, 0.5, -1), ((1.5, 0.0), 4.0, 0.5, -1), ((4.0, 1.0), 2.0, 0.5, -1),
     ((4.0, 1.0), 4.0, 0.05, -1), ((1.0, 4.0), 4.0, 0.5, 1)],
)  # fmt: skip
def test_a_chain_is_chosen_if_nothing_rivals_it(
    weights: tuple[float, float], number: float, wall: float, expected: int
) -> None:
    """It must weigh enough, be long enough, and not be the wall."""
    chains = np.array([weights, (number, number), (wall * number, wall * number)], dtype=np.float32)
    assert chain.chosen.py_func(np.array([70.0, 90.0], dtype=np.float32), np.array([0, 1]), 0, 2, chains) == expected


def test_disparities_close_together_are_one_chain() -> None:
    disparities, chain_of = np.array([70.0, 90.0, 0.0, 0.0], dtype=np.float32), np.array([0, 1, 0, 0])
    chains = np.zeros((3, 4), dtype=np.float32)
    one = np.float32(1.0)
    assert chain.chained.py_func(np.float32(90.4), one, one, 0, 2, disparities, chain_of, chains, 2) == 1
    assert chain.chained.py_func(np.float32(91.0), one, one, 0, 2, disparities, chain_of, chains, 2) == 2
    assert chains[1].tolist() == [0.0, 1.0, 1.0, 0.0]


def test_what_rows_have_in_common_is_written_between_them() -> None:
    """Of five rows looked at four show a post, half a pixel nearer from one to the next."""
    found = np.full((5, 40), np.nan, dtype=np.float32)
    for number in range(4):
        found[number, 20:30] = 70.0 + 0.5 * number
    found[2, 3] = 50.0
    height = 4 * spread.ROWS_PX + spread.MEAN_PX
    images = [np.full((height, 40), value, dtype=np.float32) for value in (60.0, 9.0, 9.0, 9.0)]
    images[0][:, 25] = 70.2
    spread.write(found, *images)
    first, last = spread.MEAN_PX // 2, spread.MEAN_PX // 2 + 3 * spread.ROWS_PX
    rows = np.arange(height)
    expected = 70.0 + 0.5 * np.clip((rows - first) / spread.ROWS_PX, 0.0, 3.0)
    assert (images[0][last:, 21] == 60.0).all()
    np.testing.assert_allclose(images[0][:last, 21], expected[:last], rtol=1e-6)
    assert (images[0][:, :20] == 60.0).all()
    assert (images[1][:last, 21] == spread.SIGMA_PX).all()
    assert np.isnan(images[2][:last, 21]).all()
    # What is known to be there is left as it is.
    kept = np.abs(expected[:last] - 70.2) < chain.SAME_PX
    assert (images[0][:last, 25][kept] == np.float32(70.2)).all()
