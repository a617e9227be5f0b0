"""Rigs, captures and small images for the tests of the dense path; each capture is made once a run."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import numpy.typing as npt

from moire_sensor import FringePattern, Reconstructor, Shot, StereoRig
from moire_sensor.paper_rig import (
    CX_PX,
    FX_PX,
    PROJECTOR_CX_PX,
    RIGHT_X_M,
    paper_pattern,
    paper_rig,
    parallel_projection,
)
from moire_sensor.phase_carrier import Carrier
from moire_sensor.projector_map import ProjectorMap
from moire_sim.analytic_scenes import analytic_capture
from moire_sim.capture import HeadCapture

Array = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]
SMALL = (96, 40)


def small_rig(lens: tuple[float, ...] = (), shift_px: float = 0.0) -> StereoRig:
    """The paper's rig cropped to 96 x 40 pixels about the principal point, the right crop ``shift_px`` farther left."""
    cameras = []
    for x_m, left_px in ((0.0, CX_PX - 48.0), (RIGHT_X_M, CX_PX - 48.0 - shift_px)):
        crop = np.array([[1.0, 0.0, -left_px], [0.0, 1.0, 20.0 - 221.62866], [0.0, 0.0, 1.0]])
        cameras.append(crop @ parallel_projection(CX_PX, x_m))
    projector = paper_rig().P_projector
    return StereoRig.from_projections(*cameras, projector, SMALL, lens, projector_size=(960, 480))


def small_map(rig: StereoRig) -> ProjectorMap:
    return ProjectorMap.build(rig, paper_pattern())


def small_carriers(projector: ProjectorMap, disparity_px: float = 90.0, rows: int = 2) -> tuple[Carrier, Carrier]:
    left = Carrier.left(projector, SMALL, disparity_px, rows)
    return left, Carrier.right(projector, SMALL, disparity_px, rows)


def outside_rig() -> StereoRig:
    """A short pair with centres of their own, the projector 200 mm to the left, turned and upside down."""
    c, s = np.cos(np.pi + 0.05), np.sin(np.pi + 0.05)
    yaw_c, yaw_s = np.cos(0.18), np.sin(0.18)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[yaw_c, 0.0, -yaw_s], [0.0, 1.0, 0.0], [yaw_s, 0.0, yaw_c]]
    )
    place = np.array([-0.20, 0.02, 0.01])
    projector = parallel_projection(PROJECTOR_CX_PX, 0.0)[:, :3] @ np.hstack([turn, -turn @ place[:, None]])
    return StereoRig.from_projections(
        parallel_projection(CX_PX, 0.0), parallel_projection(CX_PX - 25.0, 0.040), projector, (640, 480)
    )


def negative_rig() -> StereoRig:
    """The paper's rig whose right principal point lies so far to the right that all disparities are negative."""
    plain = paper_rig()
    right = parallel_projection(CX_PX + 260.0, RIGHT_X_M)
    return StereoRig.from_projections(plain.P_left, right, plain.P_projector, (640, 480), projector_size=(960, 480))


def scaled_rig(scale: float) -> StereoRig:
    """The paper's rig with all lengths scaled."""
    plain = paper_rig()
    matrices = [np.hstack([P[:, :3], scale * P[:, 3:]]) for P in (plain.P_left, plain.P_right, plain.P_projector)]
    return StereoRig.from_projections(*matrices, plain.image_size, projector_size=(960, 480))


@cache
def capture(name: str, steps: int = 1, waveform: str = "sine", **options: float) -> HeadCapture:
    """Analytic capture with the paper's rig; see ``analytic_capture`` for the options."""
    pattern: FringePattern = replace(paper_pattern(steps), waveform=waveform)  # type: ignore[arg-type]
    return analytic_capture(name, pattern, **options)  # type: ignore[arg-type]


@cache
def sensor(method: str = "dense", steps: int = 1, waveform: str = "sine") -> Reconstructor:
    """Reconstructor of the paper's rig."""
    pattern: FringePattern = replace(paper_pattern(steps), waveform=waveform)  # type: ignore[arg-type]
    return Reconstructor(paper_rig(), pattern, method=method)


@cache
def dense_shot(name: str, waveform: str = "sine", **options: float) -> Shot:
    """Dense result of an analytic capture."""
    seen = capture(name, waveform=waveform, **options)
    return sensor(waveform=waveform).reconstruct(seen.left, seen.right)


@cache
def stepped_shot(name: str, **options: float) -> Shot:
    """Four-step result of an analytic capture."""
    seen = capture(name, 4, **options)
    return sensor("phase_shift", 4).reconstruct(seen.left, seen.right)


def pixels_per_metre_error(depth_m: float) -> float:
    """Metres that one pixel of disparity is worth at a depth, paper's rig."""
    return depth_m**2 / (FX_PX * RIGHT_X_M)
