"""Rectifications and reconstructors, built when camera infos, pattern or settings change and kept while they last."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

from moire_sensor.camera_info import rectification_from_camera_info
from moire_sensor.pattern import FringePattern
from moire_sensor.reconstructor import Reconstructor
from moire_sensor.rectify import RectifiedPair
from moire_sensor.ros.reconstruction_settings import SensorSettings

# A dense programme has a pattern for each step; more than this many at once is a head that never repeats itself.
KEPT_SENSORS = 8


@dataclass(frozen=True)
class Calibration:
    """The three camera infos in force; ``key`` changes with any number in them that matters."""

    infos: dict[str, Any]
    key: Hashable


def calibration_of(infos: dict[str, Any]) -> Calibration:
    """Return the infos ``left``, ``right`` and ``projector`` with a key of their content, stamps apart."""
    key = tuple(
        (info.width, info.height, info.distortion_model, *map(tuple, (info.d, info.k, info.r, info.p)))
        for info in (infos["left"], infos["right"], infos["projector"])
    )
    return Calibration(dict(infos), key)


class SensorCache:
    """Build what a set needs, or hand out what was built for the same calibration, pattern and settings."""

    def __init__(self) -> None:
        self._pair_key: Hashable = None
        self._pair: RectifiedPair | None = None
        self._sensors: OrderedDict[Hashable, Reconstructor] = OrderedDict()

    def pair(self, calibration: Calibration) -> RectifiedPair:
        """Return the rectification; raises RigError for infos that are no rectifiable pair."""
        if self._pair is None or self._pair_key != calibration.key:
            infos = calibration.infos
            self._pair = rectification_from_camera_info(infos["left"], infos["right"], infos["projector"])
            self._pair_key = calibration.key
            self._sensors.clear()
        return self._pair

    def sensor(
        self,
        calibration: Calibration,
        pattern: FringePattern,
        depth_range_m: tuple[float, float],
        settings: SensorSettings,
    ) -> Reconstructor:
        """Return the reconstructor; raises MoireError for a rig, pattern or settings that do not go together."""
        rig = self.pair(calibration).rig
        key = (pattern, depth_range_m, settings)
        if key not in self._sensors:
            self._sensors[key] = Reconstructor(
                rig, pattern, depth_range_m, settings.method, settings.saturation_level, settings.settings
            )
        self._sensors.move_to_end(key)
        if len(self._sensors) > KEPT_SENSORS:
            self._sensors.popitem(last=False)
        return self._sensors[key]


class ThreadCaches(threading.local):
    """One cache a thread, since reconstructors have work memory of their own.

    Attributes
    ----------
    own : the cache of the thread that asks.
    """

    def __init__(self) -> None:
        self.own = SensorCache()
