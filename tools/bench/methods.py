"""Everything that is compared: our methods under fringes, OpenCV's matchers under random dots or ambient light."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

from moire_sensor import Reconstructor
from moire_sensor.paper_rig import PROJECTOR_SIZE, paper_pattern
from moire_sensor.rig import StereoRig
from moire_sensor.settings import Settings
from moire_sim.random_dots import Projected, RandomDots
from tools.bench.block_matching import BlockMatcher, Kind
from tools.bench.conditions import Condition

Depth = npt.NDArray[np.float32]
Range = tuple[float, float]
# Left and right images to depth; made once for a rig and pattern, as a driver would.
Solver = Callable[[Any, Any], Depth]
STEPS = 4
# Four square steps show only four phases; the reconstructor refuses them.
SQUARE_STEPS = 5


class Method(Protocol):
    """One thing to compare."""

    @property
    def name(self) -> str:
        """What the tables call it."""

    @property
    def ours(self) -> bool:
        """Whether it is this project's."""

    @property
    def projector_on(self) -> bool:
        """Whether it uses the projector."""

    def __hash__(self) -> int:
        """Methods are values: equal settings are one method."""

    def pattern(self, condition: Condition, scale: float = 1.0) -> Projected:
        """Pattern to project, for devices with ``scale`` times the paper's resolution."""

    def solver(self, rig: StereoRig, condition: Condition, depth_range_m: Range, scale: float = 1.0) -> Solver:
        """Return what turns the images of that pattern into depth."""


@dataclass(frozen=True)
class FringeMethod:
    """``dense``, ``phase_shift`` or ``fringe_edges``; a name may go on after the method's.

    ``half_mean_steps_px`` averages phase steps with their neighbours, see :class:`moire_sensor.Settings`.
    """

    name: str
    half_mean_steps_px: int = 0
    ours: bool = True
    projector_on: bool = True

    @property
    def method(self) -> str:
        """The method that the reconstructor knows."""
        return self.name.split()[0]

    def pattern(self, condition: Condition, scale: float = 1.0) -> Any:
        """Return the paper's fringes, in four steps for phase shifting, in five where they are square."""
        steps = SQUARE_STEPS if condition.waveform == "square" else STEPS
        fringes = paper_pattern(steps if self.method == "phase_shift" else 1)
        return replace(fringes, period_px=fringes.period_px * scale, waveform=condition.waveform)

    def sensor(self, rig: StereoRig, condition: Condition, depth_range_m: Range, scale: float = 1.0) -> Reconstructor:
        """Return the reconstructor of the method."""
        pattern = self.pattern(condition, scale)
        settings = Settings(half_mean_steps_px=self.half_mean_steps_px)
        return Reconstructor(rig, pattern, depth_range_m, self.method, settings=settings)

    def solver(self, rig: StereoRig, condition: Condition, depth_range_m: Range, scale: float = 1.0) -> Solver:
        """Set up the method."""
        sensor = self.sensor(rig, condition, depth_range_m, scale)
        return lambda left, right: sensor.reconstruct(left, right).depth_m


@dataclass(frozen=True)
class DotMethod:
    """A block matcher on random dots, or on ambient light alone."""

    kind: Kind
    window_px: int
    dot_px: float = 2.0
    projector_on: bool = True
    ours: bool = False

    @property
    def name(self) -> str:
        """The matcher's kind."""
        return self.kind if self.projector_on else f"{self.kind}, no projector"

    def pattern(self, condition: Condition, scale: float = 1.0) -> RandomDots:
        """Return dots of a fixed number of pixels; matchers look for them so."""
        width, height = PROJECTOR_SIZE
        return RandomDots(self.dot_px, size=(round(width * scale), round(height * scale)))

    def solver(self, rig: StereoRig, condition: Condition, depth_range_m: Range, scale: float = 1.0) -> Solver:
        """Set up the matcher."""
        matcher = BlockMatcher(self.kind, self.window_px, rig, depth_range_m)
        built = matcher.build()
        return lambda left, right: matcher.depth_m(built, left, right)


OURS: tuple[Method, ...] = (
    FringeMethod("dense"),
    FringeMethod("phase_shift"),
    FringeMethod("phase_shift 3x3", half_mean_steps_px=1),
    FringeMethod("fringe_edges"),
)
# Found by tools.bench.dot_scan; a full run scans again.
PEERS: tuple[DotMethod, ...] = (
    DotMethod("StereoBM", 15, 1.5),
    DotMethod("SGBM 3-way", 7, 1.5),
    DotMethod("SGBM HH", 7, 1.5),
)
