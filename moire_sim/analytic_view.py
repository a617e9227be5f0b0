"""Exact pictures of analytic surfaces under fringe light, as one camera sees them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.rig import StereoRig
from moire_sim.analytic_surfaces import Array, Surface, cast, unit, unobstructed
from moire_sim.exposure import lens_blur
from moire_sim.fringe_image import Light
from moire_sim.random_dots import Projected, signal_at

Mask = npt.NDArray[np.bool_]
SUPERSAMPLES = 4
CHECKER_M = 0.025


@dataclass(frozen=True)
class Samples:
    """What rays through image points meet; every array has one entry per ray.

    ``reflectance`` is albedo times Lambert's cosine where lit and 0 in shadow; ``surface`` is -1 for a miss;
    ``projector_px`` is (N, 2), device column and row.
    """

    points_m: Array
    surface: npt.NDArray[np.int64]
    lit: Mask
    albedo: Array
    reflectance: Array
    projector_px: Array


def device_centre(projection: Array) -> Array:
    """Return the centre of projection (3,) of a (3, 4) projection matrix."""
    return np.asarray(-np.linalg.solve(projection[:, :3], projection[:, 3]))


def checker_albedo(points: Array, texture: float) -> Array:
    """Albedo 1 and 1 - ``texture`` in cubes of 25 mm, off the planes that scenes use."""
    cells = np.floor((points + 0.0061) / CHECKER_M).astype(np.int64).sum(axis=0)
    return np.asarray(1.0 - texture * (cells % 2), dtype=np.float64)


def sample(
    surfaces: Sequence[Surface],
    rig: StereoRig,
    projection: Array,
    columns: Array,
    rows: Array,
    texture: float,
    projector_size: tuple[int, int] | None,
) -> Samples:
    """Cast rays of one camera through image points (N,) and on to the projector."""
    origin = device_centre(projection)
    pixels = np.stack([columns, rows, np.ones_like(columns)])
    rays = np.asarray(np.linalg.inv(projection[:, :3]) @ pixels, dtype=np.float64)
    t, surface = cast(surfaces, origin, rays)
    hit = np.isfinite(t)
    points = origin[:, None] + np.where(hit, t, 1.0) * rays
    light = device_centre(rig.P_projector)
    normals = np.zeros_like(points)
    for number, body in enumerate(surfaces):
        chosen = hit & (surface == number)
        normals[:, chosen] = body.normal(points[:, chosen])
    lambert = (normals * unit(light[:, None] - points)).sum(axis=0)
    device = rig.projector_pixels(points.T)
    lit = hit & (lambert > 0.0) & in_image(device, projector_size) & unobstructed(surfaces, light, points)
    albedo = np.where(hit, checker_albedo(points, texture), 0.0)
    return Samples(points, np.where(hit, surface, -1), lit, albedo, np.where(lit, albedo * lambert, 0.0), device)


def in_image(pixels: Array, size: tuple[int, int] | None) -> Mask:
    """Whether pixels (N, 2) lie in an image of ``size`` (width, height); None has no borders."""
    if size is None:
        return np.ones(len(pixels), dtype=np.bool_)
    return np.asarray(
        (pixels[:, 0] >= -0.5)
        & (pixels[:, 0] < size[0] - 0.5)
        & (pixels[:, 1] >= -0.5)
        & (pixels[:, 1] < size[1] - 0.5)
    )


def edges(samples: Samples, shape: tuple[int, int]) -> npt.NDArray[np.intp]:
    """Flat indices of pixels whose neighbours show another surface, shadow or albedo."""
    label = (samples.surface * 2 + samples.lit) * 2.0 + samples.albedo
    image = label.astype(np.float32).reshape(shape)
    kernel = np.ones((3, 3), np.uint8)
    return np.flatnonzero(cv2.dilate(image, kernel) != cv2.erode(image, kernel))


@dataclass(frozen=True)
class AnalyticView:
    """One camera's samples: at all pixel centres, and a grid of finer ones in pixels with an edge."""

    shape: tuple[int, int]
    centres: Samples
    edge_pixels: npt.NDArray[np.intp]
    fine: Samples

    @classmethod
    def of(
        cls,
        surfaces: Sequence[Surface],
        rig: StereoRig,
        projection: Array,
        texture: float,
        projector_size: tuple[int, int] | None,
    ) -> AnalyticView:
        """Cast all rays of a camera."""
        width, height = rig.image_size
        columns, rows = (grid.ravel() for grid in np.meshgrid(np.arange(float(width)), np.arange(float(height))))
        centres = sample(surfaces, rig, projection, columns, rows, texture, projector_size)
        chosen = edges(centres, (height, width))
        offsets = (np.arange(SUPERSAMPLES) + 0.5) / SUPERSAMPLES - 0.5
        down, across = (grid.ravel() for grid in np.meshgrid(offsets, offsets, indexing="ij"))
        fine_columns = (columns[chosen, None] + across).ravel()
        fine_rows = (rows[chosen, None] + down).ravel()
        fine = sample(surfaces, rig, projection, fine_columns, fine_rows, texture, projector_size)
        return cls((height, width), centres, chosen, fine)

    def picture(self, pattern: Projected, step: int, light: Light) -> npt.NDArray[np.float32]:
        """Ideal grey levels (H, W): ``albedo ambient + reflectance (offset + amplitude signal)``, blurred."""

        def grey(samples: Samples, footprint_px: float) -> Array:
            signal = signal_at(pattern, samples.projector_px, step, light.gamma, footprint_px)
            return samples.albedo * light.ambient + samples.reflectance * (light.offset + light.amplitude * signal)

        image = grey(self.centres, 1.0)
        image[self.edge_pixels] = grey(self.fine, 1.0 / SUPERSAMPLES).reshape(-1, SUPERSAMPLES**2).mean(axis=1)
        return lens_blur(image.reshape(self.shape).astype(np.float32), light.blur_px)
