"""Analytic scenes: ray intersections against a slow search, pictures and masks against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from moire_sensor.paper_rig import CX_PX, FX_PX, PERIOD_PX, PROJECTOR_X_M, paper_pattern
from moire_sim.analytic_scenes import analytic_capture, analytic_scene_names
from moire_sim.analytic_surfaces import Box, Cylinder, Relief, Sphere, Surface
from moire_sim.errors import SceneError
from moire_sim.exposure import projected_signal

SOLIDS = {
    "relief": Relief(1.0, 0.3, -0.2, ((0.02, 0.15, np.inf), (0.01, 0.3, 0.2))),
    "box": Box((0.02, 0.01, 1.0), (0.20, 0.15, 0.10), 0.4),
    "cylinder": Cylinder(0.01, 1.0, 0.08, -0.05, 0.06),
    "sphere": Sphere((0.0, 0.01, 1.0), 0.09),
}


def inside(name: str, surface: Surface, points: np.ndarray) -> np.ndarray:
    """Tell by definition whether points (3, N) are in the solid (behind the relief)."""
    x, y, z = points
    if isinstance(surface, Relief):
        return z > surface.height(x, y)[0]
    if isinstance(surface, Box):
        local = surface.local(points - np.array(surface.centre_m)[:, None])
        return np.all(np.abs(local) < np.array(surface.size_m)[:, None] / 2, axis=0)
    if isinstance(surface, Cylinder):
        radial = np.hypot(x - surface.x_m, z - surface.z_m) < surface.radius_m
        return radial & (y > surface.top_m) & (y < surface.bottom_m)
    assert isinstance(surface, Sphere), name
    return np.linalg.norm(points - np.array(surface.centre_m)[:, None], axis=0) < surface.radius_m


@pytest.mark.parametrize("name", SOLIDS)
def test_hit_is_where_a_march_along_the_ray_enters(name: str) -> None:
    surface = SOLIDS[name]
    generator = np.random.default_rng(1)
    rays = np.vstack([generator.uniform(-0.14, 0.14, (2, 60)), np.ones(60)])
    origin = np.array([0.02, -0.01, 0.0])
    t = surface.hit(origin, rays)
    marks = np.arange(0.6, 1.5, 0.0005)
    entered = np.stack([inside(name, surface, origin[:, None] + mark * rays) for mark in marks])
    found = entered.any(axis=0)
    first = marks[np.argmax(entered, axis=0)]
    # A march of 0.5 mm finds the entry up to 0.5 mm late and misses chords shorter than that.
    assert np.all(np.abs(t - first)[found] <= 0.0005 + 1e-9)
    assert np.count_nonzero(np.isfinite(t) & ~found) <= 1
    assert found.sum() > 10


@pytest.mark.parametrize("name", SOLIDS)
def test_normals_are_those_of_the_neighbouring_hits(name: str) -> None:
    surface, step = SOLIDS[name], 1e-6
    generator = np.random.default_rng(2)
    rays = np.vstack([generator.uniform(-0.04, 0.04, (2, 40)), np.ones(40)])
    origin = np.zeros(3)
    points = []
    for shift in ((0.0, 0.0), (step, 0.0), (0.0, step)):
        moved = rays + np.array([*shift, 0.0])[:, None]
        points.append(surface.hit(origin, moved) * moved)
    by_hits = np.cross(points[2] - points[0], points[1] - points[0], axis=0)
    by_hits /= np.linalg.norm(by_hits, axis=0)
    # First differences over a micrometre, of surfaces with radii above 50 mm.
    np.testing.assert_allclose(surface.normal(points[0]), by_hits, atol=1e-4)


def test_phase_of_a_plane_is_the_closed_form() -> None:
    capture = analytic_capture("plane_1000", paper_pattern(4), noise=0.0, bits=16)
    i = capture.left.astype(np.float64)
    phase = np.arctan2(i[3] - i[1], i[0] - i[2])
    columns = np.arange(640.0)
    device = columns - CX_PX + 483.54041 - FX_PX * PROJECTOR_X_M / 1.0
    off = np.angle(np.exp(1j * (phase - 2.0 * np.pi * device / PERIOD_PX)))
    # 16 bit rounding is far below; the borders repeat pixels for the blur.
    assert np.abs(off[:, 3:-3]).max() * PERIOD_PX / (2.0 * np.pi) < 0.002


def test_shadow_and_visibility_of_a_small_plate_are_the_closed_forms() -> None:
    capture = analytic_capture("small_plate")
    row = capture.depth_m[222]
    plate = np.flatnonzero(row < 1.0)
    near_m, far_m, left_edge_m = 0.9, 1.2, 0.02 - 0.04
    shadow_from = CX_PX + FX_PX * ((left_edge_m - PROJECTOR_X_M) * far_m / near_m + PROJECTOR_X_M) / far_m
    assert np.all(capture.lit[222, plate])
    dark = np.flatnonzero(~capture.lit[222])
    assert dark.min() == pytest.approx(shadow_from, abs=1.0)
    assert dark.max() == plate.min() - 1
    hidden_from = CX_PX + FX_PX * ((left_edge_m - 0.094) * far_m / near_m + 0.094) / far_m
    seen_by_right = CX_PX + FX_PX * (left_edge_m + 0.04 + 0.04 - 0.094) / near_m  # right edge in the right image
    assert seen_by_right < 640
    hidden = np.flatnonzero(~capture.covisible[222, 150:]) + 150
    assert hidden.min() == pytest.approx(hidden_from, abs=1.0)


def test_covisible_points_look_the_same_in_both_views() -> None:
    capture = analytic_capture("spheres", noise=0.0)
    rows, columns = np.nonzero(capture.covisible)
    right = columns - capture.rig.disparity_px(capture.depth_m[rows, columns])
    base = np.floor(right).astype(int)
    ok = (base >= 0) & (base < 638)
    part = (right - base)[ok]
    image = capture.right.astype(np.float64)
    seen = (1 - part) * image[rows[ok], base[ok]] + part * image[rows[ok], base[ok] + 1]
    off = np.abs(seen - capture.left[rows[ok], columns[ok]])
    # Linear interpolation of 16.7 px fringes errs by up to 1.2 grey levels, rounding by 1; Lambert's cosine is shared.
    assert np.percentile(off, 97) < 3.0


def test_square_edges_do_not_alias() -> None:
    pattern = paper_pattern()
    square = type(pattern)(period_px=16.0, waveform="square")
    columns = np.arange(16.0) + 0.25
    averaged = projected_signal(square, columns, 0, 1.0)
    fine = columns[:, None] + (np.arange(1000) + 0.5) / 1000 - 0.5
    np.testing.assert_allclose(averaged, square.signal(fine).mean(axis=1), atol=2.5e-3)


def test_gamma_bends_the_projector_only_between_its_ends() -> None:
    columns = np.linspace(0.0, 33.0, 200)
    bent = projected_signal(paper_pattern(), columns, 0, 2.2)
    np.testing.assert_allclose((bent + 1) / 2, ((paper_pattern().signal(columns) + 1) / 2) ** 2.2, atol=1e-12)


def test_noise_has_the_asked_size_and_seed() -> None:
    one, same, other = (analytic_capture("plane_1000", noise=2.0, seed=seed) for seed in (3, 3, 4))
    clean = analytic_capture("plane_1000", noise=0.0, bits=16).left / 257.0
    np.testing.assert_array_equal(one.left, same.left)
    assert np.any(one.left != other.left)
    # Rounding to whole grey levels adds a variance of 1/12; the deviation of 307200 draws is known to 0.13 %.
    assert np.std(one.left - clean) == pytest.approx(np.sqrt(4.0 + 1.0 / 12.0), rel=0.01)


def test_every_scene_is_lit_in_range_and_unsaturated() -> None:
    for name in analytic_scene_names():
        capture = analytic_capture(name)
        assert capture.left.shape == capture.right.shape == capture.depth_m.shape == (480, 640)
        assert np.nanmin(capture.depth_m) > 0.55
        assert np.nanmax(capture.depth_m) < 1.55
        assert capture.covisible.mean() > 0.6
        assert not np.any(capture.covisible & ~capture.lit)
        assert capture.left.max() < 250


def test_unknown_scene_names_those_there_are() -> None:
    with pytest.raises(SceneError, match=r"'sofa'.*plane_600.*stairs"):
        analytic_capture("sofa")
