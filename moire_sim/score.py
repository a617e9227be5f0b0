"""How good a depth image is, against the truth of a simulated capture."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.errors import ImageError
from moire_sim.capture import HeadCapture

Mask = npt.NDArray[np.bool_]
OUTLIER_PX = 1.0
GHOST_PX = 3.0
EDGE_BAND_PX = 10.0


class HasDepth(Protocol):
    """Anything with a depth image, such as :class:`moire_sensor.Shot`."""

    @property
    def depth_m(self) -> npt.NDArray[np.float32]:
        """Depth (H, W), metres, NaN where unknown."""


@dataclass(frozen=True)
class Score:
    """Accuracy of one depth image.

    "Co-visible" pixels are lit by the projector and seen by both cameras (``capture.covisible``). A pixel is "off" by
    the difference of its disparity from the true one. Depth errors are scaled to 1 m: each is multiplied by
    (1 m / z)^2 with the true z, because a disparity error grows so. "Edges" are depth jumps and the borders of light
    and of visibility; "near" is up to 10 px. Shares are 0 to 1; a share or median of no pixels is NaN.

    Attributes
    ----------
    completeness, completeness_away : share of the co-visible pixels that have a depth; of those away from edges.
    outlier_share : of the co-visible pixels with a depth, the share off by more than 1 px.
    median_error_mm : median absolute depth error scaled to 1 m, of the co-visible pixels with a depth.
    median_error_mm_away, median_error_mm_near : the same away from edges and near them.
    outlier_share_away, outlier_share_near : ``outlier_share`` away from edges and near them.
    ghost_share : share of all pixels that are not co-visible yet have a depth off by more than 3 px (or on nothing).
    covisible_share : share of all pixels that are co-visible.
    """

    completeness: float
    outlier_share: float
    median_error_mm: float
    median_error_mm_away: float
    median_error_mm_near: float
    outlier_share_away: float
    outlier_share_near: float
    ghost_share: float
    covisible_share: float
    completeness_away: float = float("nan")

    @property
    def right_share(self) -> float:
        """Share of the co-visible pixels that have a depth within 1 px: a wrong answer does not complete a picture."""
        return self.completeness * (1.0 - (0.0 if math.isnan(self.outlier_share) else self.outlier_share))


def score(shot: HasDepth, capture: HeadCapture) -> Score:
    """Compare ``shot.depth_m`` (H, W) with the truth of ``capture``; raises as :func:`score_depth`."""
    return score_depth(shot.depth_m, capture)


def score_depth(depth_m: npt.NDArray[np.floating[Any]], capture: HeadCapture) -> Score:
    """Compare a depth image (H, W), metres, NaN where unknown, with the truth of ``capture``.

    Raises
    ------
    ImageError
        A depth image of another size.
    """
    if depth_m.shape != capture.depth_m.shape:
        raise ImageError(
            f"the depth image has shape {depth_m.shape}; the truth has {capture.depth_m.shape}: "
            "give a shot of this capture"
        )
    off_px = np.abs(disparity_error_px(depth_m, capture))
    error_mm = scaled_error_mm(depth_m, capture)
    known = np.isfinite(depth_m)
    judged = known & capture.covisible
    near = near_edges(capture)
    ghosts = known & ~capture.covisible & ~(off_px <= GHOST_PX)
    return Score(
        completeness=share(known, capture.covisible),
        outlier_share=share(off_px > OUTLIER_PX, judged),
        median_error_mm=median(error_mm, judged),
        median_error_mm_away=median(error_mm, judged & ~near),
        median_error_mm_near=median(error_mm, judged & near),
        outlier_share_away=share(off_px > OUTLIER_PX, judged & ~near),
        outlier_share_near=share(off_px > OUTLIER_PX, judged & near),
        ghost_share=float(ghosts.mean()),
        covisible_share=float(capture.covisible.mean()),
        completeness_away=share(known, capture.covisible & ~near),
    )


def disparity_error_px(depth_m: npt.NDArray[np.floating[Any]], capture: HeadCapture) -> npt.NDArray[np.float64]:
    """Disparity minus true disparity (H, W), NaN where either depth is unknown."""
    return np.asarray(capture.rig.disparity_px(depth_m) - capture.rig.disparity_px(capture.depth_m))


def scaled_error_mm(depth_m: npt.NDArray[np.floating[Any]], capture: HeadCapture) -> npt.NDArray[np.float64]:
    """Absolute depth error (H, W) in millimetres scaled to 1 m, NaN where either depth is unknown."""
    true_m = capture.depth_m.astype(np.float64)
    return np.asarray(np.abs(depth_m - true_m) * 1e3 / true_m**2)


def near_edges(capture: HeadCapture, band_px: float = EDGE_BAND_PX) -> Mask:
    """Pixels (H, W) within ``band_px`` of a depth jump or of a border of light or visibility."""
    disparity = capture.rig.disparity_px(np.nan_to_num(capture.depth_m, nan=1e3)).astype(np.float32)
    edge = bends(disparity) | borders(capture.lit) | borders(capture.covisible)
    away_px = cv2.distanceTransform((~edge).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away_px <= band_px)


def bends(disparity_px: npt.NDArray[np.float32]) -> Mask:
    """Pixels (H, W) where disparity jumps: its second difference along a row or column exceeds 1 px."""
    jump = np.zeros(disparity_px.shape, dtype=np.bool_)
    jump[:, 1:-1] |= np.abs(np.diff(disparity_px, 2, axis=1)) > 1.0
    jump[1:-1] |= np.abs(np.diff(disparity_px, 2, axis=0)) > 1.0
    return jump


def borders(mask: Mask) -> Mask:
    """Pixels (H, W) with a 4-neighbour on the other side of the mask."""
    image = mask.astype(np.uint8)
    cross = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))
    return np.asarray(cv2.dilate(image, cross) != cv2.erode(image, cross))


def share(chosen: Mask, among: Mask) -> float:
    """Share of the pixels of ``among`` that are ``chosen``; NaN when there are none."""
    return float(chosen[among].mean()) if among.any() else float("nan")


def median(values: npt.NDArray[np.float64], among: Mask) -> float:
    """Median of ``values`` over ``among``; NaN when there are none."""
    return float(np.median(values[among])) if among.any() else float("nan")
