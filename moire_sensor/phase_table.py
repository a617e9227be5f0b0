"""What the fit of a window needs to know of the carrier around its centre; slow along the rows, so kept for few."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Float32 = npt.NDArray[np.float32]
# Between two rows of the table its entries are linear to 1e-6 of the largest, even for a strongly turned projector.
ROW_STEP = 8
CONSTANT = 1e-6
SLOWEST = 1e-6
# A slope along the row beyond this share of the carrier's frequency is noise.
LARGEST_DETUNING = 0.6
UPPER_TRIANGLE = np.triu_indices(3)
# Entries of a table's row, each over the columns whose window lies inside.
INVERSE, SIN_RAMP, SIN_COS_RAMP, FREE_COS, FREE_SIN, RIPPLE, LIMIT, ENTRIES = 0, 6, 7, 8, 9, 10, 11, 12


@dataclass(frozen=True, eq=False)
class FitTable:
    """Constants of the windows centred on some rows, turned into the phase of their centres.

    With theta the carrier's phase less that of the window's centre and t the column less the centre's:

    Attributes
    ----------
    rows : (R,) int64, the image rows; between them entries are linear. One row where the carrier is the same in all.
    entries : (R, 12, W - 2 half_width) float32. Six of the inverse (upper triangle) of the normal matrix of
        (1, cos theta, sin theta); the sums of t sin theta and t sin theta cos theta; the squared lengths of
        t sin theta and t cos theta, less what lies along (1, cos theta, sin theta); the ripple's factor over the
        carrier's frequency, pixels; the largest believed slope along the row, radians per pixel.
    """

    rows: npt.NDArray[np.int64]
    entries: Float32

    @classmethod
    def build(cls, phase_rad: Array, rad_per_px: Array, half_width: int, half_height: int, ripple: float) -> FitTable:
        """Table of a carrier (H, W) for windows of 2 n + 1 columns and rows."""
        first = min(half_height, phase_rad.shape[0] - 1)
        last = max(phase_rad.shape[0] - 1 - half_height, first)
        rows = np.append(np.arange(first, last, ROW_STEP), last)
        at = np.ix_(rows, np.arange(half_width, phase_rad.shape[1] - half_width))
        moments = WindowMoments(phase_rad, half_width, half_height, at)
        inverse: Array = np.linalg.inv(moments.normal_matrices()).astype(np.float64, copy=False)
        entries = [inverse[..., i, j] for i, j in zip(*UPPER_TRIANGLE, strict=True)]
        entries += detuned(moments, inverse)
        speed = np.where(np.abs(rad_per_px[at]) < SLOWEST, SLOWEST, rad_per_px[at])
        entries += [ripple / speed, LARGEST_DETUNING * np.abs(speed)]
        table = np.stack(entries, axis=1)
        if (np.ptp(table, axis=0) <= CONSTANT * np.abs(table).max(axis=(0, 2))[:, None]).all():
            rows, table = rows[:1], table[:1]
        return cls(rows.astype(np.int64), np.ascontiguousarray(table, dtype=np.float32))


class WindowMoments:
    """Sums over windows of t^power exp(i harmonic theta), for the windows centred ``at`` some pixels."""

    def __init__(
        self, phase_rad: Array, half_width: int, half_height: int, at: tuple[npt.NDArray[np.int64], ...]
    ) -> None:
        self._at = at
        # Harmonics 1 and 2 of the whole image; all sums are of these.
        self._waves = {n: (np.cos(n * phase_rad), np.sin(n * phase_rad)) for n in (1, 2)}
        self._columns = np.arange(-half_width, half_width + 1, dtype=np.float64)
        self._rows = np.ones(2 * half_height + 1)

    def of(self, power: int, harmonic: int) -> npt.NDArray[np.complex128]:
        """Sum of t^power exp(i harmonic theta), harmonic 1 or 2."""
        cos, sin = self._waves[harmonic]
        real, imaginary = (cv2.sepFilter2D(wave, -1, self._columns**power, self._rows) for wave in (cos, sin))
        turned = (real[self._at] + 1j * imaginary[self._at]) * (cos[self._at] - 1j * sin[self._at])
        return np.asarray(turned)

    def normal_matrices(self) -> Array:
        """Sums of f f^T with f = (1, cos theta, sin theta), (..., 3, 3)."""
        one, two = self.of(0, 1), self.of(0, 2)
        count = np.full(one.shape, float(self._columns.size * self._rows.size))
        top = [count, one.real, one.imag]
        middle = [one.real, 0.5 * (count + two.real), 0.5 * two.imag]
        bottom = [one.imag, 0.5 * two.imag, 0.5 * (count - two.real)]
        return np.stack([np.stack(row, axis=-1) for row in (top, middle, bottom)], axis=-2)

    def squares(self) -> tuple[Array, Array]:
        """Sums of (t cos theta)^2 and (t sin theta)^2."""
        total = float((self._columns**2).sum() * self._rows.size)
        two = self.of(2, 2).real
        return 0.5 * (total + two), 0.5 * (total - two)


def detuned(moments: WindowMoments, inverse: Array) -> list[Array]:
    """Entries about the column t (D cos theta - C sin theta) that a small change of frequency adds to the fit.

    Its even and odd parts are taken for square to each other, which they are where the frequency is constant.
    """
    sin_ramp, sin_cos_ramp = moments.of(1, 1).imag, 0.5 * moments.of(1, 2).imag
    cos_square, sin_square = moments.squares()
    along = inverse[..., 0, 0] * sin_ramp + 2.0 * inverse[..., 0, 1] * sin_cos_ramp
    bound_cos = along * sin_ramp + inverse[..., 1, 1] * sin_cos_ramp**2
    bound_sin = inverse[..., 2, 2] * sin_cos_ramp**2
    return [sin_ramp, sin_cos_ramp, sin_square - bound_cos, cos_square - bound_sin]


def ripple_factor(rad_per_px: float, half_width: int) -> float:
    """First-order phase error per relative detuning, divided by sin(2 phase), of a least-squares fit.

    A fringe e finer than the carrier adds -b w e t sin(phase + w t); its projections on cos and sin over the
    symmetric window move the phase by (w e / 2) (p + q) sin(2 phase).
    """
    t = np.arange(-half_width, half_width + 1, dtype=np.float64)
    basis = np.stack([np.ones_like(t), np.cos(rad_per_px * t), np.sin(rad_per_px * t)], axis=1)
    odd, even = (np.linalg.lstsq(basis, t * basis[:, column], rcond=None)[0] for column in (1, 2))
    return float(0.5 * rad_per_px * (odd[2] + even[1]))
