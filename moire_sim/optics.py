"""Flaws of projector, lenses, cameras and surfaces as parameters, each with unit and range; the ideal has none."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from moire_sensor.settings import check_ranges, setting


@dataclass(frozen=True)
class Optics:
    """What sets real pictures apart from ideal ones; the defaults are the ideal.

    Light levels of :class:`moire_sim.Light` hold for white that faces the projector, at 10 ms exposure and no gain, in
    the middle of the image and of the projector's field, and at ``fall_off_m`` where that is not 0.

    Raises
    ------
    SettingsError
        A value outside its range; the message names it.
    """

    projector_focus_m: float = setting(1.0, 0.05, 100.0, "distance at which the projector is sharp, m")
    projector_aperture_mm: float = setting(0.0, 0.0, 100.0, "opening of the projector's lens, mm; 0: sharp everywhere")
    projector_blur_px: float = setting(0.0, 0.0, 50.0, "blur of the projector in focus, its pixels, standard deviation")
    projector_vignetting: float = setting(0.0, 0.0, 1.0, "share of the projector's light lost in its corners")
    fall_off_m: float = setting(0.0, 0.0, 100.0, "distance at which the projector's light is as stated, m; 0: anywhere")
    speckle: float = setting(0.0, 0.0, 1.0, "contrast of the laser's speckle in a pixel, deviation over mean")
    sweep_ms: float = setting(0.0, 0.0, 1000.0, "time in which a mirror sweeps the fringes from left to right, ms")
    flicker: float = setting(0.0, 0.0, 1.0, "swing of the ambient light, share of its mean")
    lamp_hz: float = setting(100.0, 0.0, 10000.0, "rate at which the ambient light swings, Hz")
    surface_texture: float = setting(0.0, 0.0, 1.0, "darkening by texture where a body has no finish of its own, share")
    surface_specular: float = setting(0.0, 0.0, 10.0, "gloss where a body has no finish of its own, peak over white")
    k1: float = setting(0.0, -2.0, 2.0, "radial distortion of the cameras' lenses, second order (Brown-Conrady)")
    k2: float = setting(0.0, -10.0, 10.0, "radial distortion, fourth order")
    p1: float = setting(0.0, -0.1, 0.1, "decentring, along the rows")
    p2: float = setting(0.0, -0.1, 0.1, "decentring, along the columns")
    k3: float = setting(0.0, -50.0, 50.0, "radial distortion, sixth order")
    vignetting: float = setting(0.0, 0.0, 1.0, "share of the light that the cameras lose in their corners")
    supersampling: int = setting(1, 1, 4, "samples of a pixel along rows and columns, so that edges cover parts of one")  # type: ignore[assignment]
    exposure_ms: float = setting(10.0, 0.001, 1000.0, "exposure time of the cameras, ms")
    auto_exposure_grey: float = setting(
        0.0, 0.0, 255.0, "grey level that the exposure gives the brightest 1 % of the left view, from one eighth to "
        "eight times exposure_ms; 0: fixed"
    )  # fmt: skip
    gain: float = setting(1.0, 1.0, 100.0, "gain of the cameras, which multiplies light and noise")
    electrons_per_grey: float = setting(0.0, 0.0, 1e6, "electrons of an 8-bit grey level at gain 1; 0: no photon noise")
    pixel_gain_spread: float = setting(0.0, 0.0, 0.5, "fixed pattern: deviation of the pixels' gains from 1")
    pixel_offset_spread: float = setting(0.0, 0.0, 50.0, "fixed pattern: deviation of the pixels' offsets, greys")

    def __post_init__(self) -> None:
        check_ranges(self)

    @cached_property
    def lens(self) -> tuple[float, ...]:
        """Distortion k1, k2, p1, p2, k3 of both cameras, as in camera_info; empty where there is none."""
        values = (self.k1, self.k2, self.p1, self.p2, self.k3)
        return values if any(values) else ()

    @cached_property
    def is_ideal(self) -> bool:
        """True where nothing but :class:`moire_sim.Light` and the camera's noise makes the pictures."""
        return self == IDEAL


IDEAL = Optics()
# A small DLP projector with an 8 mm lens, two machine-vision cameras behind 12 mm lenses, a lit room. A white pixel
# holds 10200 electrons, as pixels of 3.45 micrometres do. What costs most, the fall-off with distance, is no choice:
# light from a lens thins with the square of the way.
REAL = Optics(
    projector_aperture_mm=8.0,
    projector_blur_px=0.4,
    projector_vignetting=0.15,
    fall_off_m=1.0,
    speckle=0.015,
    flicker=0.1,
    surface_texture=0.25,
    surface_specular=0.15,
    k1=-0.12,
    k2=0.08,
    p1=4e-4,
    p2=-3e-4,
    vignetting=0.15,
    supersampling=2,
    auto_exposure_grey=220.0,
    electrons_per_grey=40.0,
    pixel_gain_spread=0.008,
    pixel_offset_spread=0.3,
)
