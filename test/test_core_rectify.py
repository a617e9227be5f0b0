"""Rectification against OpenCV and against projected points; images sampled without moving fringes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from core_rigs import SIZE, Array, intrinsic, pixels, projection, rotation
from hypothesis import given, settings
from hypothesis import strategies as st

from moire_sensor.errors import ImageError, RigError
from moire_sensor.paper_rig import paper_rig
from moire_sensor.rectify import RectifiedPair, rectify_pair
from moire_sensor.resample import resample

LENSES = ((-0.12, 0.05, 0.001, -0.0005, 0.01), (-0.1, 0.08, -0.0007, 0.0004, 0.0))
PROJECTOR = projection(intrinsic(1600, 1590, 640, 380), rotation(3, -8, 175), np.array([0.2, 0.03, 0.01]))


class RawPair:
    """Two cameras turned by a few degrees, with unlike lenses, and the projector, in one world frame."""

    def __init__(self, seed: int, lenses: tuple[tuple[float, ...], tuple[float, ...]] = LENSES) -> None:
        rng = np.random.default_rng(seed)
        world = rotation(*rng.uniform(-150, 150, 3))
        self.lenses = lenses
        self.intrinsics = [
            intrinsic(*rng.uniform(900, 1300, 2), rng.uniform(290, 350), rng.uniform(210, 270)) for _ in range(2)
        ]
        self.rotations = [rotation(*rng.uniform(-4, 4, 3)) @ world for _ in range(2)]
        self.places = [world.T @ place for place in (np.zeros(3), np.array([0.1, *rng.uniform(-0.005, 0.005, 2)]))]
        self.projections = [
            projection(*parts) for parts in zip(self.intrinsics, self.rotations, self.places, strict=True)
        ]
        self.projector = PROJECTOR @ np.block([[world, np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
        self.pair = rectify_pair(*self.projections, self.projector, SIZE, *lenses)
        # The projector tells how the rectified left frame lies in the world, without looking into rectify_pair.
        kept, told = self.pair.rig.P_projector, self.projector
        self.world_from_left = np.linalg.solve(told[:, :3] / np.linalg.norm(told[2, :3]), kept[:, :3])

    def points(self, rng: np.random.Generator, count: int) -> tuple[Array, Array]:
        """Points all over the view, in the rectified left frame and in the world."""
        places = np.stack([rng.uniform(0, SIZE[0] - 1, count), rng.uniform(0, SIZE[1] - 1, count), np.ones(count)])
        points = (np.linalg.solve(self.pair.rig.P_left[:, :3], places) * rng.uniform(0.5, 2.0, count)).T
        return points, points @ self.world_from_left.T + self.places[0]

    def raw_pixels(self, camera: int, world: Array) -> Array:
        """What OpenCV says a raw camera sees."""
        turn = cv2.Rodrigues(self.rotations[camera])[0]
        shift = -self.rotations[camera] @ self.places[camera]
        lens = np.array(self.lenses[camera], dtype=np.float64)
        seen = cv2.projectPoints(np.ascontiguousarray(world), turn, shift, self.intrinsics[camera], lens)[0]
        return np.asarray(seen).reshape(-1, 2)


def looked_up(pixel_map: np.ndarray, at: Array) -> tuple[Array, Array]:
    """Map values between pixels (n, 2), and which places lie inside."""
    inside = (at >= 0).all(axis=1) & (at < np.array(SIZE) - 1).all(axis=1)
    corner = at[inside].astype(int)
    part = at[inside] - corner
    x, y = corner.T
    top = pixel_map[y, x] * (1 - part[:, :1]) + pixel_map[y, x + 1] * part[:, :1]
    bottom = pixel_map[y + 1, x] * (1 - part[:, :1]) + pixel_map[y + 1, x + 1] * part[:, :1]
    return top * (1 - part[:, 1:]) + bottom * part[:, 1:], inside


@settings(derandomize=True, deadline=None, max_examples=4)
@given(st.integers(0, 2**32 - 1))
def test_points_land_on_one_row_where_the_maps_say(seed: int) -> None:
    raw = RawPair(seed)
    points, world = raw.points(np.random.default_rng(seed), 400)
    rig = raw.pair.rig
    rectified = [pixels(matrix, points) for matrix in (rig.P_left, rig.P_right)]
    np.testing.assert_allclose(rectified[0][:, 1], rectified[1][:, 1], rtol=0, atol=1e-6)
    np.testing.assert_allclose(rectified[0][:, 0] - rectified[1][:, 0], rig.disparity_px(points[:, 2]), atol=1e-6)
    np.testing.assert_allclose(pixels(rig.P_projector, points), pixels(raw.projector, world), atol=1e-6)
    for camera, pixel_map in enumerate((raw.pair.left_map, raw.pair.right_map)):
        assert pixel_map is not None
        found, inside = looked_up(pixel_map, rectified[camera])
        assert inside.mean() > 0.4
        # 0.01 px is the limit; float32 maps and straight lines between pixels give 0.001
        np.testing.assert_allclose(found, raw.raw_pixels(camera, world)[inside], rtol=0, atol=0.01)


@pytest.mark.parametrize(
    "lenses", [LENSES, ((), ()), ((-0.1, 0.02, 0.001, 0.0, 0.0, 0.01, 0.02, 0.0), (0.05, 0.0, 0.0, 0.0))]
)
def test_maps_are_those_of_opencv(lenses: tuple[tuple[float, ...], tuple[float, ...]]) -> None:
    raw = RawPair(4, lenses)
    rig = raw.pair.rig
    for camera, (found, matrix) in enumerate(
        zip((raw.pair.left_map, raw.pair.right_map), (rig.P_left, rig.P_right), strict=True)
    ):
        rectified_from_camera = raw.world_from_left.T @ raw.rotations[camera].T
        expected = cv2.initUndistortRectifyMap(
            raw.intrinsics[camera], np.array(lenses[camera] or (0.0,) * 5, dtype=np.float64), rectified_from_camera,
            np.ascontiguousarray(matrix[:, :3]), SIZE, cv2.CV_32FC2,
        )[0]  # fmt: skip
        np.testing.assert_allclose(found, expected, rtol=0, atol=0.01)


def test_a_rectified_pair_keeps_its_pixels() -> None:
    rig = paper_rig()
    pair = rectify_pair(rig.P_left, rig.P_right, rig.P_projector, SIZE)
    rows, columns = np.indices(SIZE[::-1])
    assert pair.left_map is not None
    # fy takes the place of fx, so columns are stretched by 0.4 % about the middle; rows stay
    np.testing.assert_allclose(pair.left_map[..., 1], rows, atol=1e-3)
    stretch = rig.fx_px / rig.fy_px
    np.testing.assert_allclose(pair.left_map[..., 0], 319.5 + (columns - 319.5) * stretch, atol=1e-3)
    assert pair.rig.baseline_m == pytest.approx(rig.baseline_m, rel=1e-9)


def test_the_lens_of_the_projector_is_handed_on() -> None:
    raw = RawPair(1)
    lens, matrix = (0.1, -0.05, 0.001, 0.0, 0.0), intrinsic(1600, 1590, 640, 380)
    rig = rectify_pair(*raw.projections, raw.projector, SIZE, *LENSES, lens, matrix, (1280, 800)).rig
    points, world = raw.points(np.random.default_rng(0), 50)
    world_rotation = np.linalg.solve(PROJECTOR[:, :3], raw.projector[:, :3])
    turn = rotation(3, -8, 175) @ world_rotation
    expected = cv2.projectPoints(
        np.ascontiguousarray(world), cv2.Rodrigues(turn)[0], -rotation(3, -8, 175) @ [0.2, 0.03, 0.01], matrix,
        np.array(lens),
    )[0].reshape(-1, 2)  # fmt: skip
    np.testing.assert_allclose(rig.projector_pixels(points), expected, atol=1e-5)


def moved(turn: Array, place: tuple[float, float, float]) -> Array:
    return projection(intrinsic(1000, 1000, 320, 240), turn, np.array(place))


STILL = moved(np.eye(3), (0.0, 0.0, 0.0))


@pytest.mark.parametrize(
    ("right", "message"),
    [
        (moved(np.eye(3), (-0.1, 0.0, 0.0)), "180 degrees off the rows of the left one.*swap left and right"),
        (moved(np.eye(3), (0.0, 0.1, 0.0)), "90 degrees off the rows of the left one.*turn the images"),
        (moved(rotation(0, 0, 180), (0.1, 0.0, 0.0)), "180 degrees off the rows of the right one"),
        (moved(rotation(80, 0, 0), (0.1, 0.0, 0.0)), "the cameras look 80 degrees apart"),
        (STILL, "both cameras stand at one place"),
        (np.zeros((3, 4)), "P_right is singular"),
        (np.eye(4), r"P_right has shape \(4, 4\)"),
    ],
)
def test_what_cannot_be_rectified_is_refused(right: Array, message: str) -> None:
    with pytest.raises(RigError, match=message) as refusal:
        rectify_pair(STILL, right, PROJECTOR, SIZE)
    assert "\n" not in str(refusal.value)


def test_a_lens_of_three_coefficients_is_refused() -> None:
    with pytest.raises(RigError, match="lens of the right camera has 3 coefficients"):
        rectify_pair(STILL, moved(np.eye(3), (0.1, 0.0, 0.0)), PROJECTOR, SIZE, (), (0.1, 0.2, 0.3))


def test_images_of_another_size_or_type_are_refused() -> None:
    good = np.zeros(SIZE[::-1], dtype=np.uint8)
    pair = RectifiedPair(paper_rig(), None, None, SIZE)
    assert pair.rectify(good, good)[0] is good
    with pytest.raises(ImageError, match=r"right image has shape \(480, 600\); the calibration is for \(480, 640\)"):
        pair.rectify(good, good[:, :600])
    with pytest.raises(ImageError, match="the left image is float64; give uint8 or uint16"):
        pair.rectify(good.astype(np.float64), good)  # type: ignore[arg-type]


def places(columns: Array, rows: Array) -> np.ndarray:
    return np.stack(np.broadcast_arrays(columns, rows), axis=-1).astype(np.float32)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_whole_pixels_are_taken_as_they_are(dtype: type) -> None:
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, (20, 30), endpoint=True).astype(dtype)
    rows, columns = np.indices(image.shape)
    same = resample(image, places(columns, rows))
    assert same.dtype == dtype
    np.testing.assert_array_equal(same, image)
    np.testing.assert_array_equal(resample(image, places(29 - columns, rows)), image[:, ::-1])


def test_places_outside_the_image_are_black() -> None:
    image = np.full((20, 30), 200, dtype=np.uint8)
    columns = np.array([[-0.6, -0.4, 29.4, 29.6, np.nan, np.inf, 5.0, 5.0, 5.0]])
    at = places(columns, np.array([[5.0] * 7 + [-1.0, 19.6]]))
    np.testing.assert_array_equal(resample(image, at), [[0, 200, 200, 0, 0, 0, 200, 0, 0]])


def test_cubic_surfaces_are_met_exactly() -> None:
    rows, columns = np.indices((24, 40)).astype(np.float64)

    def surface(x: Array, y: Array) -> Array:
        return 30000.0 + (x - 20) ** 3 - 40 * (y - 12) ** 2 + 3 * (x - 20) * (y - 12) * 5

    rng = np.random.default_rng(0)
    at = places(rng.uniform(1, 38, (50, 50)), rng.uniform(1, 22, (50, 50)))
    found = resample(np.round(surface(columns, rows)).astype(np.uint16), at).astype(np.float64)
    # half a level of rounding, and 1.25^2 of that from the rounded input (sum of the weights' magnitudes)
    np.testing.assert_allclose(found, surface(at[..., 0].astype(float), at[..., 1].astype(float)), atol=0.5 + 0.8)


def test_an_overshoot_is_clipped() -> None:
    image = np.zeros((8, 12), dtype=np.uint8)
    image[:, 6:] = 255
    across = resample(image, places(np.linspace(4, 8, 41)[None], np.array([[4.0]])))
    assert across.min() == 0
    assert across.max() == 255
    assert (np.diff(across[0, 10:21].astype(int)) >= 0).all()


@pytest.mark.parametrize("shift_px", [0.1, 0.25, 0.5, 0.77])
def test_fringes_stay_where_they_are(shift_px: float) -> None:
    period_px, columns = 16.665, np.arange(400.0)
    angle = 2.0 * np.pi / period_px
    image = np.round(32000 + 30000 * np.cos(angle * columns)).astype(np.uint16)
    found = resample(np.tile(image, (4, 1)), places(columns[None, 50:350] + shift_px, np.array([[1.0]])))[0]
    base = np.stack([np.ones(300), np.cos(angle * columns[50:350]), -np.sin(angle * columns[50:350])], axis=1)
    _, real, imaginary = np.linalg.lstsq(base, found.astype(np.float64), rcond=None)[0]
    # the phase error of a Lagrange cubic at w = 0.377 rad a pixel is at most 2e-4 px
    assert np.arctan2(imaginary, real) / angle == pytest.approx(shift_px, abs=5e-4)


def test_the_real_pair_becomes_one_with_common_rows(capture_folder: Path) -> None:
    told = yaml.safe_load((capture_folder / "rig.yaml").read_text())["projections"]
    pair = rectify_pair(told["left"], told["right"], told["projector"], SIZE)
    assert 0.036 < pair.rig.baseline_m < 0.038
    assert pair.left_map is not None
    assert np.abs(pair.left_map - np.stack(np.indices(SIZE[::-1])[::-1], axis=-1)).max() < 40.0
