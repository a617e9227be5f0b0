"""Ten thousand damaged sets through all that turns messages into numbers: each is used or refused, none crashes."""

from __future__ import annotations

import random
import tracemalloc
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from ros_mutations import damaged
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from moire_sensor import StereoRig
from moire_sensor.errors import MoireError
from moire_sensor.paper_rig import paper_rig
from moire_sensor.reconstructor import Reconstructor
from moire_sensor.ros.camera_messages import camera_infos
from moire_sensor.ros.frame_ring import pattern_of
from moire_sensor.ros.image_messages import image_message
from moire_sensor.ros.projector_state import ProjectorState, state_message
from moire_sensor.ros.reconstruction_job import grey_pair
from moire_sensor.ros.reconstruction_settings import SPECS, read_settings
from moire_sensor.ros.sensor_cache import SensorCache, calibration_of
from moire_sensor.ros.set_intake import SetIntake
from moire_sensor.ros.set_matcher import MatchedSet

SETS = 10_000
SIZE = (64, 48)
SETTINGS = read_settings({spec.name: spec.default for spec in SPECS})
# What may be kept of the last sets: their texts here, and a rectification and some sensors in the cache.
KEPT_BYTES = 2_000_000
# Tracing memory slows everything down: only the last sets are traced, the first of those left to settle.
WATCHED_FROM, SETTLED = 8500, 300


def small_rig() -> StereoRig:
    """The paper's rig seen by cameras of a tenth of the resolution."""
    scale = np.diag([0.1, 0.1, 1.0])
    rig = paper_rig()
    return StereoRig.from_projections(scale @ rig.P_left, scale @ rig.P_right, rig.P_projector, SIZE)


RIG = small_rig()
GREY = np.random.default_rng(0).integers(0, 256, SIZE[::-1], dtype=np.uint8)


@dataclass
class Ledger:
    """Counts what becomes of the sets, as the node does."""

    laser_on: bool | None = None
    outcomes: Counter[str] = field(default_factory=Counter)
    texts: list[str] = field(default_factory=list)

    def count(self, name: str, number: int = 1) -> None:
        self.outcomes[name] += number

    def refuse(self, reason: str, text: str) -> None:
        self.outcomes[reason] += 1
        self.texts.append(text)

    def refuse_for(self, error: MoireError) -> None:
        self.refuse(type(error).__name__, str(error))


def messages() -> dict[str, Any]:
    """A good set with its camera infos."""
    header = Header()
    images: dict[str, Any] = {side: image_message(header, GREY, "mono8") for side in ("left", "right")}
    state = state_message(header, ProjectorState(100.0, 0.0))
    infos = {f"{device}_info": info for device, info in camera_infos(RIG, header, (960, 480)).items()}
    return {**images, "state": state, **infos}


def convert(kept: dict[str, Any], stamp: int, intake: SetIntake, cache: SensorCache, ledger: Ledger) -> None:
    """Everything that the node does with a set but the reconstruction itself."""
    matched = MatchedSet(stamp, {name: kept[name] for name in ("left", "right", "state")})
    infos = {device: kept[f"{device}_info"] for device in ("left", "right", "projector")}
    job = intake.job(matched, calibration_of(infos), *SETTINGS, ledger)
    if job is None:
        return
    try:
        left, right = grey_pair(job.frames[0].item, job.calibration)
        pattern, _ = pattern_of(tuple(frame.state for frame in job.frames))
        pair = cache.pair(job.calibration)
        rectified = pair.rectify(left, right)
        Reconstructor(pair.rig, pattern)
    except MoireError as error:
        ledger.refuse_for(error)
    else:
        assert all(image.shape == SIZE[::-1] for image in rectified)
        ledger.count("used")


def test_each_is_used_or_refused_with_a_reason_and_nothing_is_kept() -> None:
    intake, cache, ledger, rng = SetIntake(), SensorCache(), Ledger(), random.Random(5)
    good = messages()
    convert(good, 0, intake, cache, ledger)
    assert ledger.outcomes == {"used": 1}
    for number in range(SETS):
        if number == WATCHED_FROM:
            tracemalloc.start()
        if number == WATCHED_FROM + SETTLED:
            before = tracemalloc.get_traced_memory()[0]
        kept = dict(good)
        damaged(kept, rng)
        convert(kept, number, intake, cache, ledger)
    grown = tracemalloc.get_traced_memory()[0] - before
    tracemalloc.stop()
    assert sum(ledger.outcomes.values()) == SETS + 1
    assert set(ledger.outcomes) == {"used", "laser off", "ImageError", "PatternError", "RigError", "SettingsError"}
    assert grown < KEPT_BYTES
    assert len(ledger.texts) > SETS // 2
    assert all(len(text) < 1000 and "\n" not in text for text in ledger.texts)


def test_an_image_larger_than_reason_is_refused_before_anything_is_built() -> None:
    kept = messages()
    kept["left_info"].width = kept["left_info"].height = 16384
    ledger = Ledger()
    convert(kept, 0, SetIntake(), SensorCache(), ledger)
    assert ledger.outcomes == {"ImageError": 1}
    kept["left"] = Image(encoding="mono8", width=16384, height=16384, step=16384)
    convert(kept, 1, SetIntake(), SensorCache(), ledger)
    assert "at most 134217728 bytes" in ledger.texts[-1]
