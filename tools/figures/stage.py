"""The paper's rig as the experiments use it, and the phase that its cameras' pictures carry."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from moire_sensor.paper_rig import (
    CX_PX,
    IMAGE_SIZE,
    PERIOD_PX,
    PROJECTOR_CX_PX,
    PROJECTOR_SIZE,
    PROJECTOR_X_M,
    RIGHT_X_M,
    paper_pattern,
    parallel_projection,
)
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.reference_phase import fringe_signal
from moire_sensor.reference_ray import Camera, phase_seen_rad
from moire_sensor.rig import StereoRig

Array = npt.NDArray[np.float64]
TURN = 2.0 * np.pi
# Distance from the projector to the right camera, the base of the moire that the right camera sees.
RIGHT_BASE_M = RIGHT_X_M - PROJECTOR_X_M


def rig_of_rows(row_count: int = IMAGE_SIZE[1]) -> StereoRig:
    """Return the paper's rig with only the middle rows of its images."""
    first = (IMAGE_SIZE[1] - row_count) / 2.0

    def cropped(x_m: float) -> Array:
        matrix = parallel_projection(CX_PX, x_m)
        matrix[1] -= first * matrix[2]
        return matrix

    return StereoRig.from_projections(
        cropped(0.0),
        cropped(RIGHT_X_M),
        parallel_projection(PROJECTOR_CX_PX, PROJECTOR_X_M),
        (IMAGE_SIZE[0], row_count),
        projector_size=PROJECTOR_SIZE,
    )


def middle_row(rig: StereoRig) -> int:
    """Row of the images nearest to the optical axes' height."""
    return min(max(round(rig.centre_px[1]), 0), rig.image_size[1] - 1)


def plane_phase_rad(rig: StereoRig, camera: Camera, depth_m: float) -> Array:
    """Absolute phase (H, W) that a camera sees of a fronto-parallel plane."""
    columns, rows = np.meshgrid(*(np.arange(float(side)) for side in rig.image_size))
    projector = ProjectorMap.build(rig, paper_pattern())
    return phase_seen_rad(projector, camera, columns, rows, float(rig.disparity_px(depth_m)))


def relative_phase_rad(picture: npt.NDArray[Any], plane_rad: Array) -> Array:
    """Wrapped phase (H, W) of a picture's fringes minus a plane's, by the row FFT of section 2.1."""
    return np.asarray(np.angle(fringe_signal(picture.astype(np.float64), plane_rad, PERIOD_PX)))


def mean_phase_rad(picture: npt.NDArray[Any], plane_rad: Array) -> float:
    """Mean of the same over the whole picture, as the phase of the mean fringe."""
    return float(np.angle(fringe_signal(picture.astype(np.float64), plane_rad, PERIOD_PX).mean()))


def shift_px(depth_m: float | Array, from_depth_m: float) -> Array:
    """Shift to the left of the right camera's fringes, pixels: 41 mm x f x (1/z - 1/z0)."""
    return np.asarray(RIGHT_BASE_M * rig_focal_px() * (1.0 / np.asarray(depth_m) - 1.0 / from_depth_m))


def rig_focal_px() -> float:
    """Focal length of all three devices along rows, pixels."""
    return float(parallel_projection(CX_PX, 0.0)[0, 0])
