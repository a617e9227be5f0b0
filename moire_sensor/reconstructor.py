"""Depth from fringe images: the public face of all methods."""

from __future__ import annotations

import numpy as np

from moire_sensor.edge_depth import FringeEdges
from moire_sensor.edge_input import check_numbers
from moire_sensor.errors import ImageError, PatternError, SettingsError
from moire_sensor.pattern import FringePattern
from moire_sensor.phase_carrier import Float32
from moire_sensor.phase_pipeline import PhasePipeline
from moire_sensor.phase_steps import StepFilter, needed_frames
from moire_sensor.plain_image import Grey
from moire_sensor.reference_depth import reference_plane
from moire_sensor.rig import StereoRig
from moire_sensor.settings import Settings
from moire_sensor.shot import Shot
from moire_sensor.shot_merge import moved_region, taken_from

METHODS = ("dense", "phase_shift", "fringe_edges", "reference_plane")
DEFAULT_DEPTH_RANGE_M = (0.5, 2.0)
Images = Grey


class Reconstructor:
    """Depth from fringe images of one rig and pattern.

    Parameters
    ----------
    rig : the rectified pair and its projector.
    pattern : the projected fringes.
    depth_range_m : nearest and farthest depth that can occur, metres; the fewer periods in it, the surer the order.
    method : ``"dense"`` (one exposure, every pixel), ``"phase_shift"`` (N >= 3 exposures), ``"fringe_edges"`` (one
        exposure, the paper's sparse method) or ``"reference_plane"`` (one exposure of the left camera alone, right only
        within half a fringe of ``settings.reference_depth_m``).
    saturation_level : grey level of a saturated pixel, 255 for 8 bit, e.g. 4095 for 12 bit in uint16.
    settings : tuning; the defaults serve all rigs.

    Raises
    ------
    SettingsError
        An unknown method, a depth range that is empty or not positive, fringes too fine or too coarse for the images,
        or a projector lens with a method that does not model it.
    PatternError
        Fewer than three steps, or four square ones, for ``"phase_shift"``.
    """

    def __init__(
        self,
        rig: StereoRig,
        pattern: FringePattern,
        depth_range_m: tuple[float, float] = DEFAULT_DEPTH_RANGE_M,
        method: str = "dense",
        saturation_level: float = 255.0,
        settings: Settings | None = None,
    ) -> None:
        check_choices(depth_range_m, method, saturation_level)
        check_lens(rig, method)
        self.rig = rig
        self.pattern = pattern
        self.depth_range_m = (float(depth_range_m[0]), float(depth_range_m[1]))
        self.method = method
        self.settings = settings or Settings()
        self._saturation_level = float(saturation_level)
        self._edges = None
        if method == "fringe_edges":
            self._edges = FringeEdges(rig, pattern, self.depth_range_m, saturation_level=self._saturation_level)
        self._pipeline = PhasePipeline(rig, pattern, self.depth_range_m, self.settings)
        if method == "phase_shift":
            check_steps(pattern)
            StepFilter.build(pattern.step_phases_rad, 0, self.frames_needed)

    @property
    def frames_needed(self) -> int:
        """Frames of one result: 1, or for N steps N + 1 made odd, so that a frame lies in the middle."""
        return needed_frames(self.pattern.step_count) if self.method == "phase_shift" else 1

    def warm_up(self) -> None:
        """Compile or load every kernel, so that the first real frame is as fast as the rest.

        For uint16 images where the saturation level is beyond uint8, else for uint8.
        """
        images: Images = self._pipeline.example(self.frames_needed)
        if self._saturation_level > np.iinfo(np.uint8).max:
            images = images.astype(np.uint16)
        images = images if self.method == "phase_shift" else images[0]
        self.reconstruct(images, images)

    def reconstruct(self, left: Images, right: Images, first_step: int = 0) -> Shot:
        """Reconstruct the depth that the left camera sees.

        Parameters
        ----------
        left, right : uint8 or uint16, (n, H, W) with n >= steps for ``"phase_shift"``, (H, W) for the other methods.
        first_step : step of the pattern that the first frame carries; frame i carries (first_step + i) mod steps.

        Raises
        ------
        ImageError
            Images of another shape, type or number.
        """
        if self._edges is not None:
            return self._edges.reconstruct(left, right, first_step)
        images = [self._checked(name, image) for name, image in (("left", left), ("right", right))]
        if images[0].shape != images[1].shape:
            raise ImageError(f"{len(left)} left frames came with {len(right)} right ones; give as many of each")
        if self.method == "phase_shift":
            shot = self._pipeline.from_steps(images[0], images[1], first_step)
            return self._moved_from_single(shot, images[0], images[1], first_step)
        if self.method == "dense":
            return self._pipeline.from_single(images[0][0], images[1][0], first_step)
        return reference_plane(
            left, self.rig, self.pattern, self.depth_range_m, self.settings.reference_depth_m,
            first_step=first_step, saturation_level=self._saturation_level, settings=self.settings,
        ).shot  # fmt: skip

    def _moved_from_single(self, shot: Shot, left: Float32, right: Float32, first_step: int) -> Shot:
        """Take from the middle exposure what moved too much between the steps."""
        region = moved_region(shot, self._pipeline.window_px)
        if not region.any():
            return shot
        middle = len(left) // 2
        return taken_from(self._pipeline.from_single(left[middle], right[middle], first_step + middle), shot, region)

    def _checked(self, name: str, image: Images) -> Float32:
        """Images as float32 (n, H, W), grey levels scaled to 255 at saturation."""
        width, height = self.rig.image_size
        several = self.method == "phase_shift"
        allowed = f"(n, {height}, {width}) with n >= {self.pattern.step_count}" if several else f"({height}, {width})"
        array = np.asarray(image)
        frames = array if several else array[None]
        fewest = self.pattern.step_count if several else 1
        if frames.ndim != 3 or frames.shape[1:] != (height, width) or frames.shape[0] < fewest:
            raise ImageError(f"the {name} images have shape {array.shape}; method {self.method!r} needs {allowed}")
        if array.dtype not in (np.uint8, np.uint16):
            raise ImageError(f"the {name} images are {array.dtype}; give uint8 or uint16 grey levels")
        # In C order whatever came: the kernels compile anew for every other layout.
        levels = frames.astype(np.float32, order="C")
        if self._saturation_level != 255.0:
            levels *= np.float32(255.0 / self._saturation_level)
        return levels


def check_lens(rig: StereoRig, method: str) -> None:
    """Raise SettingsError where the projector has a lens that the method does not model."""
    if rig.projector_distortion and method in ("fringe_edges", "reference_plane"):
        raise SettingsError(
            f"method {method!r} knows no projector lens, and this projector has one {rig.projector_distortion}; "
            "use dense or phase_shift"
        )


def check_steps(pattern: FringePattern) -> None:
    """Raise PatternError for four square steps: they show four phases only, and depth from them would be wrong."""
    if pattern.waveform == "square" and pattern.step_count == 4:
        raise PatternError(
            "square fringes in 4 steps show only four phases of a period; project sine fringes, or 3, 5 or more steps"
        )


def check_choices(depth_range_m: tuple[float, float], method: str, saturation_level: float) -> None:
    """Raise SettingsError for a choice that cannot work."""
    if method not in METHODS:
        raise SettingsError(f"method is {method!r}; it must be one of {', '.join(METHODS)}")
    check_numbers(depth_range_m, saturation_level)
