"""Configuration of the reconstruction: every default once, with its unit and range."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from moire_sensor.errors import SettingsError


def setting(default: float, low: float, high: float, text: str) -> float:
    """Declare a numeric setting with its allowed range and description."""
    value: float = field(default=default, metadata={"low": low, "high": high, "text": text})
    return value


def check_ranges(settings: Any) -> None:
    """Raise SettingsError for a field of a dataclass of settings outside its range, naming it."""
    for item in fields(settings):
        value = getattr(settings, item.name)
        low, high = item.metadata["low"], item.metadata["high"]
        if not (math.isfinite(value) and low <= value <= high):
            raise SettingsError(f"{item.name} is {value}; allowed is {low} to {high} ({item.metadata['text']})")


@dataclass(frozen=True)
class Settings:
    """Tuning of the reconstruction; the defaults serve all rigs. Grey levels are scaled to 255 at saturation.

    Raises
    ------
    SettingsError
        A value outside its range; the message names it.
    """

    min_amplitude: float = setting(6.0, 0.5, 127.0, "smallest fringe amplitude of a lit pixel, grey levels of 255")
    min_amplitude_to_noise: float = setting(1.5, 0.0, 100.0, "smallest ratio of fringe amplitude to fit residual")
    half_height_px: int = setting(2, 0, 10, "rows above and below that a single-shot window takes in, pixels")  # type: ignore[assignment]
    row_step: int = setting(2, 1, 10, "solve one row in so many of a single shot; low things may be lost")  # type: ignore[assignment]
    jump_cost: float = setting(0.8, 0.0, 10.0, "cost of a depth jump between neighbours, in units of a full mismatch")
    common_error_rad: float = setting(0.03, 0.0, 1.0, "phase error common to both cameras (gamma, motion), radians")
    alignment_px: float = setting(
        0.5, 0.0, 5.0, "column error of the stereo calibration, where the projector measures better, pixels"
    )
    max_mismatch_rad: float = setting(1.2, 0.01, 3.0, "largest left-right phase mismatch that is believed, radians")
    max_mismatch_steps_rad: float = setting(
        0.3, 0.01, 3.0, "the same for phase steps, where the cameras measure against each other, radians"
    )
    max_typical_mismatch_rad: float = setting(
        0.15, 0.01, 3.0, "patch mean of the mismatch from which the whole image is refused, radians"
    )
    max_misfit: float = setting(0.2, 0.0, 1.0, "largest grey-level difference of matched views, fringe amplitudes")
    max_border_misfit: float = setting(
        0.165, 0.0, 1.0, "largest grey-level difference of a pixel beside an edge, fringe amplitudes"
    )
    half_height_grey_px: int = setting(7, 0, 50, "rows above and below that a match of grey levels takes in, pixels")  # type: ignore[assignment]
    half_mean_steps_px: int = setting(  # type: ignore[assignment]
        0, 0, 10, "rows and columns on either side that a depth of phase steps is averaged with, pixels"
    )
    max_motion_rad: float = setting(0.8, 0.0, 3.0, "largest phase drift from frame to frame that is believed, radians")
    min_confidence: float = setting(0.1, 0.0, 1.0, "depths of less confidence are left unknown")
    image_noise: float = setting(1.5, 0.01, 50.0, "camera noise where the frames cannot tell it, grey levels of 255")
    reference_depth_m: float = setting(1.5, 0.01, 100.0, "depth of the plane that reference_plane compares with, m")
    min_segment_px: int = setting(60, 0, 100000, "smallest connected surface that is kept, pixels")  # type: ignore[assignment]

    def __post_init__(self) -> None:
        check_ranges(self)
