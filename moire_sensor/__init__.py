"""Fringe projection with two cameras: dense metric depth from one exposure."""

from pathlib import Path

from moire_sensor.capture_folder import Capture, read_capture
from moire_sensor.errors import CaptureError, ImageError, MoireError, PatternError, RigError, SettingsError
from moire_sensor.kernel_cache import forget_outdated
from moire_sensor.pattern import FringePattern
from moire_sensor.phase_demodulate import demodulate
from moire_sensor.reconstructor import METHODS, Reconstructor
from moire_sensor.rectify import RectifiedPair, rectify_pair
from moire_sensor.rig import StereoRig
from moire_sensor.settings import Settings
from moire_sensor.shot import Shot, Status

__all__ = [
    "METHODS",
    "Capture",
    "CaptureError",
    "FringePattern",
    "ImageError",
    "MoireError",
    "PatternError",
    "Reconstructor",
    "RectifiedPair",
    "RigError",
    "Settings",
    "SettingsError",
    "Shot",
    "Status",
    "StereoRig",
    "read_capture",
    "rectify_pair",
]

forget_outdated(demodulate, Path(__file__).parent)
