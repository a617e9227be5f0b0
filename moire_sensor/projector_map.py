"""The projector seen from the left image: device column as a function of pixel and disparity, and back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from moire_sensor.pattern import FringePattern
from moire_sensor.projection import Array
from moire_sensor.projector_lens import HEADER, ProjectorLens, lens_of
from moire_sensor.rig import StereoRig

# Layout of ProjectorMap.packed: without a lens it ends after the first ten numbers.
PLAIN = 10
ROW = PLAIN
BEND = ROW + 4
UNBEND = BEND + HEADER
TABLES = UNBEND + HEADER
# The ideal row changes slowly along a ray: two rounds leave less than 0.001 px of the lens undone.
UNBEND_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class ProjectorMap:
    """Ideal device column ``u = (num . q) / (den . q)`` with ``q = (1, x, y, d)``, and the pattern's phase over u.

    x, y is a left pixel, d its disparity in pixels; equations (11) and (12) for any projection matrices. A lens moves
    the ideal column to the device column, on which the fringes lie.

    Attributes
    ----------
    numerator, denominator : (4,) float64.
    rad_per_column, phase_rad : absolute phase is ``rad_per_column * u + phase_rad``, the step's phase not included.
    row_numerator : (4,) float64, the same as ``numerator`` for the ideal device row.
    lens : tables of the projector's lens, None without one.
    """

    numerator: Array
    denominator: Array
    rad_per_column: float
    phase_rad: float
    row_numerator: Array
    lens: ProjectorLens | None = None

    @classmethod
    def build(cls, rig: StereoRig, pattern: FringePattern) -> ProjectorMap:
        """Derive the map from the rig's matrices and the projector's lens.

        Raises
        ------
        RigError
            A lens that cannot be undone.
        """
        pixel_to_ray = np.linalg.inv(rig.P_left[:, :3])
        along_ray = rig.P_projector[:, :3] @ pixel_to_ray
        per_disparity = rig.P_projector[:, 3] / (rig.fx_px * rig.baseline_m)
        constant = along_ray[:, 2] - per_disparity * rig.disparity_at_infinity_px
        column, row, below = np.stack([constant, along_ray[:, 0], along_ray[:, 1], per_disparity], axis=1)
        rad_per_column = 2.0 * np.pi / pattern.period_px
        return cls(column, below, rad_per_column, pattern.phase_rad, row, lens_of(rig))

    def column_px(self, x_px: Array, y_px: Array, disparity_px: Array | float) -> Array:
        """Device column seen by left pixel (x, y) at a disparity; arrays that broadcast."""
        below = self._weighted(self.denominator, x_px, y_px, disparity_px)
        column = self._weighted(self.numerator, x_px, y_px, disparity_px) / below
        if self.lens is None:
            return np.asarray(column)
        row = self._weighted(self.row_numerator, x_px, y_px, disparity_px) / below
        return np.asarray(column + self.lens.bend.at(column, row))

    def phase_rad_at(self, x_px: Array, y_px: Array, disparity_px: Array | float) -> Array:
        """Absolute phase seen by left pixel (x, y) at a disparity, radians."""
        return self.rad_per_column * self.column_px(x_px, y_px, disparity_px) + self.phase_rad

    def disparity_px_at(self, x_px: Array, y_px: Array, phase_rad: Array | float) -> Array:
        """Disparity at which left pixel (x, y) sees an absolute phase; arrays that broadcast."""
        column = (np.asarray(phase_rad) - self.phase_rad) / self.rad_per_column
        disparity = self._disparity_of_ideal(x_px, y_px, column)
        for _ in range(UNBEND_ROUNDS if self.lens is not None else 0):
            assert self.lens is not None
            below = self._weighted(self.denominator, x_px, y_px, disparity)
            row = self._weighted(self.row_numerator, x_px, y_px, disparity) / below
            disparity = self._disparity_of_ideal(x_px, y_px, column + self.lens.unbend.at(column, row))
        return disparity

    def _disparity_of_ideal(self, x_px: Array, y_px: Array, column_px: Array) -> Array:
        above = self._weighted(self.numerator, x_px, y_px, 0.0)
        below = self._weighted(self.denominator, x_px, y_px, 0.0)
        return np.asarray((column_px * below - above) / (self.numerator[3] - column_px * self.denominator[3]))

    @staticmethod
    def _weighted(weights: Array, x_px: Array, y_px: Array, disparity_px: Array | float) -> Array:
        return np.asarray(weights[0] + weights[1] * x_px + weights[2] * y_px + weights[3] * disparity_px)

    def packed(self) -> Array:
        """All numbers for the compiled functions below, float64: (10,), longer with a lens."""
        plain = [*self.numerator, *self.denominator, self.rad_per_column, self.phase_rad]
        if self.lens is None:
            return np.array(plain)
        bend, unbend = self.lens.bend, self.lens.unbend
        headers = [*self.row_numerator, *bend.header(), *unbend.header()]
        return np.concatenate([plain, headers, bend.values.ravel(), unbend.values.ravel()])


@njit
def shift_at(map_, header, start, column, row):  # type: ignore[no-untyped-def]
    """Bilinear shift of a packed table at (column, row), and its derivatives along both; constant outside."""
    columns, rows = int(map_[header + 3]), int(map_[header + 4])
    x = (column - map_[header]) * map_[header + 2]
    y = (row - map_[header + 1]) * map_[header + 2]
    x = min(x, columns - 1.0) if x > 0.0 else 0.0  # NaN becomes 0 and stays inside the table
    y = min(y, rows - 1.0) if y > 0.0 else 0.0
    left, top = min(int(x), columns - 2), min(int(y), rows - 2)
    across, down = x - left, y - top
    first = start + top * columns + left
    above = map_[first] + across * (map_[first + 1] - map_[first])
    first += columns
    below = map_[first] + across * (map_[first + 1] - map_[first])
    step = (1.0 - down) * (map_[first - columns + 1] - map_[first - columns]) + down * (map_[first + 1] - map_[first])
    return above + down * (below - above), step * map_[header + 2], (below - above) * map_[header + 2]


@njit(inline="always")
def disparity_of_phase(map_, x, y, phase):  # type: ignore[no-untyped-def]
    """Disparity at which left pixel (x, y) shows an absolute phase: ProjectorMap.disparity_px_at."""
    column = (phase - map_[9]) / map_[8]
    above = map_[0] + map_[1] * x + map_[2] * y
    below = map_[4] + map_[5] * x + map_[6] * y
    disparity = (column * below - above) / (map_[3] - column * map_[7])
    return disparity if map_.shape[0] == PLAIN else unbent_disparity(map_, x, y, column, disparity)


@njit
def unbent_disparity(map_, x, y, column, disparity):  # type: ignore[no-untyped-def]
    """Disparity of a device column through the lens, from the one without lens."""
    above = map_[0] + map_[1] * x + map_[2] * y
    below = map_[4] + map_[5] * x + map_[6] * y
    across = map_[ROW] + map_[ROW + 1] * x + map_[ROW + 2] * y
    start = TABLES + int(map_[BEND + 3] * map_[BEND + 4])
    for _ in range(UNBEND_ROUNDS):
        row = (across + map_[ROW + 3] * disparity) / (below + map_[7] * disparity)
        ideal = column + shift_at(map_, UNBEND, start, column, row)[0]
        disparity = (ideal * below - above) / (map_[3] - ideal * map_[7])
    return disparity


@njit(inline="always")
def phase_of_disparity(map_, x, y, disparity):  # type: ignore[no-untyped-def]
    """Absolute phase at left pixel (x, y) and disparity, and its derivative with disparity: phase_rad_at."""
    above = map_[0] + map_[1] * x + map_[2] * y + map_[3] * disparity
    below = map_[4] + map_[5] * x + map_[6] * y + map_[7] * disparity
    column = above / below
    slope = (map_[3] - column * map_[7]) / below
    if map_.shape[0] > PLAIN:
        column, slope = bent_column(map_, x, y, disparity, column, slope)
    return map_[8] * column + map_[9], map_[8] * slope


@njit
def bent_column(map_, x, y, disparity, column, slope):  # type: ignore[no-untyped-def]
    """Device column through the lens and its derivative with disparity, from those without lens."""
    below = map_[4] + map_[5] * x + map_[6] * y + map_[7] * disparity
    row = (map_[ROW] + map_[ROW + 1] * x + map_[ROW + 2] * y + map_[ROW + 3] * disparity) / below
    shift, along, across = shift_at(map_, BEND, TABLES, column, row)
    return column + shift, slope * (1.0 + along) + across * (map_[ROW + 3] - row * map_[7]) / below
