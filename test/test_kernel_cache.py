"""Compiled kernels on disk: gone as soon as anything they were made from has changed, kept as long as it has not."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from moire_sensor.kernel_cache import STAMP, forget_outdated

HELPER = "from numba import njit\n\n\n@njit(inline='always')\ndef factor():\n    return {factor}\n"
KERNEL = (
    "from numba import njit\n\nfrom waves.helper import factor\n\n\n"
    "@njit(cache=True)\ndef times(value):\n    return factor() * value\n"
)
RUN = (
    "import sys\nfrom pathlib import Path\nsys.path[:0] = sys.argv[1:2]\n"
    "from waves.kernel import times\nfrom moire_sensor.kernel_cache import forget_outdated\n"
    "forgotten = forget_outdated(times, Path(sys.argv[1]) / 'waves')\n"
    "print(times(2), sum(times.stats.cache_hits.values()), sorted(forgotten))\n"
)


def write(folder: Path, **texts: str) -> Path:
    package = folder / "waves"
    package.mkdir(exist_ok=True)
    for name, text in texts.items():
        (package / f"{name}.py").write_text(text)
    return package


def run(folder: Path) -> str:
    done = subprocess.run([sys.executable, "-c", RUN, str(folder)], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_a_changed_helper_of_another_file_changes_the_kernel(tmp_path: Path) -> None:
    write(tmp_path, __init__="", helper=HELPER.format(factor=3), kernel=KERNEL)
    assert run(tmp_path) == "6 0 ['__init__', 'helper', 'kernel']"
    assert run(tmp_path) == "6 1 []"
    write(tmp_path, helper=HELPER.format(factor=5))
    assert run(tmp_path) == "10 0 ['helper', 'kernel']"


def kept_kernels(folder: Path) -> tuple[object, Path, set[str]]:
    """A kernel that tells of a folder, the folder, and the files of three modules' kernels in it."""
    kept = folder / "kept"
    kept.mkdir(exist_ok=True)
    names = {f"{name}.f-3.py312.{ending}" for name in ("far", "near", "alone") for ending in ("nbi", "1.nbc")}
    for name in names:
        (kept / name).write_bytes(b"kernel")
    return SimpleNamespace(stats=SimpleNamespace(cache_path=str(kept))), kept, names


def left(kept: Path) -> set[str]:
    return {path.name for path in kept.glob("*.nb[ic]")}


@pytest.fixture
def package(tmp_path: Path) -> Path:
    near = "from waves.far import (\n    b,\n)\n"
    return write(tmp_path, far="b = 1\n", near=near, alone="from numpy import far\n")


def test_only_what_hangs_on_the_change_is_forgotten(tmp_path: Path, package: Path) -> None:
    kernel, kept, _ = kept_kernels(tmp_path)
    assert forget_outdated(kernel, package) == {"far", "near", "alone"}
    assert left(kept) == set()
    kernel, kept, names = kept_kernels(tmp_path)
    assert forget_outdated(kernel, package) == set()
    assert left(kept) == names
    write(tmp_path, far="b = 2\n")
    assert forget_outdated(kernel, package) == {"far", "near"}
    assert left(kept) == {name for name in names if name.startswith("alone")}


@pytest.mark.parametrize("text", ["{", "[1]", "\x00"])
def test_a_damaged_stamp_is_as_good_as_none(tmp_path: Path, package: Path, text: str) -> None:
    kernel, kept, _ = kept_kernels(tmp_path)
    (kept / STAMP).write_text(text)
    assert forget_outdated(kernel, package) == {"far", "near", "alone"}
    assert left(kept) == set()
    assert set(json.loads((kept / STAMP).read_text())) == {"far", "near", "alone"}


def test_what_is_not_kept_is_not_looked_at(tmp_path: Path, package: Path) -> None:
    assert forget_outdated(len, package) == set()
    assert forget_outdated(SimpleNamespace(stats=SimpleNamespace(cache_path=None)), package) == set()


def test_a_folder_that_cannot_be_written_is_a_warning(tmp_path: Path, package: Path) -> None:
    (tmp_path / "kept").write_text("a file where a folder should be")
    kernel = SimpleNamespace(stats=SimpleNamespace(cache_path=str(tmp_path / "kept")))
    with pytest.warns(RuntimeWarning, match="old compiled kernels may run"):
        forget_outdated(kernel, package)
