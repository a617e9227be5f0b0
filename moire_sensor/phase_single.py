"""Sub-pixel phase from one exposure: least squares over windows one period wide that avoid edges.

Every pixel has one fit of ``a + b cos(carrier + offset)`` over the window centred on it. A pixel then takes the fit of
whichever window that contains it fits best (symmetric multiple windows, reference [15] of the paper), so that no window
straddles a depth or shadow edge, and carries that phase to itself along the local slope.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from moire_sensor.phase_carrier import Carrier, Float32
from moire_sensor.phase_fit import PLANES, UNUSABLE, VARIANCE, fit_windows
from moire_sensor.phase_image import PhaseImage
from moire_sensor.phase_windows import pick_windows, slopes_down
from moire_sensor.settings import Settings

GOOD_SHARE = 1.3
# Enough windows for the median of their variances: one in so many rows and columns.
SAMPLED_ROWS, SAMPLED_COLUMNS = 11, 7


@dataclass(frozen=True, eq=False)
class FitPlanes:
    """Arrays of one camera that every frame fills anew, so that none is allocated.

    Attributes
    ----------
    values : (7, H + 2 pad_y, W + 2 pad_x) float32, the fits of :mod:`moire_sensor.phase_fit`. Windows that leave the
        image are never fitted and keep the variance ``UNUSABLE``; so does the margin, which spares the kernels all
        questions about the border.
    results : (3, H, W) float32, offset, amplitude and sigma of the last image.
    """

    values: Float32
    results: Float32
    pad_y: int
    pad_x: int

    @classmethod
    def of(cls, carrier: Carrier) -> FitPlanes:
        """Planes for the images of a carrier."""
        height, width = carrier.phase_rad.shape
        pad_y, pad_x = 2 * row_step(carrier), 2 * quarter(carrier)
        values = np.zeros((PLANES, height + 2 * pad_y, width + 2 * pad_x), dtype=np.float32)
        values[VARIANCE] = UNUSABLE
        return cls(values, np.empty((3, height, width), dtype=np.float32), pad_y, pad_x)

    def inside(self, plane: int) -> Float32:
        """One plane without its margin, (H, W)."""
        return self.values[plane, self.pad_y : -self.pad_y, self.pad_x : -self.pad_x]

    def typical_variance(self, carrier: Carrier) -> float:
        """Median variance of the windows that lie inside the image."""
        y, x = self.pad_y + carrier.half_height_px, self.pad_x + carrier.half_width_px
        sample = self.values[VARIANCE, y:-y:SAMPLED_ROWS, x:-x:SAMPLED_COLUMNS].ravel()
        middle = sample.size // 2
        return float(np.partition(sample, middle)[middle]) if sample.size else 0.0


def quarter(carrier: Carrier) -> int:
    """Columns of a quarter of a window."""
    return (carrier.half_width_px + 1) // 2


def row_step(carrier: Carrier) -> int:
    """Rows between windows that are compared down a column."""
    return max(carrier.half_height_px, 1)


def phase_from_single(
    image: Float32, carrier: Carrier, step_rad: float, settings: Settings, planes: FitPlanes | None = None
) -> PhaseImage:
    """Phase of every pixel of one fringe image.

    Parameters
    ----------
    image : (H, W) float32, grey levels scaled to 255 at saturation.
    carrier : the camera's carrier.
    step_rad : phase that the projector adds in this exposure.
    planes : the carrier's; offset, amplitude and sigma of the result lie in them and last until their next use.

    Returns
    -------
    PhaseImage
        NaN phase where the fringe amplitude is below ``settings.min_amplitude`` or the window is saturated.
    """
    planes = planes or FitPlanes.of(carrier)
    fit_planes(image, carrier, planes)
    return picked_phase(image, carrier, step_rad, settings, planes)


def fit_planes(image: Float32, carrier: Carrier, planes: FitPlanes) -> None:
    """Fill the planes with the fits of one image."""
    fit_windows(
        image, carrier.cos, carrier.sin, carrier.table.rows, carrier.table.entries, carrier.half_width_px,
        carrier.half_height_px, planes.values, planes.pad_y, planes.pad_x,
    )  # fmt: skip
    slopes_down(planes.values, planes.pad_y, row_step(carrier))


def picked_phase(
    image: Float32, carrier: Carrier, step_rad: float, settings: Settings, planes: FitPlanes
) -> PhaseImage:
    """Phase of every pixel from the best of the windows that hold it."""
    half_width, half_height = carrier.half_width_px, carrier.half_height_px
    offset, amplitude, sigma = planes.results
    background, status = np.empty_like(offset), np.empty(image.shape, dtype=np.uint8)
    pick_windows(
        image, planes.values, planes.pad_y, planes.pad_x, half_height * np.array([-1, 0, 1]),
        np.array([-half_width, -quarter(carrier), 0, quarter(carrier), half_width]),
        np.float32(GOOD_SHARE * planes.typical_variance(carrier)), np.float32(step_rad),
        np.float32(settings.min_amplitude), np.float32(settings.min_amplitude_to_noise),
        (2 * half_width + 1) * (2 * half_height + 1), offset, background, amplitude, sigma, status,
    )  # fmt: skip
    return PhaseImage(offset, amplitude, background, sigma, status)
