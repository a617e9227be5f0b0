"""What becomes of a whole set: the frames of one result, or a counted reason why not; no node needed."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Protocol

from std_msgs.msg import Header

from moire_sensor.errors import MoireError, PatternError
from moire_sensor.ros.camera_messages import FRAMES
from moire_sensor.ros.frame_ring import Frame, FrameRing
from moire_sensor.ros.projector_state import projector_state
from moire_sensor.ros.reconstruction_job import Exposure, Job
from moire_sensor.ros.reconstruction_report import GATHERING, LASER_OFF
from moire_sensor.ros.reconstruction_settings import OutputSettings, SensorSettings
from moire_sensor.ros.sensor_cache import Calibration
from moire_sensor.ros.set_matcher import MatchedSet


class Ledger(Protocol):
    """Counts what becomes of sets."""

    laser_on: bool | None

    def count(self, name: str, number: int = 1) -> None:
        """Count what became of a set."""

    def refuse(self, reason: str, text: str) -> None:
        """Count a refused set."""

    def refuse_for(self, error: MoireError) -> None:
        """Count a set refused for an error."""


class SetIntake:
    """Turn whole sets into jobs: one a set, or for ``phase_shift`` one for the last frames of a programme."""

    def __init__(self) -> None:
        self._ring: FrameRing[Exposure] = FrameRing()

    def clear(self) -> None:
        """Forget the frames that were gathered (stamps or settings changed)."""
        self._ring.clear()

    def job(
        self,
        matched: MatchedSet[Any],
        calibration: Calibration | None,
        settings: SensorSettings,
        output: OutputSettings,
        ledger: Ledger,
        missing: Sequence[str] = (),
    ) -> Job | None:
        """Return what is to be done now that a set is whole; None, and counted, where nothing is.

        ``missing`` : topics that the calibration waits for, where there is none.
        """
        if matched.after_jump:
            self._ring.clear()
        try:
            state = projector_state(matched.items["state"])
        except PatternError as error:
            ledger.refuse_for(error)
            return None
        ledger.laser_on = state.laser_on
        if not state.laser_on:
            ledger.refuse(LASER_OFF, "the projector is off; switch it on with projector/enable")
            return None
        if calibration is None:
            topics = ", ".join(missing) or "a camera_info topic"
            ledger.refuse("no camera info", f"nothing came on {topics}; the head must publish it")
            return None
        frame = Frame(matched.stamp_ns, state, Exposure(matched.items["left"], matched.items["right"]))
        frames = self._ring.add(frame) if settings.method == "phase_shift" else (frame,)
        if frames is None:
            ledger.count(GATHERING)
            return None
        middle = frames[len(frames) // 2].item.left.header
        # Real cameras name their frames as they like; the rectified view keeps the left one's, as image_proc does.
        header = Header(stamp=middle.stamp, frame_id=middle.frame_id or FRAMES["left"])
        return Job(header, frames, calibration, settings, output, time.monotonic())
