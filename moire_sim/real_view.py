"""What one camera sees through real optics while nothing moves: how each sample of its picture answers light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.pattern import FringePattern
from moire_sim.camera_lens import CameraLens
from moire_sim.device_view import DeviceView
from moire_sim.finish import Finish, Texture
from moire_sim.fringe_image import Light, Surfaces
from moire_sim.optics import Optics
from moire_sim.projector_light import blurred_signal, corner_loss, defocus_px, gloss, strength

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]
DEFAULT_CELL_M, DEFAULT_SHININESS = 0.03, 30.0


@dataclass(frozen=True, eq=False)
class RealView:
    """One camera's view; the arrays are of its lens's fine picture, ``corners`` (H, W) of its own.

    Attributes
    ----------
    white : share of the ambient light that a sample returns.
    answer : share of the projector's light that it returns.
    column_px : projector device column that lights it.
    blur_px : of the projector there, its pixels.
    corners : share of the light that the camera's lens lets through.
    """

    lens: CameraLens
    white: Image
    answer: Image
    column_px: Array
    blur_px: Image
    corners: Image

    @classmethod
    def of(
        cls,
        lens: CameraLens,
        surfaces: Surfaces,
        finishes: Finishes,
        projector: DeviceView,
        optics: Optics,
        size: tuple[int, int],
    ) -> RealView:
        """Work out how the surfaces that a camera sees answer light."""
        known = np.isfinite(surfaces.points_m[..., 2])
        points = np.where(known[..., None], surfaces.points_m, 1.0)
        planes = np.where(known[..., None], surfaces.planes, 1.0)
        white = surfaces.albedo * finishes.shade(points)
        returned = white * surfaces.lambert
        specular, shininess = finishes.specular()
        if specular.any():
            camera_m = lens.fine_view.centre_m
            returned = returned + specular * gloss(planes, points, projector.centre_m, camera_m, shininess)
        answer = returned * surfaces.lit_share * strength(optics, projector, points, surfaces.device_px)
        columns, rows = np.meshgrid(np.arange(float(size[0])), np.arange(float(size[1])))
        return cls(
            lens,
            white.astype(np.float32),
            np.where(known, answer, 0.0).astype(np.float32),
            surfaces.device_px[..., 0],
            defocus_px(optics, projector, points).astype(np.float32),
            corner_loss(np.stack([columns, rows], axis=-1), size, optics.vignetting).astype(np.float32),
        )

    def ambient(self, light: Light) -> Image:
        """Picture (H, W) of the steady ambient light, grey levels."""
        return self.corners * self.lens.photograph(self.white * np.float32(light.ambient), light.blur_px)

    def projected(self, pattern: FringePattern, step: int, light: Light, share: Image | None = None) -> Image:
        """Picture (H, W) of the projector's light, grey levels; ``share`` of it for each sample where not all."""
        signal = blurred_signal(pattern, step, light.gamma, self.column_px, self.blur_px)
        grey = self.answer * (light.offset + light.amplitude * signal).astype(np.float32)
        return self.corners * self.lens.photograph(grey if share is None else grey * share, light.blur_px)

    def brightest(self, light: Light) -> Image:
        """Picture (H, W) with the projector all bright: what must not saturate."""
        grey = self.white * light.ambient + self.answer * (light.offset + light.amplitude)
        return self.corners * self.lens.photograph(grey.astype(np.float32), light.blur_px)


@dataclass(frozen=True, eq=False)
class Finishes:
    """The finish of what each sample shows.

    Attributes
    ----------
    body : (H, W) number of the body, -1 where nothing is seen.
    finishes : of each body.
    rest_from_left : (4, 4) of each body, from the left optical frame to the place where its texture was put on.
    """

    body: npt.NDArray[np.int32]
    finishes: tuple[Finish, ...]
    rest_from_left: tuple[Array, ...]

    def shade(self, points_m: Array) -> Array:
        """Darkening (H, W) by texture at points (H, W, 3) in the left optical frame."""
        share = np.ones(self.body.shape)
        for number, (finish, pose) in enumerate(zip(self.finishes, self.rest_from_left, strict=True)):
            chosen = self.body == number
            if finish.texture != "none" and chosen.any():
                share[chosen] = finish.shade(points_m[chosen] @ pose[:3, :3].T + pose[:3, 3])
        return share

    def specular(self) -> tuple[Array, Array]:
        """Gloss and its exponent (H, W)."""
        gloss_of = np.array([*(one.specular for one in self.finishes), 0.0])
        shininess_of = np.array([*(one.shininess for one in self.finishes), 1.0])
        return gloss_of[self.body], shininess_of[self.body]


def finish_of(own: Finish | None, optics: Optics) -> Finish:
    """Return a body's own finish, or the one that the optics give bodies without."""
    if own is not None:
        return own
    texture: Texture = "noise" if optics.surface_texture else "none"
    return Finish(texture, optics.surface_texture, DEFAULT_CELL_M, optics.surface_specular, DEFAULT_SHININESS)
