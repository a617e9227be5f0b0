"""Exposures through ideal optics: the light that falls on each pixel's centre, and the cameras' noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from moire_sensor.pattern import FringePattern
from moire_sim.both_cameras import for_both
from moire_sim.capture import Grey
from moire_sim.exposure import noise_generator, normal_quantiles, quantised, quick_noise
from moire_sim.fringe_image import Image, Surfaces, dark_picture, fringe_picture
from moire_sim.head_options import HeadOptions
from moire_sim.still_view import StillView

CACHED_PICTURES = 32


class IdealPictures:
    """Make exposures of what ``look`` sees now; pictures without noise are kept until :meth:`clear`.

    So is one exposure made ahead of its time, until the next is asked for.
    """

    def __init__(self, look: Callable[[], StillView], options: HeadOptions, seed: int) -> None:
        self._look, self._options, self._seed = look, options, seed
        self._levels = np.float32(options.noise) * normal_quantiles()
        self._pictures: dict[tuple[FringePattern | None, int], tuple[Image, Image]] = {}
        self._ahead: dict[tuple[FringePattern | None, int, int], tuple[Grey, Grey]] = {}

    def clear(self) -> None:
        """Forget all pictures: something has moved."""
        self._pictures.clear()
        self._ahead.clear()

    def prepare(self, pattern: FringePattern | None, step: int, exposure_index: int) -> None:
        """Make an exposure ahead of its time; only where the picture without noise is known, or it could take long."""
        if (pattern, step) in self._pictures:
            self._ahead = {(pattern, step, exposure_index): self._with_noise(pattern, step, exposure_index)}

    def expose(self, pattern: FringePattern | None, step: int, exposure_index: int) -> tuple[Grey, Grey]:
        """Left and right picture; without a pattern the projector is off."""
        ahead, self._ahead = self._ahead, {}
        return ahead.get((pattern, step, exposure_index)) or self._with_noise(pattern, step, exposure_index)

    def _with_noise(self, pattern: FringePattern | None, step: int, exposure_index: int) -> tuple[Grey, Grey]:
        def picture(image: Image, camera: int) -> Grey:
            generator = noise_generator(self._seed, exposure_index, camera)
            noisy = image + quick_noise(self._levels, image.shape, generator) if self._options.noise > 0.0 else image
            return quantised(noisy, self._options.bits)

        # One after the other: a second thread would cost as much as it saves.
        left, right = self._without_noise(pattern, step)
        return picture(left, 0), picture(right, 1)

    def _without_noise(self, pattern: FringePattern | None, step: int) -> tuple[Image, Image]:
        key = (pattern, step)
        if key not in self._pictures:
            if len(self._pictures) >= CACHED_PICTURES:
                del self._pictures[next(iter(self._pictures))]
            still, light = self._look(), self._options.light

            def ideal(side: Surfaces) -> Image:
                return dark_picture(side, light) if pattern is None else fringe_picture(side, pattern, step, light)

            self._pictures[key] = for_both(ideal, (still.left, still.right))
        return self._pictures[key]
