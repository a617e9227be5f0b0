"""Heads that take turns: the time to the next turn, and two heads of two namespaces over DDS."""

from __future__ import annotations

import pytest
from ros_head import Listener, stamp_of
from ros_process import ros_node, start, stop
from sensor_msgs.msg import CameraInfo, Image

from moire_sim.turns import NANOSECONDS, seconds_to_turn


@pytest.mark.parametrize(
    ("now_s", "rate_hz", "share", "expected_s"),
    [(10.0, 10.0, 0.0, 0.1), (10.02, 10.0, 0.0, 0.08), (10.02, 10.0, 0.5, 0.03), (10.07, 10.0, 0.5, 0.08),
     (10.0, 0.5, 0.25, 0.5), (10.0, 1.0, 1.0, 1.0)],
)  # fmt: skip
def test_the_next_turn_lies_at_its_share_of_the_period(
    now_s: float, rate_hz: float, share: float, expected_s: float
) -> None:
    assert seconds_to_turn(round(now_s * NANOSECONDS), rate_hz, share) == pytest.approx(expected_s, abs=1e-9)


def test_two_heads_take_turns_and_name_their_own_frames() -> None:
    """At one exposure a second, what a busy machine adds to a stamp stays far below the half second between them."""
    with ros_node("listener") as node:
        listener = Listener(node)
        for name in ("a", "b"):
            listener.listen(f"/{name}/left/image_raw", Image)
            listener.listen(f"/{name}/right/camera_info", CameraInfo)
        heads = []
        for name, share in (("a", 0.0), ("b", 0.5)):
            parameters = ("rate_hz:=1.0", f"start_offset:={share}", f"frame_prefix:={name}/")
            heads.append(start("virtual_head", *parameters, namespace=f"/{name}"))
        try:
            listener.wait(lambda: all(len(kept) >= 2 for kept in listener.received.values()), "two exposures of each")
        finally:
            codes = [stop(head)[0] for head in heads]
    assert codes == [0, 0]
    for name, share in (("a", 0.0), ("b", 0.5)):
        images = listener.received[f"/{name}/left/image_raw"]
        for image in images:
            assert 0.0 <= (stamp_of(image) / NANOSECONDS - share) % 1.0 < 0.5
            assert image.header.frame_id == f"{name}/head_left_optical_frame"
        info = listener.received[f"/{name}/right/camera_info"][0]
        assert info.header.frame_id == f"{name}/head_right_optical_frame"
