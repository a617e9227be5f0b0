"""A process that renders views for another, into memory that both share; it ends with the other."""

from __future__ import annotations

import json
import mmap
import os
import pickle
import socket
import subprocess
import sys
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import numpy.typing as npt

from moire_sim.device_view import DeviceView
from moire_sim.errors import SimulatorError
from moire_sim.moment import Moment
from moire_sim.scene_file import Scene

if TYPE_CHECKING:
    from moire_sim.render_geometry import Buffers

# The other process looks for packages where this one does, whatever script this one is.
CODE = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from moire_sim.render_worker import main; main()"
BYTES_A_PIXEL = 16


class Job(NamedTuple):
    """What to render: a view of a moment, with or without the numbers of the bodies."""

    moment: Moment
    view: DeviceView
    with_bodies: bool


@dataclass(frozen=True, eq=False)
class SharedPicture:
    """Memory for the buffers of one view of at most ``pixels`` pixels; both processes see the same."""

    memory: mmap.mmap
    pixels: int

    @classmethod
    def of(cls, descriptor: int, pixels: int) -> SharedPicture:
        """Map the file behind a descriptor."""
        return cls(mmap.mmap(descriptor, 0), pixels)

    def arrays(self, size: tuple[int, int]) -> tuple[npt.NDArray[Any], ...]:
        """Depth, albedo and body (H, W) in the memory, as of :class:`moire_sim.render_geometry.Buffers`."""
        count, shape = size[0] * size[1], (size[1], size[0])
        starts = ((np.float64, 0), (np.float32, 8 * self.pixels), (np.int32, 12 * self.pixels))
        return tuple(
            np.frombuffer(self.memory, kind, count, start).reshape(shape)  # type: ignore[call-overload]
            for kind, start in starts
        )


class RenderWorker:
    """The process as its owner sees it; give it a job, take what it rendered, one after the other.

    Parameters
    ----------
    scene : what it renders.
    egl : by EGL, not by TinyRenderer.
    pixels : of the largest view.
    """

    def __init__(self, scene: Scene, egl: bool, pixels: int) -> None:
        memory = os.memfd_create("moire_view")
        ours, theirs = socket.socketpair()
        try:
            # The scene comes in the pictures' place, read before the first of them: the line would hold too little of
            # it, and its owner would wait until the process has started.
            task = pickle.dumps((scene, egl))
            os.ftruncate(memory, max(BYTES_A_PIXEL * pixels, len(task)))
            self._picture = SharedPicture.of(memory, pixels)
            self._picture.memory[: len(task)] = task
            arguments = (json.dumps(sys.path), str(theirs.fileno()), str(memory), str(pixels))
            # In a session of its own, Ctrl-C reaches its owner alone. What the simulator prints is not for users;
            # errors come by the line.
            self._process = subprocess.Popen(
                [sys.executable, "-c", CODE, *arguments],
                stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
                pass_fds=(theirs.fileno(), memory), start_new_session=True,
            )  # fmt: skip
        except OSError as error:
            ours.close()
            raise SimulatorError(f"no process can be started to render ({error}); use render_processes 1") from None
        finally:
            theirs.close()
            os.close(memory)
        self._line = Connection(ours.detach())
        self._ready, self._begun = False, 0

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """What the process ended with; None while it runs."""
        return self._process.poll()

    def is_ready(self) -> bool:
        """True from when the process has the scene and waits for jobs."""
        return self._ready or (self._line.poll() and self.wait_until_ready())

    def wait_until_ready(self) -> bool:
        """Wait for it."""
        self._ready = self._ready or self._receive() == "ready"
        return self._ready

    def begin(self, job: Job) -> None:
        """Let it render; the answer is :meth:`result`'s."""
        self._begun += 1
        self._send((self._begun, job))

    def result(self, job: Job) -> Buffers:
        """Wait for what :meth:`begin` began."""
        from moire_sim.render_geometry import Buffers

        while self._receive() != self._begun:
            # The answer to a job that was begun, and whose result nobody took: an interrupt came between.
            continue
        depth_m, albedo, body = (one.copy() for one in self._picture.arrays(job.view.size))
        return Buffers(depth_m, albedo, body if job.with_bodies else None)

    def close(self) -> None:
        """End the process; calling it again does nothing."""
        self._line.close()
        self._process.terminate()
        self._process.wait()

    def _send(self, message: Any) -> None:
        try:
            self._line.send(message)
        except OSError:
            raise self._lost() from None

    def _receive(self) -> Any:
        try:
            answer = self._line.recv()
        except (EOFError, OSError):
            raise self._lost() from None
        if isinstance(answer, SimulatorError):
            raise answer
        return answer

    def _lost(self) -> SimulatorError:
        self._process.wait()
        return SimulatorError(
            f"a process that renders has ended with {self._process.returncode}; start again, or use render_processes 1"
        )


def main() -> None:
    """Render until the owner closes the line, or ends."""
    from moire_sim.render_geometry import GeometryRenderer

    line = Connection(int(sys.argv[2]))
    picture = SharedPicture.of(int(sys.argv[3]), int(sys.argv[4]))
    try:
        renderer = GeometryRenderer(*pickle.loads(picture.memory[:]))
        line.send("ready")
        while True:
            number, job = line.recv()
            renderer.go_to(job.moment)
            seen = renderer.render(job.view, job.with_bodies)
            depth_m, albedo, body = picture.arrays(job.view.size)
            depth_m[...], albedo[...] = seen.depth_m, seen.albedo
            if seen.body is not None:
                body[...] = seen.body
            line.send(number)
    except (EOFError, OSError):
        # The owner has closed the line or is gone: nobody waits for an answer.
        return
    except Exception as error:
        line.send(SimulatorError(f"a process that renders has failed: {type(error).__name__}: {error}"))
