"""Fringe light on rendered geometry: the ideal, noise-free picture of one camera."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import SettingsError
from moire_sensor.pattern import FringePattern
from moire_sensor.rig import StereoRig
from moire_sensor.settings import check_ranges, setting
from moire_sim.device_view import DeviceView, dot, tangent_planes, visible_share
from moire_sim.exposure import lens_blur, projected_signal

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
    column_px : float64, projector device column.
    """

    points_m: Array
    planes: Array
    albedo: Image
    lit_share: Image
    lambert: Image
    column_px: Array

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
    safe = np.where(known[..., None], points, 1.0)
    return Surfaces(
        points,
        planes,
        np.where(known, albedo, 0.0).astype(np.float32),
        lit,
        lambert_cosine(planes, safe, projector.centre_m).astype(np.float32),
        rig.projector_pixels(safe)[..., 0],
    )


def lambert_cosine(planes: Array, points_m: Array, light_m: Array) -> Array:
    """Cosine (...) between the normals of planes ``q . X = 1`` and the way to the light, at least 0."""
    away = points_m - light_m
    scale = np.sqrt(dot(planes, planes) * dot(away, away))
    return np.asarray(np.clip(dot(planes, away) / scale, 0.0, 1.0))


def fringe_picture(surfaces: Surfaces, pattern: FringePattern, step: int, light: Light) -> Image:
    """Grey levels (H, W) float32 before noise: albedo (ambient + Lambert (offset + amplitude signal)), blurred."""
    signal = projected_signal(pattern, surfaces.column_px, step, light.gamma).astype(np.float32)
    projected = surfaces.lambert * surfaces.lit_share * (light.offset + light.amplitude * signal)
    picture = surfaces.albedo * (light.ambient + projected)
    return lens_blur(np.asarray(picture, dtype=np.float32), light.blur_px)


def dark_picture(surfaces: Surfaces, light: Light) -> Image:
    """Grey levels (H, W) float32 before noise with the projector off."""
    return lens_blur(surfaces.albedo * light.ambient, light.blur_px)
