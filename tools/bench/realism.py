"""``dense`` on pictures through real optics beside ideal ones, scene by scene, and what each flaw costs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.reconstructor import Reconstructor
from moire_sim.head_options import HeadOptions, preset
from moire_sim.scenes import indoor_names
from moire_sim.score import Score, disparity_error_px, score_depth
from moire_sim.virtual_head import VirtualHead

# Rooms go on beyond the default depth range; what lies further away still has to be told from what lies within.
RANGE_M, INDOOR_RANGE_M = (0.5, 2.0), (0.5, 4.5)
# Where things move: a time at which they are before the head.
TIME_S = 1.6
SEED = 0
ALLOWED_RATIO = 3.0
# One flaw left out of the realistic preset at a time, in a scene with things near and far.
FLAWS: Mapping[str, dict[str, Any]] = {
    "none": {},
    "fall-off with distance": {"fall_off_m": 0.0},
    "photon noise": {"electrons_per_grey": 0.0},
    "speckle": {"speckle": 0.0},
    "texture": {"surface_texture": 0.0},
    "gloss": {"surface_specular": 0.0},
    "lens distortion": {"k1": 0.0, "k2": 0.0, "p1": 0.0, "p2": 0.0},
    "vignetting": {"vignetting": 0.0, "projector_vignetting": 0.0},
    "defocus of the projector": {"projector_aperture_mm": 0.0, "projector_blur_px": 0.0},
    "fixed pattern": {"pixel_gain_spread": 0.0, "pixel_offset_spread": 0.0},
}
FLAW_SCENE = "room"
NO_FALL_OFF = "fall-off with distance"


@dataclass(frozen=True, eq=False)
class RealismRecord:
    """Score of ``dense`` on one scene under one optics; ``sigma_mm`` is the median of its own predicted error.

    ``picture`` (H, W) is the rectified left view, ``error_px`` (H, W) the disparity error.
    """

    scene: str
    optics: str
    score: Score
    sigma_mm: float
    picture: npt.NDArray[Any]
    error_px: npt.NDArray[np.float32]


def realism_records(scene: str) -> list[RealismRecord]:
    """Measure a scene under both presets; where real optics cost more than is allowed, under even light, too."""
    clean, real = (record(scene, name, preset(name)) for name in ("clean", "realistic"))
    if not ratio(clean, real) > ALLOWED_RATIO:
        return [clean, real]
    return [clean, real, *flaw_records(NO_FALL_OFF, scene)]


def ratio(clean: RealismRecord, real: RealismRecord) -> float:
    """How many times the median error of ideal optics real ones have."""
    return real.score.median_error_mm / clean.score.median_error_mm


def flaw_records(name: str, scene: str = FLAW_SCENE) -> list[RealismRecord]:
    """Measure a scene under the realistic preset with one flaw left out."""
    real = preset("realistic")
    return [record(scene, name, replace(real, optics=replace(real.optics, **FLAWS[name])))]


def record(scene: str, name: str, options: HeadOptions) -> RealismRecord:
    """Expose, rectify as a driver does, reconstruct and score."""
    pattern = paper_pattern()
    with VirtualHead(scene, SEED, options=options) as head:
        head.set_time(TIME_S)
        capture, pair = head.capture(pattern), head.rectification
    left, right = pair.rectify(capture.left, capture.right)
    range_m = INDOOR_RANGE_M if scene in indoor_names() else RANGE_M
    shot = Reconstructor(paper_rig(), pattern, range_m, "dense").reconstruct(left, right)
    sigma_mm = shot.depth_sigma_m.astype(np.float64) * 1e3 / np.square(shot.depth_m.astype(np.float64))
    known = np.isfinite(sigma_mm) & capture.covisible
    error_px = disparity_error_px(shot.depth_m, capture).astype(np.float32)
    middle = float(np.median(sigma_mm[known])) if known.any() else float("nan")
    return RealismRecord(scene, name, score_depth(shot.depth_m, capture), middle, left, error_px)
