"""Test scenes with exact truth, ray-cast without a simulator: planes, waves, solids, shadows, thin things."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.paper_rig import PROJECTOR_SIZE, paper_pattern, paper_rig
from moire_sensor.pattern import FringePattern
from moire_sensor.rig import StereoRig
from moire_sim.analytic_surfaces import Box, Cylinder, Relief, Sphere, Surface, unobstructed
from moire_sim.analytic_view import AnalyticView, device_centre, in_image
from moire_sim.capture import Grey, HeadCapture, stacked
from moire_sim.errors import SceneError
from moire_sim.exposure import exposed, noise_generator
from moire_sim.fringe_image import Light
from moire_sim.random_dots import Projected

# Projector light left in the fringes' dark parts, grey levels.
DARK_FRINGE = 10.0
BACK = Relief(1.5)

SCENES: dict[str, tuple[Surface, ...]] = {
    "plane_600": (Relief(0.6),),
    "plane_1000": (Relief(1.0),),
    "plane_1500": (Relief(1.5),),
    "tilt_0.5": (Relief(1.0, slope_x=0.5),),
    "slope_1.2": (Relief(1.0, slope_x=1.2),),
    "tilt_rows_0.5": (Relief(1.0, slope_y=0.5),),
    "waves": (Relief(1.0, waves=((0.020, 0.15, np.inf), (0.008, np.inf, 0.10))),),
    "cylinder_and_box": (
        BACK,
        Cylinder(-0.09, 1.20, 0.09, -0.15, 0.5),
        Box((0.16, 0.10, 1.15), (0.18, 0.25, 0.18), 0.35),
    ),
    "small_plate": (Relief(1.2), Box((0.02, 0.0, 0.9025), (0.080, 0.060, 0.005))),
    "spheres": (
        Relief(1.3),
        Sphere((-0.07, -0.05, 1.0), 0.08),
        Sphere((0.12, 0.06, 0.9), 0.07),
        Sphere((0.07, -0.12, 1.15), 0.04),
    ),
    "thin_poles": (
        BACK,
        Cylinder(-0.05, 0.9, 0.010, -1.0, 1.0),
        Cylinder(0.06, 0.8, 0.010, -1.0, 1.0),
        Cylinder(0.18, 1.1, 0.010, -1.0, 1.0),
    ),
    "stairs": (
        Relief(1.3),
        *(Box((0.0, 0.03 + 0.03 * step, 1.3 - 0.03 * step), (0.28, 0.03, 0.2)) for step in range(1, 5)),
        *(Box((-0.10 + 0.06 * step, -0.10, 1.3 - 0.03 * step), (0.06, 0.16, 0.2)) for step in range(1, 5)),
    ),
}


def analytic_scene_names() -> tuple[str, ...]:
    """Names that :func:`analytic_capture` accepts."""
    return tuple(SCENES)


def analytic_capture(
    name: str,
    pattern: FringePattern | None = None,
    *,
    amplitude: float = 70.0,
    noise: float = 1.5,
    seed: int = 0,
    blur_px: float = 0.5,
    gamma: float = 1.0,
    texture: float = 0.0,
    bits: int = 8,
    rig: StereoRig | None = None,
    projector_size: tuple[int, int] | None = None,
) -> HeadCapture:
    """Fringe images and exact truth of a scene, all steps of the pattern.

    Parameters
    ----------
    name : one of :func:`analytic_scene_names`.
    pattern : default the paper's single shot; n > 1 steps give (n, H, W) images.
    amplitude : grey levels of the fringes on a white surface that faces the projector.
    noise : standard deviation, grey levels; step n of camera c draws from ``default_rng((seed, n, c))``.
    blur_px : standard deviation of the lens blur, pixels.
    gamma : response of the projector, 1 is linear.
    texture : darkening of every other 25 mm cell, 0 to 1.
    bits : 8 or 16.
    rig : default the paper's. ``projector_size`` (width, height) is the paper's for the paper's rig, else unlimited.

    Raises
    ------
    SceneError
        An unknown name.
    """
    pattern = pattern or paper_pattern()
    light = Light(offset=amplitude + DARK_FRINGE, amplitude=amplitude, gamma=gamma, blur_px=blur_px)
    scene = AnalyticScene.of(scene_surfaces(name), texture, rig, projector_size)
    left, right = scene.images(pattern, [light] * pattern.step_count, noise, seed, bits)
    return HeadCapture(left, right, scene.depth_m, scene.covisible, scene.lit, scene.rig, pattern)


@dataclass(frozen=True, eq=False)
class AnalyticScene:
    """What stays of a scene whatever light falls on it; the images (H, W) are as in :class:`HeadCapture`."""

    rig: StereoRig
    views: tuple[AnalyticView, AnalyticView]
    depth_m: npt.NDArray[np.float32]
    covisible: npt.NDArray[np.bool_]
    lit: npt.NDArray[np.bool_]

    @classmethod
    def of(
        cls,
        surfaces: Sequence[Surface],
        texture: float = 0.0,
        rig: StereoRig | None = None,
        projector_size: tuple[int, int] | None = None,
    ) -> AnalyticScene:
        """Cast all rays; the parameters are those of :func:`analytic_capture`."""
        if rig is None:
            rig, projector_size = paper_rig(), projector_size or PROJECTOR_SIZE
        left, right = (
            AnalyticView.of(surfaces, rig, projection, texture, projector_size)
            for projection in (rig.P_left, rig.P_right)
        )
        centres = left.centres
        depth_m = np.where(centres.surface >= 0, centres.points_m[2], np.nan).astype(np.float32).reshape(left.shape)
        lit = centres.lit.reshape(left.shape)
        covisible = lit & seen_from_right(surfaces, rig, centres.points_m).reshape(left.shape)
        return cls(rig, (left, right), depth_m, covisible, lit)

    def images(
        self, pattern: Projected, lights: Sequence[Light], noise: float = 1.5, seed: int = 0, bits: int = 8
    ) -> tuple[Grey, Grey]:
        """Left and right pictures of a pattern, one light for each of its steps; (n, H, W) for n > 1 steps."""
        images: list[Grey] = []
        for camera, view in enumerate(self.views):
            ideal = [view.picture(pattern, step, light) for step, light in enumerate(lights)]
            frames = [
                exposed(one, noise, noise_generator(seed, step, camera), bits) for step, one in enumerate(ideal)
            ]
            images.append(stacked(frames))
        return images[0], images[1]


def scene_surfaces(name: str) -> tuple[Surface, ...]:
    """Return the surfaces of a scene, or raise SceneError naming those there are."""
    if name not in SCENES:
        raise SceneError(f"unknown analytic scene {name!r}; choose one of {', '.join(SCENES)}")
    return SCENES[name]


def seen_from_right(
    surfaces: Sequence[Surface], rig: StereoRig, points_m: npt.NDArray[np.float64]
) -> npt.NDArray[np.bool_]:
    """Whether points (3, N) lie in the right image and nothing hides them from the right camera."""
    device = rig.P_right[:, :3] @ points_m + rig.P_right[:, 3:]
    inside = in_image((device[:2] / device[2]).T, rig.image_size)
    return np.asarray(inside & unobstructed(surfaces, device_centre(rig.P_right), points_m))
