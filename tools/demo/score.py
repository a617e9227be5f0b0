"""Compares what a run recorded with the truth, or, for a real capture, with what is known about it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from rosbags.typesys import Stores, get_typestore

from moire_sensor.capture_folder import Capture
from moire_sensor.ros.bag_reader import read_messages
from moire_sim.capture import HeadCapture
from moire_sim.score import Score, score_depth
from tools.demo.record import DEPTH_TOPIC, DemoError, Recording

Depth = npt.NDArray[np.float32]
# What the demo demands of each depth image of a scene: shares of co-visible pixels, and millimetres scaled to 1 m.
MIN_COMPLETENESS, MAX_OUTLIER_SHARE, MAX_MEDIAN_ERROR_MM = 0.95, 0.02, 0.3
# And of a capture: depth where the fringes are strong, on a smooth surface within the folder's depth range.
STRONG_MODULATION = 12.0
MIN_COVERAGE = {"phase_shift": 0.90, "dense": 0.80}
MAX_ROUGH_SHARE, ROUGH_M, MEDIAN_WINDOW_PX = 0.02, 0.005, 15

_TYPES = get_typestore(Stores.ROS2_JAZZY)
_PIXELS = {"32FC1": np.float32, "16SC1": np.int16, "mono8": np.uint8, "mono16": np.uint16, "8UC1": np.uint8}


@dataclass(frozen=True)
class SceneResult:
    """The scores of every recorded depth image of a scene; the worst of each figure is judged."""

    scores: tuple[Score, ...]

    @property
    def completeness(self) -> float:
        """Least share of the co-visible pixels that have a depth."""
        return min(one.completeness for one in self.scores)

    @property
    def outlier_share(self) -> float:
        """Largest share of them that is off by more than 1 px of disparity."""
        return max(one.outlier_share for one in self.scores)

    @property
    def median_error_mm(self) -> float:
        """Largest median depth error scaled to 1 m, millimetres."""
        return max(one.median_error_mm for one in self.scores)

    def complaints(self) -> list[str]:
        """Say what is not good enough."""
        found = []
        if not self.completeness >= MIN_COMPLETENESS:
            found.append(f"completeness {self.completeness:.4f}, at least {MIN_COMPLETENESS} is demanded")
        if not self.outlier_share <= MAX_OUTLIER_SHARE:
            allowed = f"at most {MAX_OUTLIER_SHARE} is allowed"
            found.append(f"share off by more than 1 px {self.outlier_share:.4f}, {allowed}")
        if not self.median_error_mm <= MAX_MEDIAN_ERROR_MM:
            found.append(f"median error {self.median_error_mm:.3f} mm at 1 m, at most {MAX_MEDIAN_ERROR_MM} is allowed")
        return found


@dataclass(frozen=True)
class CaptureResult:
    """What a depth image of a real capture shows where the fringes are strong.

    Attributes
    ----------
    coverage : least share of the strongly modulated pixels that have a depth.
    nearest_m, farthest_m : 1st and 99th percentile of those depths.
    rough_share : largest share of them more than 5 mm from the median of the 15x15 pixels around.
    depth_range_m : what the folder says.
    """

    method: str
    coverage: float
    nearest_m: float
    farthest_m: float
    rough_share: float
    depth_range_m: tuple[float, float]

    def complaints(self) -> list[str]:
        """Say what is not good enough."""
        found = []
        least = MIN_COVERAGE[self.method]
        if not self.coverage >= least:
            found.append(f"depth on {self.coverage:.3f} of the well modulated pixels, at least {least} is demanded")
        near_m, far_m = self.depth_range_m
        if not near_m < self.nearest_m < self.farthest_m < far_m:
            found.append(f"depth from {self.nearest_m:.3f} to {self.farthest_m:.3f} m, outside {near_m} to {far_m} m")
        if not self.rough_share <= MAX_ROUGH_SHARE:
            found.append(f"{self.rough_share:.4f} of it is rough, at most {MAX_ROUGH_SHARE} is allowed")
        return found


def read_images(bag: Path, topic: str) -> list[npt.NDArray[Any]]:
    """Return all images (H, W) of a topic of a bag, in order."""
    images = []
    for message in read_messages(bag):
        if message.topic == topic:
            decoded: Any = _TYPES.deserialize_cdr(message.serialized, "sensor_msgs/msg/Image")
            pixels = np.frombuffer(decoded.data, _PIXELS[decoded.encoding])
            images.append(pixels.reshape(decoded.height, decoded.width))
    return images


def score_scene(recording: Recording, capture: HeadCapture) -> SceneResult:
    """Score every recorded depth image against the truth, which must be what the head published as such.

    Raises
    ------
    DemoError
        No depth was recorded, or the published truth is another.
    """
    depths = read_images(recording.bag, DEPTH_TOPIC)
    if not depths:
        raise DemoError(f"the bag {recording.bag} holds no depth image")
    if recording.truth_m is None or not np.array_equal(recording.truth_m, capture.depth_m, equal_nan=True):
        raise DemoError("the topic ground_truth/depth differs from the simulator's own depth")
    return SceneResult(tuple(score_depth(depth, capture) for depth in depths))


def score_capture(depths: list[Depth], method: str, capture: Capture) -> CaptureResult:
    """Judge the depth images of a capture; the worst of each figure counts."""
    if not depths:
        raise DemoError("no depth image came back from the capture")
    strong = modulation(capture) > STRONG_MODULATION
    known = [depth[strong & np.isfinite(depth)] for depth in depths]
    return CaptureResult(
        method=method,
        coverage=min(values.size / max(int(strong.sum()), 1) for values in known),
        nearest_m=min(float(np.percentile(values, 1)) if values.size else np.nan for values in known),
        farthest_m=max(float(np.percentile(values, 99)) if values.size else np.nan for values in known),
        rough_share=max(rough_share(np.where(strong, depth, np.nan)) for depth in depths),
        depth_range_m=capture.depth_range_m,
    )


def modulation(capture: Capture) -> npt.NDArray[np.float64]:
    """Fringe amplitude (H, W) in grey levels of the left view.

    By least squares over all frames; with fewer than three different steps, from the spread over 31x31 pixels, a
    sine's standard deviation being its amplitude by the square root of two.
    """
    left, _ = capture.stack()
    steps = [capture.pattern.step_phases_rad[capture.step_index(frame)] for frame in range(capture.frame_count)]
    model = np.stack([np.ones(len(steps)), np.cos(steps), np.sin(steps)], axis=1)
    if np.linalg.matrix_rank(model) < 3:
        image = left[0].astype(np.float64)
        variance = cv2.blur(image * image, (31, 31)) - cv2.blur(image, (31, 31)) ** 2
        return np.asarray(np.sqrt(2.0 * np.maximum(variance, 0.0)))
    fitted = np.linalg.pinv(model) @ left.reshape(len(steps), -1).astype(np.float64)
    return np.asarray(np.hypot(fitted[1], fitted[2]).reshape(left.shape[1:]))


def rough_share(depth_m: Depth) -> float:
    """Share of the known depths (H, W) more than 5 mm from the median of the known ones in 15x15 pixels around."""
    known = np.isfinite(depth_m)
    rough = np.abs(depth_m - local_median(depth_m)) > ROUGH_M
    return float(np.count_nonzero(rough[known])) / max(int(known.sum()), 1)


def local_median(depth_m: Depth) -> Depth:
    """Median of the known depths in 15x15 pixels around each known pixel (H, W); NaN at unknown ones."""
    half = MEDIAN_WINDOW_PX // 2
    padded = np.pad(depth_m, half, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (MEDIAN_WINDOW_PX, MEDIAN_WINDOW_PX))
    medians = np.full_like(depth_m, np.nan)
    for row, known in enumerate(np.isfinite(depth_m)):
        columns = np.flatnonzero(known)
        if columns.size:
            medians[row, columns] = np.nanmedian(windows[row, columns].reshape(columns.size, -1), axis=1)
    return medians
