"""The parameters of the reconstruction node and what they mean to the core."""

from __future__ import annotations

import inspect
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from moire_sensor.errors import SettingsError
from moire_sensor.nav_cloud import NavSettings
from moire_sensor.reconstructor import DEFAULT_DEPTH_RANGE_M, METHODS, Reconstructor
from moire_sensor.ros.parameters import ParameterSpec, specs_of
from moire_sensor.ros.shot_messages import DEPTH_ENCODINGS
from moire_sensor.ros.thresholds import Thresholds
from moire_sensor.settings import Settings

_CORE = inspect.signature(Reconstructor).parameters
_RANGE_TEXT = "m; 0 takes the range that projector/state tells, or else {:g}"

SPECS = (
    ParameterSpec("method", _CORE["method"].default, "reconstruction method", choices=METHODS),
    ParameterSpec(
        "min_depth_m", 0.0, "nearest depth, " + _RANGE_TEXT.format(DEFAULT_DEPTH_RANGE_M[0]), 0.0, 100.0
    ),
    ParameterSpec(
        "max_depth_m", 0.0, "farthest depth, " + _RANGE_TEXT.format(DEFAULT_DEPTH_RANGE_M[1]), 0.0, 100.0
    ),
    ParameterSpec(
        "saturation_level",
        float(_CORE["saturation_level"].default),
        "grey level of a saturated pixel: 255 for 8 bit, e.g. 4095 for 12 bit in mono16",
        1.0,
        65535.0,
    ),
    ParameterSpec(
        "depth_encoding", DEPTH_ENCODINGS[0], "32FC1: m, NaN unknown; 16UC1: mm, 0 unknown", choices=DEPTH_ENCODINGS
    ),
    ParameterSpec("diagnostics_period_s", 1.0, "time between diagnostics, s", 0.05, 60.0),
    ParameterSpec(
        "queue_depth",
        2,
        "sets that may wait while one is worked on; the oldest give way, and after as many all but the newest, until"
        " the node has caught up",
        1,
        1000,
    ),
    ParameterSpec(
        "parallel_sets",
        1,
        "sets worked on at a time, which share the kernels' threads: more of them give more results a second, each of"
        " which takes longer, and take memory each",
        1,
        16,
        read_only=True,
    ),
    ParameterSpec(
        "autostart", True, "configure and activate at once; false waits for lifecycle transitions", read_only=True
    ),
    ParameterSpec(
        "reliable_input",
        False,
        "subscribe reliable with depth 10 instead of sensor data with depth 5, so that nothing is lost",
        read_only=True,
    ),
    ParameterSpec(
        "input_rectified",
        False,
        "the images are rectified already, as by image_proc; false: the node rectifies them by their camera infos",
        read_only=True,
    ),
    *specs_of(Thresholds),
    *specs_of(NavSettings),
    *specs_of(Settings),
)


@dataclass(frozen=True)
class SensorSettings:
    """What a Reconstructor is made from, besides rig and pattern; a depth of 0 is automatic."""

    method: str
    min_depth_m: float
    max_depth_m: float
    saturation_level: float
    settings: Settings

    def depth_range_m(self, told_m: tuple[float, float] | None) -> tuple[float, float]:
        """Return nearest and farthest depth: as set, else as the head told, else the core's default."""
        near_m, far_m = told_m or DEFAULT_DEPTH_RANGE_M
        return self.min_depth_m or near_m, self.max_depth_m or far_m


@dataclass(frozen=True)
class OutputSettings:
    """How results are written into messages."""

    depth_encoding: str
    nav: NavSettings


def read_settings(values: Mapping[str, Any]) -> tuple[SensorSettings, OutputSettings]:
    """Return the settings of a node's parameter values.

    Raises
    ------
    SettingsError
        A combination that cannot work, such as a nearest depth beyond the farthest.
    """
    core = Settings(**{item.name: values[item.name] for item in fields(Settings)})
    nav = NavSettings(**{item.name: values[item.name] for item in fields(NavSettings)})
    sensor = SensorSettings(
        values["method"], values["min_depth_m"], values["max_depth_m"], values["saturation_level"], core
    )
    near_m, far_m = sensor.depth_range_m(None)
    if near_m >= far_m:
        raise SettingsError(
            f"min_depth_m is {near_m:g} and max_depth_m {far_m:g}; the nearest must be the smaller: set both"
        )
    return sensor, OutputSettings(values["depth_encoding"], nav)
