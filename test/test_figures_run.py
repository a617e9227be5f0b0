"""The page of the paper's experiments: written, linked, small; and a capture in the same layout."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from PIL import Image

from moire_sensor.paper_rig import PROJECTOR_SIZE, paper_pattern
from moire_sim.analytic_scenes import analytic_capture
from tools.figures import gratings, real_capture, rig_plan, run, speed_up
from tools.figures.page import write_page
from tools.figures.stage import rig_of_rows

DOCS = Path(__file__).parents[1] / "docs"
LINK = re.compile(r"!\[[^\]]*\]\(([^)]+)\)")


@pytest.fixture
def capture_of_waves(tmp_path: Path) -> Path:
    """A capture folder of five frames, few rows."""
    rig = rig_of_rows(96)
    made = analytic_capture("waves", paper_pattern(4), rig=rig, projector_size=PROJECTOR_SIZE)
    folder = tmp_path / "capture"
    folder.mkdir()
    for frame in range(5):
        cv2.imwrite(str(folder / f"left_{frame:02d}.png"), made.left[frame % 4])
        cv2.imwrite(str(folder / f"right_{frame:02d}.png"), made.right[frame % 4])
    content = {
        "image_size": list(rig.image_size),
        "pattern": {"period_px": made.pattern.period_px, "step_phases_rad": list(made.pattern.step_phases_rad)},
        "depth_range_m": [0.8, 1.3],
        "projections": {
            name: matrix.tolist()
            for name, matrix in (("left", rig.P_left), ("right", rig.P_right), ("projector", rig.P_projector))
        },
    }
    (folder / "rig.yaml").write_text(yaml.safe_dump(content))
    return folder


def test_page_holds_claims_tables_and_pictures(tmp_path: Path) -> None:
    write_page([rig_plan.experiment(rig_plan.measure()), gratings.experiment(gratings.measure(60))], tmp_path)
    page = (tmp_path / "figures.md").read_text()
    assert "| 8 | fringes of 20 mm on the reference plane at 1500 mm | 20.00 mm" in page
    assert "### Common view" in page
    pictures = LINK.findall(page)
    assert len(pictures) == 2
    for picture in pictures:
        with Image.open(tmp_path / picture) as image:
            assert np.ptp(np.asarray(image.convert("L"))) > 200


def test_times_are_told_with_their_gain() -> None:
    results = speed_up.measure(rig_of_rows(32), rows=(1, 4), repeats=1)
    assert all(one.match_ms > 0.0 and one.whole_ms > 0.0 for one in results)
    told = speed_up.experiment(results)
    assert f"{results[0].match_ms / min(one.match_ms for one in results):.1f} x" in told.claims[0].measured


def test_matching_alone_is_what_the_whole_method_does() -> None:
    made = analytic_capture("cylinder_and_box", rig=rig_of_rows(32), projector_size=PROJECTOR_SIZE)
    matches = speed_up.matching(made, 4)()
    known = np.isfinite(speed_up.solved(made, 4).depth_m)
    # The whole method drops matches without company and adds none.
    rows = (matches.partner >= 0).sum(axis=1)
    assert (known.sum(axis=1) <= rows).all()
    assert known.sum() > 0.95 * rows.sum()


def test_capture_in_the_same_layout(capture_of_waves: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run.main(["--capture", str(capture_of_waves), "--output", str(tmp_path)]) == 0
    page = (tmp_path / "figures.md").read_text()
    assert "| dense |" in page
    assert (tmp_path / LINK.findall(page)[0]).is_file()
    assert "The recorded capture" in capsys.readouterr().out


def test_methods_agree_on_a_capture(capture_of_waves: Path) -> None:
    result = real_capture.measure(capture_of_waves)
    assert real_capture.middle_frame(result.capture) == 2
    for method in ("fringe_edges", "dense"):
        # Noise of the phase steps at 1 m, 0.33 mm in the median (0.8 mm sigma), and of an edge.
        assert np.nanmedian(np.abs(result.difference_mm(method))) < 0.8
        assert abs(np.median(real_capture.shift_px(result, method))) < 0.02


def test_a_folder_that_is_no_capture_is_told_in_a_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run.main(["--capture", str(tmp_path / "none")]) == 1
    (line,) = [text for text in capsys.readouterr().err.splitlines() if text.startswith("figures:")]
    assert "there is no folder" in line


def test_committed_page_and_pictures_belong_together_and_are_small() -> None:
    linked = {DOCS / picture for picture in LINK.findall((DOCS / "figures.md").read_text())}
    present = set((DOCS / "images" / "figures").glob("*.png"))
    assert linked == present
    assert len(linked) == len(run.PAPER)
    sizes = [path.stat().st_size for path in present]
    assert max(sizes) < 300_000
    assert sum(sizes) < 2_000_000
