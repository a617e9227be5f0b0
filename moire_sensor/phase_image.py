"""Phase of one camera: what every method hands to the order solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

Float32 = npt.NDArray[np.float32]


class Light(Protocol):
    """What one camera sees of the light, (H, W): fringe amplitude and local mean in grey levels of 255, and status."""

    @property
    def amplitude(self) -> Float32:
        """Fringe amplitude b."""

    @property
    def background(self) -> Float32:
        """Local mean a."""

    @property
    def status(self) -> npt.NDArray[np.uint8]:
        """Status.OK where the phase is known."""


@dataclass(frozen=True, eq=False)
class PhaseImage:
    """Per-pixel fringe phase of one camera, arrays of shape (n, W): all rows of the image, or one in so many.

    Attributes
    ----------
    offset_rad : float32, absolute phase minus the carrier's, wrapped to -pi..pi; NaN where unknown.
    amplitude : float32, fringe amplitude b in grey levels of 255.
    background : float32, local mean a in grey levels of 255.
    sigma_rad : float32, predicted standard deviation of the phase.
    status : uint8, Status.OK where the phase is known, else UNLIT, SATURATED or MOVED.
    first_row, row_step : the image row of the first row of the arrays, and how many rows further the next one lies.
    """

    offset_rad: Float32
    amplitude: Float32
    background: Float32
    sigma_rad: Float32
    status: npt.NDArray[np.uint8]
    first_row: int = 0
    row_step: int = 1

    @property
    def rows(self) -> npt.NDArray[np.int64]:
        """Image rows (n,) of the arrays' rows."""
        return self.first_row + self.row_step * np.arange(self.offset_rad.shape[0], dtype=np.int64)


def solved_rows(height: int, step: int) -> tuple[int, int]:
    """First of every ``step``-th row of an image, as far from its first row as the last from its last; their number."""
    return (height - 1) % step // 2, (height - 1) // step + 1
