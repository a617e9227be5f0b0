"""Raw images of turned cameras with lenses over DDS: rectified by the node or beforehand, the depth is the truth's."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from raw_cameras import PERIOD_PX, in_view, infos, raw_image, rectified, true_points_m
from ros_head import NANOSECONDS, TestHead, pixels, running, time_of
from ros_process import ros_node
from sensor_msgs.msg import Image
from std_msgs.msg import Header

from moire_sensor.ros.image_messages import image_message
from moire_sensor.ros.projector_state import ProjectorState, state_message

DEPTH = "depth/image_rect"
SENSOR = ("reliable_input:=true", "diagnostics_period_s:=0.1")
STEPS = 4
# Noise floor of the rig (amplitude 70, noise 1.5, 1 m): 0.09 mm from some rows, 0.33 mm from one pixel in four steps.
# Twice that: rectification interpolates, the plane is slanted and reaches to 1.1 m.
MEDIAN_MM = {"dense": 0.18, "phase_shift": 0.66}
LEAST_COMPLETE = 0.98
# One fringe: a window that reaches over the border of a raw image sees black there.
MARGIN_PX = PERIOD_PX


@contextmanager
def reconstruction(*parameters: str) -> Iterator[TestHead]:
    with ros_node("cameras") as node, running("reconstruction", *SENSOR, *parameters):
        cameras = TestHead(node)
        cameras.listen(DEPTH, Image)
        cameras.wait_for_subscribers()
        cameras.send_infos(infos())
        yield cameras


def send(cameras: TestHead, step: int, steps: int, beforehand: bool, rng: np.random.Generator) -> int:
    """One exposure, as two drivers and a projector triggered together send it; return its stamp."""
    cameras.stamp += NANOSECONDS // 10
    phase_rad = 2.0 * math.pi * step / steps
    images = {camera: raw_image(camera, phase_rad, rng) for camera in ("left", "right")}
    if beforehand:
        images = {camera: rectified(camera, image) for camera, image in images.items()}
    stamp = time_of(cameras.stamp)
    state = ProjectorState(PERIOD_PX, phase_rad, step_index=step, step_count=steps)
    messages: dict[str, Any] = {
        f"{camera}/image_raw": image_message(Header(stamp=stamp, frame_id=f"{camera}_eye"), image, "mono8")
        for camera, image in images.items()
    }
    cameras.publish(messages | {"projector/state": state_message(Header(stamp=stamp, frame_id="projector"), state)})
    return cameras.stamp


def check(message: Image, method: str) -> None:
    """Against the plane, where both cameras see it and the projector lights it."""
    assert message.header.frame_id == "left_eye"
    error_mm = np.abs(pixels(message).astype(float) - true_points_m()[..., 2])[in_view(MARGIN_PX)] * 1e3
    assert np.isfinite(error_mm).mean() >= LEAST_COMPLETE
    assert np.nanmedian(error_mm) <= MEDIAN_MM[method]


@pytest.mark.parametrize("beforehand", [False, True], ids=["rectified by the node", "rectified beforehand"])
def test_one_exposure_of_turned_cameras_with_lenses_gives_true_depth(beforehand: bool) -> None:
    rng = np.random.default_rng(5)
    with reconstruction(f"input_rectified:={str(beforehand).lower()}") as cameras:
        check(cameras.answer(DEPTH, send(cameras, 0, 1, beforehand, rng)), "dense")


def test_steps_are_told_by_their_index_not_by_their_order() -> None:
    """A projector that is triggered through its steps: the state names the step, wherever the first one came in."""
    rng = np.random.default_rng(6)
    with reconstruction("method:=phase_shift") as cameras:
        stamps = [send(cameras, number % STEPS, STEPS, False, rng) for number in range(2, 2 + STEPS + 1)]
        check(cameras.answer(DEPTH, stamps[len(stamps) // 2]), "phase_shift")
