"""Which fringe orders the depth range admits."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moire_sensor.phase_carrier import Carrier
from moire_sensor.projector_map import ProjectorMap

RANGE_MARGIN_PX = 0.5


@dataclass(frozen=True, eq=False)
class OrderRange:
    """Orders relative to the carrier that the depth range admits: absolute offset = offset + 2 pi (first + label).

    Attributes
    ----------
    first, count : the first relative order and the number of labels.
    min_disparity_px, max_disparity_px : the depth range as disparities.
    """

    first: int
    count: int
    min_disparity_px: float
    max_disparity_px: float

    @classmethod
    def build(cls, projector: ProjectorMap, carrier: Carrier, disparities_px: tuple[float, float]) -> OrderRange:
        """Orders between two disparities over the whole image."""
        height, width = carrier.phase_rad.shape
        columns, rows = np.meshgrid(np.linspace(0, width - 1, 17), np.linspace(0, height - 1, 13))
        reference = projector.phase_rad_at(columns, rows, 0.5 * (disparities_px[0] + disparities_px[1]))
        ends = [projector.phase_rad_at(columns, rows, disparity) - reference for disparity in disparities_px]
        turns = np.stack(ends) / (2.0 * np.pi)
        first, last = int(np.floor(turns.min() + 0.5)), int(np.ceil(turns.max() - 0.5))
        return cls(first, last - first + 1, min(disparities_px), max(disparities_px))

    @property
    def limits_px(self) -> tuple[float, float]:
        """Smallest and largest disparity of a candidate: the range and a margin for noise."""
        return self.min_disparity_px - RANGE_MARGIN_PX, self.max_disparity_px + RANGE_MARGIN_PX
