"""Rendered pictures and depth against ray-traced truth, and the noise against its model."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.paper_rig import PERIOD_PX, paper_pattern
from moire_sim.analytic_scenes import AnalyticScene
from moire_sim.analytic_surfaces import Box, Cylinder, Relief, Sphere, Surface
from moire_sim.camera_chip import CameraChip, speckle_pattern
from moire_sim.capture import HeadCapture, stacked
from moire_sim.exposure import noise_generator
from moire_sim.fringe_image import Light
from moire_sim.head_options import HeadOptions
from moire_sim.optics import IDEAL, REAL, Optics
from moire_sim.virtual_head import VirtualHead

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]
STEPS = 4
PATTERN = paper_pattern(STEPS)
# What issue 7 asks for.
PHASE_LIMIT_PX, EDGE_LIMIT_PX, DEPTH_LIMIT_MM = 0.02, 1.0, 0.1
# The blur mixes fringes of two surfaces so close to an edge.
EDGE_BAND_PX = 4
BENT = Optics(k1=REAL.k1, k2=REAL.k2, p1=REAL.p1, p2=REAL.p2, supersampling=2)
WHITE = "format: 1\nbodies:\n"
WALL = "- {board: {z_m: 1.5, half_size_m: [2.0, 1.5]}, albedo: 1.0}\n"
SPHERE = "- {sphere: {centre_m: [0.02, 0.01, 1.0], radius_m: 0.12}, albedo: 1.0}\n"


@dataclass(frozen=True)
class Case:
    """One scene, described to the renderer (a name, or bodies in YAML) and to the ray tracer."""

    name: str
    scene: str
    surfaces: tuple[Surface, ...]
    optics: Optics = IDEAL


CASES = (
    Case("plane at 0.6 m", "flat_board:distance_m=0.6", (Relief(0.6),)),
    Case("board with slope 0.5", "flat_board:slope=0.5", (Relief(1.0, slope_x=0.5),)),
    Case("cylinder before a plane", "convex_cylinder", (Relief(1.5), Cylinder(0.047, 1.3, 0.2, -1.0, 1.0))),
    Case("sphere before a plane", WHITE + WALL + SPHERE, (Relief(1.5), Sphere((0.02, 0.01, 1.0), 0.12))),
    Case("plate before a plane", "board_before_plane", (Relief(1.5), Box((0.03, 0.0, 1.005), (0.24, 0.18, 0.01)))),
    Case("plane at 1 m through bent lenses", "flat_board", (Relief(1.0),), BENT),
    Case(
        "sphere through bent lenses", WHITE + WALL + SPHERE, (Relief(1.5), Sphere((0.02, 0.01, 1.0), 0.12)), BENT
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Agreement:
    """Largest differences of a rendered scene from the ray-traced one.

    Attributes
    ----------
    phase_px : of the fringes, projector columns, in both views away from edges.
    edge_px : distance from the true border of light of the pixels that are lit in one and not in the other.
    depth_mm : of the depth, scaled to 1 m by its square, away from edges.
    judged : share of the left view that is lit and away from edges.
    """

    name: str
    phase_px: float
    edge_px: float
    depth_mm: float
    judged: float


def agreements(case: Case) -> list[Agreement]:
    """Compare one case."""
    scene = AnalyticScene.of(case.surfaces)
    rendered, traced = rendered_capture(case), scene.images(PATTERN, [Light()] * STEPS, noise=0.0, bits=16)
    clear = clear_pixels(scene)
    phases = [
        phase_error_px(own, true, among)
        for own, true, among in zip((rendered.left, rendered.right), traced, clear, strict=True)
    ]
    true_m = scene.depth_m[clear[0]].astype(np.float64)
    depth_mm = np.abs(rendered.depth_m[clear[0]] - true_m) * 1e3 / np.square(true_m)
    edge_px = edge_error_px(rendered.lit, scene.lit)
    return [Agreement(case.name, max(phases), edge_px, float(depth_mm.max()), float(clear[0].mean()))]


def rendered_capture(case: Case) -> HeadCapture:
    """Four steps without noise, rectified where the lenses bend."""
    options = HeadOptions(noise=0.0, bits=16, optics=case.optics)
    with tempfile.TemporaryDirectory(prefix="moire_validation_") as folder:
        scene = case.scene
        if "\n" in scene:
            path = Path(folder) / "scene.yaml"
            path.write_text(scene, encoding="utf-8")
            scene = str(path)
        with VirtualHead(scene, options=options) as head:
            capture, pair = head.capture(PATTERN), head.rectification
    frames = [pair.rectify(left, right) for left, right in zip(capture.left, capture.right, strict=True)]
    left, right = (stacked([frame[side] for frame in frames]) for side in (0, 1))
    return HeadCapture(left, right, capture.depth_m, capture.covisible, capture.lit, capture.rig, capture.pattern)


def phase(images: npt.NDArray[np.generic]) -> Array:
    """Phase (H, W) in rad of four steps (4, H, W)."""
    grey = images.astype(np.float64)
    return np.asarray(np.arctan2(grey[3] - grey[1], grey[0] - grey[2]))


def phase_error_px(rendered: npt.NDArray[np.generic], traced: npt.NDArray[np.generic], among: Mask) -> float:
    """Largest difference of the fringes' phase, projector columns."""
    difference = phase(rendered) - phase(traced)
    off_px = np.angle(np.exp(1j * difference)) * PERIOD_PX / (2.0 * math.pi)
    return float(np.abs(off_px[among]).max())


def clear_pixels(scene: AnalyticScene) -> list[Mask]:
    """Pixels (H, W) of both views that are lit and away from edges, the image's border among them."""
    masks = []
    for view in scene.views:
        lit, shown = view.centres.lit.reshape(view.shape), view.centres.surface.reshape(view.shape)
        label = (2 * shown + lit).astype(np.float32)
        reach = np.ones((2 * EDGE_BAND_PX + 1, 2 * EDGE_BAND_PX + 1), np.uint8)
        masks.append(inner(lit & (cv2.erode(label, reach) == cv2.dilate(label, reach))))
    return masks


def inner(mask: Mask) -> Mask:
    """A mask without the pixels next to the image's border, where a bent view is made up beyond it."""
    inside = np.zeros_like(mask)
    kept = slice(EDGE_BAND_PX, -EDGE_BAND_PX)
    inside[kept, kept] = mask[kept, kept]
    return inside


def edge_error_px(rendered: Mask, traced: Mask) -> float:
    """Distance from the true border of light to the farthest pixel that is lit in one only; 0 where none is."""
    other = rendered != traced
    if not other.any():
        return 0.0
    sides = (traced.astype(np.uint8), (~traced).astype(np.uint8))
    away = [cv2.distanceTransform(side, cv2.DIST_L2, cv2.DIST_MASK_PRECISE) for side in sides]
    # A pixel beside the border is one pixel from the other side's nearest pixel, half of one from the border.
    return float((np.maximum(*away)[other]).max() - 0.5)


@dataclass(frozen=True)
class NoiseFigure:
    """One number of the noise as measured and as the model has it."""

    name: str
    measured: float
    model: float


def noise_figures(exposures: int = 40, side: int = 200, level: float = 120.0) -> list[NoiseFigure]:
    """Measure the noise of a chip of the realistic kind under even light of ``level`` grey levels."""
    optics, noise = REAL, 0.5
    chip = CameraChip.of(optics, noise, 16, (side, side), seed=1, camera=0)
    light = np.full((side, side), level, dtype=np.float32)
    frames, dark = (
        np.array([chip.expose(one, noise_generator(seed, index, 0)) for index in range(exposures)], float) / 257.0
        for seed, one in enumerate((light, 0.0 * light))
    )
    lit = dark > 0.0  # a chip cannot show less than nothing: of the dark, its upper half tells
    speckle = speckle_pattern(optics, (side, side), (1, 0))
    assert speckle is not None
    over_time = frames.std(axis=0, ddof=1)
    model_e = math.sqrt(level / optics.electrons_per_grey + noise**2)
    fixed = math.hypot(optics.pixel_gain_spread * level, optics.pixel_offset_spread)
    fixed = math.hypot(fixed, model_e / math.sqrt(exposures))
    upper = float(np.sqrt(np.mean(np.square(dark[lit]))))
    return [
        NoiseFigure("photon and read noise, grey levels", float(np.sqrt(np.mean(np.square(over_time)))), model_e),
        NoiseFigure("fixed pattern with the rest of the noise, grey levels", float(frames.mean(axis=0).std()), fixed),
        NoiseFigure("noise in the dark, upper half, grey levels", upper, math.hypot(noise, optics.pixel_offset_spread)),
        NoiseFigure("contrast of the speckle", float(speckle.std() / speckle.mean()), optics.speckle),
    ]
