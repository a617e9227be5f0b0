"""Node ``moire_viewer``: a live view of head and reconstruction as a web page on this machine."""

from __future__ import annotations

import math
import sys
from typing import Any

from rclpy.node import Node

from moire_sensor.errors import ImageError, SettingsError
from moire_sensor.ros.executable import run_node
from moire_sensor.ros.lifecycle import STEADY_CLOCK
from moire_sensor.ros.parameters import ParameterSpec, declare, help_text, refuse_unknown
from moire_sensor.ros.viewer_inputs import STREAMS, StreamState, ViewerInputs
from moire_sensor.ros.viewer_page import ViewerPage, resolve_host
from moire_sensor.ros.viewer_pictures import (
    Scale,
    confidence_of,
    depth_of,
    depth_scale,
    grey_picture,
    greys,
    known_share,
    points_of,
    scale_picture,
)

USAGE = """
moire_viewer --ros-args [-p port:=8080] [-p host:=127.0.0.1] [-r __ns:=/head]
Left, right, depth, confidence, point cloud and rates of a head and its reconstruction as a web page; open the address
that it prints.
"""
NAMESPACE = "head"
FACTS_PERIOD_S = 0.5
CONFIDENCE = Scale(0.0, 1.0)
SPECS = (
    ParameterSpec("host", "127.0.0.1", "address to serve the page at; not loopback: others see it", read_only=True),
    ParameterSpec("port", 8080, "TCP port of the page; 0: any free one", 0, 65535, read_only=True),
    ParameterSpec("max_rate_hz", 5.0, "how often the page is renewed at most, Hz", 0.1, 60.0, read_only=True),
    ParameterSpec("max_points", 80_000, "points of the cloud to send at most", 100, 5_000_000, read_only=True),
    ParameterSpec("near_m", 0.0, "depth of the darkest colour, m; 0: the nearest known", 0.0, 100.0, read_only=True),
    ParameterSpec("far_m", 0.0, "depth of the brightest colour, m; 0: the farthest known", 0.0, 100.0, read_only=True),
    ParameterSpec("silent_after_s", 2.0, "time without a message after which a topic is named, s", 0.1, 60.0,
                  read_only=True),
)  # fmt: skip


class ViewerNode(Node):  # type: ignore[misc]
    """Subscribe while a browser shows the page; at each tick show the newest message of each topic.

    ``options`` go to rclpy's Node.
    """

    def __init__(self, **options: Any) -> None:
        super().__init__("moire_viewer", namespace=NAMESPACE, **options)
        self._values = declare(self, SPECS)
        refuse_unknown(self)
        check_scale(self._values["near_m"], self._values["far_m"])
        self._inputs = ViewerInputs(self)
        refuse_unknown(self, qos=True, others=self._inputs.qos_parameters())
        self._scale = Scale(0.0, 1.0)
        self._known = math.nan
        address, loopback = resolve_host(self._values["host"])
        self._page = ViewerPage(address, self._values["port"], self.get_namespace().strip("/"))
        # The page must not stand still with simulated time.
        self.create_timer(1.0 / self._values["max_rate_hz"], self._tick, clock=STEADY_CLOCK)
        self.create_timer(FACTS_PERIOD_S, self._show_facts, clock=STEADY_CLOCK)
        if not loopback:
            self.get_logger().warning(
                f"the page is served at {address}: everyone who reaches this machine sees the images; "
                "host:=127.0.0.1 keeps them here"
            )
        self.get_logger().info(f"ready: open {self._page.url} in a browser; showing {self.get_namespace()}")

    def close(self) -> None:
        """End the page."""
        self._inputs.close()
        self._page.close()

    def _tick(self) -> None:
        watched = self._page.browsers() > 0
        if watched and not self._inputs.is_open:
            self._inputs.open()
        elif self._inputs.is_open and not watched:
            self._inputs.close()
        if self._inputs.is_open:
            for name in STREAMS:
                self._show_newest(name)

    def _show_newest(self, name: str) -> None:
        message = self._inputs.newest(name)
        if message is None:
            return
        try:
            self._show(name, message)
        except ImageError as error:
            self._inputs.note_shown(name, str(error))
        else:
            self._inputs.note_shown(name)

    def _show(self, name: str, message: Any) -> None:
        page = self._page
        if name == "cloud":
            points = points_of(message, self._values["max_points"])
            by_depth = page.coloured_by_depth()
            colours = self._scale.colours(points.points_m[:, 2]) if by_depth else greys(points.brightness)
            page.show_cloud(points.points_m, colours)
        elif name == "depth":
            depth_m = depth_of(message)
            self._known = known_share(depth_m)
            self._scale = depth_scale(depth_m, self._values["near_m"], self._values["far_m"])
            note = f"{self._scale.low:.2f} to {self._scale.high:.2f} m, stripes: unknown"
            page.show_picture(name, scale_picture(depth_m, self._scale), note)
        elif name == "confidence":
            page.show_picture(name, scale_picture(confidence_of(message), CONFIDENCE), "0 (dark) to 1")
        else:
            page.show_picture(name, grey_picture(name, message), "")

    def _show_facts(self) -> None:
        if not self._inputs.is_open:
            return
        states = self._inputs.states(self._values["silent_after_s"])
        self._page.show_facts(facts_text(states, self._known))
        for name, state in states.items():
            if state.trouble and name != "cloud":
                self._page.show_note(name, state.trouble)


def check_scale(near_m: float, far_m: float) -> None:
    """Raise SettingsError if the ends of the scale, where both are given, are not in order."""
    if near_m and far_m and near_m >= far_m:
        raise SettingsError(f"near_m is {near_m:g} and far_m {far_m:g}; the nearest must be the smaller: set both")


def facts_text(states: dict[str, StreamState], known: float) -> str:
    """Return the table of rates and, above it, what is wrong, as Markdown."""
    troubles = [f"**{one.topic}**: {one.trouble}" for one in states.values() if one.trouble]
    rows = [
        f"| {name} | {one.rate_hz:.1f} | {one.shown_hz:.1f} | {milliseconds(one.latency_s)} |"
        for name, one in states.items()
    ]
    share = "" if math.isnan(known) or states["depth"].trouble else f"depth is known in {known:.1%} of the pixels"
    table = ["| topic | Hz | shown Hz | latency ms |", "|---|---|---|---|", *rows]
    return "\n\n".join([*troubles, "\n".join(table), share])


def milliseconds(seconds: float) -> str:
    """Return a latency for the table; that of another clock is unknown."""
    return "?" if math.isnan(seconds) else f"{seconds * 1e3:.0f}"


def main() -> int:
    """Run the node; the console script."""
    return run_node(ViewerNode, USAGE + help_text(SPECS))


if __name__ == "__main__":
    sys.exit(main())
