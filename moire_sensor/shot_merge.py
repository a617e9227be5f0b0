"""What moved too much between the steps, taken from the middle exposure alone."""

from __future__ import annotations

from dataclasses import fields, replace

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.shot import Shot, Status

# Fewer pixels that moved are noise, and not worth a reconstruction of their own.
FEWEST_PX = 60
TAKEN = ("depth_m", "depth_sigma_m", "disparity_px", "fringe_order", "confidence")


def moved_region(shot: Shot, reach_px: int) -> npt.NDArray[np.bool_]:
    """Pixels (H, W) without depth that moved, or lie next to such: their partner in the other view moved, or windows
    up to ``reach_px`` took in what did."""
    moved = (shot.status == Status.MOVED).astype(np.uint8)
    if np.count_nonzero(moved) < FEWEST_PX:
        return np.zeros(moved.shape, dtype=np.bool_)
    around = cv2.dilate(moved, np.ones((2 * reach_px + 1, 2 * reach_px + 1), dtype=np.uint8))
    return np.asarray((around > 0) & ~np.isfinite(shot.depth_m))


def taken_from(single: Shot, shot: Shot, region: npt.NDArray[np.bool_]) -> Shot:
    """Return ``shot`` with what ``single`` knows of a region, marked FROM_SINGLE_SHOT."""
    taken = region & np.isfinite(single.depth_m)
    images = {field.name: getattr(shot, field.name).copy() for field in fields(shot) if field.name in TAKEN}
    for name, image in images.items():
        image[taken] = getattr(single, name)[taken]
    status = np.where(taken, np.uint8(Status.FROM_SINGLE_SHOT), shot.status)
    return replace(shot, status=status, **images)
