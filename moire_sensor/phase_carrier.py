"""The carrier: phase that the middle of the depth range would show, and the window one period wide around it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.errors import SettingsError
from moire_sensor.projector_map import ProjectorMap

Float32 = npt.NDArray[np.float32]
MIN_WINDOW_PX = 5
DETUNED_BINS = 32


@dataclass(frozen=True, eq=False)
class Carrier:
    """What one camera would see of a fronto-parallel surface at the middle disparity.

    Attributes
    ----------
    phase_rad : (H, W) float32, absolute carrier phase.
    cos, sin : (H, W) float32 of it.
    rad_per_px : (H, W) float32, its derivative along the row.
    inverse : (H, W, 6) float32, upper triangle of the inverse normal matrix of (1, cos, -sin) over the window.
    detuned : (bins, 9) float32, moments of a fringe off the carrier's frequency, see :func:`detuned_table`.
    half_width_px, half_height_px : the window holds 2 n + 1 columns and rows.
    ripple : factor of the phase error ``ripple * e * sin(2 phase)`` when the fringe is e times finer than the carrier.
    """

    phase_rad: Float32
    cos: Float32
    sin: Float32
    rad_per_px: Float32
    inverse: Float32
    detuned: Float32
    half_width_px: int
    half_height_px: int
    ripple: float

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
        cos, sin = np.cos(phase), np.sin(phase)
        inverse = inverse_normal_matrices(cos, sin, half_width, half_height_px)
        ripple = ripple_factor(float(np.median(np.abs(rad_per_px))), half_width)
        detuned = detuned_table(rad_per_px, half_width, half_height_px)
        return cls(
            phase_rad=as_float32(phase),
            cos=as_float32(cos),
            sin=as_float32(sin),
            rad_per_px=as_float32(rad_per_px),
            inverse=as_float32(inverse),
            detuned=as_float32(detuned),
            half_width_px=half_width,
            half_height_px=half_height_px,
            ripple=ripple,
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


def box_sum(values: npt.NDArray[np.float64], half_width: int, half_height: int) -> npt.NDArray[np.float64]:
    """Sum over the window centred on each pixel (H, W); meaningful where the window lies inside."""
    size = (2 * half_width + 1, 2 * half_height + 1)
    return np.asarray(cv2.boxFilter(values, -1, size, normalize=False, borderType=cv2.BORDER_CONSTANT))


def inverse_normal_matrices(
    cos: npt.NDArray[np.float64], sin: npt.NDArray[np.float64], half_width: int, half_height: int
) -> npt.NDArray[np.float64]:
    """Upper triangle (00, 01, 02, 11, 12, 22) of the inverse of sum f f^T with f = (1, cos, -sin), (H, W, 6)."""
    count = float((2 * half_width + 1) * (2 * half_height + 1))
    a, b = (box_sum(values, half_width, half_height) for values in (cos, -sin))
    c, d = (box_sum(values, half_width, half_height) for values in (cos * cos, -cos * sin))
    e = count - c
    cofactors = [c * e - d * d, b * d - a * e, a * d - b * c, count * e - b * b, a * b - count * d, count * c - a * a]
    determinant = count * cofactors[0] + a * cofactors[1] + b * cofactors[2]
    inside = np.zeros(cos.shape, dtype=bool)
    inside[half_height : cos.shape[0] - half_height, half_width : cos.shape[1] - half_width] = True
    return np.asarray(np.stack(cofactors, axis=-1) / np.where(inside, determinant, np.inf)[..., None])


def detuned_table(
    rad_per_px: npt.NDArray[np.float64], half_width: int, half_height: int
) -> npt.NDArray[np.float64]:
    """What the fit needs to know of the column t (D cos - C sin) that a small change of frequency adds.

    Row k belongs to the k-th of ``DETUNED_BINS`` frequencies between the smallest and largest of the image: the
    frequency, the window's sums of t sin, t sin cos, t^2 cos^2, t^2 sin^2, and the inverse normal matrices of (1, cos)
    (upper triangle) and of (sin).
    """
    speeds = np.abs(rad_per_px)
    t = np.arange(-half_width, half_width + 1, dtype=np.float64)
    rows = 2 * half_height + 1
    table = []
    for speed in np.linspace(speeds.min(), speeds.max(), DETUNED_BINS):
        cos, sin = np.cos(speed * t), np.sin(speed * t)
        even = rows * np.array([[t.size, cos.sum()], [cos.sum(), cos @ cos]])
        moments = [rows * (t @ sin), rows * (t * sin @ cos), rows * (t * cos @ (t * cos)), rows * (t * sin @ (t * sin))]
        table.append([speed, *moments, *np.linalg.inv(even)[np.triu_indices(2)], 1.0 / (rows * (sin @ sin))])
    return np.array(table)


def ripple_factor(rad_per_px: float, half_width: int) -> float:
    """First-order phase error per relative detuning, divided by sin(2 phase), of a least-squares fit.

    A fringe e finer than the carrier adds -b w e t sin(phase + w t); its projections on cos and sin over the
    symmetric window move the phase by (w e / 2) (p + q) sin(2 phase).
    """
    t = np.arange(-half_width, half_width + 1, dtype=np.float64)
    basis = np.stack([np.ones_like(t), np.cos(rad_per_px * t), np.sin(rad_per_px * t)], axis=1)
    odd, even = (np.linalg.lstsq(basis, t * basis[:, column], rcond=None)[0] for column in (1, 2))
    return float(0.5 * rad_per_px * (odd[2] + even[1]))
