"""One unit of work of the reconstruction node: messages of one result to a shot; no node needed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from moire_sensor.errors import ImageError
from moire_sensor.reconstructor import Reconstructor
from moire_sensor.ros.frame_ring import Frame, pattern_of
from moire_sensor.ros.image_messages import GreyImage, grey_image
from moire_sensor.ros.reconstruction_settings import OutputSettings, SensorSettings
from moire_sensor.ros.sensor_cache import Calibration, SensorCache
from moire_sensor.ros.shot_facts import shot_facts
from moire_sensor.shot import Shot
from moire_sensor.view_alignment import measure_alignment

# Pixels at an edge that one camera's grey level alone, or a bridge, gave a depth are less certain than this.
MEASURED_PX = 0.3


@dataclass(frozen=True)
class Exposure:
    """The image messages of one exposure, as they came."""

    left: Image
    right: Image


@dataclass(frozen=True)
class Job:
    """What one result needs.

    Attributes
    ----------
    header : that of the result, with the stamp of the middle frame.
    taken_s : when the set was whole, seconds of ``time.monotonic``.
    """

    header: Header
    frames: tuple[Frame[Exposure], ...]
    calibration: Calibration
    settings: SensorSettings
    output: OutputSettings
    taken_s: float = 0.0


@dataclass(frozen=True)
class Result:
    """A shot with the reconstructor that made it."""

    sensor: Reconstructor
    shot: Shot

    def facts(self) -> dict[str, Any]:
        """Return what the diagnostics show of the last result."""
        return shot_facts(self.sensor, self.shot)


def reconstruct(job: Job, cache: SensorCache) -> Result:
    """Convert, rectify and reconstruct.

    Raises
    ------
    MoireError
        Images, calibration, pattern or settings that cannot be used.
    """
    # Images first: what is built for camera infos is as large as they say, and then that is as large as real images.
    pairs = [grey_pair(frame.item, job.calibration) for frame in job.frames]
    states = tuple(frame.state for frame in job.frames)
    pattern, first_step = pattern_of(states)
    depth_range_m = job.settings.depth_range_m(states[-1].depth_range_m)
    sensor = cache.sensor(job.calibration, pattern, depth_range_m, job.settings)
    rectification = cache.pair(job.calibration)
    left, right = zip(*(rectification.rectify(*pair) for pair in pairs), strict=True)
    if len(pairs) == 1:
        return Result(sensor, sensor.reconstruct(left[0], right[0], first_step))
    return Result(sensor, sensor.reconstruct(np.stack(left), np.stack(right), first_step))


def alignment_facts(job: Job, result: Result, cache: SensorCache) -> dict[str, Any]:
    """Return row offset and period error of the middle exposure, for the diagnostics; see ``view_alignment``."""
    frame = job.frames[len(job.frames) // 2]
    left, right = cache.pair(job.calibration).rectify(*grey_pair(frame.item, job.calibration))
    pattern, _ = pattern_of((frame.state,))
    sensor = result.sensor
    found = measure_alignment(sensor.rig, pattern, left, right, measured_m(result), sensor.depth_range_m)
    return {"row offset px": found.row_offset_px, "period error": found.period_error}


def measured_m(result: Result) -> npt.NDArray[np.float32]:
    """Depth of the pixels that both cameras measured, NaN where one alone or a neighbour told it."""
    shot, rig = result.shot, result.sensor.rig
    sigma_px = shot.depth_sigma_m * (rig.fx_px * rig.baseline_m) / shot.depth_m**2
    return np.where(sigma_px < MEASURED_PX, shot.depth_m, np.float32(np.nan))


def grey_pair(exposure: Exposure, calibration: Calibration) -> tuple[GreyImage, GreyImage]:
    """Return left and right image (H, W); raises ImageError for those that cannot be read or are of another size."""
    images = grey_image("left", exposure.left), grey_image("right", exposure.right)
    for name, image in zip(("left", "right"), images, strict=True):
        info = calibration.infos[name]
        if image.shape != (info.height, info.width):
            raise ImageError(
                f"the {name} image is {image.shape[1]}x{image.shape[0]} and {name}/camera_info is for "
                f"{info.width}x{info.height}: calibrate at this size or set the camera to it"
            )
    return images
