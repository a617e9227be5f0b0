"""The demo judges: right depth passes, wrong depth is named, for scenes and for the real capture."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from io import StringIO
from pathlib import Path

import numpy as np
import pytest

from moire_sensor import FringePattern, Reconstructor, read_capture
from moire_sim.analytic_scenes import analytic_capture
from moire_sim.capture import HeadCapture
from moire_sim.score import score_depth
from tools.demo import run as demo_run
from tools.demo.pictures import View, draw_overview
from tools.demo.record import DemoError, Recording, Run, all_sets_done
from tools.demo.report import write_report
from tools.demo.score import (
    CaptureResult,
    SceneResult,
    local_median,
    modulation,
    rough_share,
    score_capture,
)
from tools.demo.table import Outcome, as_text, lost_sets

COUNTS = {"matched": 20, "reconstructed": 20, "superseded": 0, "gathering": 0, "unwatched": 0}
RUN = Run("flat_board", "virtual_head", (), "dense", 20)


@pytest.fixture(scope="module")
def capture() -> HeadCapture:
    return analytic_capture("plane_1000", pattern=FringePattern(16.665))


def result_of(depth_m: np.ndarray, capture: HeadCapture) -> SceneResult:
    return SceneResult((score_depth(capture.depth_m, capture), score_depth(depth_m, capture)))


def test_the_truth_is_right(capture: HeadCapture) -> None:
    result = result_of(capture.depth_m, capture)
    assert result.complaints() == []
    assert (result.completeness, result.outlier_share, result.median_error_mm) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("spoil", "complaint"),
    [
        (lambda depth: np.where(np.arange(640) < 200, np.nan, depth), "completeness"),
        (lambda depth: np.where(np.arange(640) % 20 == 0, depth * 1.2, depth), "off by more than 1 px"),
        (lambda depth: depth + 0.0005, "median error"),
    ],
)
def test_one_wrong_depth_image_among_right_ones_is_named(
    capture: HeadCapture, spoil: Callable[[np.ndarray], np.ndarray], complaint: str
) -> None:
    complaints = result_of(spoil(capture.depth_m).astype(np.float32), capture).complaints()
    assert len(complaints) == 1
    assert complaint in complaints[0]


def test_lost_sets_are_named() -> None:
    assert lost_sets(RUN, Recording(Path("bag"), 20, COUNTS)) == []
    assert lost_sets(RUN, Recording(Path("bag"), 19, COUNTS))
    assert lost_sets(RUN, Recording(Path("bag"), 20, COUNTS | {"reconstructed": 19, "superseded": 1}))
    assert lost_sets(RUN, Recording(Path("bag"), 20, COUNTS | {"reconstructed": 16, "gathering": 4})) == []


def test_a_run_ends_when_every_set_is_accounted_for() -> None:
    assert all_sets_done(RUN, Recording(Path("bag"), 20, COUNTS), depths=20)
    assert not all_sets_done(RUN, Recording(Path("bag"), 20, COUNTS), depths=19)
    assert not all_sets_done(RUN, Recording(Path("bag"), 20, COUNTS | {"reconstructed": 19}), depths=19)
    lost = COUNTS | {"reconstructed": 15, "superseded": 3, "refused: bad image": 2}
    assert all_sets_done(RUN, Recording(Path("bag"), 20, lost), depths=15)


def test_rough_share_counts_what_stands_out() -> None:
    rows, columns = np.mgrid[0:60, 0:80]
    depth_m = (0.5 + 1e-4 * columns + 2e-4 * rows).astype(np.float32)
    assert rough_share(depth_m) == 0.0
    depth_m[10:50:10, 10:70:10] += 0.02
    depth_m[:, 75:] = np.nan
    assert rough_share(depth_m) == pytest.approx(24 / (60 * 75))


def test_local_median_is_numpys() -> None:
    depth_m = np.random.default_rng(1).normal(1.0, 0.1, (40, 50)).astype(np.float32)
    depth_m[3:9, 20:30] = np.nan
    medians = local_median(depth_m)
    for row, column in ((0, 0), (12, 25), (39, 49), (20, 3)):
        window = depth_m[max(row - 7, 0) : row + 8, max(column - 7, 0) : column + 8]
        assert medians[row, column] == np.nanmedian(window)
    assert np.isnan(medians[5, 25])


class StubCapture:
    """The parts of a capture that the modulation is worked out from."""

    def __init__(self, pattern: FringePattern, frames: list[np.ndarray]) -> None:
        self.pattern, self.frame_count, self._frames = pattern, len(frames), np.stack(frames)

    def step_index(self, frame: int) -> int:
        return frame % self.pattern.step_count

    def stack(self) -> tuple[np.ndarray, np.ndarray]:
        return self._frames, self._frames


@pytest.mark.parametrize(("steps", "tolerance"), [(4, 0.5), (3, 0.5), (1, 1.5)])
def test_modulation_is_the_amplitude(steps: int, tolerance: float) -> None:
    # Tolerances in grey levels: rounding to whole levels; one frame: a window that is not a whole number of periods.
    pattern = FringePattern(16.0).with_equal_steps(steps)
    columns = np.broadcast_to(np.arange(200.0), (40, 200))
    frames = [np.round(100 + 40 * pattern.signal(columns, step)).astype(np.uint8) for step in range(steps)]
    amplitude = modulation(StubCapture(pattern, frames))  # type: ignore[arg-type]
    assert np.abs(amplitude[:, 20:-20] - 40).max() < tolerance


@pytest.mark.parametrize("method", ["phase_shift", "dense"])
def test_the_real_hand_is_a_smooth_hand(capture_folder: Path, method: str) -> None:
    capture = read_capture(capture_folder)
    left, right = capture.stack()
    sensor = Reconstructor(capture.rig, capture.pattern, capture.depth_range_m, method=method)
    shots = [
        sensor.reconstruct(left[first : first + 5], right[first : first + 5], first)
        if method == "phase_shift"
        else sensor.reconstruct(left[first], right[first], first)
        for first in range(4)
    ]
    result = score_capture([shot.depth_m for shot in shots], method, capture)
    assert result.complaints() == []
    assert 0.44 < result.nearest_m < result.farthest_m < 0.52


def test_a_bad_capture_is_named() -> None:
    good = CaptureResult("dense", 0.9, 0.45, 0.5, 0.01, (0.4, 0.56))
    assert good.complaints() == []
    assert "0.799 of the well modulated" in replace(good, coverage=0.799).complaints()[0]
    assert "outside 0.4 to 0.56 m" in replace(good, farthest_m=0.57).complaints()[0]
    assert "outside" in replace(good, nearest_m=float("nan")).complaints()[0]
    assert "rough" in replace(good, rough_share=0.03).complaints()[0]


def test_foreign_output_folder_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "demo").mkdir()
    (tmp_path / "demo" / "thesis.txt").write_text("precious")
    with pytest.raises(DemoError, match="move it away"):
        demo_run.prepare(tmp_path / "demo")
    assert (tmp_path / "demo" / "thesis.txt").read_text() == "precious"
    demo_run.prepare(tmp_path / "mine")
    demo_run.prepare(tmp_path / "mine")


def test_report_is_one_file_with_table_pictures_and_points(tmp_path: Path, capture: HeadCapture) -> None:
    outcome = Outcome(RUN, Recording(tmp_path / "bag", 20, COUNTS, [0.05, 0.07]),
                      result_of(capture.depth_m, capture), ("something is wrong",))  # fmt: skip
    order = capture.pattern.order_at(np.zeros(capture.depth_m.shape))
    points_m = capture.rig.points(capture.depth_m)
    view = View("a <plane>", capture.left, capture.right, order, capture.depth_m, np.zeros_like(capture.depth_m),
                "error", 2.0, points_m)  # fmt: skip
    (tmp_path / RUN.name).mkdir()
    draw_overview(view, tmp_path / RUN.name / "overview.png")
    page = write_report(tmp_path, [(outcome, view)]).read_text()
    assert "Not right: flat_board." in page
    assert "something is wrong" in page
    assert "flat_board  dense   20" in as_text([outcome])
    assert not re.search(r"(src|href)=\"?https?:", page)
    clouds = json.loads(re.search(r'type="application/json">(.*?)</script>', page, re.DOTALL)[1])  # type: ignore[index]
    assert clouds[0]["title"] == "a <plane>"
    known = np.isfinite(points_m[::2, ::2, 2]).sum()
    assert len(clouds[0]["grey"]) == 4 * -(-known // 3)


def test_a_scene_through_both_nodes_ends_right(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["demo"])
    monkeypatch.setattr(demo_run, "isolate_ros", StringIO)  # this test run is isolated already
    monkeypatch.setattr(demo_run, "scene_names", lambda: ("flat_board",))
    # So few that no machine has to supersede one: the queue of the demo's reconstruction holds ten.
    monkeypatch.setattr(demo_run, "SCENE_EXPOSURES", 3)
    monkeypatch.setattr(demo_run, "RATE_HZ", 2.0)
    assert demo_run.main() == 0
    printed = capsys.readouterr().out
    assert re.search(r"flat_board +dense +3 +3 +3 +0 .* right\n", printed)
    assert {path.name for path in (tmp_path / "demo").iterdir()} == {"COLCON_IGNORE", "flat_board", "report.html"}
    assert (tmp_path / "demo/flat_board/bag/metadata.yaml").is_file()
    assert (tmp_path / "demo/flat_board/overview.png").stat().st_size > 50_000


def test_what_is_not_right_ends_with_1_and_the_reason(
    tmp_path: Path, capture: HeadCapture, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    result = result_of(capture.depth_m, capture)
    wrong = Outcome(RUN, Recording(tmp_path / "bag", 20, COUNTS, [0.05]), result, ("something is wrong",))
    monkeypatch.setattr(demo_run, "write_report", lambda output, outcomes: output / "report.html")
    right = replace(wrong, complaints=())
    assert demo_run.conclude([(right, None)]) == 0  # type: ignore[list-item]
    assert demo_run.conclude([(right, None), (wrong, None)]) == 1  # type: ignore[list-item]
    assert capsys.readouterr().err == "demo: not right: flat_board, something is wrong\n"


def test_bad_capture_folder_ends_the_demo_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.argv", ["demo", "--capture", "nowhere"])
    assert demo_run.main() == 1
    assert re.fullmatch(r"demo: .*nowhere.*\n", capsys.readouterr().err)


@pytest.mark.parametrize(
    ("steps", "frames", "methods"),
    [(4, 8, ["phase_shift", "dense"]), (4, 5, ["phase_shift", "dense"]), (4, 4, ["dense"]), (1, 9, ["dense"])],
)
def test_capture_methods_fit_the_frames(steps: int, frames: int, methods: list[str]) -> None:
    capture = StubCapture(FringePattern(16.0).with_equal_steps(steps), [np.zeros((2, 2))] * frames)
    assert demo_run.capture_methods(capture) == methods  # type: ignore[arg-type]
