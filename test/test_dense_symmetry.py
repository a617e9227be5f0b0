"""What must not matter: where the images are cut, which way is up, which camera is called left."""

from __future__ import annotations

import numpy as np
import pytest
from dense_rigs import Array, Float32, capture, dense_shot, sensor, stepped_shot

from moire_sensor import Reconstructor, Shot, StereoRig
from moire_sensor.paper_rig import paper_rig
from moire_sensor.shot import UNKNOWN_ORDER

SCENE = "spheres"
WIDTH, HEIGHT = 640, 480
METHODS = pytest.mark.parametrize("method", ["dense", "phase_shift"])


def shot_of(method: str) -> Shot:
    return dense_shot(SCENE) if method == "dense" else stepped_shot(SCENE)


def images(method: str) -> tuple[Array, Array]:
    seen = capture(SCENE, 1 if method == "dense" else 4)
    return seen.left, seen.right


def reconstruct(method: str, rig: StereoRig, left: Array, right: Array) -> Shot:
    pattern = sensor(method, 1 if method == "dense" else 4).pattern
    return Reconstructor(rig, pattern, method=method).reconstruct(left, right)


def moved(left_by: tuple[float, float], right_by: tuple[float, float], size: tuple[int, int]) -> StereoRig:
    """The paper's rig with images cut at (column, row) of either camera."""
    plain = paper_rig()
    cut = [np.array([[1.0, 0.0, -x], [0.0, 1.0, -y], [0.0, 0.0, 1.0]]) for x, y in (left_by, right_by)]
    projector = plain.P_projector
    return StereoRig.from_projections(cut[0] @ plain.P_left, cut[1] @ plain.P_right, projector, size)


def turned(columns: bool, rows: bool, swap: bool, height: int = HEIGHT) -> StereoRig:
    """The paper's rig in a world and images mirrored along x, along y or both; the cameras exchanged or not."""
    plain = paper_rig()
    flip = np.array([[-1.0 if columns else 1.0, 0.0, WIDTH - 1.0 if columns else 0.0],
                     [0.0, -1.0 if rows else 1.0, height - 1.0 if rows else 0.0], [0.0, 0.0, 1.0]])  # fmt: skip
    world = np.diag([flip[0, 0], flip[1, 1], 1.0, 1.0])
    cameras = [flip @ P @ world for P in ((plain.P_right, plain.P_left) if swap else (plain.P_left, plain.P_right))]
    return StereoRig.from_projections(*cameras, plain.P_projector @ world, (WIDTH, height))


def check_same(method: str, found: Float32, expected: Float32) -> None:
    """Disparities of the same pixels: known at the same places, and equal but for rounding, for all but a few.

    Rounding decides beside edges which pixels count as one surface, and a single shot's windows carry it a period far:
    there 0.01 px, the noise of one window, 99 % of the pixels. Phase steps meet no such choice away from edges.
    """
    within_px, share = {"dense": (0.01, 0.99), "phase_shift": (0.002, 0.999)}[method]
    known = np.isfinite(expected)
    assert (np.isfinite(found) == known).mean() >= 0.998
    apart_px = np.abs(found - expected)[known & np.isfinite(found)]
    assert (apart_px < within_px).mean() >= share
    assert (apart_px > 1.0).mean() <= 0.0005


@METHODS
@pytest.mark.parametrize("by_px", [(0, 24), (20, 0), (33, 18)])
def test_cut_images_give_the_cut_depth(method: str, by_px: tuple[int, int]) -> None:
    """Shift equivariance along rows and columns, a fringe's window and what the right image lost apart.

    Even numbers of rows, so that the same rows are solved.
    """
    x, y = by_px
    rig = moved(by_px, by_px, (WIDTH - x, HEIGHT - y))
    shot = reconstruct(method, rig, *(image[..., y:, x:].copy() for image in images(method)))
    plain = shot_of(method).disparity_px[y:, x:]
    inside = np.indices(plain.shape)[1] - np.nan_to_num(plain) > 40.0
    inside[:20] = False
    check_same(method, np.where(inside, shot.disparity_px, np.nan), np.where(inside, plain, np.nan))
    assert inside.mean() > 0.6


@METHODS
def test_a_shifted_right_image_shifts_disparities_alone(method: str) -> None:
    left, right = images(method)
    shifted = np.zeros_like(right)
    shifted[..., :-30] = right[..., 30:]
    shot = reconstruct(method, moved((0.0, 0.0), (30.0, 0.0), (WIDTH, HEIGHT)), left, shifted)
    plain = shot_of(method).disparity_px
    inside = np.indices(plain.shape)[1] - np.nan_to_num(plain) > 50.0
    check_same(method, np.where(inside, shot.disparity_px - 30.0, np.nan), np.where(inside, plain, np.nan))


@METHODS
def test_upside_down_images_give_upside_down_depth(method: str) -> None:
    """Mirror equivariance along columns, of an odd number of rows, so that the same ones are solved."""
    height = HEIGHT - 1
    left, right = (image[..., :height, :] for image in images(method))
    plain = reconstruct(method, moved((0.0, 0.0), (0.0, 0.0), (WIDTH, height)), left.copy(), right.copy())
    left, right = (image[..., ::-1, :].copy() for image in (left, right))
    shot = reconstruct(method, turned(columns=False, rows=True, swap=False, height=height), left, right)
    check_same(method, shot.disparity_px[::-1], plain.disparity_px)


@METHODS
@pytest.mark.parametrize("rows", [False, True])
def test_mirrored_cameras_agree_with_each_other(method: str, rows: bool) -> None:
    """Mirrored along rows, right is left: the right camera's depth, which is the left one's where both see it."""
    step = -1 if rows else 1
    left, right = (image[..., ::step, ::-1].copy() for image in images(method))
    shot = reconstruct(method, turned(columns=True, rows=rows, swap=True), right, left)
    of_right, plain = shot.disparity_px[::step, ::-1], shot_of(method).disparity_px
    y, x = np.nonzero(np.isfinite(plain))
    column = x - plain[y, x]
    base = np.clip(np.floor(column).astype(int), 0, WIDTH - 2)
    pair = np.stack([of_right[y, base], of_right[y, base + 1]])
    seen = pair[0] + (column - base) * (pair[1] - pair[0])
    # Across an edge there is nothing between two columns.
    smooth = np.abs(pair[1] - pair[0]) < 1.0
    apart = np.abs(seen - plain[y, x])[smooth]
    assert smooth.mean() > 0.95
    # Below the noise of two results: 0.35 mm at 1 m are 0.041 px for phase steps, 0.058 mm are 0.007 px for one shot.
    assert np.median(apart) < {"dense": 0.007, "phase_shift": 0.041}[method]
    assert (apart > 1.0).mean() < 0.005


@METHODS
@pytest.mark.parametrize("name", ["slope_1.2", "tilt_rows_0.5", "waves"])
def test_orders_are_monotone_along_ordered_surfaces(method: str, name: str) -> None:
    """What the projector sees from left to right, so does the camera: along a row the order only grows."""
    shot = dense_shot(name) if method == "dense" else stepped_shot(name)
    for row in shot.fringe_order[5::19]:
        orders = row[row != UNKNOWN_ORDER].astype(int)
        assert orders.size > 300
        assert orders[-1] - orders[0] > 15
        # At a border between two periods noise may toggle the order by one.
        assert (np.maximum.accumulate(orders) - orders).max() <= 1
        assert np.diff(orders).max() <= 1
