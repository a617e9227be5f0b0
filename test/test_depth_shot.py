"""What a shot says of every pixel, against its definition."""

from __future__ import annotations

import numpy as np
import pytest

from moire_sensor.depth_shot import drop_out_of_range, results
from moire_sensor.paper_rig import paper_rig
from moire_sensor.shot import Status

SHAPE = (20, 50)


def test_depths_out_of_range_are_dropped() -> None:
    rig = paper_rig()
    depth_m = np.random.default_rng(1).uniform(0.3, 3.0, SHAPE)
    disparity = np.float32(rig.disparity_px(depth_m))
    disparity[:, 7] = np.nan
    expected = np.where((depth_m >= 0.98 * 0.5) & (depth_m <= 1.02 * 2.0), disparity, np.float32(np.nan))
    drop_out_of_range(disparity, rig, (0.5, 2.0))
    np.testing.assert_array_equal(disparity, expected)
    assert 0.2 < np.isfinite(expected).mean() < 0.8


@pytest.mark.parametrize("lost", [Status.OCCLUDED, Status.AMBIGUOUS])
def test_every_pixel_has_depth_sigma_and_status(lost: Status) -> None:
    rng, rig = np.random.default_rng(2), paper_rig()
    depth_m = rng.uniform(0.5, 2.0, SHAPE)
    depth_m[rng.uniform(size=SHAPE) < 0.3] = np.nan
    disparity = np.float32(rig.disparity_px(depth_m))
    sigma_px, confidence = np.float32(rng.uniform(0.01, 0.1, SHAPE)), np.float32(rng.uniform(size=SHAPE))
    confidence[np.isnan(depth_m)] = 0.0
    seen = rng.choice(np.array([Status.OK, Status.UNLIT, Status.SATURATED], dtype=np.uint8), SHAPE)
    given = confidence.copy()
    depth, sigma, kept, status = results((disparity, sigma_px, confidence), seen, rig, 0.4, lost)
    good = np.isfinite(depth_m) & (given >= 0.4)
    np.testing.assert_allclose(depth, np.where(good, depth_m, np.nan), rtol=1e-5)
    slope = depth_m**2 / (rig.fx_px * rig.baseline_m)
    np.testing.assert_allclose(sigma, np.where(good, slope * sigma_px, np.nan), rtol=1e-5)
    np.testing.assert_array_equal(kept, np.where(good, disparity, np.float32(np.nan)))
    np.testing.assert_array_equal(confidence, np.where(good, given, np.float32(0.0)))
    expected = np.where(seen == Status.OK, lost, seen)
    expected[np.isfinite(depth_m) & ~good] = Status.AMBIGUOUS
    expected[good] = Status.OK
    np.testing.assert_array_equal(status, expected)
