"""The fringe order of every pixel: what each candidate costs, and which ones neighbours agree on."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from moire_sensor.order_cost import OrderCosts
from moire_sensor.order_path import OrderPaths
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap

Int8 = npt.NDArray[np.int8]


class OrderSolver:
    """Chooses among the candidate orders; owns all its memory, so results last until the next :meth:`solve`.

    Parameters
    ----------
    carriers, projector : the carriers of both cameras and the map that fixes disparities.
    orders : the candidates.
    jump_cost : cost of leaving a surface between neighbours, in units of a full mismatch.
    """

    def __init__(
        self, carriers: tuple[Carrier, Carrier], projector: ProjectorMap, orders: OrderRange, jump_cost: float
    ) -> None:
        height, width = carriers[0].phase_rad.shape
        self._costs = OrderCosts(carriers, projector, orders)
        self._paths = OrderPaths((width, height), orders.count, jump_cost)
        self._runner_up = np.full((height, width), -1, dtype=np.int8)
        self._second = np.full((height, width), -1, dtype=np.int8)

    def solve(
        self, phases: tuple[PhaseImage, PhaseImage], greys: tuple[Float32, Float32], shading_rad: float
    ) -> tuple[Int8, Float32]:
        """Return the cheapest label (H, W) int8, -1 where the phase is unknown, and by how much the next costs more.

        Parameters
        ----------
        phases, greys : of the left and right camera, (H, W).
        shading_rad : mismatch of phases that shading explains, radians.
        """
        self._costs.fill(phases, greys, shading_rad, self._paths.cost)
        label, self._runner_up, margin = self._paths.solve(phases[0].offset_rad)
        return label, margin

    def second(self, refused: npt.NDArray[np.bool_]) -> Int8:
        """Return the second cheapest label (H, W) where the first was refused, -1 elsewhere or where there is none."""
        # By arithmetic, since a masked copy takes five times as long: -1 has all bits set.
        np.subtract(refused.view(np.int8), 1, out=self._second)
        np.bitwise_or(self._second, self._runner_up, out=self._second)
        return self._second
