"""Costmaps by Nav2's rules and our parameter files, from our messages over DDS, against the truth of three scenes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import yaml
from nav_costmap import Cell, Costmap, Observation, VoxelCostmap
from ros_head import Exposure, TestHead, running
from ros_process import ros_node
from sensor_msgs.msg import PointCloud2, PointField

from moire_sensor import StereoRig
from moire_sensor.nav_cloud import NavSettings
from moire_sensor.paper_rig import paper_pattern
from moire_sim import HeadOptions, VirtualHead

ROOT = Path(__file__).parents[1]
MARKS, FREE = "points_nav", "points_nav_clearing"
SENSOR = ("reliable_input:=true", "diagnostics_period_s:=0.1")
LAYERS: dict[str, tuple[type[Costmap], int]] = {"obstacle": (Costmap, 2), "voxel": (VoxelCostmap, 3)}
# Height of the camera over the floor as the scene has it, tilt downwards; the scene, the same after things have left.
SCENES = {
    "corridor": (0.35, 0.1, "corridor_with_boxes:boxes=1", "corridor_with_boxes:boxes=0"),
    "boxes": (0.35, 0.1, "corridor_with_boxes", "corridor_with_boxes:boxes=1"),
    "doorway": (0.5, 0.15, "doorway", "doorway:bin_m=0"),
    "table": (0.8, 0.35, "table_edge", "table_edge:distance_m=1.3"),
}
# points_nav tells the middle of what lies in a voxel, which is off by up to half of one: nothing is asked of cells
# that the truth only touches within that of their border, and a cell that close to the truth is no phantom.
MARGIN_M = NavSettings().nav_voxel_m / 2.0
# What counts as visible: fringes twice as strong as the weakest that the method uses, on a patch of 5 by 5 pixels.
LEAST_AMPLITUDE, LEAST_PIXELS = 12.0, 25
# Half of a window, pixels: what the right camera sees closer to its border is measured by the part of one, and the
# doorway's left reveal there, steep and half a fringe wide, is found in half of all exposures.
HALF_WINDOW_PX = 8
LEAST_FOUND = 0.99


@dataclass(frozen=True)
class View:
    """A scene as exposed, with the truth in the map's frame: x ahead, y left, z up from the floor, metres."""

    exposure: Exposure
    map_from_left: npt.NDArray[np.float64]
    truth_m: npt.NDArray[np.float64]
    visible: npt.NDArray[np.bool_]

    @property
    def origin_m(self) -> npt.NDArray[np.float64]:
        return self.map_from_left[:3, 3]

    def on_map(self, points_m: npt.NDArray[Any]) -> npt.NDArray[np.float64]:
        return np.asarray(points_m.astype(float) @ self.map_from_left[:3, :3].T + self.origin_m)


@cache
def view(scene: str, height_m: float, tilt_rad: float, pan_rad: float = 0.0) -> View:
    with VirtualHead(scene, seed=1) as head:
        at_rest = head.frames["head_left_optical_frame"]
        head.set_head(pan_rad, tilt_rad)
        capture = head.capture(paper_pattern())
        rest_from_left = np.linalg.inv(at_rest) @ head.frames["head_left_optical_frame"]
    with VirtualHead(scene, options=HeadOptions(noise=0.0, bits=16)) as head:
        head.set_head(pan_rad, tilt_rad)
        steps = head.capture(paper_pattern(4)).left.astype(float) * 255.0 / 65535.0
    amplitude = np.hypot(steps[0] - steps[2], steps[3] - steps[1]) / 2.0
    map_from_rest = np.array([[0, 0, 1, 0], [-1, 0, 0, 0], [0, -1, 0, height_m], [0, 0, 0, 1.0]])
    made = View(
        Exposure.of(capture),
        map_from_rest @ rest_from_left,
        np.empty(0),
        capture.covisible & (amplitude >= LEAST_AMPLITUDE) & seen_whole(capture.rig, capture.depth_m),
    )
    return View(made.exposure, made.map_from_left, made.on_map(capture.rig.points(capture.depth_m)), made.visible)


def seen_whole(rig: StereoRig, depth_m: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    """Left pixels (H, W) that the right camera does not see close to its left or right border."""
    column = np.arange(depth_m.shape[1]) - rig.disparity_px(depth_m)
    return (column >= HALF_WINDOW_PX) & (column <= depth_m.shape[1] - 1 - HALF_WINDOW_PX)


def costmap(layer: str) -> Costmap:
    """An empty map with the parameters of our file for a layer."""
    content = yaml.safe_load((ROOT / "config" / f"nav2_{layer}_layer.yaml").read_text())
    parameters = content["local_costmap"]["local_costmap"]["ros__parameters"]
    return LAYERS[layer][0](parameters, parameters[f"{layer}_layer"])


def true_points(seen: View, chart: Costmap, layer: str, mask: npt.NDArray[np.bool_]) -> npt.NDArray[np.float64]:
    """True points of some pixels that an ideal sensor's message would mark."""
    known = mask & np.isfinite(seen.truth_m).all(axis=-1)
    source = next(one for one in chart.sources().values() if one.marking)
    return chart.markable(Observation.of(source, seen.origin_m, seen.truth_m[known]), LAYERS[layer][1])


def wanted_cells(seen: View, chart: Costmap, layer: str) -> set[Cell]:
    """Cells in which enough of a visible surface lies off their borders."""
    points_m = true_points(seen, chart, layer, seen.visible)
    within_m = (points_m[:, :2] - chart.origin_m) % chart.resolution_m
    inside = ((within_m > MARGIN_M) & (within_m < chart.resolution_m - MARGIN_M)).all(axis=-1)
    return {cell for cell, pixels in Counter(chart.cells(points_m[inside])).items() if pixels >= LEAST_PIXELS}


def allowed_cells(seen: View, chart: Costmap, layer: str) -> set[Cell]:
    """Cells that any surface in view, visible to the sensor or not, touches or nearly touches."""
    points_m = true_points(seen, chart, layer, np.ones_like(seen.visible))
    shifts = [(x, y, 0.0) for x in (-MARGIN_M, 0.0, MARGIN_M) for y in (-MARGIN_M, 0.0, MARGIN_M)]
    return set().union(*(chart.touched(points_m + shift) for shift in shifts))


@pytest.fixture(scope="module")
def head() -> Iterator[TestHead]:
    """The reconstruction with our parameters for navigation."""
    values = yaml.safe_load((ROOT / "config" / "navigation.yaml").read_text())["/**/reconstruction"]["ros__parameters"]
    given = (f"{name}:={value}" for name, value in values.items())
    with ros_node("test_head") as node, running("reconstruction", *SENSOR, *given):
        head = TestHead(node)
        for topic in (MARKS, FREE):
            head.listen(topic, PointCloud2)
        head.wait_for_subscribers()
        yield head


@pytest.fixture(scope="module")
def clouds(head: TestHead) -> Any:
    """Both clouds of a view, in the map's frame, asked for once."""
    answers: dict[int, dict[str, npt.NDArray[np.float64]]] = {}

    def ask(seen: View) -> dict[str, npt.NDArray[np.float64]]:
        if id(seen) not in answers:
            stamp = head.send(seen.exposure)
            answers[id(seen)] = {
                f"/head/{topic}": seen.on_map(points_of(head.answer(topic, stamp))) for topic in (MARKS, FREE)
            }
        return answers[id(seen)]

    return ask


def points_of(message: PointCloud2) -> npt.NDArray[np.float32]:
    """Points as Nav2 reads them: float32 x y z, rows without padding, every one finite."""
    places = {one.name: (one.offset, one.datatype) for one in message.fields}
    assert [places[name] for name in "xyz"] == [(offset, PointField.FLOAT32) for offset in (0, 4, 8)]
    assert message.row_step == message.point_step * message.width
    assert message.header.frame_id == "head_left_optical_frame"
    points = np.frombuffer(message.data, np.float32).reshape(-1, message.point_step // 4)[:, :3]
    assert message.is_dense
    assert np.isfinite(points).all()
    return points


def look(chart: Costmap, seen: View, clouds: Any, only: str = "") -> None:
    """One update of the map, from all sources or from one ``only``."""
    received = clouds(seen)
    chart.update(
        [
            Observation.of(source, seen.origin_m, received[source.topic])
            for name, source in chart.sources().items()
            if only in ("", name)
        ]
    )


@pytest.mark.parametrize("layer", LAYERS)
@pytest.mark.parametrize("name", SCENES)
def test_obstacles_are_found_nothing_else_is_and_what_leaves_is_cleared(name: str, layer: str, clouds: Any) -> None:
    height_m, tilt_rad, *scenes = SCENES[name]
    chart = costmap(layer)
    before: set[Cell] = set()
    for scene in scenes:
        seen = view(scene, height_m, tilt_rad)
        look(chart, seen, clouds)
        wanted, allowed = wanted_cells(seen, chart, layer), allowed_cells(seen, chart, layer)
        assert len(wanted & chart.lethal) >= LEAST_FOUND * len(wanted), f"{scene}: missed {wanted - chart.lethal}"
        assert not chart.lethal - allowed, f"{scene}: phantoms"
        # The second time: marks that have nothing behind them any more are gone, all of them.
        left = before - allowed
        assert len(left) >= 5 or not before
        before = set(chart.lethal)


@pytest.mark.parametrize("layer", LAYERS)
def test_a_reveal_seen_at_a_grazing_angle_marks_nothing_beside_it(layer: str, clouds: Any) -> None:
    """The head turned so that the doorway's left reveal is a few columns wide, half of them doubted."""
    height_m, tilt_rad, present, _ = SCENES["doorway"]
    chart = costmap(layer)
    seen = view(present, height_m, tilt_rad, -0.12)
    look(chart, seen, clouds)
    assert chart.lethal
    assert not chart.lethal - allowed_cells(seen, chart, layer)


def test_free_rays_clear_where_the_background_is_out_of_range(clouds: Any) -> None:
    height_m, tilt_rad, present, gone = SCENES["corridor"]
    remaining = {}
    for only in ("", "head"):
        chart = costmap("voxel")
        for scene in (present, gone):
            look(chart, view(scene, height_m, tilt_rad), clouds, only)
        seen = view(gone, height_m, tilt_rad)
        remaining[only] = len(chart.lethal - allowed_cells(seen, chart, "voxel"))
    assert remaining[""] == 0
    assert remaining["head"] > 0
