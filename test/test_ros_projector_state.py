"""Projector state messages and the frames of a phase-shift programme, without a node."""

from __future__ import annotations

import math

import pytest
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from moire_sensor.errors import PatternError
from moire_sensor.paper_rig import paper_pattern, paper_rig
from moire_sensor.pattern import FringePattern
from moire_sensor.phase_steps import needed_frames
from moire_sensor.reconstructor import Reconstructor
from moire_sensor.ros.frame_ring import Frame, FrameRing, pattern_of
from moire_sensor.ros.projector_state import (
    REQUIRED,
    ProjectorState,
    projector_state,
    state_message,
    state_of_exposure,
)

HAND_STEPS = (0.0, -math.pi / 2, -math.pi, -3 * math.pi / 2)


def good_message(**changes: float) -> JointState:
    """A state with some values changed."""
    message = state_message(Header(), ProjectorState(16.0, 0.5, 1, 4))
    for name, value in changes.items():
        message.position[list(message.name).index(name)] = value
    return message


@pytest.mark.parametrize(
    "state",
    [
        ProjectorState(16.6652, 0.0),
        ProjectorState(44.9, -4.7, 3, 4, "square", False),
        ProjectorState(20.0, 1.0, 0, 1, "sine", True, (0.4, 0.56)),
    ],
)
def test_a_state_survives_its_message(state: ProjectorState) -> None:
    assert projector_state(state_message(Header(), state)) == state


def test_message_names_follow_the_contract() -> None:
    message = state_message(Header(frame_id="head_projector_optical_frame"), ProjectorState(16.0, 0.5, 1, 4, "square"))
    pairs = dict(zip(message.name, message.position, strict=True))
    assert pairs == {
        "format_version": 1.0,
        "fringe_period_px": 16.0,
        "fringe_phase_rad": 0.5,
        "step_index": 1.0,
        "step_count": 4.0,
        "waveform": 1.0,
        "laser_on": 1.0,
    }


def test_unknown_names_are_ignored_in_any_order() -> None:
    message = good_message()
    pairs = [("temperature_c", math.nan), *zip(message.name, message.position, strict=True)][::-1]
    mixed = JointState(name=[name for name, _ in pairs], position=[value for _, value in pairs])
    assert projector_state(mixed) == projector_state(message)


@pytest.mark.parametrize("name", REQUIRED)
def test_a_missing_name_is_an_error_that_names_it(name: str) -> None:
    message = good_message()
    kept = [index for index, known in enumerate(message.name) if known != name]
    less = JointState(name=[message.name[index] for index in kept], position=[message.position[i] for i in kept])
    with pytest.raises(PatternError, match=f"lacks {name}"):
        projector_state(less)


@pytest.mark.parametrize("name", REQUIRED)
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_value_that_is_not_finite_is_an_error_that_names_it(name: str, value: float) -> None:
    with pytest.raises(PatternError, match=f"{name} in projector/state is (nan|inf)"):
        projector_state(good_message(**{name: value}))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"format_version": 2.0}, "format_version 2; this node reads 1"),
        ({"step_index": 4.0}, "step_index in projector/state is 4; it must be a whole number from 0 to 3"),
        ({"step_index": 0.5}, "step_index in projector/state is 0.5"),
        ({"step_count": 0.0}, "step_count in projector/state is 0"),
        ({"step_count": 1e9}, "from 1 to 64"),
        ({"waveform": 2.0}, "waveform in projector/state is 2"),
        ({"laser_on": -1.0}, "laser_on in projector/state is -1"),
    ],
)
def test_a_value_outside_its_range_is_an_error(changes: dict[str, float], says: str) -> None:
    with pytest.raises(PatternError, match=says):
        projector_state(good_message(**changes))


def test_positions_of_another_number_and_names_given_twice_are_errors() -> None:
    message = good_message()
    with pytest.raises(PatternError, match="7 names and 6 positions"):
        projector_state(JointState(name=message.name, position=message.position[:-1]))
    with pytest.raises(PatternError, match="names laser_on more than once"):
        projector_state(JointState(name=[*message.name, "laser_on"], position=[*message.position, 0.0]))


def test_a_depth_range_upside_down_is_an_error() -> None:
    message = state_message(Header(), ProjectorState(16.0, 0.0, depth_range_m=(2.0, 0.5)))
    with pytest.raises(PatternError, match=r"2 to 0\.5 m"):
        projector_state(message)


def frames_of(pattern: FringePattern, count: int, period_ns: int = 100, first: int = 0) -> list[Frame[int]]:
    return [
        Frame(1000 + period_ns * n, state_of_exposure(pattern, n % pattern.step_count), n)
        for n in range(first, first + count)
    ]


def feed(ring: FrameRing[int], frames: list[Frame[int]]) -> list[list[int]]:
    got = [ring.add(frame) for frame in frames]
    return [[frame.item for frame in one] for one in got if one is not None]


@pytest.mark.parametrize("steps", [3, 4, 5, 8])
def test_each_new_frame_gives_a_result_once_enough_have_come(steps: int) -> None:
    sensor = Reconstructor(paper_rig(), paper_pattern(steps), method="phase_shift")
    needed = sensor.frames_needed
    assert needed == needed_frames(steps)
    assert needed % 2 == 1
    results = feed(FrameRing(), frames_of(paper_pattern(steps), 20))
    assert results == [list(range(n, n + needed)) for n in range(20 - needed + 1)]


def test_a_lost_frame_starts_anew() -> None:
    frames = frames_of(paper_pattern(4), 12)
    del frames[6]
    assert feed(FrameRing(), frames) == [[0, 1, 2, 3, 4], [1, 2, 3, 4, 5], [7, 8, 9, 10, 11]]


def test_a_lost_programme_starts_anew_though_the_step_fits() -> None:
    frames = frames_of(paper_pattern(4), 14)
    del frames[5:9]
    assert feed(FrameRing(), frames) == [[0, 1, 2, 3, 4], [9, 10, 11, 12, 13]]


def test_a_change_of_pattern_or_of_step_phases_starts_anew() -> None:
    first = frames_of(paper_pattern(4), 5)
    other = frames_of(FringePattern(20.0).with_equal_steps(4), 6, first=5)
    assert feed(FrameRing(), first + other) == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9], [6, 7, 8, 9, 10]]
    backwards = FringePattern(paper_pattern().period_px, 0.0, HAND_STEPS)
    mixed = frames_of(paper_pattern(4), 4) + frames_of(backwards, 6, first=4)
    # Frame 4 shows step 0, which both programmes share; frame 5 cannot belong to the first.
    assert feed(FrameRing(), mixed) == [[0, 1, 2, 3, 4], [5, 6, 7, 8, 9]]


def test_stamps_that_do_not_rise_start_anew() -> None:
    frames = frames_of(paper_pattern(4), 5)
    assert feed(FrameRing(), [*frames[:4], Frame(10, frames[4].state, 4)]) == []


@pytest.mark.parametrize("first", range(4))
def test_pattern_of_frames_is_the_programme_whatever_the_first_step(first: int) -> None:
    pattern = FringePattern(44.9, 0.3, HAND_STEPS)
    states = tuple(frame.state for frame in frames_of(pattern, 5, first=first))
    found, first_step = pattern_of(states)
    assert first_step == first
    assert (found.period_px, found.waveform) == (44.9, "sine")
    assert found.phase_rad == pytest.approx(0.3)
    assert found.step_phases_rad == pytest.approx(HAND_STEPS)


def test_pattern_of_one_frame_shows_what_the_exposure_showed() -> None:
    single = FringePattern(16.0, 0.7)
    assert pattern_of((state_of_exposure(single, 0),)) == (single, 0)
    stepped = FringePattern(16.0, 0.7, HAND_STEPS)
    found, first_step = pattern_of((state_of_exposure(stepped, 3),))
    assert found.phase_at(5.0, first_step) == pytest.approx(stepped.phase_at(5.0, 3))
