"""Fringe light on rendered geometry: the ideal, noise-free picture of one camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import SettingsError
from moire_sensor.pattern import FringePattern
from moire_sensor.projection import distort_pixels
from moire_sensor.rig import StereoRig
from moire_sensor.settings import check_ranges, setting
from moire_sim.device_view import DeviceView, lambert_cosine, tangent_planes, visible_share
from moire_sim.exposure import lens_blur, projected_signal
from moire_sim.surface_kernels import fill_pixels

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]
LIT_SHARE = 0.5


@dataclass(frozen=True)
class Light:
    """Light and lens; grey levels are of 8 bit, for white that faces the projector; all are 0 or more.

    Raises
    ------
    SettingsError
        A value outside its range, or an amplitude above the offset.
    """

    ambient: float = setting(20.0, 0.0, 255.0, "light that is always there, grey levels")
    offset: float = setting(80.0, 0.0, 255.0, "mean of the projector's light, grey levels")
    amplitude: float = setting(70.0, 0.0, 255.0, "amplitude of the fringes, grey levels, at most offset")
    gamma: float = setting(1.0, 0.2, 5.0, "response of the projector, 1 is linear")
    blur_px: float = setting(0.55, 0.0, 20.0, "blur of the cameras' lenses, pixels, standard deviation")

    def __post_init__(self) -> None:
        check_ranges(self)
        if self.amplitude > self.offset:
            raise SettingsError(f"amplitude is {self.amplitude}; it must be 0 to {self.offset:g}, the offset")


@dataclass(frozen=True, eq=False)
class Surfaces:
    """What a camera sees, pixel by pixel, and how the projector's light falls on it; all arrays (H, W, ...).

    Attributes
    ----------
    points_m : (H, W, 3) in the left optical frame, NaN where nothing is seen.
    planes : (H, W, 3) tangent planes ``q . X = 1``.
    albedo : float32, 0 where nothing is seen.
    lit_share : float32, 0 (shadow or outside the projector's image) to 1.
    lambert : float32, cosine between normal and light, 0 where it faces away.
    device_px : (H, W, 2) projector device column and row, of no meaning where nothing is seen.
    """

    points_m: Array
    planes: Array
    albedo: Image
    lit_share: Image
    lambert: Image
    device_px: Array

    @property
    def lit(self) -> npt.NDArray[np.bool_]:
        """Pixels (H, W) at least half lit by the projector."""
        return self.lit_share >= LIT_SHARE


def light_surfaces(
    rig: StereoRig, camera: DeviceView, depth_m: Array, albedo: Image, projector: DeviceView, projector_depth_m: Array
) -> Surfaces:
    """Work out light and shadow on what a camera sees, from its depth buffer and the projector's."""
    points = camera.points(depth_m)
    planes = tangent_planes(camera, depth_m)
    lit = visible_share(projector, projector_depth_m, points, planes)
    known = np.isfinite(depth_m)
    return Surfaces(
        points,
        planes,
        np.where(known, albedo, np.float32(0.0)),
        lit,
        lambert_cosine(planes, points, projector.centre_m),
        lighting_pixels(rig, points),
    )


def lighting_pixels(rig: StereoRig, points_m: Array) -> Array:
    """Projector device column and row (H, W, 2) that light points (H, W, 3); no light comes where there is none."""
    pixels = np.empty((*points_m.shape[:-1], 2))
    fill_pixels(points_m.reshape(-1, 3), rig.P_projector, pixels.reshape(-1, 2))
    if not rig.projector_distortion:
        return pixels
    return distort_pixels(pixels, rig.projector_matrix, rig.projector_distortion)


def fringe_picture(surfaces: Surfaces, pattern: FringePattern, step: int, light: Light) -> Image:
    """Grey levels (H, W) float32 before noise: albedo (ambient + Lambert (offset + amplitude signal)), blurred."""
    signal = projected_signal(pattern, surfaces.device_px[..., 0], step, light.gamma).astype(np.float32)
    projected = surfaces.lambert * surfaces.lit_share * (light.offset + light.amplitude * signal)
    picture = surfaces.albedo * (light.ambient + projected)
    return lens_blur(np.asarray(picture, dtype=np.float32), light.blur_px)


def dark_picture(surfaces: Surfaces, light: Light) -> Image:
    """Grey levels (H, W) float32 before noise with the projector off."""
    return lens_blur(surfaces.albedo * light.ambient, light.blur_px)
