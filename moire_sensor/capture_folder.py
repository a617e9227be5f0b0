"""A folder of recorded fringe images with its rig file, as a file camera reads it."""

from __future__ import annotations

import dataclasses
import math
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
from moire_sensor.projection import check_image_size
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
    pattern : the fringe programme; the frame named n carries step n mod step_count.
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
        """Step of the pattern that a frame carries: the number in its file name modulo the number of steps."""
        return int(self.frame_names[frame]) % self.pattern.step_count

    def frame(self, frame: int) -> tuple[Image, Image]:
        """Rectified left and right image (H, W), uint8 or uint16, of a frame counted from 0; kept once read.

        Raises
        ------
        CaptureError
            A PNG that is missing, unreadable, of another size than rig.yaml says, or not of one depth with the others.
        """
        return self._frames[frame]

    def stack(self) -> tuple[Image, Image]:
        """All rectified frames, two arrays (n, H, W)."""
        left, right = zip(*self._frames, strict=True)
        return np.stack(left), np.stack(right)

    @cached_property
    def _frames(self) -> list[tuple[Image, Image]]:
        raw = [(self._read(f"left_{name}.png"), self._read(f"right_{name}.png")) for name in self.frame_names]
        depths = sorted({str(image.dtype) for pair in raw for image in pair})
        if len(depths) > 1:
            raise CaptureError(f"the images of {self.folder} are partly {' and partly '.join(depths)}; give one depth")
        return [self.pair.rectify(*images) for images in raw]

    def _read(self, name: str) -> Image:
        path = self.folder / name
        image = decoded(path)
        width, height = self.pair.raw_size
        if image.shape != (height, width):
            raise CaptureError(
                f"{path} is {image.shape[1]} x {image.shape[0]} pixels; {RIG_FILE} says {width} x {height}: "
                "give the images the calibration was made with"
            )
        return image


def decoded(path: Path) -> Image:
    """Return the grey image (H, W) in a file, or raise CaptureError."""
    try:
        content = np.frombuffer(path.read_bytes(), dtype=np.uint8)
        image = cv2.imdecode(content, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH) if content.size else None
    except OSError as error:
        raise CaptureError(f"cannot read {path}: {error.strerror}; give an 8 or 16 bit grey PNG") from error
    if image is None or image.dtype not in (np.uint8, np.uint16):
        raise CaptureError(f"{path} holds no image that can be read; give an 8 or 16 bit grey PNG")
    return np.asarray(image)


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
        size = check_image_size(content["image_size"])
        pair = rig_of_capture(content["projections"], size)
        pattern = pattern_of(content["pattern"])
        depth_range_m = depth_range_of(content["depth_range_m"])
    except KeyError as error:
        raise CaptureError(f"{path / RIG_FILE} is not usable: {error} is missing; {NEEDED}") from error
    except MoireError as error:
        raise CaptureError(f"{path / RIG_FILE} is not usable: {error}") from error
    capture = Capture(path, pair, pattern, depth_range_m, frame_names(path))
    capture.frame(0)
    return capture


def read_rig_file(path: Path) -> dict[str, Any]:
    """Return the mapping in a rig file, or raise CaptureError."""
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise CaptureError(f"cannot read {path}: {' '.join(str(error).split())}; {NEEDED}") from error
    if not isinstance(content, dict):
        raise CaptureError(f"{path} holds a {type(content).__name__}, not a mapping; {NEEDED}")
    return content


def rig_of_capture(projections: Any, size: tuple[int, int]) -> RectifiedPair:
    """Take a rectified pair as it is; rectify any other."""
    if not isinstance(projections, dict):
        raise CaptureError(f"projections is a {type(projections).__name__}; give left, right, projector, (3, 4) each")
    left, right, projector = (projections[name] for name in ("left", "right", "projector"))
    try:
        return RectifiedPair(StereoRig.from_projections(left, right, projector, size), None, None, size)
    except RigError:
        return rectify_pair(left, right, projector, size)


def pattern_of(fields: Any) -> FringePattern:
    """Return the pattern that a mapping describes."""
    if not isinstance(fields, dict):
        raise CaptureError(f"pattern is a {type(fields).__name__}; give period_px, phase_rad, step_phases_rad")
    known = [field.name for field in dataclasses.fields(FringePattern)]
    unknown = [str(name) for name in fields if name not in known]
    if unknown:
        raise CaptureError(f"pattern has {', '.join(unknown)}; allowed are {', '.join(known)}")
    return FringePattern(**{"period_px": fields["period_px"], **fields})


def depth_range_of(limits: Any) -> tuple[float, float]:
    """Return (nearest, farthest) in metres, or raise CaptureError."""
    try:
        nearest, farthest = (float(limit) for limit in limits)
    except (TypeError, ValueError):
        nearest = farthest = math.nan
    if not 0.0 < nearest < farthest < math.inf:
        raise CaptureError(f"depth_range_m is {limits}; give [nearest, farthest] in metres with 0 < nearest < farthest")
    return nearest, farthest


def frame_names(folder: Path) -> tuple[str, ...]:
    """Numbers of the frames that both cameras have, none left out, or raise CaptureError."""
    numbers = {
        side: {found[1] for path in folder.iterdir() if (found := re.fullmatch(rf"{side}_(\d+)\.png", path.name))}
        for side in ("left", "right")
    }
    names = sorted(numbers["left"], key=int)
    if alone := numbers["left"] ^ numbers["right"]:
        what = f"frames {', '.join(sorted(alone))} have one image only"
    elif not names:
        what = "it holds no left_NN.png"
    elif [int(name) - int(names[0]) for name in names] != list(range(len(names))):
        what = f"the frames are {', '.join(names)}, but each must follow the one before, as the steps of the pattern do"
    else:
        return tuple(names)
    raise CaptureError(f"the capture {folder} is incomplete: {what}; {NEEDED}")
