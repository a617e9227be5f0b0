"""The virtual head against analytic, ray-traced truth."""

from __future__ import annotations

import hashlib
import math
import subprocess
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from sim_rigs import QUARTER_PROJECTOR, quarter_pattern, quarter_rig

from moire_sensor.errors import SettingsError
from moire_sensor.paper_rig import CX_PX, CY_PX, FX_PX, FY_PX, PERIOD_PX, paper_pattern, paper_rig
from moire_sensor.pattern import FringePattern
from moire_sensor.rig import StereoRig
from moire_sim import (
    HeadCapture,
    HeadOptions,
    Light,
    SceneError,
    VirtualHead,
    ideal_pictures,
    indoor_names,
    scene_names,
)
from moire_sim.analytic_scenes import SCENES, analytic_capture
from moire_sim.analytic_surfaces import Box, Cylinder, Relief, Surface
from moire_sim.capture import Grey
from moire_sim.exposure import noise_generator, normal_quantiles, quick_noise
from moire_sim.scenes import scene_bodies
from moire_sim.score import near_edges

ROOT = Path(__file__).parents[1]
CLEAN = HeadOptions(noise=0.0, bits=16)
# The same scenes, rendered and ray-traced.
TWINS: dict[str, tuple[Surface, ...]] = {
    "flat_board:distance_m=0.6": (Relief(0.6),),
    "flat_board:slope=0.5": (Relief(1.0, slope_x=0.5),),
    "flat_board:slope=-1.2,distance_m=1.1": (Relief(1.1, slope_x=-1.2),),
    "convex_cylinder": (Relief(1.5), Cylinder(0.047, 1.3, 0.2, -1.0, 1.0)),
    "board_before_plane": (Relief(1.5), Box((0.03, 0.0, 1.005), (0.24, 0.18, 0.01))),
    "free_form": (Relief(1.1, waves=((0.04, 0.30, np.inf), (0.016, np.inf, 0.45))),),
}
SMOOTH = [name for name in TWINS if name not in ("convex_cylinder", "board_before_plane")]
# Chords of the meshes: 8 mm^2 of grid steps times curvature, with a margin of two.
MESH_ERROR_M = {"free_form": 6e-5, "convex_cylinder": 1e-5}


@cache
def twins(scene: str) -> tuple[HeadCapture, HeadCapture]:
    """One scene rendered and ray-traced, four steps, without noise."""
    pattern = paper_pattern(4)
    with pytest.MonkeyPatch.context() as patch, VirtualHead(scene, options=CLEAN) as head:
        patch.setitem(SCENES, scene, TWINS[scene])
        return head.capture(pattern), analytic_capture(scene, pattern, noise=0.0, bits=16, blur_px=0.55)


def phase_and_modulation(images: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    i = images.astype(np.float64) / 257.0
    return np.arctan2(i[3] - i[1], i[0] - i[2]), np.hypot(i[3] - i[1], i[0] - i[2]) / 2.0


@pytest.mark.parametrize("scene", TWINS)
def test_depth_light_and_visibility_are_exact(scene: str) -> None:
    rendered, traced = twins(scene)
    # 24 bit depth buffers resolve 2e-6 m here.
    np.testing.assert_allclose(rendered.depth_m, traced.depth_m, atol=MESH_ERROR_M.get(scene, 5e-6), rtol=0)
    # A shadow edge may fall on the other side of a pixel's centre; never a whole pixel away.
    assert np.count_nonzero(rendered.lit != traced.lit) < 480
    assert np.count_nonzero(rendered.covisible != traced.covisible) < 480


@pytest.mark.parametrize("scene", SMOOTH)
def test_fringe_phase_is_exact_in_both_views(scene: str) -> None:
    rendered, traced = twins(scene)
    for side in ("left", "right"):
        phase, modulation = phase_and_modulation(getattr(rendered, side))
        true_phase, true_modulation = phase_and_modulation(getattr(traced, side))
        off_px = np.angle(np.exp(1j * (phase - true_phase))) * PERIOD_PX / (2.0 * np.pi)
        assert np.abs(off_px).max() < 0.02  # issue 7, validation
        # Lambert's cosine on the mesh's facets.
        np.testing.assert_allclose(modulation, true_modulation, atol=1.0)


@pytest.mark.parametrize("scene", ["convex_cylinder", "board_before_plane"])
def test_fringe_phase_is_exact_up_to_the_blur_of_an_edge(scene: str) -> None:
    rendered, traced = twins(scene)
    clear = traced.lit & ~near_edges(traced, band_px=4.0)
    off_rad = phase_and_modulation(rendered.left)[0] - phase_and_modulation(traced.left)[0]
    off_px = np.angle(np.exp(1j * off_rad)) * PERIOD_PX / (2.0 * np.pi)
    assert clear.mean() > 0.85
    assert np.abs(off_px[clear]).max() < 0.02  # issue 7, validation


def test_a_shadow_is_dark_to_its_edge_and_only_there() -> None:
    rendered, traced = twins("board_before_plane")
    for capture in (rendered, traced):
        _, modulation = phase_and_modulation(capture.left)
        middle = modulation[222]
        plate = np.flatnonzero(capture.depth_m[222] < 1.2)
        dark = np.flatnonzero(middle < 5.0)
        assert np.all(np.diff(dark) == 1)
        assert not capture.lit[222, dark[2:-2]].any()
        assert middle[: dark[0] - 2].min() > 50.0
        assert dark[-1] < plate[0]
        assert middle[plate[3:-3]].min() > 50.0
        # Where the plate ends the blur mixes fringes of two depths.
        assert middle[plate[-1] + 4 :].min() > 50.0


def rotated_rig() -> StereoRig:
    """Projector to the left of the pair, turned in, with another focal length."""
    angle = 0.15
    turn = np.array([[np.cos(angle), 0.02, -np.sin(angle)], [0.0, 1.0, 0.0], [np.sin(angle), 0.0, np.cos(angle)]])
    u, _, vt = np.linalg.svd(turn)
    rotation = u @ vt
    intrinsic = np.array([[1000.0, 0.0, 480.0], [0.0, 1010.0, 260.0], [0.0, 0.0, 1.0]])
    projector = intrinsic @ np.hstack([rotation, -rotation @ [[-0.12], [0.02], [0.01]]])
    paper = paper_rig()
    return StereoRig.from_projections(paper.P_left, paper.P_right, projector, paper.image_size)


def test_any_rig_can_be_simulated(monkeypatch: pytest.MonkeyPatch) -> None:
    rig, size, pattern = rotated_rig(), (900, 500), paper_pattern(4)
    monkeypatch.setitem(SCENES, "twin", TWINS["board_before_plane"])
    with VirtualHead("board_before_plane", rig=rig, options=HeadOptions(noise=0, bits=16, projector_size=size)) as head:
        rendered = head.capture(pattern)
    traced = analytic_capture("twin", pattern, noise=0, bits=16, rig=rig, projector_size=size)
    assert 0.03 < np.mean(~traced.lit) < 0.5
    assert np.count_nonzero(rendered.lit != traced.lit) < 480
    assert np.count_nonzero(rendered.covisible != traced.covisible) < 480
    phase, true_phase = (phase_and_modulation(capture.right)[0] for capture in (rendered, traced))
    # Rows of the plane alone: the plate's shadow starts at row 99.
    off = np.abs(np.angle(np.exp(1j * (phase - true_phase))))[3:95, 3:-3]
    assert off.max() * PERIOD_PX / (2.0 * np.pi) < 0.02


def test_turning_the_head_turns_the_depth() -> None:
    pan, tilt = 0.1, -0.07
    with VirtualHead("flat_board", options=CLEAN) as head:
        at_rest = np.linalg.inv(head.frames["head_left_optical_frame"])
        before = head.depth_m
        head.set_head(pan, tilt)
        rest_from_left = at_rest @ head.frames["head_left_optical_frame"]
        depth = head.depth_m
        head.set_head(0.0, 0.0)
        np.testing.assert_array_equal(head.depth_m, before)
    columns, rows = np.meshgrid(np.arange(640), np.arange(480))
    rays = np.stack([(columns - CX_PX) / FX_PX, (rows - CY_PX) / FY_PX, np.ones_like(columns)], axis=-1)
    truth = (1.0 - rest_from_left[2, 3]) / (rays @ rest_from_left[2, :3])
    np.testing.assert_allclose(depth, truth, atol=5e-6, rtol=0)
    # The optical axis after panning left and tilting up; the simulator's forward kinematics is good to 1e-8.
    assert rest_from_left[0, 2] == pytest.approx(-np.sin(pan) * np.cos(tilt), abs=1e-7)
    assert rest_from_left[1, 2] == pytest.approx(np.sin(tilt), abs=1e-7)


def test_frames_of_the_urdf_are_the_papers_rig() -> None:
    with VirtualHead("flat_board") as head:
        frames, urdf = head.frames, head._renderer.frames()
    for name, x_m in (("left", 0.0), ("projector", 0.053), ("right", 0.094)):
        left_from = np.linalg.inv(frames["head_left_optical_frame"])
        expected = np.eye(4)
        expected[0, 3] = x_m
        for poses in (frames, urdf):
            np.testing.assert_allclose(left_from @ poses[f"head_{name}_optical_frame"], expected, atol=1e-9)
    forward = frames["head_left_optical_frame"][:3, 2]
    np.testing.assert_allclose(forward, [1.0, 0.0, 0.0], atol=1e-9)


def test_geometry_is_rendered_once_while_nothing_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    with VirtualHead("flat_board") as head:
        renders: list[object] = []
        render = head._renderer.render
        monkeypatch.setattr(head._renderer, "render", lambda *view: (renders.append(view), render(*view))[1])
        for index in range(3):
            head.expose(paper_pattern(4), index, index)
        head.ambient()
        head.set_head(0.0, 0.0)
        head.capture(paper_pattern())
        assert len(renders) == 3
        head.set_head(0.05, 0.0)
        head.expose(paper_pattern())
        assert len(renders) == 6


def test_the_same_seed_gives_the_same_images_in_another_process() -> None:
    code = (
        "import hashlib; from moire_sim import VirtualHead; from moire_sensor.paper_rig import paper_pattern\n"
        "with VirtualHead('cylinder_and_box', seed=5) as head:\n"
        "    c = head.capture(paper_pattern(3))\n"
        "print(hashlib.sha256(c.left.tobytes() + c.right.tobytes() + c.depth_m.tobytes()).hexdigest())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    with VirtualHead("cylinder_and_box", seed=5) as head:
        capture = head.capture(paper_pattern(3))
        again = head.capture(paper_pattern(3), exposure_index=0)
        later = head.capture(paper_pattern(3))
    digest = hashlib.sha256(capture.left.tobytes() + capture.right.tobytes() + capture.depth_m.tobytes()).hexdigest()
    assert digest in done.stdout
    np.testing.assert_array_equal(capture.left, again.left)
    assert np.any(capture.left != later.left)


def test_exposures_of_the_stream_are_those_of_the_capture() -> None:
    pattern = paper_pattern(3)
    with VirtualHead("flat_board", seed=1) as head:
        capture = head.capture(pattern, exposure_index=7)
        left, right = head.expose(pattern, 2, 9)
    np.testing.assert_array_equal(capture.left[2], left)
    np.testing.assert_array_equal(capture.right[2], right)


def test_an_exposure_made_ahead_is_the_one_that_would_be_made(monkeypatch: pytest.MonkeyPatch) -> None:
    pattern = paper_pattern(3)
    with VirtualHead("flat_board", seed=1) as head:
        plain = {index: head.expose(pattern, index, index) for index in range(3)}
        head.ambient()
        made: list[tuple[int, ...]] = []
        monkeypatch.setattr(
            ideal_pictures, "noise_generator", lambda *key: (made.append(key), noise_generator(*key))[1]
        )

        def check(expected: tuple[Grey, Grey], index: int, makes: int) -> None:
            made.clear()
            np.testing.assert_array_equal(head.expose(pattern, index, index), expected)
            assert len(made) == makes

        head.prepare(pattern, 1, 1)
        check(plain[1], 1, 0)
        # Each is used once, and only as what was asked for: not as another one, nor after the head has turned.
        check(plain[1], 1, 2)
        head.prepare(pattern, 1, 1)
        check(plain[2], 2, 2)
        check(plain[1], 1, 2)
        head.prepare(None, 0, 1)
        check(plain[1], 1, 2)
        head.prepare(pattern, 1, 1)
        head.set_head(0.02, 0.0)
        made.clear()
        turned = head.expose(pattern, 1, 1)
        assert len(made) == 2
        assert np.any(turned[0] != plain[1][0])
        # What is not known without noise would have to be worked out first, perhaps for nothing.
        made.clear()
        head.prepare(pattern, 2, 2)
        assert not made


def test_without_the_laser_there_are_no_fringes() -> None:
    with VirtualHead("flat_board", options=HeadOptions(noise=0.0)) as head:
        left, right = head.ambient()
    assert np.all(left == 20)
    assert np.all(right == 20)


def test_grey_levels_follow_the_options() -> None:
    light = Light(ambient=10.0, offset=50.0, amplitude=30.0, blur_px=0.0)
    square = FringePattern(period_px=16.0, waveform="square")
    with VirtualHead("flat_board", options=HeadOptions(light=light, noise=0.0)) as head:
        capture = head.capture(square)
    # Lambert's cosine at the image border, 13 degrees off, is 0.97.
    middle = capture.left[222, 300:400]
    assert middle.max() == 90
    assert middle.min() == 30


@pytest.mark.parametrize("scene", scene_names())
def test_every_scene_is_a_fair_task(scene: str) -> None:
    """Table scenes lie within the default depth range; indoor ones go on to 6 m, and many rays meet nothing."""
    indoor = scene in indoor_names()
    options = HeadOptions(projector_size=QUARTER_PROJECTOR)
    with VirtualHead(scene, rig=quarter_rig(), options=options) as head:
        capture = head.capture(quarter_pattern())
    assert capture.left.dtype == np.uint8
    assert indoor or np.isfinite(capture.depth_m).all()
    assert np.nanmin(capture.depth_m) > 0.55
    assert np.nanmax(capture.depth_m) < (6.0 if indoor else 1.9)
    assert capture.covisible.mean() > (0.05 if indoor else 0.7)
    assert not np.any(capture.covisible & ~capture.lit)
    assert max(capture.left.max(), capture.right.max()) < 250


def test_noise_is_normal_and_of_every_pixel_camera_and_exposure_its_own() -> None:
    """Moments within five standard errors of the normal distribution's; one table serves, whatever is drawn from it."""
    assert np.array_equal(normal_quantiles(), -normal_quantiles()[::-1])
    shape = (480, 640)
    draws = [quick_noise(normal_quantiles(), shape, noise_generator(*key)) for key in ((0, 1, 0), (0, 1, 1), (0, 2, 0))]
    error = 5.0 / math.sqrt(math.prod(shape))
    for noise in draws:
        # Standard errors of the moments of n normal numbers: sqrt of 1, 2, 15 and 96 over n.
        for power, expected, spread in ((1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0)):
            assert abs((noise.astype(float) ** power).mean() - expected) < error * math.sqrt(spread)
        for other in (np.roll(noise, 1, 0), np.roll(noise, 1, 1), *(one for one in draws if one is not noise)):
            assert abs((noise * other).mean()) < error


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        ("sofa", r"unknown scene 'sofa'; choose one of board_before_plane, .*room"),
        ("", r"unknown scene ''"),
        ("flat_board:colour=1", r"no option 'colour'; it takes distance_m=0.3..3, slope"),
        ("flat_board:distance_m=far", r"distance_m='far'; it takes distance_m=0.3..3"),
        ("flat_board:distance_m=9", r"distance_m='9'; it takes"),
        ("flat_board:distance_m=nan", r"distance_m='nan'; it takes"),
        ("room:distance_m=1", r"no option 'distance_m'; it takes no options"),
    ],
)
def test_a_wrong_scene_is_one_clear_line(scene: str, words: str) -> None:
    with pytest.raises(SceneError, match=words) as caught:
        VirtualHead(scene)
    assert "\n" not in str(caught.value)


def test_wrong_settings_are_refused() -> None:
    with pytest.raises(SettingsError, match="noise is -1"):
        HeadOptions(noise=-1.0)
    with pytest.raises(SettingsError, match="bits is 10; it must be 8, 12 or 16"):
        HeadOptions(bits=10)
    with pytest.raises(SettingsError, match="amplitude is 90"):
        Light(amplitude=90.0)
    with pytest.raises(SettingsError, match="seed is -1"):
        VirtualHead(seed=-1)
    with VirtualHead() as head, pytest.raises(SettingsError, match=r"head_tilt_joint was given 2.0 rad.*-0.6 to 0.9"):
        head.set_head(0.0, 2.0)


def test_without_pybullet_the_error_says_what_to_install() -> None:
    code = (
        "import sys; sys.modules['pybullet'] = None\n"
        "from moire_sim import SimulatorError, VirtualHead\n"
        "try:\n    VirtualHead()\nexcept SimulatorError as error:\n    print(error)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert "needs pybullet" in done.stdout


def test_meshes_turn_outwards() -> None:
    for scene in ("cylinder_and_box", "room"):
        for body in scene_bodies(scene):
            a, b, c = (body.vertices_m[body.triangles[:, i]] - body.vertices_m.mean(axis=0) for i in range(3))
            volume = np.sum(np.cross(a, b) * c) / 6.0
            if np.ptp(body.vertices_m[:, 2]) > 0.0:
                assert volume > 0.0
