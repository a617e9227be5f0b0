"""The projector seen from the left image: device column as a function of pixel and disparity."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moire_sensor.pattern import FringePattern
from moire_sensor.rig import Array, StereoRig


@dataclass(frozen=True, eq=False)
class ProjectorMap:
    """Ideal device column ``u = (num . q) / (den . q)`` with ``q = (1, x, y, d)``, and the pattern's phase over u.

    x, y is a left pixel, d its disparity in pixels; equations (11) and (12) for any projection matrices.

    Attributes
    ----------
    numerator, denominator : (4,) float64.
    rad_per_column, phase_rad : absolute phase is ``rad_per_column * u + phase_rad``, the step's phase not included.
    """

    numerator: Array
    denominator: Array
    rad_per_column: float
    phase_rad: float

    @classmethod
    def build(cls, rig: StereoRig, pattern: FringePattern) -> ProjectorMap:
        """Derive the map from the rig's matrices; a lens of the projector is not in it."""
        pixel_to_ray = np.linalg.inv(rig.P_left[:, :3])
        inverse_depth_per_px = 1.0 / (rig.fx_px * rig.baseline_m)
        rows = []
        for row in (0, 2):
            along_ray = rig.P_projector[row, :3] @ pixel_to_ray
            per_disparity = rig.P_projector[row, 3] * inverse_depth_per_px
            constant = along_ray[2] - per_disparity * rig.disparity_at_infinity_px
            rows.append(np.array([constant, along_ray[0], along_ray[1], per_disparity]))
        return cls(rows[0], rows[1], 2.0 * np.pi / pattern.period_px, pattern.phase_rad)

    def column_px(self, x_px: Array, y_px: Array, disparity_px: Array | float) -> Array:
        """Ideal device column seen by left pixel (x, y) at a disparity; arrays that broadcast."""
        above = self._linear(self.numerator, x_px, y_px) + self.numerator[3] * disparity_px
        below = self._linear(self.denominator, x_px, y_px) + self.denominator[3] * disparity_px
        return np.asarray(above / below)

    def phase_rad_at(self, x_px: Array, y_px: Array, disparity_px: Array | float) -> Array:
        """Absolute phase seen by left pixel (x, y) at a disparity, radians."""
        return self.rad_per_column * self.column_px(x_px, y_px, disparity_px) + self.phase_rad

    @staticmethod
    def _linear(weights: Array, x_px: Array, y_px: Array) -> Array:
        return np.asarray(weights[0] + weights[1] * x_px + weights[2] * y_px)

    def packed(self) -> Array:
        """All ten numbers, (10,) float64, for the compiled kernels."""
        return np.concatenate([self.numerator, self.denominator, [self.rad_per_column, self.phase_rad]])
