"""The projector's lens as two small tables: how far it moves a device column, and how far it has moved one.

Fringes lie on device columns, geometry gives ideal ones. The row matters to the lens, but no fringe tells it; the ideal
row follows from the geometry, so both tables are indexed by it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from moire_sensor.errors import RigError
from moire_sensor.projection import Array, distort_pixels
from moire_sensor.rig import StereoRig

# A tenth of the phase noise floor of a single shot, 3e-3 rad, on fringes of 40 columns.
TABLE_ERROR_PX = 0.002
PITCHES_PX = (32.0, 16.0, 8.0, 4.0, 2.0)
MARGIN_PX = 2.0
ITERATIONS = 100
SOLVED_PX = 1e-7
HEADER = 5


@dataclass(frozen=True, eq=False)
class ShiftTable:
    """Column shifts in pixels on a grid, bilinear in between and constant outside.

    Attributes
    ----------
    first_column_px, first_row_px : place of ``values[0, 0]``.
    pitch_px : distance of the nodes in both directions.
    values : (rows, columns) float64, at least 2 each.
    """

    first_column_px: float
    first_row_px: float
    pitch_px: float
    values: Array

    def at(self, column_px: Array, row_px: Array) -> Array:
        """Shift at columns and rows (arrays that broadcast); the slow twin of ``shift_at`` in projector_map."""
        rows, columns = self.values.shape
        x = np.clip((np.asarray(column_px) - self.first_column_px) / self.pitch_px, 0.0, columns - 1.0)
        y = np.clip((np.asarray(row_px) - self.first_row_px) / self.pitch_px, 0.0, rows - 1.0)
        known = np.isfinite(x + y)
        x, y = np.where(known, x, 0.0), np.where(known, y, 0.0)
        left, top = np.minimum(x.astype(np.intp), columns - 2), np.minimum(y.astype(np.intp), rows - 2)
        across, down = x - left, y - top
        above = (1.0 - across) * self.values[top, left] + across * self.values[top, left + 1]
        below = (1.0 - across) * self.values[top + 1, left] + across * self.values[top + 1, left + 1]
        return np.where(known, (1.0 - down) * above + down * below, np.nan)

    def header(self) -> list[float]:
        """First column and row, nodes per pixel, number of columns and rows."""
        rows, columns = self.values.shape
        return [self.first_column_px, self.first_row_px, 1.0 / self.pitch_px, float(columns), float(rows)]


@dataclass(frozen=True, eq=False)
class ProjectorLens:
    """Device column = ideal column + bend(ideal column, ideal row); ideal = device + unbend(device, ideal row).

    Attributes
    ----------
    bend : shifts over ideal columns and ideal rows.
    unbend : shifts over device columns and ideal rows.
    """

    bend: ShiftTable
    unbend: ShiftTable

    def largest_error_px(self, rig: StereoRig) -> float:
        """Largest error of both tables at the middles of their cells, where it is largest."""
        columns, rows = cell_middles(self.bend)
        bend = np.abs(self.bend.at(columns, rows) - bend_px(rig, columns, rows)).max()
        columns, rows = cell_middles(self.unbend)
        ideal = columns + self.unbend.at(columns, rows)
        unbend = np.abs(ideal + bend_px(rig, ideal, rows) - columns).max()
        return float(max(bend, unbend))


@lru_cache(maxsize=4)
def lens_of(rig: StereoRig) -> ProjectorLens | None:
    """Return the tables over the device, right to 0.002 px, or None for a projector without a lens.

    Raises
    ------
    RigError
        Coefficients that fold the image over itself within the device, or bend it too sharply for a table.
    """
    if not rig.projector_distortion:
        return None
    for pitch_px in PITCHES_PX:
        lens = ProjectorLens(bend_table(rig, pitch_px), unbend_table(rig, pitch_px))
        if lens.largest_error_px(rig) <= TABLE_ERROR_PX:
            return lens
    raise folded(rig)


def bend_px(rig: StereoRig, columns_px: Array, rows_px: Array) -> Array:
    """Exact shift from ideal to device columns at ideal columns and rows of one shape."""
    pixels = np.stack([columns_px, rows_px], axis=-1)
    return np.asarray(distort_pixels(pixels, rig.projector_matrix, rig.projector_distortion)[..., 0] - columns_px)


def bend_table(rig: StereoRig, pitch_px: float) -> ShiftTable:
    """Shifts to device columns over the ideal pixels that the device shows."""
    low, high = ideal_bounds(rig)
    columns, rows = grid(low, high, pitch_px)
    values = bend_px(rig, columns, rows)
    if not (np.diff(columns + values, axis=1) > 0.0).all():
        raise folded(rig)
    return ShiftTable(float(columns[0, 0]), float(rows[0, 0]), pitch_px, values)


def unbend_table(rig: StereoRig, pitch_px: float) -> ShiftTable:
    """Shifts to ideal columns over device columns and the ideal rows that the device shows."""
    low, high = ideal_bounds(rig)
    columns, rows = grid(np.array([0.0, low[1]]), np.array([device_size(rig)[0] - 1.0, high[1]]), pitch_px)
    ideal = columns.copy()
    for _ in range(ITERATIONS):
        missing = columns - ideal - bend_px(rig, ideal, rows)
        ideal += missing
        if np.abs(missing).max() < SOLVED_PX:
            return ShiftTable(float(columns[0, 0]), float(rows[0, 0]), pitch_px, ideal - columns)
    raise folded(rig)


def ideal_bounds(rig: StereoRig) -> tuple[Array, Array]:
    """Smallest and largest ideal (column, row) of the device's border pixels."""
    width, height = device_size(rig)
    across, down = np.linspace(0.0, width - 1.0, 65), np.linspace(0.0, height - 1.0, 65)
    sides = [np.broadcast_arrays(across, row) for row in (0.0, height - 1.0)]
    sides += [np.broadcast_arrays(column, down) for column in (0.0, width - 1.0)]
    device = np.concatenate([np.stack(side, axis=-1) for side in sides])
    ideal = device.copy()
    for _ in range(ITERATIONS):
        missing = device - distort_pixels(ideal, rig.projector_matrix, rig.projector_distortion)
        ideal += missing
        if np.abs(missing).max() < SOLVED_PX:
            return ideal.min(axis=0), ideal.max(axis=0)
    raise folded(rig)


def device_size(rig: StereoRig) -> tuple[int, int]:
    """Size of a projector that has a lens; from_projections saw to it that it is known."""
    assert rig.projector_size is not None
    return rig.projector_size


def grid(low: Array, high: Array, pitch_px: float) -> tuple[Array, Array]:
    """Columns and rows of nodes that reach a little over both corners, (rows, columns) each."""
    nodes = [
        start - MARGIN_PX + pitch_px * np.arange(int(np.ceil((end - start + 2.0 * MARGIN_PX) / pitch_px)) + 1)
        for start, end in zip(low, high, strict=True)
    ]
    columns, rows = np.meshgrid(*nodes)
    return columns, rows


def cell_middles(table: ShiftTable) -> tuple[Array, Array]:
    """Columns and rows of the middles of a table's cells."""
    rows, columns = (np.arange(count - 1) + 0.5 for count in table.values.shape)
    middle_columns, middle_rows = np.meshgrid(columns, rows)
    return (
        table.first_column_px + table.pitch_px * middle_columns,
        table.first_row_px + table.pitch_px * middle_rows,
    )


def folded(rig: StereoRig) -> RigError:
    """Say that the lens cannot be undone."""
    return RigError(
        f"the projector's lens {rig.projector_distortion} folds or tears its image of {rig.projector_size} pixels; "
        "calibrate again, with fewer coefficients or with points out to the corners"
    )
