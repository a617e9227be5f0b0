"""A head that shows a still scene makes each exposure before its turn."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import pytest
import rclpy
from ros_process import spin_until

from moire_sim.virtual_head import VirtualHead
from moire_sim.virtual_head_node import VirtualHeadNode

STEPS = 3


def test_the_next_exposure_is_made_before_its_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[tuple[Any, ...]] = []

    def noted(name: str) -> Callable[..., Any]:
        real = getattr(VirtualHead, name)

        def call(head: VirtualHead, *what: Any) -> Any:
            calls.append((name, *what[:3]))
            return real(head, *what)

        return call

    for name in ("prepare", "expose"):
        monkeypatch.setattr(VirtualHead, name, noted(name))

    def used() -> list[int]:
        """Exposures that were made ahead and were then the next ones."""
        return [
            what[2]
            for (name, *what), (then, *asked) in pairwise(calls)
            if (name, then) == ("prepare", "expose") and what == asked
        ]

    rclpy.init(args=["--ros-args", "-p", "rate_hz:=10.0", "-p", f"phase_steps:={STEPS}"])
    node = VirtualHeadNode()
    try:
        spin_until(node, lambda: len(used()) > STEPS, "exposures made ahead")
        assert len({index % STEPS for index in used()}) == STEPS
        made = [call for call in calls if call[0] == "prepare"]
        assert len(made) == len({index for _, _, _, index in made})
    finally:
        node.close()
        node.destroy_node()
        rclpy.try_shutdown()
