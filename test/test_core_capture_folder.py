"""Capture folders: read back what was written, and one clear line for whatever is wrong with them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from core_rigs import intrinsic, projection, rotation

from moire_sensor.capture_folder import read_capture
from moire_sensor.errors import CaptureError

WIDTH, HEIGHT = 64, 48
LEFT = projection(intrinsic(100, 100, 32, 24), np.eye(3), np.zeros(3))
RIGHT = projection(intrinsic(100, 100, 32, 24), np.eye(3), np.array([0.1, 0.0, 0.0]))
PROJECTOR = projection(intrinsic(120, 120, 60, 40), rotation(0, 0, 180), np.array([0.3, 0.0, 0.0]))


def content(right: np.ndarray = RIGHT) -> dict[str, Any]:
    return {
        "image_size": [WIDTH, HEIGHT],
        "pattern": {"period_px": 12.5, "phase_rad": 0.5, "step_phases_rad": [0.0, 2.0, 4.0], "waveform": "square"},
        "depth_range_m": [0.4, 0.6],
        "projections": {"left": LEFT.tolist(), "right": right.tolist(), "projector": PROJECTOR.tolist()},
    }


def grey(number: int, dtype: type = np.uint8) -> np.ndarray:
    return np.random.default_rng(number).integers(0, np.iinfo(dtype).max, (HEIGHT, WIDTH)).astype(dtype)


def write(
    folder: Path, rig: dict[str, Any] | None = None, names: tuple[str, ...] = ("00", "01"), dtype: type = np.uint8
) -> Path:
    (folder / "rig.yaml").write_text(yaml.safe_dump(content() if rig is None else rig))
    for name in names:
        for side in ("left", "right"):
            cv2.imwrite(str(folder / f"{side}_{name}.png"), grey(int(name) + 100 * (side == "right"), dtype))
    return folder


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_a_rectified_capture_is_read_as_it_is(dtype: type, tmp_path: Path) -> None:
    capture = read_capture(str(write(tmp_path, names=("00", "01"), dtype=dtype)))
    assert (capture.frame_count, capture.depth_range_m) == (2, (0.4, 0.6))
    assert (capture.pattern.period_px, capture.pattern.step_phases_rad) == (12.5, (0.0, 2.0, 4.0))
    assert capture.pair.left_map is None
    assert capture.rig.baseline_m == pytest.approx(0.1)
    for frame in range(2):
        left, right = capture.frame(frame)
        np.testing.assert_array_equal(left, grey(frame, dtype))
        np.testing.assert_array_equal(right, grey(100 + frame, dtype))
    assert capture.stack()[0].shape == (2, HEIGHT, WIDTH)


def test_the_number_in_the_name_tells_the_step(tmp_path: Path) -> None:
    capture = read_capture(write(tmp_path, names=("09", "10", "11", "12", "8")))
    assert capture.frame_names == ("8", "09", "10", "11", "12")
    assert [capture.step_index(frame) for frame in range(5)] == [2, 0, 1, 2, 0]


def test_a_pair_whose_rows_disagree_is_rectified(tmp_path: Path) -> None:
    lower = projection(intrinsic(100, 100, 32, 21), np.eye(3), np.array([0.1, 0.0, 0.0]))
    capture = read_capture(write(tmp_path, content(right=lower)))
    # centred on each image, the left view moves half of the 3 px up and the right one half down; no view is lost
    np.testing.assert_allclose(capture.rig.P_left[1, 2], capture.rig.P_right[1, 2])
    assert capture.pair.right_map is not None
    assert capture.pair.left_map is not None
    shift = capture.pair.left_map[..., 1] - capture.pair.right_map[..., 1]
    np.testing.assert_allclose(shift, 3.0, atol=1e-5)
    assert capture.frame(0)[0].shape == (HEIGHT, WIDTH)


def replaced(**parts: Any) -> Callable[[Path], None]:
    return lambda folder: (folder / "rig.yaml").write_text(yaml.safe_dump({**content(), **parts})) and None


def without(name: str) -> Callable[[Path], None]:
    return lambda folder: (folder / "rig.yaml").write_text(
        yaml.safe_dump({key: value for key, value in content().items() if key != name})
    ) and None


def text(data: str | bytes, name: str = "rig.yaml") -> Callable[[Path], None]:
    return lambda folder: (folder / name).write_bytes(data.encode() if isinstance(data, str) else data) and None


def image(name: str, pixels: np.ndarray) -> Callable[[Path], None]:
    return lambda folder: cv2.imwrite(str(folder / name), pixels) and None


def projections(**matrices: Any) -> Callable[[Path], None]:
    return replaced(projections={**content()["projections"], **matrices})


BROKEN: dict[str, tuple[Callable[[Path], Any], str]] = {
    "no rig file": (lambda folder: (folder / "rig.yaml").unlink(), "cannot read .*rig.yaml: .*No such file"),
    "no yaml": (text("a: [1, 2\nb: }\n"), "cannot read .*rig.yaml"),
    "bytes": (text(bytes(range(128, 256))), "cannot read .*rig.yaml"),
    "empty": (text(""), "holds a NoneType, not a mapping"),
    "list": (text("- 1\n"), "holds a list, not a mapping"),
    "no size": (without("image_size"), "'image_size' is missing"),
    "no pattern": (without("pattern"), "'pattern' is missing"),
    "no range": (without("depth_range_m"), "'depth_range_m' is missing"),
    "no projections": (without("projections"), "'projections' is missing"),
    "size": (replaced(image_size=[64.5, 48]), r"image_size is \[64.5, 48\]"),
    "size of three": (replaced(image_size=[64, 48, 3]), "image_size is"),
    "size in words": (replaced(image_size="VGA"), "image_size is VGA"),
    "pattern in words": (replaced(pattern="fine"), "pattern is a str"),
    "pattern of nothing": (replaced(pattern={}), "'period_px' is missing"),
    "pattern with more": (replaced(pattern={"period_px": 12.0, "hue": 1}), "pattern has hue; allowed are period_px"),
    "period in words": (replaced(pattern={"period_px": "wide"}), "period_px is 'wide'"),
    "steps": (replaced(pattern={"period_px": 12.0, "step_phases_rad": 4}), "step_phases_rad is 4"),
    "range reversed": (replaced(depth_range_m=[0.6, 0.4]), r"depth_range_m is \[0.6, 0.4\]"),
    "range of one": (replaced(depth_range_m=0.5), "depth_range_m is 0.5"),
    "range in words": (replaced(depth_range_m=["near", "far"]), "depth_range_m is"),
    "matrices in words": (replaced(projections="none"), "projections is a str"),
    "wrong shape": (projections(left=np.eye(3).tolist()), r"P_left has shape \(3, 3\); it must have shape \(3, 4\)"),
    "ragged": (projections(right=[[1, 2], [3]]), "P_right is not an array of numbers"),
    "not calibrated": (projections(projector=np.zeros((3, 4)).tolist()), "P_projector is singular"),
    "swapped": (projections(left=RIGHT.tolist(), right=LEFT.tolist()), "swap left and right"),
    "another size": (image("right_01.png", np.zeros((10, 20), np.uint8)), "right_01.png is 20 x 10 pixels; .* 64 x 48"),
    "no image": (text("no picture", "left_01.png"), "left_01.png holds no image that can be read"),
    "empty image": (text("", "left_01.png"), "left_01.png holds no image"),
    "mixed": (image("left_01.png", grey(0, np.uint16)), "partly uint16 and partly uint8"),
    "alone": (lambda folder: (folder / "right_01.png").unlink(), "frames 01 have one image only"),
    "gap": (lambda folder: [path.rename(folder / path.name.replace("_01", "_02")) for path in folder.glob("*_01.png")],
            "the frames are 00, 02, but each must follow"),
    "no frames": (lambda folder: [path.unlink() for path in folder.glob("*.png")], "it holds no left_NN.png"),
}  # fmt: skip


@pytest.mark.parametrize("case", BROKEN)
def test_a_broken_capture_is_refused_in_one_line(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    spoil, message = BROKEN[case]
    spoil(write(tmp_path))
    with pytest.raises(CaptureError, match=message) as refusal:
        read_capture(tmp_path)
    assert "\n" not in str(refusal.value)
    assert capfd.readouterr() == ("", "")


def test_a_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    for path in (tmp_path / "nowhere", write(tmp_path) / "rig.yaml"):
        with pytest.raises(CaptureError, match=r"there is no folder .*left_NN.png, right_NN.png and rig.yaml"):
            read_capture(path)


def test_the_real_capture_is_read(capture_folder: Path) -> None:
    capture = read_capture(capture_folder)
    assert (capture.frame_count, capture.depth_range_m) == (8, (0.40, 0.56))
    assert [capture.step_index(frame) for frame in range(8)] == [0, 1, 2, 3, 0, 1, 2, 3]
    assert capture.pair.left_map is not None
    left, right = capture.stack()
    assert left.shape == right.shape == (8, 480, 640)
    assert left.dtype == np.uint8
