"""Both cameras' views of a moment through real optics, from rendered geometry."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from moire_sensor.rig import StereoRig
from moire_sim.both_cameras import for_both
from moire_sim.camera_lens import CameraLens
from moire_sim.device_view import DeviceView
from moire_sim.fringe_image import light_surfaces
from moire_sim.meshes import Body, LoadedBody
from moire_sim.moment import Moment
from moire_sim.optics import Optics
from moire_sim.real_view import Finishes, RealView, finish_of

if TYPE_CHECKING:
    from moire_sim.render_geometry import Buffers, GeometryRenderer

Array = npt.NDArray[np.float64]


class RealLook:
    """Render what real optics need; ``views`` are left, right and projector."""

    def __init__(
        self,
        renderer: GeometryRenderer,
        rig: StereoRig,
        views: tuple[DeviceView, ...],
        optics: Optics,
        bodies: tuple[Body | LoadedBody, ...],
    ) -> None:
        self._renderer, self._rig, self._optics = renderer, rig, optics
        self._cameras, self._projector = views[:2], views[2]
        self._lenses = tuple(CameraLens.of(view, optics) for view in self._cameras)
        self._finishes = tuple(finish_of(body.finish, optics) for body in bodies)

    def __call__(self, moment: Moment) -> tuple[RealView, RealView]:
        """Go to a moment and look at it."""
        self._renderer.go_to(moment)
        seen = self._renderer.render_views(
            (*(lens.fine_view for lens in self._lenses), self._projector), (True, True, False)
        )
        return for_both(self._view, self._cameras, self._lenses, seen[:2], [seen[2].depth_m] * 2)

    def _view(self, camera: DeviceView, lens: CameraLens, seen: Buffers, lamp_depth_m: Array) -> RealView:
        surfaces = light_surfaces(self._rig, lens.fine_view, seen.depth_m, seen.albedo, self._projector, lamp_depth_m)
        assert seen.body is not None
        finishes = Finishes(seen.body, self._finishes, self._renderer.rest_from_left())
        return RealView.of(lens, surfaces, finishes, self._projector, self._optics, camera.size)
