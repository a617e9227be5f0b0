"""Surfaces whose views do not agree: what lies outside the depth range meets no order, and takes a wrong one.

The phases of a wrong order lie far apart, and do so all over a surface; noise, shading and texture move them either
way. So connected surfaces are judged as wholes, and only in images where something is amiss, for it takes its time.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.depth_refine import Match
from moire_sensor.depth_trust import JUMP_PX
from moire_sensor.depth_views import PATCH_PX
from moire_sensor.phase_carrier import Float32

# Enough pixels for a mean: every second row and column.
SAMPLE_PX = 2
# No surface of a valid scene lies as far off (thin poles in dim light 0.4), what stands behind the range 0.3 to 1.1.
FOREIGN_RAD = 0.5
# In an image that does not fit as a whole only surfaces as good as this are believed, and only if they make up this
# share of what was matched: 0.24 where half of a room lies behind the range, at most 0.05 with wrong images.
SURE_RAD, SURE_SHARE = 0.02, 0.15


def agreeing(match: Match, views_fit: bool) -> Match:
    """The match with disparities only on surfaces whose two phases agree.

    Parameters
    ----------
    match : the final match.
    views_fit : whether left and right view fit each other over most of the image. If not, only surfaces beyond doubt
        are kept, and none where they are few: then rig or pattern are wrong, not the depth range.
    """
    surface = surfaces(match.disparity_px)
    mismatch_rad, pixels = mismatch_of(surface, match.signed_mismatch_rad)
    agree = ~(mismatch_rad > FOREIGN_RAD) if views_fit else mismatch_rad < SURE_RAD
    if not views_fit and pixels[agree].sum() < SURE_SHARE * pixels.sum():
        agree[:] = False
    return replace(match, disparity_px=np.where(agree[surface], match.disparity_px, np.float32(np.nan)))


def surfaces(disparity: Float32) -> npt.NDArray[np.int32]:
    """Number of the connected surface of every pixel (H, W), 0 beside a jump and where the disparity is NaN."""
    inside = np.isfinite(disparity)
    inside[:, :-1] &= np.abs(np.diff(disparity, axis=1)) <= JUMP_PX
    inside[:-1] &= np.abs(np.diff(disparity, axis=0)) <= JUMP_PX
    return np.asarray(cv2.connectedComponents(inside.view(np.uint8), connectivity=4)[1], dtype=np.int32)


def mismatch_of(
    surface: npt.NDArray[np.int32], signed_mismatch_rad: Float32
) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.int64]]:
    """Mean absolute mismatch of the patches of every surface (n,), NaN of number 0, and its sampled pixels (n,)."""
    height, width = surface.shape
    count, across = int(surface.max()) + 1, -(-width // PATCH_PX)
    patch = np.arange(height)[:, None] // PATCH_PX * across + np.arange(width) // PATCH_PX
    patches = int(patch[-1, -1]) + 1
    every = np.s_[::SAMPLE_PX, ::SAMPLE_PX]
    surface, patch, signed_rad = surface[every], patch[every], signed_mismatch_rad[every]
    known = (surface > 0) & np.isfinite(signed_rad)
    place = surface[known].astype(np.int64) * patches + patch[known]
    total = np.bincount(place, signed_rad[known], count * patches).reshape(count, patches)
    pixels = np.bincount(surface[known], minlength=count)
    with np.errstate(invalid="ignore"):
        return np.abs(total).sum(axis=1) / pixels, pixels
