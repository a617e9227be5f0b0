"""OpenCV's block matchers, set up for a rig and a depth range: the usual matchers of active stereo."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.rig import StereoRig

Depth = npt.NDArray[np.float32]
Grey8 = npt.NDArray[np.uint8]
Kind = Literal["StereoBM", "SGBM 3-way", "SGBM HH"]
KINDS: tuple[Kind, ...] = ("StereoBM", "SGBM 3-way", "SGBM HH")
# OpenCV's disparities are multiples of 1/16 px.
SUBPIXELS = 16.0
# Specks up to this area (px) go, as in OpenCV's samples; neighbours within 2 px belong together.
SPECK_AREA_PX, SPECK_STEP_PX = 100, 2
UNIQUENESS_PERCENT = 10
LEFT_RIGHT_PX = 1
MARGIN_PX = 2


@dataclass(frozen=True)
class BlockMatcher:
    """One matcher with a square window of ``window_px`` (odd).

    Both matchers leave out the columns of the left image whose farthest candidate would lie outside the right image.
    So that they answer at the whole image, both pictures are mirrored outwards first; the answer is cut back.
    """

    kind: Kind
    window_px: int
    rig: StereoRig
    depth_range_m: tuple[float, float]

    @property
    def name(self) -> str:
        """The matcher and its window."""
        return f"{self.kind} {self.window_px}"

    def disparities(self) -> tuple[int, int]:
        """Least disparity and the number of them, a multiple of 16 px."""
        farthest, nearest = (float(self.rig.disparity_px(depth)) for depth in reversed(self.depth_range_m))
        least = int(np.floor(farthest)) - MARGIN_PX
        return least, 16 * int(np.ceil((nearest + MARGIN_PX - least) / 16.0))

    def build(self) -> Any:
        """Return OpenCV's matcher."""
        least, count = self.disparities()
        if self.kind == "StereoBM":
            matcher = cv2.StereoBM.create(count, self.window_px)
            matcher.setMinDisparity(least)
            matcher.setUniquenessRatio(UNIQUENESS_PERCENT)
            matcher.setDisp12MaxDiff(LEFT_RIGHT_PX)
            matcher.setSpeckleWindowSize(SPECK_AREA_PX)
            matcher.setSpeckleRange(SPECK_STEP_PX)
            return matcher
        area = self.window_px**2
        return cv2.StereoSGBM.create(
            minDisparity=least,
            numDisparities=count,
            blockSize=self.window_px,
            P1=8 * area,
            P2=32 * area,
            disp12MaxDiff=LEFT_RIGHT_PX,
            preFilterCap=31,
            uniquenessRatio=UNIQUENESS_PERCENT,
            speckleWindowSize=SPECK_AREA_PX,
            speckleRange=SPECK_STEP_PX,
            mode=cv2.STEREO_SGBM_MODE_HH if self.kind == "SGBM HH" else cv2.STEREO_SGBM_MODE_SGBM_3WAY,
        )

    def depth_m(self, matcher: Any, left: Grey8, right: Grey8) -> Depth:
        """Depth (H, W), metres, NaN where the matcher has none; images are 8-bit (H, W)."""
        least, count = self.disparities()
        height, width = left.shape
        rim, wide = self.window_px // 2 + 1, least + count + self.window_px // 2 + 1
        padded = [
            cv2.copyMakeBorder(image, rim, rim, wide, rim, cv2.BORDER_REFLECT_101) for image in (left, right)
        ]
        whole = matcher.compute(*padded)[rim : rim + height, wide : wide + width]
        disparity = whole.astype(np.float32) / np.float32(SUBPIXELS)
        disparity[whole < least * SUBPIXELS] = np.nan
        return self.rig.depth_m(disparity).astype(np.float32)
