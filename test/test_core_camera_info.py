"""Camera infos, as messages and as YAML files: rectification against OpenCV, and every info to refuse."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from core_rigs import SIZE, intrinsic, pixels, rotation

from moire_sensor.camera_info import rectification_from_camera_info
from moire_sensor.errors import RigError
from moire_sensor.paper_rig import PROJECTOR_SIZE, paper_rig
from moire_sensor.rig import StereoRig

LENSES = (np.array([-0.12, 0.05, 0.001, -0.0005, 0.01]), np.array([-0.1, 0.08, -0.0007, 0.0004, 0.0]))
MATRICES = (intrinsic(1210, 1200, 310, 250), intrinsic(1190, 1195, 335, 231))
RIGHT_FROM_LEFT = rotation(0.5, -2.0, 1.0)
SHIFT_M = np.array([-0.095, 0.002, 0.001])
NAMES = ("left", "right", "projector")


def info(K: Any, D: Any, R: Any, P: Any, size: tuple[int, int] = SIZE, model: str = "plumb_bob") -> SimpleNamespace:
    """The fields of a sensor_msgs/CameraInfo."""
    return SimpleNamespace(
        width=size[0], height=size[1], distortion_model=model, d=list(np.ravel(D)), k=list(np.ravel(K)),
        r=list(np.ravel(R)), p=list(np.ravel(P)),
    )  # fmt: skip


def paper_infos() -> dict[str, Any]:
    rig = paper_rig()
    matrices = (rig.P_left, rig.P_right, rig.P_projector)
    return {
        name: info(P[:, :3], np.zeros(5), np.eye(3), P, PROJECTOR_SIZE if name == "projector" else SIZE)
        for name, P in zip(NAMES, matrices, strict=True)
    }


def raw_infos() -> tuple[dict[str, Any], tuple[np.ndarray, np.ndarray]]:
    """Infos of a pair with lenses, as cv2.stereoRectify makes them, and R of both cameras."""
    turns = cv2.stereoRectify(
        MATRICES[0], LENSES[0], MATRICES[1], LENSES[1], SIZE, RIGHT_FROM_LEFT, SHIFT_M[:, None], alpha=0
    )
    infos = {
        name: info(MATRICES[i], LENSES[i], turns[i], turns[2 + i]) for i, name in enumerate(("left", "right"))
    }
    return {**infos, "projector": paper_infos()["projector"]}, (turns[0], turns[1])


def write(path: Path, message: SimpleNamespace) -> Path:
    """Write what camera_calibration writes."""

    def matrix(values: list[float], rows: int) -> dict[str, Any]:
        return {"rows": rows, "cols": len(values) // rows, "data": [float(value) for value in values]}

    content = {
        "image_width": message.width, "image_height": message.height, "camera_name": path.stem,
        "distortion_model": message.distortion_model, "camera_matrix": matrix(message.k, 3),
        "distortion_coefficients": matrix(message.d, 1), "rectification_matrix": matrix(message.r, 3),
        "projection_matrix": matrix(message.p, 3),
    }  # fmt: skip
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.mark.parametrize("as_files", [False, True])
def test_rectification_is_that_of_opencv(as_files: bool, tmp_path: Path) -> None:
    infos, turns = raw_infos()
    sources = {name: write(tmp_path / f"{name}.yaml", infos[name]) for name in NAMES} if as_files else infos
    pair = rectification_from_camera_info(**sources)
    assert pair.rig.baseline_m == pytest.approx(np.linalg.norm(SHIFT_M), rel=1e-9)
    rng = np.random.default_rng(0)
    at = np.stack([rng.integers(0, SIZE[0], 500), rng.integers(0, SIZE[1], 500)], axis=1)
    depth_m = rng.uniform(0.5, 2.0, (500, 1))
    points = depth_m * np.linalg.solve(pair.rig.P_left[:, :3], np.concatenate([at, np.ones((500, 1))], axis=1).T).T
    left = points @ turns[0]  # from the rectified left frame to the raw left camera's
    expected = cv2.projectPoints(left, np.zeros(3), np.zeros(3), MATRICES[0], LENSES[0])[0].reshape(-1, 2)
    assert pair.left_map is not None
    np.testing.assert_allclose(pair.left_map[at[:, 1], at[:, 0]], expected, rtol=0, atol=0.01)
    seen = pixels(pair.rig.P_right, points)
    np.testing.assert_allclose(seen[:, 1], at[:, 1], atol=1e-6)
    right = left @ RIGHT_FROM_LEFT.T + SHIFT_M
    expected = cv2.projectPoints(right, np.zeros(3), np.zeros(3), MATRICES[1], LENSES[1])[0].reshape(-1, 2)
    assert pair.right_map is not None
    columns = cv2.remap(pair.right_map, seen.astype(np.float32)[None], None, cv2.INTER_LINEAR)[0]
    inside = (seen >= 0).all(axis=1) & (seen <= np.array(SIZE) - 1).all(axis=1)
    assert inside.mean() > 0.5
    # OpenCV 4 rounds the place in the map to 1/32 px: up to 0.016 px more on a map of slope 1
    np.testing.assert_allclose(columns[inside], expected[inside], rtol=0, atol=0.01 + 1 / 64)


def test_rectified_infos_need_no_maps_and_give_the_paper_rig(tmp_path: Path) -> None:
    infos = paper_infos()
    for sources in (infos, {name: str(write(tmp_path / f"{name}.yaml", infos[name])) for name in NAMES}):
        pair = rectification_from_camera_info(**sources)
        assert pair.left_map is None
        assert pair.right_map is None
        rig = StereoRig.from_camera_info(**sources)
        for name in ("P_left", "P_right", "P_projector"):
            np.testing.assert_array_equal(getattr(rig, name), getattr(paper_rig(), name))
        assert (rig.image_size, rig.projector_size) == (SIZE, PROJECTOR_SIZE)


def test_the_projector_is_an_inverse_camera_with_its_lens() -> None:
    infos = paper_infos()
    K, lens = intrinsic(1250, 1240, 480, 230), np.array([0.1, -0.05, 0.001, 0.002, 0.0])
    turn, shift = rotation(2.0, -9.0, 170.0), np.array([-0.1, 0.02, 0.005])
    infos["projector"] = info(K, lens, np.zeros(9), K @ np.hstack([turn, shift[:, None]]), PROJECTOR_SIZE)
    points = np.random.default_rng(0).uniform([-0.2, -0.2, 0.5], [0.2, 0.2, 2.0], (100, 3))
    expected = cv2.projectPoints(points, cv2.Rodrigues(turn)[0], shift, K, lens)[0].reshape(-1, 2)
    rig = StereoRig.from_camera_info(**infos)
    np.testing.assert_allclose(rig.projector_pixels(points), expected, atol=1e-8)


def changed(which: str, **fields: Any) -> dict[str, Any]:
    infos = paper_infos()
    for key, value in fields.items():
        setattr(infos[which], key, value)
    return infos


def broken() -> dict[str, tuple[dict[str, Any], str]]:
    infos = paper_infos()
    shifted, lifted = list(infos["right"].p), list(infos["left"].p)
    shifted[3], lifted[3] = 0.0, 5.0
    rows = list(infos["right"].p)
    rows[6] += 3.0
    roi = SimpleNamespace(x_offset=10, y_offset=0, width=320, height=240, do_rectify=False)
    return {
        "missing": ({**infos, "right": None}, "right camera info is no sensor_msgs/CameraInfo"),
        "uncalibrated": (changed("left", k=[0.0] * 9, p=[0.0] * 12), "left camera info is all zero, an uncalibrated"),
        "no P": (changed("left", p=[0.0] * 12), "left camera info is all zero"),
        "short K": (changed("left", k=[1.0] * 8), r"K of the left camera info has shape \(8,\)"),
        "K of ones": (changed("left", k=[1.0] * 9), "intrinsic matrix of the left camera info is"),
        "short P": (changed("projector", p=[1.0] * 9), "P of the projector camera info has shape"),
        "words": (changed("right", d=["a"] * 5), "lens of the right camera info is not an array of numbers"),
        "nan": (changed("right", p=[np.nan] * 12), "P of the right camera info contains NaN"),
        "three D": (changed("left", d=[0.1] * 3), "lens of the left camera info has 3 coefficients"),
        "eight D": (changed("left", d=[0.1] * 8), "has 8 lens coefficients; model 'plumb_bob' takes 0 or 4 or 5"),
        "fisheye": (changed("left", distortion_model="equidistant"), "'equidistant'; allowed are plumb_bob, rational"),
        "no R": (changed("right", r=[0.0] * 9), "R of the right camera info is no rotation"),
        "mirror": (changed("right", r=[-1.0, 0, 0, 0, 1, 0, 0, 0, 1]), "R of the right camera info is no rotation"),
        "sizes": (changed("right", width=800), r"left camera info is for \(640, 480\) and the right for \(800, 480\)"),
        "no size": (changed("left", width=0, height=0), "image size of the left camera info is"),
        "no baseline": (changed("right", p=shifted), r"P\[3\] = 0\.0; it must be -fx \* baseline_m"),
        "left shifted": (changed("left", p=lifted), "the left camera is the origin"),
        "rows": (changed("right", p=rows), r"rows disagree by up to 3\.00 px"),
        "binning": (changed("left", binning_x=2, binning_y=2), r"left camera info tells of binning \(2, 2\)"),
        "region": (changed("right", roi=roi), r"region of interest \(10, 0, 320, 240\)"),
    }


@pytest.mark.parametrize("case", broken())
def test_an_unusable_info_is_refused_in_one_line(case: str) -> None:
    infos, message = broken()[case]
    with pytest.raises(RigError, match=message) as refusal:
        rectification_from_camera_info(**infos)
    assert "\n" not in str(refusal.value)


def test_whole_images_may_say_so() -> None:
    whole = SimpleNamespace(x_offset=0, y_offset=0, width=640, height=480, do_rectify=False)
    infos = changed("left", binning_x=1, binning_y=1, roi=whole)
    assert rectification_from_camera_info(**infos).left_map is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "No such file"),
        ("", "cannot read the left camera info"),
        ("image_width: 640\n", "'image_height' is missing"),
        ("a: [1, 2\nb: }\n", "cannot read the left camera info"),
        ("- 1\n- 2\n", "cannot read the left camera info"),
        (
            "image_width: wide\nimage_height: 480\ncamera_matrix: {data: []}\nprojection_matrix: {data: []}\n",
            "image size of the left camera info",
        ),
    ],
)
def test_an_unreadable_file_is_refused_in_one_line(text: str | None, message: str, tmp_path: Path) -> None:
    path = tmp_path / "left.yaml"
    if text is not None:
        path.write_text(text)
    with pytest.raises(RigError, match=message) as refusal:
        rectification_from_camera_info(**{**paper_infos(), "left": path})
    assert "\n" not in str(refusal.value)
    assert "left" in str(refusal.value)


def test_a_file_of_bytes_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "left.yaml"
    path.write_bytes(bytes(range(128, 256)))
    with pytest.raises(RigError, match="cannot read the left camera info"):
        rectification_from_camera_info(**{**paper_infos(), "left": path})


def test_a_file_without_rectification_is_of_a_rectified_camera(tmp_path: Path) -> None:
    path = write(tmp_path / "left.yaml", paper_infos()["left"])
    content = yaml.safe_load(path.read_text())
    del content["rectification_matrix"], content["distortion_coefficients"]
    path.write_text(yaml.safe_dump(content))
    assert rectification_from_camera_info(**{**paper_infos(), "left": path}).left_map is None
