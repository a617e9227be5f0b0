"""Rigs and rows with known truth for the tests of the fringe-edge and the reference-plane method."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from moire_sensor.edge_find import EdgeRows
from moire_sensor.edge_lanes import whole_vectors
from moire_sensor.paper_rig import (
    CX_PX,
    IMAGE_SIZE,
    PROJECTOR_CX_PX,
    PROJECTOR_X_M,
    RIGHT_X_M,
    paper_rig,
    parallel_projection,
)
from moire_sensor.rig import StereoRig

Array = npt.NDArray[np.float64]


def rotation(x_rad: float, y_rad: float, z_rad: float) -> Array:
    """Rotation about x, then y, then z."""
    (cx, sx), (cy, sy), (cz, sz) = ((np.cos(a), np.sin(a)) for a in (x_rad, y_rad, z_rad))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def rig_with_projector(angles_rad: tuple[float, float, float], place_m: tuple[float, float, float]) -> StereoRig:
    """The paper's cameras with a projector turned and placed at will."""
    intrinsic = parallel_projection(PROJECTOR_CX_PX, 0.0)[:, :3]
    turn = rotation(*angles_rad)
    projector = intrinsic @ np.hstack([turn, -turn @ np.array(place_m)[:, None]])
    cameras = (parallel_projection(CX_PX, x_m) for x_m in (0.0, RIGHT_X_M))
    return StereoRig.from_projections(*cameras, projector, IMAGE_SIZE)


def rigs_under_test() -> dict[str, StereoRig]:
    """The paper's, one with the projector turned and outside the pair, and one with it upside down."""
    return {
        "paper": paper_rig(),
        "outside": rig_with_projector((0.05, -0.20, 0.1), (0.25, 0.03, -0.02)),
        "upside_down": rig_with_projector((0.0, 0.0, np.pi), (PROJECTOR_X_M, 0.0, 0.0)),
    }


def edge_rows(rows: list[list[tuple[float, int]]], height: float = 50.0) -> EdgeRows:
    """Edges given as (column, side), row by row."""
    most = whole_vectors(max([1, *(len(row) for row in rows)]))
    x_px = np.full((len(rows), most), np.nan, dtype=np.float32)
    side = np.zeros(x_px.shape, dtype=np.int8)
    for y, row in enumerate(rows):
        for number, (x, up) in enumerate(row):
            x_px[y, number], side[y, number] = x, up
    heights = np.full(x_px.shape, height, dtype=np.float32)
    counts = np.array([len(row) for row in rows], dtype=np.int64)
    sigma_px, shares = np.full(x_px.shape, 0.05, dtype=np.float32), np.zeros((0, most), dtype=np.float32)
    return EdgeRows(x_px, side, heights, sigma_px, counts, shares, np.zeros(0, dtype=np.int64))


def random_edges(generator: np.random.Generator, first: float, last: float, count: int) -> list[tuple[float, int]]:
    """Edges of either side anywhere between two columns, in order."""
    columns = np.sort(generator.uniform(first, last, count))
    return [(float(x), int(generator.choice([-1, 1]))) for x in columns]
