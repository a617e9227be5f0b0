"""The viewer's web page, made with viser: pictures beside a point cloud to turn, served by this process alone."""

from __future__ import annotations

import contextlib
import io
import ipaddress
import socket
from typing import Any

import numpy as np

from moire_sensor.errors import SettingsError
from moire_sensor.ros.viewer_pictures import Floats, Picture

LABELS = {"left": "left camera", "right": "right camera", "depth": "depth", "confidence": "confidence"}
CAMERAS, RESULTS = ("left", "right"), ("depth", "confidence")
PANEL_PX = 300
EMPTY = np.full((480, 640, 3), 235, dtype=np.uint8)
BY_DEPTH, BY_BRIGHTNESS = "depth", "brightness"
# Size of a point, times its distance from the camera: the gap between points is about that much.
POINT_SIZE = 0.0025
AXES_M = 0.05
JPEG_QUALITY = 85
# Where one looks at the cloud from, in the left optical frame: from behind, above and beside the camera, this many
# times the radius away that holds nine of ten points.
EYE = np.array([0.45, -0.35, -0.82])
DISTANCE, RADIUS_PERCENT = 1.6, 90


def resolve_host(host: str) -> tuple[str, bool]:
    """Return the address of a host name of this machine, and whether it is loopback; raises SettingsError."""
    try:
        address = str(socket.getaddrinfo(host, None, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0][4][0])
    except (OSError, UnicodeError) as error:
        raise SettingsError(
            f"parameter host is {host!r}, which is no address: {error}; give one of this machine, such as 127.0.0.1"
        ) from error
    return address, ipaddress.ip_address(address.partition("%")[0]).is_loopback


def url_host(address: str) -> str:
    """Return what stands for an address in a URL; the name of this machine for all of its addresses."""
    if ipaddress.ip_address(address.partition("%")[0]).is_unspecified:
        return socket.gethostname()
    return f"[{address}]" if ":" in address else address


def check_port_is_free(address: str, port: int) -> None:
    """Raise SettingsError if nothing can be served at an address and port; 0 is any free port.

    viser would go on to the next port without a word.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    try:
        with socket.socket(family, socket.SOCK_STREAM) as probe:
            # As servers do: a port that a viewer used a moment ago is free.
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((address, port))
            probe.listen()
    except OSError as error:
        raise SettingsError(
            f"the page cannot be served at {address} port {port}: {error.strerror}; choose another with "
            "-p port:=NUMBER (0: any free one) or -p host:=ADDRESS"
        ) from error


class ViewerPage:
    """The page and its server; browsers come and go.

    Parameters
    ----------
    address, port : where it is served; port 0 is any free one.
    title : shown above the table of rates.

    Raises
    ------
    SettingsError
        viser is not installed, or the address or port cannot be had.
    """

    def __init__(self, address: str, port: int, title: str) -> None:
        check_port_is_free(address, port)
        self._server = _local_server(address, port, title)
        if port not in (0, self._server.get_port()):
            self.close()
            raise SettingsError(f"port {port} of {address} was taken just now; choose another with -p port:=NUMBER")
        self.url = f"http://{url_host(address)}:{self._server.get_port()}"
        self._looking: set[int] = set()
        self._cloud: Any = None
        self._build()

    def browsers(self) -> int:
        """Return how many browsers show the page."""
        return len(self._server.get_clients())

    def coloured_by_depth(self) -> bool:
        """Tell whether the cloud is wanted in the colours of depth, not in grey."""
        return bool(self._colour.value == BY_DEPTH)

    def show_picture(self, name: str, picture: Picture, note: str) -> None:
        """Show a picture of "left", "right", "depth" or "confidence", with a note beside its name."""
        self._pictures[name].image = picture
        self.show_note(name, note)

    def show_note(self, name: str, note: str) -> None:
        """Show a note beside the name of a picture."""
        self._pictures[name].label = f"{LABELS[name]}: {note}" if note else LABELS[name]

    def show_cloud(self, points_m: Floats, colours: Picture) -> None:
        """Show points (N, 3) in metres, left optical frame, with their colours (N, 3)."""
        if self._cloud is None:
            self._cloud = self._server.scene.add_point_cloud(
                "/cloud", points_m, colours, point_size=POINT_SIZE, precision="float32", point_shading="flat"
            )
        else:
            with self._server.atomic():
                self._cloud.points = points_m
                self._cloud.colors = colours
        clients = self._server.get_clients()
        self._looking &= clients.keys()
        for number in clients.keys() - self._looking if len(points_m) else ():
            self._look(clients[number], points_m)
            self._looking.add(number)

    def show_facts(self, markdown: str) -> None:
        """Show the table of rates and what is wrong."""
        if self._facts.content != markdown:
            self._facts.content = markdown

    def close(self) -> None:
        """End the server."""
        self._server.stop()

    def _build(self) -> None:
        server = self._server
        server.scene.set_up_direction("-y")
        server.scene.add_frame("/left_camera", axes_length=AXES_M, axes_radius=AXES_M / 20)
        server.gui.configure_theme(show_logo=False, show_share_button=False)
        self._facts = server.gui.add_markdown("waiting for the first messages")
        pictures = {name: _picture(server, name) for name in CAMERAS}
        results = server.gui.add_panel()
        with results.add_tab("results"):
            self._pictures = pictures | {name: _picture(server, name) for name in RESULTS}
            self._colour = server.gui.add_dropdown("cloud's colour", (BY_DEPTH, BY_BRIGHTNESS))
            again = server.gui.add_button("look at the cloud again")
        again.on_click(lambda event: self._looking.clear())
        for panel, dock in ((server.gui.main_panel, "dock_left"), (results, "dock_right")):
            getattr(panel, dock)()
            panel.set_width(PANEL_PX)

    def _look(self, client: Any, points_m: Floats) -> None:
        middle = np.median(points_m, axis=0)
        radius_m = np.percentile(np.linalg.norm(points_m - middle, axis=1), RADIUS_PERCENT)
        self._cloud.point_size = POINT_SIZE * float(middle[2])
        with client.atomic():
            client.camera.position = middle + EYE * DISTANCE * radius_m
            client.camera.look_at = middle


def _picture(server: Any, name: str) -> Any:
    return server.gui.add_image(EMPTY, label=LABELS[name], format="jpeg", jpeg_quality=JPEG_QUALITY)


def _local_server(address: str, port: int, title: str) -> Any:
    """A viser server that cannot be asked to open a tunnel to the outside, which its page could otherwise do."""
    try:
        import viser  # Only the viewer needs it, and it is slow to import.
    except ImportError as error:
        raise SettingsError(
            f"the viewer needs the library viser ({error}); install it: pip install 'moire_sensor[viewer]', or "
            "pip install viser"
        ) from error

    class LocalServer(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> str | None:
            return None

    # It prints an address in any case, and for some hosts one that is wrong.
    with contextlib.redirect_stdout(io.StringIO()):
        return LocalServer(address, port, label=title, verbose=False)
