"""What a body's surface looks like beyond its albedo: texture and gloss."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Literal

import numpy as np
import numpy.typing as npt

from moire_sim.errors import SceneError

Array = npt.NDArray[np.float64]
Texture = Literal["none", "checker", "stripes", "noise"]
TEXTURES: tuple[Texture, ...] = ("none", "checker", "stripes", "noise")
# The lattice of the noise repeats after so many cells.
LATTICE = 32
# Faces lie on round numbers; cells begin beside them, so that rounding does not speckle a face.
CELL_SHIFT_M = 0.00613


@dataclass(frozen=True)
class Finish:
    """Texture and gloss of a body.

    Attributes
    ----------
    texture : ``"none"``, ``"checker"`` (cubes), ``"stripes"`` (upright) or ``"noise"`` (smooth spots of two sizes).
    contrast : largest darkening by the texture, 0 to 1.
    cell_m : size of a cell of the texture, 1 mm to 10 m.
    specular : peak of the gloss over the brightness of white that faces the light, 0 to 10.
    shininess : exponent of the gloss (Blinn 1977), 1 (dull) to 2000 (mirror).

    Raises
    ------
    SceneError
        A value outside its range.
    """

    texture: Texture = "none"
    contrast: float = 0.3
    cell_m: float = 0.025
    specular: float = 0.0
    shininess: float = 30.0

    def __post_init__(self) -> None:
        if self.texture not in TEXTURES:
            raise SceneError(f"texture is {self.texture!r}; choose one of {', '.join(TEXTURES)}")
        ranges = {"contrast": (0.0, 1.0), "cell_m": (0.001, 10.0), "specular": (0.0, 10.0), "shininess": (1.0, 2000.0)}
        for name, (low, high) in ranges.items():
            if not low <= getattr(self, name) <= high:
                raise SceneError(f"{name} of a finish is {getattr(self, name)}; it must be {low:g} to {high:g}")

    def shade(self, points_m: Array) -> Array:
        """Factor (N,) on the albedo at points (N, 3) of the body at rest."""
        if self.texture == "none" or self.contrast == 0.0:
            return np.ones(len(points_m))
        place = (points_m + CELL_SHIFT_M) / self.cell_m
        if self.texture == "noise":
            dark = 0.65 * lattice_noise(place) + 0.35 * lattice_noise(3.1 * place)
        else:
            axes = place if self.texture == "checker" else place[:, ::2]
            dark = np.asarray(np.floor(axes).sum(axis=1) % 2.0)
        return np.asarray(1.0 - self.contrast * dark)


def lattice_noise(place: Array) -> Array:
    """Smooth values 0..1 (N,) at points (N, 3): trilinear between random numbers at whole coordinates."""
    values = lattice()
    first = np.floor(place)
    low = first.astype(np.intp) % LATTICE
    high = (low + 1) % LATTICE
    part = place - first
    part = part * part * (3.0 - 2.0 * part)
    total = np.zeros(len(place))
    for x, x_weight in ((low[:, 0], 1.0 - part[:, 0]), (high[:, 0], part[:, 0])):
        for y, y_weight in ((low[:, 1], 1.0 - part[:, 1]), (high[:, 1], part[:, 1])):
            weight = x_weight * y_weight
            total += weight * ((1.0 - part[:, 2]) * values[x, y, low[:, 2]] + part[:, 2] * values[x, y, high[:, 2]])
    return total


@cache
def lattice() -> Array:
    """Random numbers 0..1 of the noise, the same everywhere."""
    return np.random.default_rng(20261122).random((LATTICE, LATTICE, LATTICE))
