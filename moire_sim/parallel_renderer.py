"""The renderer with helpers: what moves is rendered in several processes at a time."""

from __future__ import annotations

from collections.abc import Sequence

from moire_sim.device_view import DeviceView
from moire_sim.moment import Moment
from moire_sim.render_geometry import Buffers, GeometryRenderer
from moire_sim.render_worker import Job, RenderWorker
from moire_sim.scene_file import Scene


class ParallelRenderer(GeometryRenderer):
    """Renders in this process, and where something moves, each view in a process of its own.

    While the head and all before it stand still, no other process is started; while the others start, this one renders
    alone. The picture of a moment is the same to the bit whoever renders it.

    Parameters
    ----------
    scene, egl : as of :class:`GeometryRenderer`.
    processes : with this one, 2 or more.
    """

    def __init__(self, scene: Scene, egl: bool, processes: int) -> None:
        self._workers: list[RenderWorker] = []
        self._others = processes - 1
        self._moment: Moment | None = None
        self._rendered = self._moves = False
        super().__init__(scene, egl)

    def go_to(self, moment: Moment) -> None:
        """Turn the head, and put its base and all bodies where they are at a time."""
        self._moves = self._moves or (self._rendered and moment != self._moment)
        self._moment = moment
        super().go_to(moment)

    def render_views(self, views: Sequence[DeviceView], with_bodies: Sequence[bool]) -> list[Buffers]:
        """Render several views of now: the last ones elsewhere, those before them here."""
        self._rendered = True
        if self._moves and not self._workers:
            pixels = max(view.size[0] * view.size[1] for view in views)
            self._workers = [RenderWorker(self._scene, self._egl, pixels) for _ in range(self._others)]
        ready = [worker for worker in self._workers if worker.is_ready()]
        if not ready or self._moment is None:
            return super().render_views(views, with_bodies)
        here = max(1, len(views) - len(ready))
        jobs = [Job(self._moment, *one) for one in zip(views[here:], with_bodies[here:], strict=True)]
        for worker, job in zip(ready, jobs, strict=False):
            worker.begin(job)
        own = super().render_views(views[:here], with_bodies[:here])
        return [*own, *(worker.result(job) for worker, job in zip(ready, jobs, strict=False))]

    def close(self) -> None:
        """Leave the pybullet world and end the other processes."""
        for worker in self._workers:
            worker.close()
        self._workers = []
        super().close()


