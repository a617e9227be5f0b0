"""The cameras' lenses: the pinhole view that is rendered for a bent, supersampled picture, and the way between them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from moire_sensor.camera_info import Calibration
from moire_sensor.rectify import RectifiedPair
from moire_sensor.resample import resample
from moire_sensor.rig import StereoRig
from moire_sim.device_view import DeviceView
from moire_sim.errors import SimulatorError
from moire_sim.optics import Optics

Array = npt.NDArray[np.float64]
Image = npt.NDArray[np.float32]
# What cubic interpolation reaches beyond a place.
REACH_PX = 2
# A lens that looks further out than this share of the image needs more pixels than it is worth.
MAX_MARGIN = 0.5
ITERATIONS, SOLVED_PX = 100, 1e-6
STEPS = 60000.0


@dataclass(frozen=True, eq=False)
class CameraLens:
    """One camera's bent pixels in the pinhole picture rendered for them.

    Attributes
    ----------
    fine_view : the pinhole to render: ``samples`` times finer, with a margin for what the lens sees further out.
    places : (samples H, samples W, 2) float32, column and row of each sample in the fine picture; None: the same ones.
    samples : samples of a pixel along rows and along columns.
    """

    fine_view: DeviceView
    places: Image | None
    samples: int

    @classmethod
    def of(cls, view: DeviceView, optics: Optics) -> CameraLens:
        """Work out the fine view of a camera; raises SimulatorError for a lens that bends too much."""
        samples = optics.supersampling
        if not optics.lens:
            return cls(finer(view, samples, (0, 0)), None, samples)
        ideal = ideal_places(view, optics.lens, samples)
        width, height = view.size
        outside = np.maximum(-ideal.min(axis=(0, 1)), ideal.max(axis=(0, 1)) - (width - 1.0, height - 1.0))
        if not (np.isfinite(ideal).all() and np.all(outside < np.multiply(view.size, MAX_MARGIN))):
            raise SimulatorError(
                f"a lens with k1, k2, p1, p2, k3 = {', '.join(f'{value:g}' for value in optics.lens)} folds its image "
                "or looks too far out; use smaller coefficients"
            )
        margin = np.maximum(np.ceil(outside), 0.0).astype(int) + REACH_PX
        places = samples * (ideal + margin) + (samples - 1) / 2.0
        fine = finer(view, samples, (int(margin[0]), int(margin[1])))
        return cls(fine, np.ascontiguousarray(places, dtype=np.float32), samples)

    def photograph(self, fine: Image, blur_px: float) -> Image:
        """Bring a fine picture to the camera's pixels (H, W): blurred by the lens, bent, averaged over each pixel."""
        if blur_px > 0.0:
            fine = np.asarray(cv2.GaussianBlur(fine, (0, 0), blur_px * self.samples, borderType=cv2.BORDER_REPLICATE))
        if self.places is not None:
            # In steps of a 60000th of the brightest, finer than any chip's; the kernel is the rectification's.
            step = np.float32(max(float(fine.max()), 1e-6) / STEPS)
            fine = resample((fine / step + 0.5).astype(np.uint16), self.places).astype(np.float32) * step
        height, width = (length // self.samples for length in fine.shape)
        mean = fine.reshape(height, self.samples, width, self.samples).mean(axis=(1, 3))
        return np.asarray(mean, dtype=np.float32)


def finer(view: DeviceView, samples: int, margin_px: tuple[int, int]) -> DeviceView:
    """Return the pinhole with ``samples`` pixels for one, and more pixels on each side."""
    scale = np.diag([samples, samples, 1.0])
    scale[:2, 2] = [samples * margin + (samples - 1) / 2.0 for margin in margin_px]
    width, height = (samples * (length + 2 * margin) for length, margin in zip(view.size, margin_px, strict=True))
    return DeviceView(scale @ view.intrinsic, view.device_from_left, (width, height))


def ideal_places(view: DeviceView, lens: tuple[float, ...], samples: int) -> Array:
    """Pixels (samples H, samples W, 2) of the pinhole that the samples of the bent pixels see; NaN of a folded lens."""
    columns, rows = (
        (np.arange(samples * length, dtype=np.float64) + 0.5) / samples - 0.5 for length in view.size
    )
    (fx, skew, cx), (_, fy, cy), _ = view.intrinsic
    bent_y = np.broadcast_to((rows[:, None] - cy) / fy, (rows.size, columns.size))
    bent_x = (columns - cx - skew * bent_y) / fx
    x, y = bent_x.copy(), bent_y.copy()
    for _ in range(ITERATIONS):
        seen_x, seen_y = distorted(x, y, lens)
        missing_x, missing_y = bent_x - seen_x, bent_y - seen_y
        x += missing_x
        y += missing_y
        largest_px = fx * max(np.abs(missing_x).max(), np.abs(missing_y).max())
        if largest_px < SOLVED_PX:
            return np.stack([fx * x + skew * y + cx, fy * y + cy], axis=-1)
        if not largest_px < sum(view.size):
            break
    return np.full((*x.shape, 2), np.nan)


def distorted(x: Array, y: Array, lens: tuple[float, ...]) -> tuple[Array, Array]:
    """Bend normal coordinates by k1, k2, p1, p2, k3 (Brown 1966, Conrady 1919), as OpenCV does."""
    k1, k2, p1, p2, k3 = lens
    xx, yy, xy = x * x, y * y, x * y
    squared = xx + yy
    radial = 1.0 + squared * (k1 + squared * (k2 + squared * k3))
    return (
        np.asarray(x * radial + 2.0 * p1 * xy + p2 * (squared + 2.0 * xx)),
        np.asarray(y * radial + p1 * (squared + 2.0 * yy) + 2.0 * p2 * xy),
    )


def rectification(rig: StereoRig, optics: Optics) -> RectifiedPair:
    """Return what turns the head's pictures into those of its rig, as a driver learns from the camera infos."""
    size = rig.image_size
    left, right = (
        Calibration(name, size, P[:, :3], optics.lens, np.eye(3), P).raw_map()
        for name, P in (("left", rig.P_left), ("right", rig.P_right))
    )
    return RectifiedPair(rig, left, right, size)
