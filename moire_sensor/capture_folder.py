"""A folder of recorded fringe images with its rig file, as a file camera reads it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from moire_sensor.errors import CaptureError, MoireError, RigError
from moire_sensor.pattern import FringePattern
from moire_sensor.rectify import Image, RectifiedPair, rectify_pair
from moire_sensor.rig import StereoRig

RIG_FILE = "rig.yaml"
NEEDED = "it needs left_NN.png, right_NN.png and rig.yaml (projections, image_size, pattern, depth_range_m)"


@dataclass(frozen=True, eq=False)
class Capture:
    """A recorded capture, its images rectified on reading where the pair's rows do not agree.

    Attributes
    ----------
    folder : where it lies.
    pair : the rectified rig and the maps that bring the PNGs there (none for a pair that is rectified already).
    pattern : the fringe programme; frame n carries step n mod step_count.
    depth_range_m : nearest and farthest depth, metres.
    frame_names : number parts of the file names, in order.
    """

    folder: Path
    pair: RectifiedPair
    pattern: FringePattern
    depth_range_m: tuple[float, float]
    frame_names: tuple[str, ...]

    @property
    def rig(self) -> StereoRig:
        """The rectified rig."""
        return self.pair.rig

    @property
    def frame_count(self) -> int:
        """Number of exposures."""
        return len(self.frame_names)

    def step_index(self, frame: int) -> int:
        """Step of the pattern that a frame carries."""
        return frame % self.pattern.step_count

    def frame(self, frame: int) -> tuple[Image, Image]:
        """Rectified left and right image (H, W), uint8 or uint16, of a frame counted from 0.

        Raises
        ------
        CaptureError
            A PNG that is missing, unreadable or of another size than rig.yaml says.
        """
        return self._frames[frame]

    def stack(self) -> tuple[Image, Image]:
        """All rectified frames, two arrays (n, H, W)."""
        left, right = zip(*self._frames, strict=True)
        return np.stack(left), np.stack(right)

    @cached_property
    def _frames(self) -> list[tuple[Image, Image]]:
        return [
            self.pair.rectify(*(self._read(f"{side}_{name}.png") for side in ("left", "right")))
            for name in self.frame_names
        ]

    def _read(self, name: str) -> Image:
        path = self.folder / name
        image = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
        if image is None:
            raise CaptureError(f"cannot read {path} as an image; give an 8 or 16 bit grey PNG")
        width, height = self.pair.raw_size
        if image.shape != (height, width):
            raise CaptureError(
                f"{path} is {image.shape[1]} x {image.shape[0]} pixels; {RIG_FILE} says {width} x {height}: "
                "give the images the calibration was made with"
            )
        return np.asarray(image)  # type: ignore[return-value]


def read_capture(folder: str | Path) -> Capture:
    """Read a capture folder: ``left_NN.png``, ``right_NN.png`` and ``rig.yaml``.

    Raises
    ------
    CaptureError
        A folder or file that is missing, incomplete or malformed; the message says which and what is needed.
    """
    path = Path(folder)
    if not path.is_dir():
        raise CaptureError(f"there is no folder {path}; give the folder of a capture: {NEEDED}")
    content = read_rig_file(path / RIG_FILE)
    try:
        size = (int(content["image_size"][0]), int(content["image_size"][1]))
        nearest, farthest = (float(value) for value in content["depth_range_m"])
        projections = [content["projections"][name] for name in ("left", "right", "projector")]
        pattern = FringePattern(**content["pattern"])
        pair = rig_of_capture(projections, size)
    except (KeyError, IndexError, TypeError, ValueError, MoireError) as error:
        raise CaptureError(f"{path / RIG_FILE} is not usable: {described(error)}; {NEEDED}") from error
    capture = Capture(path, pair, pattern, (nearest, farthest), frame_names(path))
    capture.frame(0)
    return capture


def described(error: Exception) -> str:
    """Say in words what a reading error means."""
    return f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else str(error)


def read_rig_file(path: Path) -> dict[str, Any]:
    """Return the mapping in a rig file, or raise CaptureError."""
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise CaptureError(f"cannot read {path}: {error}; {NEEDED}") from error
    if not isinstance(content, dict):
        raise CaptureError(f"{path} holds a {type(content).__name__}, not a mapping; {NEEDED}")
    return content


def rig_of_capture(projections: list[Any], size: tuple[int, int]) -> RectifiedPair:
    """Take a rectified pair as it is; rectify any other."""
    try:
        return RectifiedPair(StereoRig.from_projections(*projections, size), None, None, size)
    except RigError:
        return rectify_pair(*projections, size)


def frame_names(folder: Path) -> tuple[str, ...]:
    """Numbers of the frames that both cameras have, or raise CaptureError."""
    numbers = {
        side: {found[1] for path in folder.iterdir() if (found := re.fullmatch(rf"{side}_(\d+)\.png", path.name))}
        for side in ("left", "right")
    }
    alone = numbers["left"] ^ numbers["right"]
    if alone or not numbers["left"]:
        what = f"frames {', '.join(sorted(alone))} have one image only" if alone else "it holds no left_NN.png"
        raise CaptureError(f"the capture {folder} is incomplete: {what}; {NEEDED}")
    return tuple(sorted(numbers["left"], key=int))
