"""A turning point cloud for the README: one exposure of the virtual head, its depth, and its points."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from moire_sensor import Reconstructor
from moire_sensor.paper_rig import paper_pattern
from moire_sim import VirtualHead

SCENE, DEPTH_RANGE_M = "cylinder_and_box", (0.5, 2.0)
SIZE, SMALL = (534, 400), (266, 200)
FRAMES, FRAME_MS = 36, 90
SWING_RAD, NOD_RAD, LEAN_RAD = math.radians(30.0), math.radians(8.0), math.radians(12.0)
# A map safe for colour-blind readers, without its darkest end.
COLOUR_MAP, DARKEST = "viridis", 0.15
# Share of the height that the cloud fills when seen from the camera.
FILL = 0.8
PALETTE, FONT_PX = 128, 13
BACKDROP, UNKNOWN = (16, 18, 22), (110, 110, 110)
Rgb = npt.NDArray[np.uint8]


@dataclass(frozen=True, eq=False)
class Cloud:
    """A reconstructed exposure.

    Attributes
    ----------
    points_m : (N, 3), left optical frame.
    colours : (N, 3) uint8, the depth, as bright as the view without fringes.
    left : (H, W) uint8, what the left camera saw.
    depth : (H, W, 3) uint8, the depth in the same colours.
    """

    points_m: npt.NDArray[np.float64]
    colours: Rgb
    left: npt.NDArray[np.uint8]
    depth: Rgb


def measure(scene: str = SCENE, seed: int = 0) -> Cloud:
    """Take one exposure and reconstruct it."""
    pattern = paper_pattern()
    with VirtualHead(scene, seed=seed) as head:
        capture = head.capture(pattern)
    shot = Reconstructor(capture.rig, pattern, DEPTH_RANGE_M).reconstruct(capture.left, capture.right)
    known = np.isfinite(shot.depth_m)
    near, far = np.percentile(shot.depth_m[known], (1, 99))
    share = np.where(known, (far - shot.depth_m) / (far - near), 0.0)
    tints = np.asarray(mpl.colormaps[COLOUR_MAP](DARKEST + (1.0 - DARKEST) * share))[..., :3]
    light = np.clip(0.35 + 0.65 * shot.background / np.percentile(shot.background[known], 98), 0.0, 1.0)
    return Cloud(
        capture.rig.points(shot.depth_m)[known].astype(np.float64),
        np.round(255.0 * (tints * light[..., None])[known]).astype(np.uint8),
        np.asarray(capture.left, np.uint8),
        np.where(known[..., None], np.round(255.0 * tints), np.array(UNKNOWN)).astype(np.uint8),
    )


def view(cloud: Cloud, pan_rad: float, tilt_rad: float) -> Rgb:
    """Draw the cloud as seen after walking around its middle: far points first, each two pixels wide."""
    width, height = SIZE
    middle = 0.5 * (cloud.points_m.min(axis=0) + cloud.points_m.max(axis=0))
    turned = (cloud.points_m - middle) @ turn(pan_rad, tilt_rad).T
    distance = float(middle[2])
    depth = turned[:, 2] + distance
    focal = FILL * height * distance / float(np.ptp(cloud.points_m[:, 1]))
    column = np.round(width / 2 + focal * turned[:, 0] / depth).astype(np.int64)
    row = np.round(height / 2 + focal * turned[:, 1] / depth).astype(np.int64)
    far_first = np.argsort(-depth)
    picture = np.full((height + 1, width + 1, 3), BACKDROP, dtype=np.uint8)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height) & (depth > 0.0)
    order = far_first[inside[far_first]]
    for down, right in ((1, 1), (1, 0), (0, 1), (0, 0)):
        picture[row[order] + down, column[order] + right] = cloud.colours[order]
    return picture[:height, :width]


def turn(pan_rad: float, tilt_rad: float) -> npt.NDArray[np.float64]:
    """Rotation about the upright axis, then about the one across."""
    pan = [[math.cos(pan_rad), 0.0, math.sin(pan_rad)], [0.0, 1.0, 0.0], [-math.sin(pan_rad), 0.0, math.cos(pan_rad)]]
    tilt = [
        [1.0, 0.0, 0.0],
        [0.0, math.cos(tilt_rad), -math.sin(tilt_rad)],
        [0.0, math.sin(tilt_rad), math.cos(tilt_rad)],
    ]
    return np.asarray(np.array(tilt) @ np.array(pan))


def draw_turning(cloud: Cloud, path: Path) -> None:
    """Write the animation: picture and depth, and beside them the cloud from a place that swings around it."""
    sheet = Image.new("RGB", (SMALL[0] + SIZE[0], SIZE[1]))
    for row, image in enumerate((cloud.left, cloud.depth)):
        sheet.paste(Image.fromarray(image).resize(SMALL, Image.Resampling.LANCZOS), (0, row * SMALL[1]))
    frames = []
    for number in range(FRAMES):
        angle = 2.0 * math.pi * number / FRAMES
        drawn = view(cloud, SWING_RAD * math.sin(angle), LEAN_RAD + NOD_RAD * math.cos(angle))
        frame = sheet.copy()
        frame.paste(Image.fromarray(drawn), (SMALL[0], 0))
        label(frame)
        frames.append(frame)
    # One palette for all, so that nothing flickers.
    palette = frames[0].quantize(PALETTE)
    indexed = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    path.parent.mkdir(parents=True, exist_ok=True)
    indexed[0].save(path, save_all=True, append_images=indexed[1:], duration=FRAME_MS, loop=0, optimize=False)


def label(frame: Image.Image) -> None:
    """Write under each part what it is."""
    draw = ImageDraw.Draw(frame)
    for place, text in (
        ((6, SMALL[1] - 20), "left camera, one exposure"),
        ((6, 2 * SMALL[1] - 20), "depth; grey: unknown"),
        ((SMALL[0] + 6, SIZE[1] - 20), "its points"),
    ):
        draw.rectangle(draw.textbbox(place, text, font_size=FONT_PX), fill=BACKDROP)
        draw.text(place, text, fill=(235, 235, 235), font_size=FONT_PX)
