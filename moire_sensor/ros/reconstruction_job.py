"""One unit of work of the reconstruction node: messages of one result to a shot; no node needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from moire_sensor.reconstructor import Reconstructor
from moire_sensor.ros.frame_ring import Frame, pattern_of
from moire_sensor.ros.image_messages import GreyImage, grey_image
from moire_sensor.ros.reconstruction_settings import OutputSettings, SensorSettings
from moire_sensor.ros.sensor_cache import Calibration, SensorCache
from moire_sensor.shot import Shot


@dataclass(frozen=True)
class Exposure:
    """The image messages of one exposure, as they came."""

    left: Image
    right: Image


@dataclass(frozen=True)
class Job:
    """What one result needs; ``header`` is that of the result, with the stamp of the middle frame."""

    header: Header
    frames: tuple[Frame[Exposure], ...]
    calibration: Calibration
    settings: SensorSettings
    output: OutputSettings


@dataclass(frozen=True)
class Result:
    """A shot with the reconstructor that made it."""

    sensor: Reconstructor
    shot: Shot

    def facts(self) -> dict[str, Any]:
        """Return what the diagnostics show of the last result."""
        near_m, far_m = self.sensor.depth_range_m
        return {
            "unknown share": float(np.isnan(self.shot.depth_m).mean()),
            "min depth m": near_m,
            "max depth m": far_m,
            "method": self.sensor.method,
            "fringe period px": self.sensor.pattern.period_px,
            "step count": self.sensor.pattern.step_count,
            "waveform": self.sensor.pattern.waveform,
        }


def reconstruct(job: Job, cache: SensorCache) -> Result:
    """Convert, rectify and reconstruct.

    Raises
    ------
    MoireError
        Images, calibration, pattern or settings that cannot be used.
    """
    states = tuple(frame.state for frame in job.frames)
    pattern, first_step = pattern_of(states)
    depth_range_m = job.settings.depth_range_m(states[-1].depth_range_m)
    sensor = cache.sensor(job.calibration, pattern, depth_range_m, job.settings)
    left, right = rectified_images(job, cache)
    return Result(sensor, sensor.reconstruct(left, right, first_step))


def rectified_images(job: Job, cache: SensorCache) -> tuple[GreyImage, GreyImage]:
    """Return rectified images, (H, W) of one frame or (n, H, W) of several."""
    pair = cache.pair(job.calibration)
    rectified = [
        pair.rectify(grey_image("left", frame.item.left), grey_image("right", frame.item.right))
        for frame in job.frames
    ]
    if len(rectified) == 1:
        return rectified[0]
    left, right = zip(*rectified, strict=True)
    return np.stack(left), np.stack(right)
