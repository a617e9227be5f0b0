"""One exposure programme of a simulated head, with its truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.pattern import FringePattern
from moire_sensor.rig import StereoRig

Grey = npt.NDArray[np.uint8] | npt.NDArray[np.uint16]


@dataclass(frozen=True, eq=False)
class HeadCapture:
    """Fringe images and the truth they were made from, aligned with the left view where not said otherwise.

    Attributes
    ----------
    left, right : uint8 or uint16 grey levels, (H, W) for a single shot, (n, H, W) for n > 1 steps.
    depth_m : (H, W) float32, z in the left optical frame at the pixel's centre; NaN where nothing is seen.
    covisible : (H, W) bool, the point at the pixel's centre is lit by the projector and seen by both cameras.
    lit : (H, W) bool, the point at the pixel's centre is lit by the projector.
    rig, pattern : what the images were made with.
    """

    left: Grey
    right: Grey
    depth_m: npt.NDArray[np.float32]
    covisible: npt.NDArray[np.bool_]
    lit: npt.NDArray[np.bool_]
    rig: StereoRig
    pattern: FringePattern


def stacked(frames: list[Grey]) -> Grey:
    """One image as it is, several as (n, H, W)."""
    if len(frames) == 1:
        return frames[0]
    if frames[0].dtype == np.uint8:
        return np.asarray(frames, dtype=np.uint8)
    return np.asarray(frames, dtype=np.uint16)
