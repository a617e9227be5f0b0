"""Figure 1: the moire of two gratings, equations (1) to (5)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from moire_sensor.reference_height import shift_of_phase_m
from moire_sensor.reference_phase import grating, moire_phase_periods, superposed
from tools.figures.drawing import DEPTH_MAP, ERROR_MAP, draw_panel
from tools.figures.page import Claim, Experiment
from tools.figures.stage import TURN, Array
from tools.small_png import save

C = 0.4
PITCH_PX, PITCH_M = 16.0, 0.020
# Plane waves, equation (5): tan theta_1 + tan theta_2, and a hump of three moire contours.
TANGENTS = 0.5
HUMP_M, HUMP_WIDTH_PX = 0.120, (110.0, 85.0)


@dataclass(frozen=True, eq=False)
class TwoGratings:
    """Everything (H, W): the model grating, the sum with the reference, true and measured height in metres.

    ``identity_error`` is the largest difference between the sum and the product form of equation (4).
    """

    model: Array
    total: Array
    height_m: Array
    measured_m: Array
    identity_error: float

    @property
    def error_mm(self) -> Array:
        """Measured minus true height (H, W)."""
        return (self.measured_m - self.height_m) * 1e3

    @property
    def contours(self) -> float:
        """Moire contours up to the top of the hump: the largest psi."""
        return float(self.height_m.max() * TANGENTS / PITCH_M)


def measure(rows: int = 300, noise: float = 0.005, seed: int = 0) -> TwoGratings:
    """Bend a grating over a hump, lay it on the reference, and find the height in the sum alone."""
    y, x = np.mgrid[0.0:rows, 0.0:640.0]
    reach = ((x - 319.5) / HUMP_WIDTH_PX[0]) ** 2 + ((y - (rows - 1) / 2.0) / HUMP_WIDTH_PX[1]) ** 2
    height_m = HUMP_M * np.exp(-0.5 * reach)
    psi = height_m * TANGENTS / PITCH_M
    carrier_rad = TURN * x / PITCH_PX
    model = grating(carrier_rad + TURN * psi, C)
    total = superposed(grating(carrier_rad, C), model)
    product = 2.0 * C * (1.0 + np.cos(np.pi * psi) * np.cos(TURN * (x / PITCH_PX + 0.5 * psi)))
    seen = total + noise * np.random.default_rng(seed).standard_normal(total.shape)
    found = moire_phase_periods(seen, carrier_rad, C, PITCH_PX)
    # The hump is smooth and flat at the border, so here whole periods can be counted along each row.
    psi_found = np.unwrap(found, period=1.0, axis=1)
    measured_m = shift_of_phase_m(psi_found, PITCH_M) / TANGENTS
    return TwoGratings(model, total, height_m, measured_m, float(np.abs(product - total).max()))


def draw_gratings(result: TwoGratings, path: Path) -> None:
    """Model grating, moire, height and error."""
    figure = Figure(figsize=(11.0, 5.6), layout="constrained")
    axes = figure.subplots(2, 2)
    draw_panel(axes[0, 0], result.model, "grating bent by the object, equation (2)", (0.0, 1.0), unit="transmittance")
    draw_panel(axes[0, 1], result.total, "sum with the reference, equation (4)", (0.0, 2.0), unit="transmittance")
    height = result.measured_m * 1e3
    draw_panel(axes[1, 0], height, "height from the sum", (0.0, HUMP_M * 1e3), DEPTH_MAP, "mm")
    draw_panel(axes[1, 1], result.error_mm, "error of the height", (-0.5, 0.5), ERROR_MAP, "mm")
    save(figure, path)


def experiment(result: TwoGratings) -> Experiment:
    """Tell what the sum gives."""
    error = float(np.sqrt(np.mean(np.square(result.error_mm))))
    text = (
        f"A hump of {HUMP_M * 1e3:.0f} mm bends a grating of {PITCH_M * 1e3:.0f} mm pitch; laid on the straight one, "
        f"{result.contours:.1f} moire contours appear, dark where the beat cos(pi psi) is zero. Equation (4), a sum "
        f"equal to a product, holds to {result.identity_error:.0e}. Fourier analysis of the rows, with noise of 0.005, "
        f"returns the height to {error:.2f} mm rms. Contours are counted from the flat border inwards; across a jump "
        "they could not be."
    )
    claim = Claim(
        "1",
        "two superposed gratings show the phase psi of the object, equations (1) to (5)",
        f"height of a {HUMP_M * 1e3:.0f} mm hump to {error:.2f} mm rms",
        "yes",
    )
    title = "Figure 1: moire of two gratings"
    return Experiment("fig01_gratings", title, text, (), (claim,), lambda path: draw_gratings(result, path))
