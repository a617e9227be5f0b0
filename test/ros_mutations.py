"""Sets whose messages were damaged at random, from a seed."""

from __future__ import annotations

import copy
import math
import random
from collections.abc import Callable
from typing import Any

from sensor_msgs.msg import CameraInfo, Image, JointState

NUMBERS = (0.0, -0.0, -1.0, 1e-300, 1e300, -1e300, math.nan, math.inf, -math.inf, 0.5, 2.0**31, 1e9)
SIZES = (0, 1, 7, 15, 16, 17, 639, 641, 16384, 16385, 65536, 2**31, 2**32 - 1)
TEXTS = ("", "mono8", "mono16", "rgb8", "MONO8", "bayer_rggb8", "\u00e9\u4e2d", "a" * 5000, "32FC1", "plumb_bob")


def damaged_image(image: Image, rng: random.Random) -> None:
    """Change a few fields; the data may be cut, grown, or changed in some bytes."""
    size = len(image.data)
    changes: tuple[Callable[[], None], ...] = (
        lambda: setattr(image, "encoding", rng.choice(TEXTS)),
        lambda: setattr(image, "width", rng.choice(SIZES)),
        lambda: setattr(image, "height", rng.choice(SIZES)),
        lambda: setattr(image, "step", rng.choice(SIZES)),
        lambda: setattr(image, "is_bigendian", rng.choice((0, 1, 2, 255))),
        lambda: setattr(image, "data", image.data[: rng.randrange(size)] if size else image.data),
        lambda: setattr(image, "data", image.data + image.data[: rng.randrange(1, 100)]),
        lambda: change_bytes(image, rng),
    )
    for change in rng.sample(changes, rng.randint(1, 3)):
        change()


def change_bytes(image: Image, rng: random.Random) -> None:
    """Change bytes of the picture itself, which is no fault that a message could show."""
    for _ in range(min(20, len(image.data))):
        image.data[rng.randrange(len(image.data))] = rng.randrange(256)


def damaged_state(state: JointState, rng: random.Random) -> None:
    """Change names and values."""
    names, values = list(state.name), list(state.position)
    for _ in range(rng.randint(1, 3)):
        kind = rng.randrange(6)
        if kind <= 1 and values:
            values[rng.randrange(len(values))] = rng.choice(NUMBERS)
        elif kind == 2 and names:
            names[rng.randrange(len(names))] = rng.choice((*TEXTS, "laser_on", "step_count"))
        elif kind == 3:
            values = values[: rng.randrange(len(values) + 1)]
        elif kind == 4:
            names = names[: rng.randrange(len(names) + 1)]
        else:
            names, values = names * rng.randint(1, 300), values * rng.randint(1, 300)
    state.name, state.position = names, values


def damaged_info(info: CameraInfo, rng: random.Random) -> None:
    """Change size, lens model and some numbers."""
    for _ in range(rng.randint(1, 3)):
        kind = rng.randrange(5)
        if kind == 0:
            setattr(info, rng.choice(("width", "height", "binning_x", "binning_y")), rng.choice(SIZES))
        elif kind == 1:
            info.distortion_model = rng.choice((*TEXTS, "rational_polynomial", "equidistant"))
        elif kind == 2:
            info.d = [rng.choice(NUMBERS) for _ in range(rng.choice((0, 1, 4, 5, 8, 12, 14, 1000)))]
        else:
            field = rng.choice(("k", "r", "p"))
            values = [float(value) for value in getattr(info, field)]
            values[rng.randrange(len(values))] = rng.choice(NUMBERS)
            setattr(info, field, [0.0] * len(values) if rng.random() < 0.1 else values)


def damaged(messages: dict[str, Any], rng: random.Random) -> str:
    """Put a damaged copy in the place of one of a set's messages, and return its topic."""
    topic = rng.choice(tuple(messages))
    message = messages[topic] = copy.deepcopy(messages[topic])
    if isinstance(message, Image):
        damaged_image(message, rng)
    elif isinstance(message, JointState):
        damaged_state(message, rng)
    else:
        damaged_info(message, rng)
    return topic
