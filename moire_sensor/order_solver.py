"""The fringe order of every pixel: what each candidate costs, and which ones neighbours agree on.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import get_num_threads, njit

from moire_sensor.apart import ROW
from moire_sensor.order_cost import OrderCosts
from moire_sensor.order_path import OrderPaths
from moire_sensor.order_range import OrderRange
from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_image import PhaseImage
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.scratch import scratch

Int8 = npt.NDArray[np.int8]


class OrderSolver:
    """Chooses among the candidate orders.

    Parameters
    ----------
    carriers, projector : the carriers of both cameras and the map that fixes disparities.
    orders : the candidates.
    jump_cost : cost of leaving a surface between neighbours, in units of a full mismatch.
    """

    def __init__(
        self, carriers: tuple[Carrier, Carrier], projector: ProjectorMap, orders: OrderRange, jump_cost: float
    ) -> None:
        self._costs = OrderCosts(carriers, projector, orders)
        self._labels, self._jump_cost = orders.count, jump_cost
        self._runner_up: Int8 = np.full((1, 1), -1, dtype=np.int8)

    def _paths(self, shape: tuple[int, ...]) -> OrderPaths:
        """The programmes' memory, shared in the thread."""
        rows, width = shape
        key = ("paths", shape, self._labels, self._jump_cost, get_num_threads())
        return scratch(key, lambda: OrderPaths(rows, width, self._labels, self._jump_cost))

    def solve(
        self,
        phases: tuple[PhaseImage, PhaseImage],
        greys: tuple[Float32, Float32],
        shading_rad: float,
    ) -> tuple[Int8, Float32]:
        """Return the cheapest label (n, W) int8, -1 where the phase is unknown, and by how much the next costs more.

        They last until another solver of the thread works.

        Parameters
        ----------
        phases, greys : of the left and right camera, (n, W) and (H, W).
        shading_rad : mismatch of phases that shading explains, radians.
        """
        paths = self._paths(phases[0].offset_rad.shape)
        self._costs.fill(phases, greys, shading_rad, paths.cost)
        label, self._runner_up, margin = paths.solve(phases[0].offset_rad)
        return label, margin

    def second(self, label: Int8, disparity_px: Float32) -> Int8:
        """Return the second cheapest label (n, W) where the first got no disparity, -1 elsewhere or without one."""
        second = np.empty_like(label)
        take_second(label.ravel(), self._runner_up.ravel(), disparity_px.ravel(), second.ravel())
        return second


@njit(cache=True, **ROW)
def take_second(label, runner_up, disparity, second):  # type: ignore[no-untyped-def]
    """Fill ``second`` (n,)."""
    for index in range(second.size):
        refused = (label[index] >= 0) & (disparity[index] != disparity[index])
        second[index] = runner_up[index] if refused else np.int8(-1)
