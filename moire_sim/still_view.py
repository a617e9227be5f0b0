"""What the head's cameras see, and what the projector lights, while nothing moves."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from moire_sensor.rig import StereoRig
from moire_sim.both_cameras import for_both
from moire_sim.device_view import DeviceView, visible_share
from moire_sim.fringe_image import LIT_SHARE, Surfaces, light_surfaces

Array = npt.NDArray[np.float64]

if TYPE_CHECKING:
    from moire_sim.render_geometry import Buffers, GeometryRenderer


@dataclass(frozen=True, eq=False)
class StillView:
    """Everything that stays while neither the scene nor the head moves; ``right_depth_m`` is the right view's own."""

    left: Surfaces
    right: Surfaces
    depth_m: npt.NDArray[np.float32]
    right_view: DeviceView
    right_depth_m: Array

    @cached_property
    def covisible(self) -> npt.NDArray[np.bool_]:
        """Pixels (H, W) of the left view that are lit and seen by both cameras; only the truth's users need them."""
        seen = visible_share(self.right_view, self.right_depth_m, self.left.points_m, self.left.planes)
        return self.left.lit & (seen >= LIT_SHARE)


def still_view(renderer: GeometryRenderer, rig: StereoRig, views: tuple[DeviceView, ...]) -> StillView:
    """Render the cameras and the projector and work out light and shadow."""
    left_view, right_view, projector = views
    left, right, lamp = renderer.render_views(views, (False,) * len(views))

    def lit(view: DeviceView, seen: Buffers) -> Surfaces:
        return light_surfaces(rig, view, seen.depth_m, seen.albedo, projector, lamp.depth_m)

    left_surfaces, right_surfaces = for_both(lit, (left_view, right_view), (left, right))
    return StillView(left_surfaces, right_surfaces, left.depth_m.astype(np.float32), right_view, right.depth_m)
