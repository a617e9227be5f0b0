"""A headless Chromium for tests of pages, driven by its DevTools protocol."""

from __future__ import annotations

import base64
import itertools
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import numpy.typing as npt
from websockets.sync.client import ClientConnection, connect

NAMES = ("chromium", "chromium-browser", "google-chrome")
# Software WebGL, and nothing of its own on the network.
FLAGS = (
    "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage",
    "--remote-debugging-port=0",
)  # fmt: skip
# Bounds for a hang on a machine five times slower, not measurements.
TIMEOUT_S = 180.0
EXIT_TIMEOUT_S = 60.0


def find_chromium() -> str | None:
    """Path of a Chromium, None where there is none."""
    return next(filter(None, map(shutil.which, NAMES)), None)


class Tab:
    """One page; ``requested`` are the addresses of all that it asked for."""

    def __init__(self, socket: ClientConnection) -> None:
        self.requested: list[str] = []
        self._loaded = False
        self._socket = socket
        self._numbers = itertools.count(1)
        self._session: dict[str, str] = {}
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = {"sessionId": self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]}
        self._call("Network.enable")
        self._call("Page.enable")

    def open(self, url: str) -> None:
        """Go to an address; what was before is gone then."""
        self._loaded = False
        self._call("Page.navigate", url=url)
        while not self._loaded:
            self._receive()

    def picture(self) -> npt.NDArray[np.uint8]:
        """What is seen now, (H, W, 3), blue first."""
        png = base64.b64decode(self._call("Page.captureScreenshot")["data"])
        return np.asarray(cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR), dtype=np.uint8)

    def text(self) -> str:
        """All text of the page."""
        return str(self._call("Runtime.evaluate", expression="document.body.innerText")["result"]["value"])

    def wait(self, happened: Callable[[], bool], what: str) -> None:
        """Wait until something is seen on the page."""
        deadline = time.monotonic() + TIMEOUT_S
        while not happened():
            assert time.monotonic() < deadline, f"waited {TIMEOUT_S:g} s in vain for {what}; the page: {self.text()}"
            # The answer comes with the browser's next frame.
            self._call("Runtime.evaluate", expression="new Promise(requestAnimationFrame)", awaitPromise=True)

    def _call(self, method: str, **parameters: Any) -> Any:
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": parameters, **self._session}))
        while (answer := self._receive()).get("id") != number:
            pass
        assert "result" in answer, answer
        return answer["result"]

    def _receive(self) -> dict[str, Any]:
        message: dict[str, Any] = json.loads(self._socket.recv(timeout=TIMEOUT_S))
        if message.get("method") == "Network.requestWillBeSent":
            self.requested.append(message["params"]["request"]["url"])
        self._loaded |= message.get("method") == "Page.loadEventFired"
        return message


@contextmanager
def browser_tab(chromium: str, profile: Path, size_px: tuple[int, int] = (1280, 900)) -> Iterator[Tab]:
    """Start a browser with an empty profile folder; it is gone at the end."""
    size = f"--window-size={size_px[0]},{size_px[1]}"
    command = [chromium, *FLAGS, size, f"--user-data-dir={profile}", "about:blank"]
    process = subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    assert process.stderr is not None
    try:
        said = next(line for line in process.stderr if line.startswith("DevTools listening on "))
        with connect(said.split()[-1], max_size=None) as socket:
            yield Tab(socket)
    finally:
        os.killpg(process.pid, signal.SIGTERM)
        process.communicate(timeout=EXIT_TIMEOUT_S)
