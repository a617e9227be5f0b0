"""Scenes from files: bodies, options, meshes and robots, motion; a bad file is one clear line."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
from sim_rigs import QUARTER_PROJECTOR, quarter_rig
from source_scan import ROOT

from moire_sim import HeadOptions, Light, SceneError, VirtualHead, indoor_names, scene_names
from moire_sim.body_motion import Path as Way
from moire_sim.body_motion import Swing
from moire_sim.meshes import Body, board, box, to_obj
from moire_sim.scenes import load_scene, scene_bodies

WALL = "- board: {z_m: 1.5, half_size_m: [2.0, 1.5]}\n"
URDF = """<robot name="pillar"><link name="pillar"><inertial><origin xyz="0 0 0.4"/><mass value="1"/>
<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<visual><origin xyz="1.0 0.1 0"/><geometry><box size="0.2 0.3 2.0"/></geometry></visual></link></robot>"""
SDF = """<sdf version="1.6"><model name="pillar"><static>1</static><link name="pillar"><pose>1.0 0.1 0 0 0 0</pose>
<visual name="seen"><geometry><box><size>0.2 0.3 2.0</size></box></geometry></visual></link></model></sdf>"""


def written(folder: Path, text: str, name: str = "scene.yaml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def depth_before(scene: str, time_s: float = 0.0) -> np.ndarray:
    """Truth (120, 160) of a scene at a time."""
    with VirtualHead(scene, rig=quarter_rig(), options=HeadOptions(projector_size=QUARTER_PROJECTOR)) as head:
        head.set_time(time_s)
        return np.asarray(head.depth_m)


def test_a_scene_of_ones_own_is_what_its_file_says(tmp_path: Path) -> None:
    text = (
        "format: 1\nabout: a wall and a plate\noptions: {distance_m: {default: 1.0, low: 0.5, high: 1.4}}\nbodies:\n"
        + WALL
        + "- {box: {centre_m: [0, 0, distance_m + 0.01 / 2], size_m: [0.2, 0.2, 0.01]}, albedo: 0.5}\n"
        + "- {sphere: {centre_m: [0, 0, 0.7], radius_m: 0.1}, when: distance_m > 1.3}\n"
    )
    path = written(tmp_path, text)
    bodies = scene_bodies(f"{path}:distance_m=1.2")
    assert all(isinstance(body, Body) for body in bodies)
    assert [to_obj(body) for body in bodies if isinstance(body, Body)] == [
        to_obj(board(1.5, (2.0, 1.5), 0.9)),
        to_obj(box((0.0, 0.0, 1.205), (0.2, 0.2, 0.01), 0.5)),
    ]
    assert len(scene_bodies(f"{path}:distance_m=1.4")) == 3
    depth_m = depth_before(str(path))
    assert depth_m[55, 80] == pytest.approx(1.0, abs=1e-5)
    assert depth_m[5, 5] == pytest.approx(1.5, abs=1e-5)


@pytest.mark.parametrize(
    ("name", "text"), [("robot.urdf", URDF), ("world.sdf", SDF)], ids=["urdf", "sdf"]
)
def test_robots_and_worlds_stand_where_their_files_say(tmp_path: Path, name: str, text: str) -> None:
    """Files are x ahead, y left, z up: the pillar's front is 0.9 m ahead, 0.1 m to the left."""
    alone = depth_before(str(written(tmp_path, text, name)))
    seen = np.isfinite(alone)
    assert np.nanmin(alone) == pytest.approx(0.9, abs=1e-4)
    columns = np.flatnonzero(seen[60])
    # 0.05 m to the right of the left camera's axis less 0.15: columns cx - f (0.25 .. -0.05) / 0.9, quarter scale.
    assert columns[[0, -1]] == pytest.approx([max(80.9 - 312.5 * 0.25 / 0.9, 0.0), 80.9 + 312.5 * 0.05 / 0.9], abs=1.0)
    kind = name.rpartition(".")[2]
    scene = written(tmp_path, f"format: 1\nbodies:\n{WALL}- {kind}: {{file: {name}, position_m: [0.1, 0.0, 0.2]}}\n")
    moved = depth_before(str(scene))
    assert moved[60, 80] == pytest.approx(1.1, abs=1e-4)
    assert moved[60, 5] == pytest.approx(1.5, abs=1e-4)


def sdf(*models: str) -> str:
    return f'<sdf version="1.6">{"".join(models)}</sdf>'


def held(tag: str, pose: str, *within: str) -> str:
    return f'<{tag} name="{tag}"><pose>{pose}</pose>{"".join(within)}</{tag}>'


CUBE = "<geometry><box><size>0.2 0.2 0.2</size></box></geometry>"
ROUND = "<geometry><{0}><radius>0.1</radius><length>0.4</length></{0}></geometry>"
PLANE = "<geometry><plane><normal>0 0 1</normal><size>0.2 0.2</size></plane></geometry>"
AHEAD, LYING, HALF_TURN = "1.5 0.05 0 0 0 0", "0 0 0 0 1.5707963267948966 0", "0 0 3.141592653589793"
UPRIGHT = "1.5 0.05 0 0 -1.5707963267948966 0"


def one(model: str, link: str = "", visual: str = "", shape: str = CUBE) -> str:
    return held("model", model, held("link", link, held("visual", visual, shape)))


@pytest.mark.parametrize(
    ("model", "front_m", "widest_m"),
    [
        (one("1 0.05 0 0 0 0", "0.3 0 0 0 0 0", "0.2 0 0 0 0 0"), 1.4, 1.4),
        (one("", AHEAD), 1.4, 1.4),
        (held("world", "", one(AHEAD)), 1.4, 1.4),
        # Half a turn of the model takes what lies 0.3 m behind it to 0.3 m before it.
        (one(f"1.8 0.05 0 {HALF_TURN}", "0.3 0 0 0 0 0"), 1.4, 1.4),
        (held("model", "0.5 0.05 0 0 0 0", one("1 0 0 0 0 0")), 1.4, 1.4),
        (one(AHEAD, "", LYING, ROUND.format("cylinder")), 1.3, 1.3),
        (one(AHEAD, "", LYING, ROUND.format("capsule")), 1.2, 1.3),
        # Its face looks up, so back to the head where it is turned by a quarter about y.
        (one(UPRIGHT, shape=PLANE), 1.5, 1.5),
    ],
    ids=["each its own", "link", "world", "turned", "within", "cylinder", "capsule", "plane"],
)
def test_each_pose_of_an_sdf_file_counts(tmp_path: Path, model: str, front_m: float, widest_m: float) -> None:
    """Model, link and visual each add their pose; the middle always lies 0.05 m to the left of the head's zero."""
    depth_m = depth_before(str(written(tmp_path, sdf(model), "world.sdf")))
    assert np.nanmin(depth_m) == pytest.approx(front_m, abs=1e-4)
    columns, rows = (np.flatnonzero(np.isfinite(depth_m).any(axis=axis)) for axis in (0, 1))
    # What is 0.2 m across, seen from the front: 312.5 px focal length here.
    assert columns[[0, -1]] == pytest.approx(80.9 + 312.5 * np.array([-0.15, 0.05]) / widest_m, abs=1.0)
    assert rows[[0, -1]] == pytest.approx(55.4 + 313.7 * np.array([-0.1, 0.1]) / widest_m, abs=1.0)


@pytest.mark.parametrize(
    ("within", "words"),
    [
        ("<include><uri>model://tree</uri></include>", "has <include>, which is not read; put the models into"),
        ("<link name='l'><pose relative_to='other'>1 0 0 0 0 0</pose></link>", "link 'l' has a pose with relative_to"),
        ("<link name='l'><pose>1 0 0</pose></link>", "link 'l': <pose> is '1 0 0'; give 6 finite number"),
        ("<link name='l'><pose>1 0 0 0 0 nan</pose></link>", "<pose> is '1 0 0 0 0 nan'; give 6 finite"),
        ("<link name='l'><visual name='v'><geometry><road/></geometry></visual></link>", "geometry is 'road'; give"),
        ("<link name='l'><visual name='v'/></link>", "geometry is 'of several kinds, or none'; give one of box"),
        (
            "<link name='l'><visual name='v'><geometry><mesh><uri>model://a.dae</uri></mesh></geometry></visual></link>",
            "mesh 'model://a.dae' is not read; give .obj or .stl",
        ),
        (
            "<link name='l'><visual name='v'><geometry><sphere><radius>-1</radius></sphere></geometry></visual></link>",
            "<radius> is -1; it must be more than 0 m",
        ),
        ("<link name='l'/>", "has no model with a link with a visual; there is nothing to see"),
    ],
)  # fmt: skip
def test_an_sdf_file_that_is_not_understood_is_one_clear_line(tmp_path: Path, within: str, words: str) -> None:
    path = written(tmp_path, sdf(f"<model name='m'>{within}</model>"), "world.sdf")
    with pytest.raises(SceneError, match=words) as caught:
        load_scene(str(path))
    assert "\n" not in str(caught.value)


def test_an_sdf_body_moves_as_a_whole_and_keeps_its_colours(tmp_path: Path) -> None:
    dark = "<material><diffuse>0.4 0.4 0.4 1</diffuse></material>"
    link = held("link", "", held("visual", "0 0.3 0 0 0 0", CUBE), held("visual", "0 -0.3 0 0 0 0", CUBE, dark))
    written(tmp_path, sdf(held("model", "1.0 0 0 0 0 0", link)), "pair.sdf")
    move = "motion: {path: {times_s: [0, 1], shifts_m: [[0, 0, 0], [0, 0, 0.5]]}}"
    scene = load_scene(str(written(tmp_path, f"format: 1\nbodies:\n- {{sdf: {{file: pair.sdf}}, {move}}}\n")))
    assert [body.albedo for body in scene.bodies] == [0.9, 0.4]
    assert all(body.motion is not None and body.motion.pose(1.0)[2, 3] == 0.5 for body in scene.bodies)


def test_meshes_are_read_scaled_turned_and_placed(tmp_path: Path) -> None:
    """A cube of 2 units, x ahead, y left, z up, half as large, a quarter turn about z, its middle 1.2 m ahead."""
    cube = box((0.0, 0.0, 0.0), (2.0, 2.0, 4.0), 1.0)
    written(tmp_path, to_obj(cube), "cube.obj")
    mesh = "{file: cube.obj, scale: 0.1, position_m: [0, 0, 1.2], rpy_rad: [0, 1.5707963267948966, 0]}"
    depth_m = depth_before(str(written(tmp_path, f"format: 1\nbodies:\n{WALL}- mesh: {mesh}\n")))
    # The long axis, z of the file, now points ahead: its end is 0.2 m before the middle.
    assert depth_m[55, 80] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("bodies: [", "is no YAML near line"),
        ("format: 1\n", "has no list of bodies; give 1 to 1000"),
        ("- 1\n", "give fields, as name: value"),
        ("format: 2\nbodies: []\n", "has format 2; this program reads 1"),
        ("format: 1\nbodies: []\ncolour: red\n", "has the field 'colour'; the fields are about, bodies"),
        ("format: 1\nbodies:\n- {albedo: 1.0}\n", "body 1 is of 'albedo'; give it as one of box, cylinder, capsule"),
        ("format: 1\nbodies:\n- {box: {centre_m: [0, 0, 1]}}\n", "body 1, box: size_m is missing; given is 'centre_m'"),
        ("format: 1\nbodies:\n- {sphere: {centre_m: [0, 0, far], radius_m: 1}}\n", r"centre_m is 'far'; .*none here"),
        ("format: 1\nbodies:\n- {sphere: {centre_m: [0, 0, 1], radius_m: .nan}}\n", "radius_m is 'nan'; give a number"),
        ("format: 1\nbodies:\n- {sphere: {centre_m: [0, 0, 1], radius_m: 1}, albedo: 2}\n", "albedo is '2'; .* 0 to 1"),
        ("format: 1\nbodies:\n- {mesh: {file: none.obj}}\n", r"body 1, mesh: there is no file .*none\.obj"),
        ("format: 1\nbodies:\n- {mesh: {file: scene.yaml}}\n", "no mesh that can be read; give .obj or .stl"),
        (
            "format: 1\nbodies:\n- {box: {centre_m: [0, 0, 1], size_m: [1, 1, 1]}, motion: {path: {times_s: [1, 0],"
            " shifts_m: [[0, 0, 0], [0, 0, 0]]}}}\n",
            r"times_s is \[1.0, 0.0\]; give two or more times that rise",
        ),
        (
            "format: 1\nbodies:\n- {box: {centre_m: [0, 0, 1], size_m: [1, 1, 1]}, finish: {texture: plaid}}\n",
            "body 1, finish: texture is 'plaid'; choose one of none, checker, stripes, noise",
        ),
        ("format: 1\nbodies:\n- {box: {centre_m: [0, 0, 1], size_m: ['9**9**9', 1, 1]}}\n", r"size_m is '9\*\*9\*\*9'"),
        ("!!python/object/apply:os.getcwd []\n", "is no YAML near line 1"),
    ],
)
def test_a_bad_scene_file_is_one_clear_line(tmp_path: Path, text: str, words: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(SceneError, match=words) as caught:
        load_scene(str(path))
    assert "\n" not in str(caught.value)


def test_files_that_are_no_scenes_are_refused(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"cannot be read: No such file"):
        load_scene(str(tmp_path / "none.yaml"))
    with pytest.raises(SceneError, match="is no XML"):
        load_scene(str(written(tmp_path, "robot", "text.urdf")))
    with pytest.raises(SceneError, match="holds <page>; a URDF file holds <robot>"):
        load_scene(str(written(tmp_path, "<page/>", "page.sdf")))
    with pytest.raises(SceneError, match=r"body 1 of the scene cannot be loaded from .*empty\.urdf"):
        VirtualHead(str(written(tmp_path, "<robot name='empty'/>", "empty.urdf")))


def test_a_path_goes_straight_between_its_places_and_begins_again() -> None:
    way = Way((0.0, 1.0, 3.0), ((0, 0, 0), (1, 0, 0), (1, 0, 2)), (0.0, 0.0, 1.0), (1.0, 0.0, 0.0), repeat=True)
    np.testing.assert_allclose(way.pose(0.5)[:3, 3], [0.5, 0.0, 0.0])
    np.testing.assert_allclose(way.pose(3.5), way.pose(0.5), atol=1e-12)
    turned = way.pose(2.0)
    # Half a radian to the left about the pivot, which the shift takes along: the right side goes away.
    np.testing.assert_allclose(turned @ [1, 0, 0, 1], [2.0, 0.0, 1.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(turned @ [2, 0, 0, 1], [2.0 + math.cos(0.5), 0.0, 1.0 + math.sin(0.5), 1.0], atol=1e-12)


def test_a_swing_turns_about_its_axis_by_the_right_hand() -> None:
    swing = Swing((0.0, 1.0, 0.0), (0.0, 0.0, 2.0), math.pi / 2.0, 4.0)
    np.testing.assert_allclose(swing.pose(0.0), np.eye(4), atol=1e-15)
    np.testing.assert_allclose(swing.pose(1.0) @ [1, 1, 0, 1], [0.0, 2.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(swing.pose(3.0) @ [1, 1, 0, 1], [0.0, 0.0, 0.0, 1.0], atol=1e-12)


def test_a_person_crosses_and_the_truth_follows() -> None:
    """At 0.8 m/s, starting 0.8 m to the left, the person is at x = 0 and 0.08 m after 1 and 1.1 s."""
    options = HeadOptions(projector_size=QUARTER_PROJECTOR)
    with VirtualHead("person_crossing", rig=quarter_rig(), options=options) as head:
        assert head.moves
        assert not head.base_moves
        for time_s, x_m in ((1.0, 0.0), (1.1, 0.08), (1.0, 0.0)):
            head.set_time(time_s)
            near = np.flatnonzero(head.depth_m[60] < 1.35)
            # The round front turns away symmetrically; the capsule's tangents from the camera are 0.19 m apart.
            middle_m = (near.mean() - 80.9) * 1.15 / 312.5
            assert middle_m == pytest.approx(x_m, abs=0.02)
            assert np.nanmin(head.depth_m[60]) == pytest.approx(1.11, abs=0.02)


def test_a_head_that_drives_sees_the_end_of_the_corridor_come_nearer() -> None:
    options = HeadOptions(projector_size=QUARTER_PROJECTOR)
    with VirtualHead("corridor_drive", rig=quarter_rig(), options=options) as head:
        assert head.base_moves
        before = head.frames
        for time_s, way_m in ((0.0, 0.0), (2.0, 0.8), (4.0, 1.6)):
            head.set_time(time_s)
            assert head.depth_m[20, 81] == pytest.approx(3.3 - way_m, abs=1e-4)
            # head_base_link is x ahead.
            np.testing.assert_allclose(head.world_from_base[:3, 3], [way_m, 0.0, 0.0], atol=1e-6)
        for name, pose in head.frames.items():
            np.testing.assert_allclose(pose, before[name], atol=1e-6)


def test_a_still_scene_has_no_time() -> None:
    with VirtualHead("room", rig=quarter_rig(), options=HeadOptions(projector_size=QUARTER_PROJECTOR)) as head:
        before = head.depth_m
        head.set_time(3.0)
        assert head.depth_m is before
        assert not head.moves


def test_a_dozen_indoor_scenes_ship() -> None:
    assert len(indoor_names()) >= 12
    assert set(indoor_names()) < set(scene_names())
    papers = {"flat_board", "board_before_plane", "convex_cylinder", "free_form", "cylinder_and_box"}
    assert papers <= set(scene_names())


def test_the_examples_of_the_documentation_are_scenes(tmp_path: Path) -> None:
    written(tmp_path, to_obj(box((0.0, 0.0, 0.0), (80.0, 80.0, 100.0), 1.0)), "mug.obj")
    examples = re.findall(r"```yaml\n(.*?)```", (ROOT / "docs" / "scene_files.md").read_text(), flags=re.DOTALL)
    counts = [len(load_scene(str(written(tmp_path, text))).bodies) for text in examples]
    assert counts == [3, 1]
    assert load_scene(str(written(tmp_path, examples[1]))).moves


def test_a_finish_shows_without_real_optics(tmp_path: Path) -> None:
    """Checks of 5 cm at 1 m are 16 columns wide here, and as dark as their contrast says."""
    finish = "finish: {texture: checker, contrast: 0.5, cell_m: 0.05}"
    text = f"format: 1\nbodies:\n- {{board: {{z_m: 1.0, half_size_m: [1, 1]}}, albedo: 1.0, {finish}}}\n"
    options = HeadOptions(light=Light(blur_px=0.0), noise=0.0, projector_size=QUARTER_PROJECTOR)
    with VirtualHead(str(written(tmp_path, text)), rig=quarter_rig(), options=options) as head:
        left, _ = head.ambient()
    assert np.unique(left).tolist() == [10, 20]
    edges = np.flatnonzero(np.diff(left[60].astype(int)))
    np.testing.assert_allclose(np.diff(edges), 312.47 * 0.05, atol=1.0)
