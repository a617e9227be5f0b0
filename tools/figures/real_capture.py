"""A recorded capture in the layout of figures 11 and 12; there is no truth, methods are compared with each other."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from moire_sensor import Reconstructor, read_capture
from moire_sensor.capture_folder import Capture
from moire_sensor.errors import CaptureError
from moire_sensor.phase_steps import needed_frames
from moire_sensor.settings import Settings
from tools.bench.tables import Table, number, percent
from tools.demo.pictures import span
from tools.demo.score import STRONG_MODULATION, modulation
from tools.figures.page import Experiment
from tools.figures.surface_pictures import Column, Sheet, draw_sheet

METHODS = ("reference_plane", "fringe_edges", "dense", "phase_shift")
ERROR_LIMIT_MM = 3.0
WRONG_M = 0.005

Depth = npt.NDArray[Any]


@dataclass(frozen=True, eq=False)
class CaptureResult:
    """Depth (H, W) by method, and where the fringes are strong (H, W)."""

    capture: Capture
    depths_m: dict[str, Depth]
    strong: npt.NDArray[np.bool_]
    plane_m: float

    def difference_mm(self, method: str) -> Depth:
        """Depth minus that of the phase steps, which each pixel measures by itself; NaN where either is unknown."""
        return np.asarray((self.depths_m[method] - self.depths_m["phase_shift"]) * 1e3)


def measure(folder: Path) -> CaptureResult:
    """Reconstruct a capture by every method; the classic one compares with a plane through the middle of the object.

    Raises
    ------
    CaptureError
        A folder that is not a capture, or one with too few steps to compare with.
    """
    capture = read_capture(folder)
    if capture.pattern.step_count < 3:
        raise CaptureError(
            f"the capture {folder} has {capture.pattern.step_count} step(s); the figures compare with phase steps: "
            "give one with 3 or more"
        )
    depths = {"phase_shift": depth_by(capture, "phase_shift", Settings())}
    plane_m = float(np.nanmedian(depths["phase_shift"]))
    for method in METHODS[:-1]:
        depths[method] = depth_by(capture, method, replace(Settings(), reference_depth_m=plane_m))
    return CaptureResult(capture, depths, modulation(capture) > STRONG_MODULATION, plane_m)


def depth_by(capture: Capture, method: str, settings: Settings) -> Depth:
    """Depth by the first frames of the phase steps, or by the middle one of these alone."""
    sensor = Reconstructor(capture.rig, capture.pattern, capture.depth_range_m, method, settings=settings)
    left, right = capture.stack()
    if method != "phase_shift":
        middle = middle_frame(capture)
        return sensor.reconstruct(left[middle], right[middle], capture.step_index(middle)).depth_m
    frames = frames_used(capture)
    return sensor.reconstruct(left[:frames], right[:frames], capture.step_index(0)).depth_m


def frames_used(capture: Capture) -> int:
    """Frames that the phase steps take: motion-compensated where there are enough."""
    return min(needed_frames(capture.pattern.step_count), capture.frame_count)


def middle_frame(capture: Capture) -> int:
    """Number of the frame at whose time the result of the phase steps is valid."""
    return (frames_used(capture) - 1) // 2


def draw_capture(result: CaptureResult, path: Path) -> None:
    """Write the sheet of all methods."""
    limits = span(result.depths_m["phase_shift"], 0.5)
    columns = [
        Column(method, result.depths_m[method], result.difference_mm(method), method == "fringe_edges")
        for method in METHODS
    ]
    left, right = result.capture.frame(middle_frame(result.capture))
    rig = result.capture.rig
    draw_sheet(Sheet(left, right, None, columns, rig, limits, ERROR_LIMIT_MM, "depth - phase_shift"), path)


def shift_px(result: CaptureResult, method: str) -> Depth:
    """Disparity minus that of the phase steps (N,), where the fringes are strong and both are known."""
    rig = result.capture.rig
    found, steps = (rig.disparity_px(result.depths_m[name][result.strong]) for name in (method, "phase_shift"))
    return np.asarray((found - steps)[np.isfinite(found - steps)])


def row_of(result: CaptureResult, method: str) -> tuple[str, ...]:
    """Completeness of a method and its differences from the phase steps."""
    known = np.isfinite(result.depths_m[method])[result.strong]
    difference = np.abs(result.difference_mm(method)[result.strong])
    difference = difference[np.isfinite(difference)]
    figures = ("-", "-", "-")
    if difference.size:
        wrong = percent(float((difference > WRONG_M * 1e3).mean()))
        shift = f"{float(np.median(shift_px(result, method))):+.2f}"
        figures = (number(float(np.median(difference)), 2), wrong, shift)
    return method, percent(float(known.mean())), *figures


def experiment(result: CaptureResult) -> Experiment:
    """Tell how the methods agree."""
    note = (
        f"Where the fringes are strong (amplitude above {STRONG_MODULATION:.0f} grey levels); differences from "
        "phase_shift. Median shift: disparity minus that of phase_shift. `fringe_edges` measures between the cameras "
        "alone, the others from whichever views the rig's geometry favours: a shift of all its points tells that the "
        "cameras do not fit the projector (calibration, or exposures at different times)."
    )
    columns = ("method", "complete %", "median difference mm", "more than 5 mm apart %", "median shift px")
    table = Table("Methods on the capture", note, columns, tuple(row_of(result, method) for method in METHODS))
    text = (
        f"`phase_shift` takes the first {frames_used(result.capture)} frames; the other methods take frame "
        f"{middle_frame(result.capture)} of these alone, at whose time its result is valid. `reference_plane` compares "
        f"with a plane at {result.plane_m * 1e3:.0f} mm."
    )
    return Experiment("capture", "The recorded capture", text, (table,), (), lambda path: draw_capture(result, path))
