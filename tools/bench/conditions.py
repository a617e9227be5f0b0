"""The conditions of the comparison: light, camera and surface, each the default but for one thing."""

from __future__ import annotations

import math
from dataclasses import dataclass

from moire_sensor.pattern import Waveform
from moire_sim.analytic_scenes import DARK_FRINGE
from moire_sim.fringe_image import Light

# Where white would be brighter, the exposure is shortened until it is this bright, grey levels.
BRIGHTEST = 235.0
FRAMES_PER_S, LAMP_HZ, LAMP_START_RAD = 60.0, 100.0, 0.7


@dataclass(frozen=True)
class Condition:
    """What the pictures of one comparison have in common.

    Attributes
    ----------
    amplitude, ambient, noise : grey levels of white, before the exposure is shortened (noise: after it).
    blur_px : standard deviation of the lens blur, pixels.
    gamma : response of the projector, 1 is linear.
    texture : darkening of every other 25 mm cell, 0 to 1.
    flicker : modulation of the ambient light at 100 Hz, 0 to 1; frames follow at 60 per second.
    """

    name: str
    amplitude: float = 70.0
    ambient: float = 20.0
    noise: float = 1.5
    blur_px: float = 0.5
    gamma: float = 1.0
    texture: float = 0.0
    waveform: Waveform = "sine"
    flicker: float = 0.0

    @property
    def changes_fringes_only(self) -> bool:
        """Whether the condition does not exist for dots, which are bright or dark."""
        return self.waveform != "sine" or self.gamma != 1.0

    def lights(self, frame_count: int, projector_on: bool = True) -> list[Light]:
        """Return the light of each frame, the exposure such that white does not saturate."""
        offset = self.amplitude + DARK_FRINGE if projector_on else 0.0
        amplitude = self.amplitude if projector_on else 0.0
        scale = min(1.0, BRIGHTEST / (self.ambient * (1.0 + self.flicker) + offset + amplitude))
        return [
            Light(scale * self.ambient * lamp, scale * offset, scale * amplitude, self.gamma, self.blur_px)
            for lamp in (1.0 + self.flicker * lamp_wave(frame) for frame in range(frame_count))
        ]


def lamp_wave(frame: int) -> float:
    """Brightness -1..1 of a lamp on 50 Hz mains in a frame."""
    return math.sin(2.0 * math.pi * LAMP_HZ * frame / FRAMES_PER_S + LAMP_START_RAD)


DEFAULT = Condition("default")
TEXTURED = Condition("texture 0.3", texture=0.3)
CONDITIONS = (
    DEFAULT,
    Condition("square", waveform="square"),
    Condition("gamma 2.2", gamma=2.2),
    Condition("noise 4", noise=4.0),
    Condition("blur 1.6 px", blur_px=1.6),
    Condition("amplitude 20", amplitude=20.0),
    TEXTURED,
)
# On textured surfaces, so that stereo without a projector has something to match.
ILLUMINATION = (
    Condition("ambient 1x", ambient=70.0, texture=0.3),
    Condition("ambient 3x", ambient=210.0, texture=0.3),
    Condition("flicker 1x", ambient=70.0, flicker=0.3, texture=0.3),
)
# The same light on white surfaces tells what the light costs by itself.
PLAIN_AMBIENT = Condition("ambient 3x, white", ambient=210.0)
