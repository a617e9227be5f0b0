"""All scenes of the virtual head on one sheet: what the left camera sees, and the depth made of one exposure."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw

from moire_sensor import Reconstructor
from moire_sensor.paper_rig import paper_pattern
from moire_sim import VirtualHead, indoor_names, scene_names
from tools.docs.cloud import COLOUR_MAP, DARKEST, UNKNOWN

NEAR_RANGE_M, INDOOR_RANGE_M = (0.5, 2.0), (0.5, 6.0)
PANEL, COLUMNS, GAP_PX, TEXT_PX, FONT_PX = (150, 112), 3, 6, 18, 13
# Depth is told by colour within each scene, but a flat board stays one colour.
LEAST_SPAN_M = 0.02
Rgb = npt.NDArray[np.uint8]


def measure(scene: str, seed: int = 0) -> tuple[npt.NDArray[np.uint8], npt.NDArray[np.float32]]:
    """Return what the left camera sees of a scene (H, W), and its depth (H, W) in metres, NaN unknown."""
    pattern = paper_pattern()
    with VirtualHead(scene, seed=seed) as head:
        capture = head.capture(pattern)
    limits = INDOOR_RANGE_M if scene in indoor_names() else NEAR_RANGE_M
    shot = Reconstructor(capture.rig, pattern, limits).reconstruct(capture.left, capture.right)
    return np.asarray(capture.left, np.uint8), shot.depth_m


def tinted(depth_m: npt.NDArray[np.float32]) -> Rgb:
    """Return a depth image in colour (H, W, 3): near bright, far dark, unknown grey."""
    known = np.isfinite(depth_m)
    near, far = np.percentile(depth_m[known], (1, 99))
    far = max(far, near + LEAST_SPAN_M)
    share = np.where(known, np.clip((far - depth_m) / (far - near), 0.0, 1.0), 0.0)
    tints = np.asarray(mpl.colormaps[COLOUR_MAP](DARKEST + (1.0 - DARKEST) * share))[..., :3]
    return np.where(known[..., None], np.round(255.0 * tints), np.array(UNKNOWN)).astype(np.uint8)


def draw_scenes(path: Path) -> None:
    """Write the sheet."""
    names = scene_names()
    cell = (2 * PANEL[0] + GAP_PX, PANEL[1] + TEXT_PX)
    rows = -(-len(names) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * cell[0] - GAP_PX, rows * cell[1]), "white")
    draw = ImageDraw.Draw(sheet)
    for number, name in enumerate(names):
        left, depth_m = measure(name)
        corner = (number % COLUMNS * cell[0], number // COLUMNS * cell[1])
        for side, image in enumerate((left, tinted(depth_m))):
            small = Image.fromarray(image).resize(PANEL, Image.Resampling.BOX)
            sheet.paste(small, (corner[0] + side * PANEL[0], corner[1]))
        draw.text((corner[0] + 2, corner[1] + PANEL[1] + 1), name, fill=(30, 30, 30), font_size=FONT_PX)
    path.parent.mkdir(parents=True, exist_ok=True)
    sheet.quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)
