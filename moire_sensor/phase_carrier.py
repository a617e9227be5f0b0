"""The carrier: phase that the middle of the depth range would show, and the window one period wide around it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import SettingsError
from moire_sensor.phase_table import FitTable, ripple_factor
from moire_sensor.projector_map import ProjectorMap

Float32 = npt.NDArray[np.float32]
MIN_WINDOW_PX = 5


@dataclass(frozen=True, eq=False)
class Carrier:
    """What one camera would see of a fronto-parallel surface at the middle disparity.

    Attributes
    ----------
    phase_rad : (H, W) float32, absolute carrier phase.
    cos, sin : (H, W) float32 of it.
    rows : (2, 1 or H, W) float32, cos and sin: of one row where all are the same.
    rad_per_px : (H, W) float32, its derivative along the row.
    table : constants of the windows' fits.
    half_width_px, half_height_px : the window holds 2 n + 1 columns and rows.
    disparity_px : disparity of that surface.
    """

    phase_rad: Float32
    cos: Float32
    sin: Float32
    rows: Float32
    rad_per_px: Float32
    table: FitTable
    half_width_px: int
    half_height_px: int
    disparity_px: float

    @classmethod
    def left(cls, projector: ProjectorMap, size: tuple[int, int], disparity_px: float, half_height_px: int) -> Carrier:
        """Carrier of the left camera for a surface at ``disparity_px``."""
        return cls._build(projector, size, disparity_px, 0.0, half_height_px)

    @classmethod
    def right(cls, projector: ProjectorMap, size: tuple[int, int], disparity_px: float, half_height_px: int) -> Carrier:
        """Carrier of the right camera: right column x sees what left column x + disparity sees."""
        return cls._build(projector, size, disparity_px, disparity_px, half_height_px)

    @classmethod
    def _build(
        cls, projector: ProjectorMap, size: tuple[int, int], disparity_px: float, shift_px: float, half_height_px: int
    ) -> Carrier:
        columns, rows = np.meshgrid(np.arange(size[0], dtype=np.float64), np.arange(size[1], dtype=np.float64))
        phase = projector.phase_rad_at(columns + shift_px, rows, disparity_px)
        rad_per_px = np.gradient(phase, axis=1)
        half_width = half_period_px(rad_per_px)
        ripple = ripple_factor(float(np.median(np.abs(rad_per_px))), half_width)
        # Of rows that are all the same, one tells the carrier, and those of one window tell the table.
        alike = bool((phase == phase[:1]).all())
        unlike, window = phase[: 1 if alike else None], slice(2 * half_height_px + 1 if alike else None)
        return cls(
            phase_rad=as_float32(phase),
            cos=as_float32(np.cos(phase)),
            sin=as_float32(np.sin(phase)),
            rows=as_float32(np.stack([np.cos(unlike), np.sin(unlike)])),
            rad_per_px=as_float32(rad_per_px),
            table=FitTable.build(phase[window], rad_per_px[window], half_width, half_height_px, ripple),
            half_width_px=half_width,
            half_height_px=half_height_px,
            disparity_px=disparity_px,
        )


def as_float32(table: npt.NDArray[np.float64]) -> Float32:
    """Contiguous float32 copy, as the kernels read it."""
    return np.ascontiguousarray(table, dtype=np.float32)


def half_period_px(rad_per_px: npt.NDArray[np.float64]) -> int:
    """Half of the odd number of columns nearest to the median period, or raise SettingsError."""
    speed = float(np.median(np.abs(rad_per_px)))
    width = rad_per_px.shape[1]
    period_px = 2.0 * np.pi / max(speed, 1e-9)
    if not MIN_WINDOW_PX <= period_px <= width / 4:
        raise SettingsError(
            f"a fringe is {period_px:.1f} camera columns wide at the middle of the depth range; between "
            f"{MIN_WINDOW_PX} and {width // 4} (a quarter of the image) are allowed: change period_px"
        )
    return max(round((period_px - 1.0) / 2.0), MIN_WINDOW_PX // 2)
