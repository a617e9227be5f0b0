"""Classic projection moire: one camera, one exposure, depth against a reference plane (section 2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from moire_sensor.edge_input import Image, as_grey, check_numbers
from moire_sensor.edge_noise import camera_noise
from moire_sensor.errors import SettingsError
from moire_sensor.pattern import FringePattern
from moire_sensor.plain_image import as_plain
from moire_sensor.projector_map import ProjectorMap
from moire_sensor.reference_phase import fringe_signal, low_passed
from moire_sensor.reference_ray import Camera, check_camera, disparity_on_ray_px, phase_seen_rad
from moire_sensor.rig import Array, StereoRig
from moire_sensor.settings import Settings
from moire_sensor.shot import UNKNOWN_ORDER, Shot, Status

TURN = 2.0 * np.pi
PHASE_STEP_RAD = 1e-4


@dataclass(frozen=True, eq=False)
class ReferencePlane:
    """Result of one camera, aligned with its image.

    Attributes
    ----------
    psi_periods : (H, W) float64, phase minus the reference plane's, -1/2 to 1/2 (equations 2 and 7); NaN where unlit.
    shot : its images on the grid of the camera that was used; ``confidence`` is one over the number of fringe orders
        that the depth range allows at the pixel: nothing in one camera's image tells them apart.
    """

    psi_periods: Array
    shot: Shot


def reference_plane(
    image: Image,
    rig: StereoRig,
    pattern: FringePattern,
    depth_range_m: tuple[float, float],
    reference_depth_m: float = 1.5,
    *,
    camera: Camera = "left",
    fringe_number: int = 0,
    first_step: int = 0,
    saturation_level: float = 255.0,
    settings: Settings | None = None,
) -> ReferencePlane:
    """Measure depth as the shift of the fringes from where a fronto-parallel plane would show them.

    Right only for surfaces within half a period of the plane: what lies beyond comes out whole fringe orders off
    (section 2.3). For the paper's rig the depth is ``l - u l / (B + u)`` with ``u = psi p``; the intersection of ray
    and light sheet that is taken here is the same for any projection matrices.

    Parameters
    ----------
    image : uint8 or uint16 (H, W), one exposure of ``camera``.
    depth_range_m : nearest and farthest depth; results outside are left unknown.
    reference_depth_m : depth of the plane, metres.
    fringe_number : N of equation (7), the orders that the whole image is off the plane's.
    first_step : step of the pattern that the exposure carries.
    saturation_level : grey level of a saturated pixel.
    settings : ``min_amplitude`` tells what is lit.

    Raises
    ------
    ImageError
        An image of another shape or type.
    SettingsError
        A camera, depth range, reference depth or saturation level that cannot be.
    """
    limits_m = check_numbers(depth_range_m, saturation_level)
    check_camera(camera)
    if not (np.isfinite(reference_depth_m) and reference_depth_m > 0.0):
        raise SettingsError(f"reference_depth_m is {reference_depth_m}; it must be finite and above 0 metres")
    picture = as_grey(camera, image, rig, saturation_level)
    seen = CameraPhase(ProjectorMap.build(rig, pattern), rig, camera)
    plane_rad = seen.phase_rad(reference_depth_m)
    step_rad = pattern.step_phases_rad[first_step % pattern.step_count]

    period_px = TURN / abs(float(np.median(np.diff(plane_rad, axis=1))))
    fringe = fringe_signal(picture, plane_rad + step_rad, period_px)
    psi_periods = np.angle(fringe) / TURN
    phase_rad = plane_rad + TURN * (psi_periods + fringe_number)

    status = pixel_status(picture, np.abs(fringe), settings or Settings())
    sigma_rad = phase_sigma_rad(camera_noise(as_plain(image), 255.0 / saturation_level), np.abs(fringe), period_px)
    background = low_passed(picture.astype(np.complex128), period_px).real
    shot = as_shot(seen, phase_rad, sigma_rad, status, limits_m, background)
    return ReferencePlane(np.where(status == Status.UNLIT, np.nan, psi_periods), shot)


@dataclass(frozen=True, eq=False)
class CameraPhase:
    """What a camera sees of the pattern, pixel by pixel; all arrays (H, W)."""

    projector: ProjectorMap
    rig: StereoRig
    camera: Camera

    @property
    def pixels(self) -> tuple[Array, Array]:
        """Columns and rows."""
        x, y = np.meshgrid(*(np.arange(float(side)) for side in self.rig.image_size))
        return x, y

    def phase_rad(self, depth_m: float) -> Array:
        """Absolute phase of a fronto-parallel plane, the exposure's step not included."""
        return phase_seen_rad(self.projector, self.camera, *self.pixels, float(self.rig.disparity_px(depth_m)))

    def depth_m(self, phase_rad: Array) -> Array:
        """Depth of what shows a phase; NaN where none can."""
        return self.rig.depth_m(disparity_on_ray_px(self.projector, self.camera, *self.pixels, phase_rad))


def as_shot(
    seen: CameraPhase,
    phase_rad: Array,
    sigma_rad: Array,
    status: npt.NDArray[np.uint8],
    limits_m: tuple[float, float],
    background: Array,
) -> Shot:
    """Images of the depth that an absolute phase (H, W) stands for; AMBIGUOUS where it is outside the limits."""
    depth = seen.depth_m(phase_rad)
    m_per_rad = np.abs(seen.depth_m(phase_rad + PHASE_STEP_RAD) - depth) / PHASE_STEP_RAD
    lit = status == Status.OK
    known = lit & (depth >= limits_m[0]) & (depth <= limits_m[1])
    orders = orders_between(phase_rad, seen.phase_rad(limits_m[0]), seen.phase_rad(limits_m[1]))
    return Shot(
        depth_m=where_known(known, depth),
        depth_sigma_m=where_known(known, m_per_rad * sigma_rad),
        disparity_px=where_known(known, seen.rig.disparity_px(depth)),
        fringe_order=np.where(known, np.floor(phase_rad / TURN + 0.5), UNKNOWN_ORDER).astype(np.int16),
        confidence=np.where(known, 1.0 / orders, 0.0).astype(np.float32),
        status=np.where(lit & ~known, Status.AMBIGUOUS, status).astype(np.uint8),
        background=background.astype(np.float32),
    )


def where_known(known: npt.NDArray[np.bool_], values: Array) -> npt.NDArray[np.float32]:
    """Return values (H, W) as float32, NaN where not known."""
    return np.where(known, values, np.nan).astype(np.float32)


def pixel_status(picture: npt.NDArray[np.float32], amplitude: Array, settings: Settings) -> npt.NDArray[np.uint8]:
    """OK, UNLIT or SATURATED, (H, W)."""
    status = np.where(amplitude < settings.min_amplitude, Status.UNLIT, Status.OK).astype(np.uint8)
    status[picture >= 255.0] = Status.SATURATED
    return status


def phase_sigma_rad(noise: float, amplitude: Array, period_px: float) -> Array:
    """Predicted standard deviation of the phase: a triangle two periods T wide has 2 / (3 T) of the noise's power."""
    return np.asarray(noise * np.sqrt(2.0 * 2.0 / (3.0 * period_px)) / np.maximum(amplitude, 1e-6))


def orders_between(phase_rad: Array, near_rad: Array, far_rad: Array) -> Array:
    """Fringe orders that a phase (H, W) known but for whole turns can have between two ends, at least 1."""
    least, most = np.minimum(near_rad, far_rad), np.maximum(near_rad, far_rad)
    number = np.floor((most - phase_rad) / TURN) - np.ceil((least - phase_rad) / TURN) + 1.0
    return np.asarray(np.maximum(number, 1.0))
