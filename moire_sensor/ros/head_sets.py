"""Sets of a head: images and state matched by stamp, with the calibration in force; no node needed."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import CameraInfo, Image, JointState

from moire_sensor.ros.camera_messages import info_of_rectified
from moire_sensor.ros.sensor_cache import Calibration, calibration_of
from moire_sensor.ros.set_matcher import MatchedSet, SetMatcher

STREAM_TOPICS: dict[str, tuple[str, Any]] = {
    "left": ("left/image_raw", Image),
    "right": ("right/image_raw", Image),
    "state": ("projector/state", JointState),
}
INFO_TOPICS = {device: f"{device}/camera_info" for device in ("left", "right", "projector")}
# Sets that came before the camera infos; at 30 Hz the infos may come a third of a second late.
HELD_SETS = 10
NANOSECONDS = 1_000_000_000
Taker = Callable[[MatchedSet[Any], Calibration | None], None]


def stamp_ns(message: Any) -> int:
    """Return the stamp of a stamped message in nanoseconds."""
    return int(message.header.stamp.sec) * NANOSECONDS + int(message.header.stamp.nanosec)


class HeadSets:
    """Take the messages of a head as they come; ``take`` is called with each whole set.

    With the set comes the calibration in force, None where a camera info is still missing after a while. Camera infos
    tell of raw images, unless the images come ``rectified`` already.
    """

    def __init__(self, take: Taker, rectified: bool = False) -> None:
        self._rectified = rectified
        self.matcher: SetMatcher[Any] = SetMatcher(tuple(STREAM_TOPICS))
        self._take = take
        self._infos: dict[str, CameraInfo] = {}
        self._calibration: Calibration | None = None
        self._held: deque[MatchedSet[Any]] = deque()

    @property
    def missing_infos(self) -> list[str]:
        """Topics of the camera infos that have not come yet."""
        return [topic for device, topic in INFO_TOPICS.items() if device not in self._infos]

    @property
    def calibration(self) -> Calibration | None:
        """The camera infos in force, None while one is missing."""
        if self._calibration is None and not self.missing_infos:
            self._calibration = calibration_of(self._infos)
        return self._calibration

    def clear(self, reason: str) -> None:
        """Forget what was not matched yet."""
        self.matcher.clear(reason)
        self._held.clear()

    def add(self, stream: str, message: Any) -> None:
        """Take a message of ``"left"``, ``"right"`` or ``"state"``."""
        matched = self.matcher.add(stream, stamp_ns(message), message)
        if matched is not None:
            self._held.append(matched)
            self._release()

    def add_info(self, device: str, message: CameraInfo) -> None:
        """Take the camera info of ``"left"``, ``"right"`` or ``"projector"``; it holds until the next."""
        self._infos[device] = info_of_rectified(message) if self._rectified and device != "projector" else message
        self._calibration = None
        self._release()

    def give_up(self) -> None:
        """Hand on what still waits for camera infos: none will come any more (the end of a bag)."""
        while self._held:
            self._take(self._held.popleft(), self.calibration)

    def _release(self) -> None:
        """Hand on what is held once all infos are there; before that, only what is too much to hold."""
        most = HELD_SETS if self.missing_infos else 0
        while len(self._held) > most:
            self._take(self._held.popleft(), self.calibration)
