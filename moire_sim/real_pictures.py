"""Exposures through real optics: light of the moment, of the lamp and of the sweep, on two chips."""

from __future__ import annotations

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.pattern import FringePattern
from moire_sim.both_cameras import for_both
from moire_sim.camera_chip import NOMINAL_EXPOSURE_MS, CameraChip, lamp, speckle_pattern
from moire_sim.capture import Grey
from moire_sim.exposure import noise_generator
from moire_sim.fringe_image import Light
from moire_sim.moment import Moment
from moire_sim.optics import Optics
from moire_sim.real_view import RealView

Image = npt.NDArray[np.float32]
Views = tuple[RealView, RealView]
# Of a sweep during which something moves, so many moments are rendered; the light between them is mixed.
SWEEP_MOMENTS = 5
BRIGHT_PERCENTILE = 99.0
EXPOSURE_REACH = 8.0
CACHED_PICTURES = 16


@dataclass(frozen=True, eq=False)
class Lit:
    """The light on one chip: ambient and the projector's, grey levels (H, W)."""

    ambient: Image
    projected: Image | None


class RealPictures:
    """Make exposures of what ``look`` sees at a moment; the last moments' light is kept while nothing moves.

    Parameters
    ----------
    look : returns both cameras' views of a moment.
    projector_width : of the projector's image, pixels: what a sweep takes its time for.
    """

    def __init__(
        self,
        look: Callable[[Moment], Views],
        optics: Optics,
        light: Light,
        chips: Sequence[CameraChip],
        seed: int,
        projector_width: int,
    ) -> None:
        self._look, self._optics, self._light, self._chips = look, optics, light, tuple(chips)
        self._seed, self._projector_width = seed, projector_width
        self._kept: tuple[tuple[Moment, ...], list[Views]] = ((), [])
        self._lit: dict[tuple[FringePattern | None, int], tuple[Lit, Lit]] = {}
        self._exposure_ms = optics.exposure_ms

    def expose(
        self,
        pattern: FringePattern | None,
        step: int,
        exposure_index: int,
        time_s: float,
        way: Callable[[float], Moment],
    ) -> tuple[Grey, Grey]:
        """Left and right picture; ``way`` tells the moment so many seconds after its middle, which is at ``time_s``."""
        moments = tuple(way(offset_s) for offset_s in self._offsets_s())
        self._go_to(moments if len(set(moments)) > 1 else moments[:1])
        middle = way(0.0)
        lit = self._light_of(pattern, step)
        swing = lamp(self._optics, time_s, self._exposure_ms)

        def picture(camera: int, light: Lit) -> Grey:
            return self._picture(camera, light, swing, middle, noise_generator(self._seed, exposure_index, camera))

        return for_both(picture, (0, 1), lit)

    @property
    def exposure_ms(self) -> float:
        """Exposure time of the last picture, ms."""
        return self._exposure_ms

    def _offsets_s(self) -> list[float]:
        half_s = self._optics.sweep_ms * 0.5e-3
        offsets: list[float] = np.linspace(-half_s, half_s, SWEEP_MOMENTS).tolist() if half_s else [0.0]
        return offsets

    def _go_to(self, moments: tuple[Moment, ...]) -> None:
        if self._kept[0] != moments:
            self._kept = (moments, [self._look(moment) for moment in moments])
            self._lit.clear()
            self._exposure_ms = self._exposed_for(self._kept[1][len(moments) // 2][0])

    def _exposed_for(self, left: RealView) -> float:
        """Exposure time, ms: fixed, or such that the bright parts of the left view have the wanted grey level."""
        wanted, usual_ms = self._optics.auto_exposure_grey, self._optics.exposure_ms
        if not wanted:
            return usual_ms
        grey = float(np.percentile(left.brightest(self._light), BRIGHT_PERCENTILE))
        grey *= self._optics.gain * usual_ms / NOMINAL_EXPOSURE_MS
        return usual_ms * float(np.clip(wanted / max(grey, 1e-6), 1.0 / EXPOSURE_REACH, EXPOSURE_REACH))

    def _light_of(self, pattern: FringePattern | None, step: int) -> tuple[Lit, Lit]:
        key = (pattern, step)
        if key not in self._lit:
            if len(self._lit) >= CACHED_PICTURES:
                del self._lit[next(iter(self._lit))]
            self._lit[key] = for_both(lambda *views: self._mixed(views, pattern, step), *self._kept[1])
        return self._lit[key]

    def _mixed(self, views: Sequence[RealView], pattern: FringePattern | None, step: int) -> Lit:
        """Light of a sweep's moments on one chip: each moment's where the mirror throws light then."""
        ambient = mean_of([view.ambient(self._light) for view in views])
        if pattern is None:
            return Lit(ambient, None)
        if len(views) == 1:
            return Lit(ambient, views[0].projected(pattern, step, self._light))
        parts = [
            view.projected(pattern, step, self._light, self._share(view, number, len(views)))
            for number, view in enumerate(views)
        ]
        return Lit(ambient, np.asarray(np.sum(parts, axis=0), dtype=np.float32))

    def _share(self, view: RealView, number: int, count: int) -> Image:
        """Share (fine picture) of a moment in the light: 1 at its columns, down to 0 at its neighbours' columns."""
        place = view.column_px / (self._projector_width - 1.0) * (count - 1.0)
        away = np.abs(np.clip(place, 0.0, count - 1.0) - number)
        return np.asarray(np.clip(1.0 - away, 0.0, 1.0), dtype=np.float32)

    def _picture(
        self, camera: int, lit: Lit, swing: float, middle: Moment, generator: np.random.Generator
    ) -> Grey:
        light = lit.ambient * np.float32(swing)
        if lit.projected is not None:
            speckle = speckle_pattern(self._optics, light.shape, (self._seed, camera, *bits_of(middle)))
            light = light + (lit.projected if speckle is None else lit.projected * speckle)
        scale = np.float32(self._exposure_ms / NOMINAL_EXPOSURE_MS)
        return self._chips[camera].expose(light * scale, generator)


def mean_of(pictures: Sequence[Image]) -> Image:
    """Mean (H, W) of pictures; of one it is the picture itself."""
    return pictures[0] if len(pictures) == 1 else np.asarray(np.mean(pictures, axis=0), dtype=np.float32)


def bits_of(moment: Moment) -> tuple[int, ...]:
    """Whole numbers that name a moment, for the seed of what stays the same while nothing moves."""
    return struct.unpack("<3Q", struct.pack("<3d", *moment))
