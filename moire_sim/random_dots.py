"""Random dots from the same projector: the pattern of active stereo cameras, for comparison with fringes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from moire_sensor.paper_rig import PROJECTOR_SIZE
from moire_sensor.pattern import FringePattern
from moire_sim.errors import SceneError
from moire_sim.exposure import bent_response, projected_signal

Array = npt.NDArray[np.float64]


@dataclass(frozen=True)
class RandomDots:
    """Square dots on the projector device, each bright (1) or dark (-1) by chance.

    Parameters
    ----------
    dot_px : side of a dot, projector pixels, at least 1.
    bright_share : chance of a dot to be bright, between 0 and 1.
    seed : of the chance.
    size : projector pixels, (width, height).

    Raises
    ------
    SceneError
        A value outside its range.
    """

    dot_px: float = 2.0
    bright_share: float = 0.5
    seed: int = 0
    size: tuple[int, int] = PROJECTOR_SIZE
    dots: npt.NDArray[np.float32] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not 1.0 <= self.dot_px <= min(self.size):
            raise SceneError(f"dot_px is {self.dot_px}; it must be 1 to {min(self.size)} projector pixels")
        if not 0.0 < self.bright_share < 1.0:
            raise SceneError(f"bright_share is {self.bright_share}; it must lie between 0 and 1")
        columns, rows = (int(np.ceil(length / self.dot_px)) for length in self.size)
        chance = np.random.default_rng(self.seed).random((rows, columns))
        dots = np.where(chance < self.bright_share, 1.0, -1.0).astype(np.float32)
        object.__setattr__(self, "dots", dots)

    @property
    def step_count(self) -> int:
        """Number of exposures: dots are a single shot."""
        return 1

    def signal(self, device_px: Array, footprint_px: float = 1.0) -> Array:
        """Brightness -1..1 at device pixels (N, 2), averaged over a square of ``footprint_px`` (at most ``dot_px``)."""
        place = (device_px + 0.5) / self.dot_px
        first = np.floor(place - 0.5)
        # The border between the two nearest dots lies at first + 1; the part of the footprint beyond it shows the next.
        beyond = np.clip((place - first - 1.0) * self.dot_px / footprint_px + 0.5, 0.0, 1.0)
        rows, columns = self.dots.shape
        left, right = (np.clip(first[:, 0] + step, 0, columns - 1).astype(np.intp) for step in (0, 1))
        upper, lower = (np.clip(first[:, 1] + step, 0, rows - 1).astype(np.intp) for step in (0, 1))
        across, down = beyond[:, 0], beyond[:, 1]
        above = (1.0 - across) * self.dots[upper, left] + across * self.dots[upper, right]
        below = (1.0 - across) * self.dots[lower, left] + across * self.dots[lower, right]
        return np.asarray((1.0 - down) * above + down * below)


Projected = FringePattern | RandomDots


def signal_at(pattern: Projected, device_px: Array, step: int, gamma: float, footprint_px: float) -> Array:
    """Projector output in -1..1 at device pixels (N, 2), as :func:`moire_sim.exposure.projected_signal`."""
    if isinstance(pattern, RandomDots):
        return bent_response(pattern.signal(device_px, footprint_px), gamma)
    return projected_signal(pattern, device_px[:, 0], step, gamma, footprint_px)
