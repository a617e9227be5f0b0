"""A bag of the head's topics is complete: played into a fresh reconstruction node it gives the same depth."""

from __future__ import annotations

from pathlib import Path

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from ros_process import ros_node, spin_until, start, stop
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from moire_sensor.ros.bag_message import BagMessage, header_stamp_ns
from moire_sensor.ros.bag_player import BagPlayer
from moire_sensor.ros.bag_reader import read_messages
from moire_sensor.ros.bag_topics import HEAD_TOPICS
from tools.demo.record import Run, record

DEPTH = "/head/depth/image_rect"
HEAD_NAMES = [f"/head/{topic.name}" for topic in HEAD_TOPICS]
# The queue holds every set, so that a slow machine supersedes none.
RECONSTRUCTION = ("queue_depth:=1000",)


def record_run(folder: Path, method: str, steps: int, exposures: int, results: int) -> Path:
    """Record head and reconstruction, two processes, as the demo does; return the bag."""
    parameters = ("scene:=cylinder_and_box", f"phase_steps:={steps}", "rate_hz:=10.0", f"frames:={exposures}")
    with ros_node("recorder") as node:
        recording = record(Run("replay", "virtual_head", parameters, method, exposures, RECONSTRUCTION), node, folder)
    assert recording.counts["reconstructed"] == results
    return recording.bag


def replay(folder: Path, method: str, exposures: int, results: int) -> list[bytes]:
    """Play the head's topics of a bag into a new process, set by set; return its depth images."""
    depths: list[bytes] = []
    done: list[Header] = []
    ready: list[DiagnosticArray] = []
    with ros_node("player") as node:
        player = BagPlayer(node, folder, HEAD_NAMES)
        node.create_subscription(Image, "depth/image_rect", depths.append, 10, raw=True)
        node.create_subscription(Header, "acquisition_done", done.append, 10)
        # Created last: once something comes through it, the reconstruction knows the other subscriptions too.
        node.create_subscription(DiagnosticArray, "/diagnostics", ready.append, 10)
        reconstruction = start("reconstruction", f"method:={method}", "reliable_input:=true", *RECONSTRUCTION)
        try:
            spin_until(node, lambda: bool(ready) and all_listen(player), "the reconstruction node")
            for number, messages in enumerate(sets_of(player), start=1):
                for message in messages:
                    player.publish(message)
                # The first frames of a phase-shift programme give no result yet; their few sets fit the queues.
                taken = number - (exposures - results)
                spin_until(node, lambda taken=taken: len(done) >= taken, f"set {number} to be taken")
            spin_until(node, lambda: len(depths) == results, f"{results} depth images")
        finally:
            code, output = stop(reconstruction)
    assert code == 0, output
    return depths


def sets_of(player: BagPlayer) -> list[list[BagMessage]]:
    """The messages by exposure, in the order they came; what has no stamp goes with the first."""
    exposures: dict[int, list[BagMessage]] = {}
    unstamped = []
    for message in player.messages():
        if message.topic.endswith("robot_description"):
            unstamped.append(message)
        else:
            exposures.setdefault(message.stamp_ns, []).append(message)
    sets = [exposures[stamp_ns] for stamp_ns in sorted(exposures)]
    return [unstamped + sets[0], *sets[1:]]


def all_listen(player: BagPlayer) -> bool:
    """Tell whether images, state and camera infos have a subscriber."""
    wanted = [name for name in player.publishers if name.endswith(("image_raw", "camera_info", "state"))]
    return all(player.publishers[name].get_subscription_count() for name in wanted)


def body(serialized: bytes) -> bytes:
    """An image message without its first four bytes, which tell the encoding."""
    return serialized[4:]


@pytest.mark.parametrize(
    ("method", "steps", "exposures", "results"), [("dense", 1, 4, 4), ("phase_shift", 4, 7, 3)]
)
def test_replayed_bag_gives_the_same_depth(
    tmp_path: Path, method: str, steps: int, exposures: int, results: int
) -> None:
    bag = record_run(tmp_path / "run", method, steps, exposures, results)
    recorded = [message for message in read_messages(bag) if message.topic == DEPTH]
    replayed = replay(bag, method, exposures, results)
    assert len(recorded) == results
    assert [header_stamp_ns(depth) for depth in replayed] == [message.stamp_ns for message in recorded]
    assert [body(depth) for depth in replayed] == [body(message.serialized) for message in recorded]
