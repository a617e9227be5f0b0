"""Fringe edges against known crossings, an oracle, and their predicted noise."""

from __future__ import annotations

import numpy as np
import pytest

from moire_sensor import edge_find
from moire_sensor.edge_crossing import DOWN, UP
from moire_sensor.edge_find import EdgeRows, bright_share
from moire_sensor.edge_noise import camera_noise
from moire_sensor.edge_scan import BORDER_PX, mark_extrema, mark_turns, sum_taps
from moire_sensor.edge_settings import EdgeSettings
from moire_sensor.errors import SettingsError

PERIOD = 16.67
COLUMNS = np.arange(640.0)
# The crossing is read from a chord of one pixel, off the sine by (pi / period)^3 / 9 sqrt(3) of a radian at worst, and
# the extrema from parabolas over two pixels: together below 0.01 px without noise.
EXACT_PX = 0.01


def find_edges(image: np.ndarray, settings: EdgeSettings) -> EdgeRows:
    """Edges of an image in grey levels of 255, given as sixteen bits: rounded to 1/256 of a level."""
    whole = np.round(image * 256.0).astype(np.uint16)
    return edge_find.find_edges((whole, whole), settings, 1.0 / 256.0)[0]


def fringes(phase_rad: np.ndarray, amplitude: float = 70.0) -> np.ndarray:
    return (80.0 + amplitude * np.cos(phase_rad)).astype(np.float32)


def off_px(edges, row: int, phase_of, rad_per_px) -> np.ndarray:
    """Distance of the edges of a row from where the phase is -pi/2 (up) or pi/2 (down), pixels."""
    x = edges.x_px[row, : edges.number[row]].astype(np.float64)
    side = edges.side[row, : edges.number[row]]
    error = phase_of(x) + side * np.pi / 2.0
    return (error - 2.0 * np.pi * np.round(error / (2.0 * np.pi))) / rad_per_px(x)


def test_edges_of_a_sine_lie_where_the_cosine_is_zero() -> None:
    shifts = np.linspace(0.0, 2.0 * np.pi, 40)[:, None]
    edges = find_edges(fringes(2.0 * np.pi / PERIOD * COLUMNS + shifts), EdgeSettings())
    rad_per_px = 2.0 * np.pi / PERIOD
    for row in range(40):
        error = off_px(edges, row, lambda x, row=row: rad_per_px * x + shifts[row, 0], lambda x: rad_per_px)
        assert np.abs(error).max() < EXACT_PX
        side = edges.side[row, : edges.number[row]]
        assert np.all(side[1:] == -side[:-1])
        # 640 / 8.33 half fringes; the one that each border cuts, and the half before it, have no second extremum.
        assert 73 <= edges.number[row] <= 76


def test_shading_does_not_move_edges() -> None:
    """Light that falls by 1 % a pixel would move the middle between peak and trough by 0.4 px."""
    phase = 2.0 * np.pi / PERIOD * COLUMNS
    shade = 1.0 - 0.6 * COLUMNS / 640.0 - 0.1 * np.cos(COLUMNS / 100.0)
    edges = find_edges((fringes(phase)[None] * shade).astype(np.float32), EdgeSettings())
    error = off_px(edges, 0, lambda x: 2.0 * np.pi / PERIOD * x, lambda x: 2.0 * np.pi / PERIOD)
    # Levels are continued along straight lines, and peaks shift with the shade: second order, 1 / 20 of the first.
    assert np.abs(error).max() < 0.05


def test_a_phase_jump_spoils_no_edge_but_the_one_that_it_cuts() -> None:
    jump = 320
    phase = 2.0 * np.pi / PERIOD * COLUMNS + 2.1 * (jump <= COLUMNS)
    edges = find_edges(fringes(phase)[None], EdgeSettings())
    rad_per_px = 2.0 * np.pi / PERIOD
    error = off_px(edges, 0, lambda x: rad_per_px * x + np.where(x < jump, 0.0, 2.1), lambda x: rad_per_px)
    away = np.abs(edges.x_px[0, : edges.number[0]] - jump) > PERIOD / 2.0
    assert np.abs(error[away]).max() < EXACT_PX


def test_predicted_sigma_is_what_noise_does() -> None:
    generator = np.random.default_rng(3)
    rad_per_px = 2.0 * np.pi / PERIOD
    image = fringes(rad_per_px * COLUMNS + np.zeros((200, 1)), amplitude=40.0)
    noisy = (image + 2.0 * generator.standard_normal(image.shape)).astype(np.float32)
    edges = find_edges(noisy, EdgeSettings())
    error = np.concatenate([off_px(edges, row, lambda x: rad_per_px * x, lambda x: rad_per_px) for row in range(200)])
    sigma = np.concatenate([edges.sigma_px[row, : edges.number[row]] for row in range(200)])
    # The prediction leaves out that the extrema are picked among noisy samples; issue 3 asks for 20 %.
    assert np.sqrt(np.mean(error**2)) == pytest.approx(np.sqrt(np.mean(sigma**2)), rel=0.2)
    assert abs(error.mean()) < 5.0 * error.std() / np.sqrt(error.size)


def test_noise_of_whole_grey_levels_is_recovered_beside_surface_borders() -> None:
    generator = np.random.default_rng(4)
    image = fringes(2.0 * np.pi / PERIOD * COLUMNS + np.where(np.arange(480) < 200, 0.0, 1.5)[:, None])
    for noise in (0.5, 1.5, 4.0):
        seen = np.round(image + noise * generator.standard_normal(image.shape)).astype(np.uint8)
        # Rounding adds 1/12; 77 000 differences tell a standard deviation to 0.3 %, the clipping to 2 %.
        assert camera_noise(seen) == pytest.approx(np.hypot(noise, 12.0**-0.5), rel=0.02)
        # The same levels at 16 bits are the same noise.
        assert camera_noise(seen.astype(np.uint16) * 16, 1.0 / 16.0) == pytest.approx(camera_noise(seen), rel=1e-9)


def slow_extrema(row: np.ndarray, contrast: float) -> list[int]:
    """From the start or the last turn, the first column that lies ``contrast`` off what was reached since."""
    found: list[int] = []
    start, seeking = 0, 0
    while True:
        for x in range(start + 1, row.size):
            since = row[start : x + 1]
            if seeking >= 0 and row[x] <= since.max() - contrast:
                turn, towards = start + int(np.argmax(since)), -1
                break
            if seeking <= 0 and row[x] >= since.min() + contrast:
                turn, towards = start + int(np.argmin(since)), 1
                break
        else:
            return found
        # Of the first turn nobody knows what came before it.
        if seeking != 0 and BORDER_PX <= turn < row.size - BORDER_PX:
            found.append(turn)
        start, seeking = x, towards


def test_extrema_equal_a_slow_search() -> None:
    generator = np.random.default_rng(5)
    walk = np.cumsum(generator.standard_normal((30, 200)), axis=1).astype(np.float32)
    # Half of the rows in whole grey levels: peaks and troughs then have flat tops.
    walk[::2] = np.round(walk[::2])
    for contrast in (1.0, 3.0, 8.0):
        total = 0
        for row in walk:
            turns, columns = np.zeros(202, dtype=np.int32), np.zeros(202, dtype=np.int32)
            turning = np.zeros(200, dtype=np.uint8)
            number = mark_extrema(row, turns[: mark_turns(row, turning, turns)], np.float32(contrast), columns)
            assert columns[:number].tolist() == slow_extrema(row, np.float32(contrast))
            total += number
        assert total > 30


def test_mirrored_images_give_mirrored_edges() -> None:
    generator = np.random.default_rng(6)
    image = fringes(2.0 * np.pi / PERIOD * COLUMNS + 0.4 * np.sin(COLUMNS / 60.0) + np.linspace(0, 6, 20)[:, None])
    image = (image + generator.standard_normal(image.shape)).astype(np.float32)
    edges, mirrored = find_edges(image, EdgeSettings()), find_edges(image[:, ::-1].copy(), EdgeSettings())
    for y in range(20):
        count = edges.number[y]
        assert mirrored.number[y] == count
        # Columns are float32 of up to 640: known to 3e-5 px.
        np.testing.assert_allclose(639.0 - mirrored.x_px[y, :count][::-1], edges.x_px[y, :count], atol=2e-4)
        assert np.array_equal(-mirrored.side[y, :count][::-1], edges.side[y, :count])


def test_a_dim_or_constant_image_has_no_edges() -> None:
    dim = find_edges(fringes(2.0 * np.pi / PERIOD * COLUMNS[None], amplitude=5.0), EdgeSettings())
    assert dim.number.tolist() == [0]
    flat = find_edges(np.full((3, 640), 255.0, dtype=np.float32), EdgeSettings())
    assert flat.number.tolist() == [0, 0, 0]
    assert bright_share((dim, flat)) == 0.5


def test_smoothing_keeps_the_mean_and_the_size() -> None:
    row = np.random.default_rng(7).integers(0, 65536, 40).astype(np.uint16)
    sums = np.empty(40, dtype=np.int32)
    sum_taps(row, sums)
    expected = np.convolve(np.pad(row.astype(np.int64), 2, mode="edge"), np.array([1, 4, 6, 4, 1]), mode="valid")
    assert np.array_equal(sums, expected)


@pytest.mark.parametrize("gamma", [1.0, 2.2])
def test_bright_share_is_that_of_the_bent_wave(gamma: float) -> None:
    phase = 2.0 * np.pi / PERIOD * COLUMNS + np.linspace(0, 6, 30)[:, None]
    image = (10.0 + 140.0 * ((1.0 + np.cos(phase)) / 2.0) ** gamma).astype(np.float32)
    # The same of the wave under the five-pixel smoothing, on a grid of 1/100 px.
    fine = 2.0 * np.pi / PERIOD * np.arange(0.0, PERIOD, 0.01)
    taps = zip((-2, -1, 0, 1, 2), (1, 4, 6, 4, 1), strict=True)
    wave = sum(tap / 16.0 * ((1.0 + np.cos(fine + 2.0 * np.pi / PERIOD * off)) / 2.0) ** gamma for off, tap in taps)
    expected = float(np.mean(wave > 0.5 * (wave.max() + wave.min())))
    assert bright_share((find_edges(image, EdgeSettings()),)) == pytest.approx(expected, abs=0.002)


def test_sides_are_named_along_the_row() -> None:
    edges = find_edges(fringes(2.0 * np.pi / PERIOD * COLUMNS)[None], EdgeSettings())
    x, side = edges.x_px[0], edges.side[0]
    middle = edges.number[0] // 2
    rises = np.cos(2.0 * np.pi / PERIOD * (x[middle] + 1.0)) > np.cos(2.0 * np.pi / PERIOD * (x[middle] - 1.0))
    assert side[middle] == (UP if rises else DOWN)


@pytest.mark.parametrize(
    ("bad", "words"),
    [
        ({"lambda_oc": 3.0}, "lambda_oc 3.0 and lambda_mat 2.0"),
        ({"same_side_periods": 0.0}, "same_side_periods is 0.0; allowed is 0.001 to 0.25"),
        ({"rows": 0}, "rows is 0"),
        ({"min_run": 1.5}, "min_run is 1.5; give a whole number"),
        ({"lambda_r": float("nan")}, "lambda_r is nan"),
    ],
)
def test_settings_out_of_range_are_refused(bad: dict[str, float], words: str) -> None:
    with pytest.raises(SettingsError) as caught:
        EdgeSettings(**bad)  # type: ignore[arg-type]
    assert words in str(caught.value)
