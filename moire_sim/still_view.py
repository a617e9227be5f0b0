"""What the head's cameras see, and what the projector lights, while nothing moves."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from moire_sensor.rig import StereoRig
from moire_sim.device_view import DeviceView, visible_share
from moire_sim.fringe_image import LIT_SHARE, Surfaces, light_surfaces

if TYPE_CHECKING:
    from moire_sim.render_geometry import GeometryRenderer


@dataclass(frozen=True, eq=False)
class StillView:
    """Everything that stays while neither the scene nor the head moves."""

    left: Surfaces
    right: Surfaces
    depth_m: npt.NDArray[np.float32]
    covisible: npt.NDArray[np.bool_]


def still_view(renderer: GeometryRenderer, rig: StereoRig, views: tuple[DeviceView, ...]) -> StillView:
    """Render the cameras and the projector and work out light, shadow and visibility."""
    left_view, right_view, projector = views
    left, right, lamp = (renderer.render(view) for view in views)
    left_surfaces = light_surfaces(rig, left_view, left.depth_m, left.albedo, projector, lamp.depth_m)
    right_surfaces = light_surfaces(rig, right_view, right.depth_m, right.albedo, projector, lamp.depth_m)
    seen_right = visible_share(right_view, right.depth_m, left_surfaces.points_m, left_surfaces.planes)
    covisible = left_surfaces.lit & (seen_right >= LIT_SHARE)
    return StillView(left_surfaces, right_surfaces, left.depth_m.astype(np.float32), covisible)
