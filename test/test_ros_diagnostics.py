"""What `/diagnostics` says of every concern, over DDS: a head that is right, and what each fault looks like."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from ros_head import Exposure, TestHead, running
from ros_process import ros_node
from sensor_msgs.msg import Image

from moire_sensor.paper_rig import PERIOD_PX
from moire_sim.analytic_scenes import analytic_capture

DEPTH = "depth/image_rect"
CONCERNS = (
    "input", "reconstruction", "rates", "latency", "unknown pixels", "order ambiguity", "saturation", "darkness",
    "laser", "row misalignment", "period mismatch",
)  # fmt: skip


@cache
def capture(**options: Any) -> Any:
    return analytic_capture("plane_1000", **options)


@pytest.fixture(scope="module")
def head() -> Iterator[TestHead]:
    process = running(
        "reconstruction", "reliable_input:=true", "queue_depth:=50", "diagnostics_period_s:=0.1", "check_period_s:=0.1"
    )
    with process, ros_node("test_head") as node:
        under_test = TestHead(node)
        under_test.listen(DEPTH, Image)
        under_test.wait_for_subscribers()
        yield under_test


def wait_for(head: TestHead, concern: str, says: str, exposure: Exposure, said_so: bool = True) -> dict[str, str]:
    """Send exposures until a status says something, or no longer does; returns its values."""

    def said() -> bool:
        head.answer(DEPTH, head.send(exposure))
        return (says in head.facts.get(f"reconstruction: {concern}", {}).get("message", "")) == said_so

    head.wait(said, f"{concern!r} to say {says!r}")
    return head.facts[f"reconstruction: {concern}"]


def test_every_concern_has_a_status_of_its_own(head: TestHead) -> None:
    wait_for(head, "period mismatch", "+0.0", Exposure.of(capture()))
    own = {name.removeprefix("reconstruction: ") for name in head.facts if name.startswith("reconstruction: ")}
    assert own == set(CONCERNS)
    said = {concern: head.facts[f"reconstruction: {concern}"]["message"] for concern in CONCERNS}
    assert said["laser"] == "on"
    assert said["saturation"] == "0.0%"
    assert "not measured: too little texture" in said["row misalignment"]
    assert float(head.facts["reconstruction: unknown pixels"]["unknown share"]) == pytest.approx(0.18, abs=0.02)
    assert float(head.facts["reconstruction: latency"]["whole set to result p50 ms"]) > 0.0
    assert float(head.facts["reconstruction: rates"]["received left Hz"]) > 0.0


def shifted(rows: int) -> Exposure:
    exposure = Exposure.of(capture(texture=0.5))
    return replace(exposure, right=np.roll(exposure.right, rows, axis=0))


def faulty(kind: str) -> tuple[str, str, Exposure]:
    """Concern, what it says, and an exposure with that fault."""
    good = Exposure.of(capture())
    white = np.full_like(good.left, 255)
    even = np.full_like(good.left, 120)
    black = np.full_like(good.left, 3)
    return {
        "saturated": ("saturation", "are saturated: shorten the exposure", replace(good, left=white, right=white)),
        "dark": ("darkness", "100% of the pixels show no fringes", replace(good, left=black, right=black)),
        "no fringes": ("laser", "but a bright picture shows no fringes", replace(good, left=even, right=even)),
        "unknown": ("unknown pixels", "have no depth", replace(good, right=good.right[:, ::-1].copy())),
        "rows": ("row misalignment", "rows below the left one", shifted(2)),
        "period": ("period mismatch", "+10.0% longer", good.with_state(fringe_period_px=PERIOD_PX / 1.1)),
        "one percent": ("period mismatch", "do not fit each other", good.with_state(fringe_period_px=PERIOD_PX / 1.01)),
        "order": ("order ambiguity", "are of doubtful order", good.with_state(fringe_period_px=PERIOD_PX / 1.1)),
    }[kind]


@pytest.mark.parametrize(
    "kind", ["saturated", "dark", "no fringes", "unknown", "rows", "period", "one percent", "order"]
)
def test_each_fault_is_told_by_its_own_status_and_gone_afterwards(head: TestHead, kind: str) -> None:
    concern, says, exposure = faulty(kind)
    values = wait_for(head, concern, says, exposure)
    if kind == "rows":
        assert float(values["row offset px"]) == pytest.approx(2.0, abs=0.1)
    wait_for(head, concern, says, Exposure.of(capture()), said_so=False)


def test_the_laser_off_is_a_warning_of_its_own_and_no_error_of_the_sets(head: TestHead) -> None:
    def off() -> bool:
        head.send(Exposure.of(capture()).with_state(laser_on=False))
        return "projector/enable" in head.facts["reconstruction: laser"]["message"]

    head.wait(off, "the laser's status")
    assert head.facts["reconstruction: reconstruction"]["message"] == "working"
    wait_for(head, "laser", "on", Exposure.of(capture()))


@pytest.mark.parametrize(
    ("name", "value", "concern", "says"),
    [
        ("warn_rate_hz", 1000.0, "rates", "fewer than warn_rate_hz 1000"),
        ("warn_latency_s", 0.001, "latency", "above warn_latency_s 0.001"),
        ("warn_unknown_share", 0.1, "unknown pixels", "18% of the pixels have no depth"),
    ],
)
def test_thresholds_are_parameters_that_change_at_run_time(
    head: TestHead, name: str, value: float, concern: str, says: str
) -> None:
    before = head.facts[f"reconstruction: {concern}"].get(name)

    def put(number: float) -> bool:
        request = SetParameters.Request(parameters=[Parameter(name, value=number).to_parameter_msg()])
        return bool(head.call(SetParameters, "reconstruction/set_parameters", request).results[0].successful)

    assert put(value)
    wait_for(head, concern, says, Exposure.of(capture()))
    assert not put(-1.0)
    assert put(float(before or 0.5 if name != "warn_rate_hz" else 0.0))


@pytest.mark.parametrize("topic", ["left/image_raw", "right/image_raw", "projector/state"])
def test_a_silent_topic_is_named_at_once_and_then_back(head: TestHead, topic: str) -> None:
    name = head.node.resolve_topic_name(topic)

    def said(text: str, without: str) -> bool:
        head.send(Exposure.of(capture()), without=without)
        return text in head.facts["reconstruction: input"]["message"]

    head.wait(lambda: said(f"silent: {name}", topic), f"{name} to be called silent")
    assert head.facts["reconstruction: input"][f"silent {name}"] == "yes"
    head.wait(lambda: said("receiving", ""), f"{name} to be back")
    head.answer(DEPTH, head.send(Exposure.of(capture())))
