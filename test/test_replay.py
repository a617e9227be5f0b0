"""A bag of the head's topics is complete: played into a fresh reconstruction node it gives the same depth."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import pytest
from bag_runs import DEPTH, HEAD_NAMES, RECONSTRUCTION
from diagnostic_msgs.msg import DiagnosticArray
from ros_process import ros_node, spin_until, start, stop
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from moire_sensor.ros.bag_message import BagMessage, header_stamp_ns
from moire_sensor.ros.bag_player import BagPlayer
from moire_sensor.ros.bag_reader import read_messages

LOOPS = 3


def replay(folder: Path, method: str, loops: int = 1) -> list[bytes]:
    """Play the head's topics of a bag into a new process, set by set; return its depth images."""
    depths: list[bytes] = []
    done: list[Header] = []
    ready: list[DiagnosticArray] = []
    gathering = 4 if method == "phase_shift" else 0
    with ros_node("player") as node:
        player = BagPlayer(node, folder, HEAD_NAMES)
        node.create_subscription(Image, "depth/image_rect", depths.append, 10, raw=True)
        node.create_subscription(Header, "acquisition_done", done.append, 10)
        # Created last: once something comes through it, the reconstruction knows the other subscriptions too.
        node.create_subscription(DiagnosticArray, "/diagnostics", ready.append, 10)
        reconstruction = start("reconstruction", f"method:={method}", "reliable_input:=true", *RECONSTRUCTION)
        try:
            spin_until(node, lambda: bool(ready) and all_listen(player), "the reconstruction node")
            taken = 0
            for _ in range(loops):
                for number, messages in enumerate(sets_of(player.messages()), start=1):
                    for message in messages:
                        player.publish(message)
                    # The first frames of a phase-shift programme give no result yet; their few sets fit the queues.
                    taken += number > gathering
                    spin_until(node, lambda taken=taken: len(done) >= taken, f"set {number} to be taken")
            spin_until(node, lambda: len(depths) == taken, f"{taken} depth images")
        finally:
            code, output = stop(reconstruction)
    assert code == 0, output
    return depths


def sets_of(messages: Iterable[BagMessage]) -> list[list[BagMessage]]:
    """The messages by exposure, in the order they came; what has no stamp goes with the first."""
    exposures: dict[int, list[BagMessage]] = {}
    unstamped = []
    for message in messages:
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
    """An image message's pixels alone: the bytes that fill gaps before them are not defined."""
    return serialized[-640 * 480 * 4 :]


@pytest.mark.parametrize("method", ["dense", "phase_shift"])
def test_every_loop_of_a_replayed_bag_gives_the_same_depth(request: pytest.FixtureRequest, method: str) -> None:
    bag: Path = request.getfixturevalue(f"{method}_bag")
    recorded = {one.stamp_ns: body(one.serialized) for one in read_messages(bag) if one.topic == DEPTH}
    replayed = replay(bag, method, LOOPS)
    assert [header_stamp_ns(depth) for depth in replayed] == sorted(recorded) * LOOPS
    assert all(body(depth) == recorded[header_stamp_ns(depth)] for depth in replayed)
    assert Counter(map(header_stamp_ns, replayed)) == dict.fromkeys(recorded, LOOPS)
