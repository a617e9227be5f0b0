"""The real capture of a hand: a short pair, the projector 185 mm outside it and upside down, motion between the frames.

There is no truth; what is asserted is what the capture's own description says (a smooth hand at 0.45 to 0.50 m) and
that methods which share only the calibration agree.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from moire_sensor import Reconstructor, Shot, read_capture
from moire_sensor.capture_folder import Capture
from moire_sensor.settings import Settings

Mask = npt.NDArray[np.bool_]
Float = npt.NDArray[np.floating]
MIN_MODULATION = 12.0


@dataclass(frozen=True)
class Hand:
    """What the tests share: images of all frames, their modulation, results."""

    capture: Capture
    left: npt.NDArray[np.uint8]
    right: npt.NDArray[np.uint8]
    modulation: Float

    @property
    def lit(self) -> Mask:
        return self.modulation > MIN_MODULATION

    def sensor(self, method: str, settings: Settings | None = None) -> Reconstructor:
        return Reconstructor(
            self.capture.rig, self.capture.pattern, self.capture.depth_range_m, method, settings=settings
        )


@cache
def load(folder: Path) -> Hand:
    capture = read_capture(folder)
    frames = [capture.frame(n) for n in range(capture.frame_count)]
    left, right = (np.stack([pair[camera] for pair in frames]) for camera in (0, 1))
    # Two cycles of four steps: modulation is twice the size of the first harmonic, plain by its definition.
    turn = np.exp(1j * np.pi / 2 * np.arange(len(left)))
    modulation = 2.0 * np.abs(np.tensordot(turn, left.astype(float), axes=1)) / len(left)
    return Hand(capture, left, right, modulation)


@cache
def stepped(folder: Path) -> Shot:
    hand = load(folder)
    return hand.sensor("phase_shift").reconstruct(hand.left, hand.right, hand.capture.step_index(0))


@cache
def single(folder: Path, n: int) -> Shot:
    hand = load(folder)
    return hand.sensor("dense").reconstruct(hand.left[n], hand.right[n], hand.capture.step_index(n))


def off_from_median(depth_m: Float, judged: Mask) -> float:
    """Share of pixels more than 5 mm from the median of the known depths in the 15 x 15 window, every third pixel."""
    windows = sliding_window_view(np.pad(depth_m, 7, constant_values=np.nan), (15, 15))
    rows, columns = (index[::3] for index in np.nonzero(judged & np.isfinite(depth_m)))
    medians = np.nanmedian(windows[rows, columns].reshape(rows.size, -1), axis=1)
    return float((np.abs(depth_m[rows, columns] - medians) > 0.005).mean())


@pytest.mark.parametrize(("method", "share"), [("phase_shift", 0.90), ("dense", 0.80)])
def test_hand_is_whole_smooth_and_where_it_was(capture_folder: Path, method: str, share: float) -> None:
    hand = load(capture_folder)
    steps = method == "phase_shift"
    for shot in [stepped(capture_folder)] if steps else [single(capture_folder, n) for n in (0, 3, 4)]:
        known = np.isfinite(shot.depth_m) & hand.lit
        assert known.sum() >= share * hand.lit.sum()
        # 2 % is what the task allows to be off; 0.2 % are.
        assert ((shot.depth_m[known] > 0.44) & (shot.depth_m[known] < 0.52)).mean() >= 0.98
        assert off_from_median(shot.depth_m, hand.lit) <= 0.02


def test_single_shots_agree_with_phase_shifting(capture_folder: Path) -> None:
    """Both valid at the time of frame 3.5."""
    hand = load(capture_folder)
    mean = 0.5 * (single(capture_folder, 3).depth_m + single(capture_folder, 4).depth_m)
    apart_m = np.abs(mean - stepped(capture_folder).depth_m)
    both = np.isfinite(apart_m) & hand.lit
    assert both.sum() >= 0.85 * hand.lit.sum()
    assert np.median(apart_m[both]) <= 0.0008
    assert (apart_m[both] <= 0.005).mean() >= 0.97


def test_depth_given_in_the_dim_is_the_cloth_behind(capture_folder: Path) -> None:
    """Specks of depth beside the fingers are no ghosts: in a wider range and dimmer light the same plane comes out.

    The cloth is a plane 0.51 to 0.54 m away whose modulation lies at the threshold of 6 grey levels.
    """
    hand = load(capture_folder)
    dim = (hand.modulation > 3.0) & (hand.modulation < 8.0)
    rows, columns = np.indices(dim.shape) / 100.0

    def design(chosen: Mask) -> Float:
        return np.column_stack([rows[chosen], columns[chosen], np.ones(int(chosen.sum()))])

    sensor = Reconstructor(
        hand.capture.rig, hand.capture.pattern, (0.40, 0.75), "phase_shift", settings=Settings(min_amplitude=2.0)
    )
    wide = sensor.reconstruct(hand.left, hand.right, hand.capture.step_index(0))
    cloth = np.isfinite(wide.depth_m) & dim & (wide.depth_m > 0.505)
    # Inverse depth of a plane is linear in the pixel.
    plane = np.linalg.lstsq(design(cloth), 1.0 / wide.depth_m[cloth].astype(float), rcond=None)[0]
    assert cloth.sum() > 20000
    shot = stepped(capture_folder)
    specks = np.isfinite(shot.depth_m) & dim & (shot.depth_m > 0.505)
    assert specks.sum() > 500
    assert np.percentile(np.abs(shot.depth_m[specks] - 1.0 / (design(specks) @ plane)), 97) < 0.005


def test_swapped_cameras_are_refused(capture_folder: Path) -> None:
    hand = load(capture_folder)
    steps = hand.capture.step_index
    assert np.isnan(hand.sensor("dense").reconstruct(hand.right[3], hand.left[3], steps(3)).depth_m).all()
    assert np.isnan(hand.sensor("phase_shift").reconstruct(hand.right, hand.left, steps(0)).depth_m).all()
