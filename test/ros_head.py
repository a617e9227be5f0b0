"""A head in the test's own hands: it sends any set, whole or not, and keeps what the reconstruction answers."""

from __future__ import annotations

import signal
import subprocess
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node
from rclpy.qos import QoSProfile
from ros_process import TIMEOUT_S, spin_until, start, stop
from sensor_msgs.msg import CameraInfo, Image, JointState
from std_msgs.msg import Header

from moire_sensor import FringePattern, StereoRig
from moire_sensor.paper_rig import PROJECTOR_SIZE, paper_rig
from moire_sensor.ros.camera_messages import camera_infos
from moire_sensor.ros.image_messages import GreyImage, image_message
from moire_sensor.ros.projector_state import ProjectorState, state_message, state_of_exposure

NANOSECONDS = 1_000_000_000
FIRST_STAMP_NS = 1_700_000_000 * NANOSECONDS
QUEUE = QoSProfile(depth=100)
NUMPY_TYPES = {"32FC1": np.float32, "8UC1": np.uint8, "mono8": np.uint8, "16SC1": np.int16, "16UC1": np.uint16}


def time_of(stamp: int) -> Time:
    """Message form of a stamp in nanoseconds."""
    return Time(sec=stamp // NANOSECONDS, nanosec=stamp % NANOSECONDS)


def stamp_of(message: Any) -> int:
    """Stamp in nanoseconds of a stamped message, or of a bare header."""
    header = message if isinstance(message, Header) else message.header
    return int(header.stamp.sec * NANOSECONDS + header.stamp.nanosec)


def pixels(message: Image) -> npt.NDArray[Any]:
    """Pixels of an image that the reconstruction published, read as a consumer reads them."""
    assert message.is_bigendian == 0
    return np.frombuffer(message.data, NUMPY_TYPES[message.encoding]).reshape(message.height, message.width)


@dataclass(frozen=True)
class Exposure:
    """What one set is made of; each part can be replaced to make a bad one."""

    left: GreyImage
    right: GreyImage
    state: ProjectorState
    rig: StereoRig

    @classmethod
    def of(cls, capture: Any, step: int = 0, pattern: FringePattern | None = None) -> Exposure:
        """Frame ``step`` of a capture."""
        shown = pattern or capture.pattern
        stacked = capture.left.ndim == 3
        left, right = (image[step] if stacked else image for image in (capture.left, capture.right))
        return cls(left, right, state_of_exposure(shown, step % shown.step_count), capture.rig)

    def with_state(self, **changes: Any) -> Exposure:
        """The same images under another state."""
        return replace(self, state=replace(self.state, **changes))


@contextmanager
def running(name: str, *parameters: str, number: signal.Signals = signal.SIGINT) -> Iterator[subprocess.Popen[str]]:
    """Run an executable; at the end it must end with 0 on a signal, and a failing test leaves none behind."""
    process = start(name, *parameters)
    try:
        yield process
        if process.poll() is None:
            code, output = stop(process, number)
            assert code == 0, output
            assert "Traceback" not in output, output
    except BaseException:
        process.kill()
        print(f"--- {name} printed:\n{process.communicate()[0]}")
        raise


@dataclass
class Listener:
    """Keep what a node under test publishes."""

    node: Node
    received: dict[str, list[Any]] = field(default_factory=dict)
    facts: dict[str, dict[str, str]] = field(default_factory=dict)
    reports: int = 0

    def __post_init__(self) -> None:
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._note_diagnostics, QUEUE)

    def _note_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self.facts[status.name] = {**values, "message": status.message}
            self.reports += status.name == "reconstruction: reconstruction"

    def listen(self, topic: str, kind: Any) -> Any:
        """Keep every message of a topic in ``received[topic]``; returns the subscription."""
        kept = self.received.setdefault(topic, [])
        return self.node.create_subscription(kind, topic, kept.append, QUEUE)

    def wait(self, happened: Callable[[], bool], what: str, timeout_s: float = TIMEOUT_S) -> None:
        """Handle messages until something happened, or fail with the latest diagnostics."""
        try:
            spin_until(self.node, happened, what, timeout_s)
        except AssertionError as error:
            raise AssertionError(f"{error}; diagnostics: {self.facts}") from error

    def wait_for_publishers(self) -> None:
        """Wait until every topic listened to has a publisher."""
        self.wait(lambda: all(self.node.count_publishers(topic) for topic in self.received), "the publishers")

    def answer(self, topic: str, stamp: int) -> Any:
        """Wait for the message of a topic that has a stamp."""
        kept = self.received[topic]
        self.wait(lambda: any(stamp_of(one) == stamp for one in kept), f"{topic} of {stamp}")
        return next(one for one in kept if stamp_of(one) == stamp)

    def count(self, concern: str, name: str) -> int:
        """A count of the reconstruction's diagnostics; 0 while it is not named."""
        return int(self.facts.get(f"reconstruction: {concern}", {}).get(name, "0"))

    def wait_for_count(self, concern: str, name: str, number: int) -> None:
        """Wait until a count has reached a number, and check that it went no further."""
        self.wait(lambda: self.count(concern, name) >= number, f"{concern}: {name} to be {number}")
        assert self.count(concern, name) == number

    def call(self, kind: Any, name: str, request: Any) -> Any:
        """Call a service and return its answer."""
        client = self.node.create_client(kind, name)
        self.wait(client.service_is_ready, f"the service {name}")
        future = client.call_async(request)
        self.wait(future.done, f"the answer of {name}")
        self.node.destroy_client(client)
        return future.result()


@dataclass
class TestHead(Listener):
    """Publish sets from a test's node and listen to what becomes of them."""

    __test__ = False
    stamp: int = FIRST_STAMP_NS

    def __post_init__(self) -> None:
        super().__post_init__()
        kinds = {"left/image_raw": Image, "right/image_raw": Image, "projector/state": JointState}
        kinds |= {f"{device}/camera_info": CameraInfo for device in ("left", "right", "projector")}
        self._publishers = {topic: self.node.create_publisher(kind, topic, QUEUE) for topic, kind in kinds.items()}

    def wait_for_subscribers(self) -> None:
        """Wait until a reconstruction listens to every topic, and its results are connected.

        Discovery is not symmetrical: sets without light are sent until one has arrived.
        """
        self.wait(lambda: all(one.get_subscription_count() for one in self._publishers.values()), "a subscriber")
        self.wait_for_publishers()
        dark = np.zeros((480, 640), dtype=np.uint8)
        exposure = Exposure(dark, dark, ProjectorState(16.0, 0.0, laser_on=False), paper_rig())

        def arrived() -> bool:
            self.publish(self.messages(exposure))
            return self.count("reconstruction", "refused: laser off") > 0

        self.wait(arrived, "a first set to arrive")
        matched = -1
        while matched != self.count("input", "matched"):
            matched, reports = self.count("input", "matched"), self.reports
            self.wait(lambda seen=reports: self.reports >= seen + 3, "the last of them")  # type: ignore[misc]

    def send_infos(self, infos: dict[str, CameraInfo]) -> None:
        """Publish camera infos as they are."""
        for device, info in infos.items():
            self._publishers[f"{device}/camera_info"].publish(info)

    def messages(self, exposure: Exposure) -> dict[str, Any]:
        """The three messages of a set under the next stamp."""
        self.stamp += NANOSECONDS // 10
        header = Header(stamp=time_of(self.stamp), frame_id="head_left_optical_frame")
        encoding = "mono8" if exposure.left.dtype == np.uint8 else "mono16"
        return {
            "left/image_raw": image_message(header, exposure.left, encoding),
            "right/image_raw": image_message(header, exposure.right, encoding),
            "projector/state": state_message(header, exposure.state),
        }

    def publish(self, messages: dict[str, Any]) -> None:
        """Publish messages by topic."""
        for topic, message in messages.items():
            self._publishers[topic].publish(message)

    def send(self, exposure: Exposure, without: str = "") -> int:
        """Publish camera infos and a set, perhaps ``without`` one of its topics; return its stamp."""
        self.send_infos(camera_infos(exposure.rig, Header(stamp=time_of(self.stamp)), PROJECTOR_SIZE))
        messages = self.messages(exposure)
        self.publish({topic: message for topic, message in messages.items() if topic != without})
        return self.stamp
