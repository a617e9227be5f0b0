"""The package as pip, colcon and rosdep see it."""

from __future__ import annotations

import ast
import shutil
import signal
import subprocess
import sys
import sysconfig
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from source_scan import ROOT, ROS_PACKAGES, imported_packages, python_files

from moire_sensor.errors import MoireError
from moire_sensor.resources import resource_path
from tools import setup_env

# rosdep key -> name on the Python package index.
PIP_NAMES = {
    "python3-colcon-common-extensions": {"colcon-common-extensions"},
    "python3-hypothesis": {"hypothesis"},
    "python3-matplotlib": {"matplotlib"},
    "python3-mypy": {"mypy"},
    "python3-numba": {"numba"},
    "python3-numpy": {"numpy"},
    "python3-opencv": {"opencv-python-headless"},
    "python3-pybullet-pip": {"pybullet", "pybullet-arm64"},
    "python3-pytest": {"pytest"},
    "python3-pytest-xdist": {"pytest-xdist"},
    "python3-rosbags-pip": {"rosbags"},
    "python3-ruff-pip": {"ruff"},
    "python3-tqdm": {"tqdm"},
    "python3-types-pyyaml": {"types-PyYAML"},
    "python3-yaml": {"PyYAML"},
}


def setup_constant(name: str) -> list[str]:
    for node in ast.parse((ROOT / "setup.py").read_text()).body:
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == name:
            return list(ast.literal_eval(node.value))
    raise AssertionError(f"setup.py has no {name}")


def manifest(tag: str) -> set[str]:
    return {element.text or "" for element in ET.parse(ROOT / "package.xml").getroot().iter(tag)}


def pip_names(requirements: list[str]) -> set[str]:
    return {requirement.partition(";")[0].partition(">")[0].strip() for requirement in requirements}


@pytest.mark.parametrize(
    ("constant", "tag"), [("INSTALL_REQUIRES", "exec_depend"), ("DEV_REQUIRES", "test_depend")]
)
def test_pip_and_rosdep_dependencies_agree(constant: str, tag: str) -> None:
    keys = {key for key in manifest(tag) if key.startswith("python3-")}
    assert set().union(*(PIP_NAMES[key] for key in keys)) == pip_names(setup_constant(constant))


def test_imported_ros_packages_are_declared() -> None:
    files = python_files("moire_sensor") + python_files("moire_sim") + python_files("launch")
    used = set().union(*map(imported_packages, files)) & ROS_PACKAGES
    assert used <= manifest("exec_depend")


def executables() -> dict[str, str]:
    return dict(line.split(" = ") for line in setup_constant("EXECUTABLES"))


def test_executables_are_installed_and_their_functions_exist() -> None:
    scripts = Path(sysconfig.get_path("scripts"))
    assert {"virtual_head", "reconstruction", "capture_player", "record_bag"} <= set(executables())
    for name, target in executables().items():
        module, _, function = target.partition(":")
        assert (scripts / name).is_file(), f"{name} is not in {scripts}: run make setup"
        tree = ast.parse((ROOT / (module.replace(".", "/") + ".py")).read_text())
        assert function in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


# Sends a signal when the first of the package's slow modules is looked for.
INTERRUPTED = """
import os, sys
from moire_commands import start

class Interrupter:
    def find_spec(self, name, path=None, target=None):
        os.kill(os.getpid(), {number})

sys.meta_path.insert(0, Interrupter())
sys.exit(start.reconstruction())
"""


@pytest.mark.parametrize("number", [int(signal.SIGINT), int(signal.SIGTERM)])
def test_a_signal_while_an_executable_imports_ends_it_with_0(number: int) -> None:
    done = subprocess.run([sys.executable, "-c", INTERRUPTED.format(number=number)], capture_output=True, text=True,
                          check=False, cwd=ROOT)  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")


@pytest.fixture(scope="module")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build this package with colcon in a workspace of its own."""
    colcon = Path(sysconfig.get_path("scripts")) / "colcon"
    if not colcon.is_file():
        pytest.skip("colcon is not installed in this environment")
    folder = tmp_path_factory.mktemp("workspace")
    data = [name for name in setup_constant("DATA_FOLDERS") if (ROOT / name).is_dir()]
    for name in ["moire_commands", "moire_sensor", "moire_sim", "resource", *data]:
        ignored = shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / name, folder / "src" / "moire_sensor" / name, ignore=ignored, dirs_exist_ok=True)
    for name in ["package.xml", "setup.py", "setup.cfg", "pyproject.toml", "LICENSE"]:
        shutil.copy(ROOT / name, folder / "src" / "moire_sensor" / name)
    for arguments in (["list"], ["build"]):
        done = subprocess.run([str(colcon), *arguments], cwd=folder, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        (folder / f"{arguments[0]}.txt").write_text(done.stdout)
    return folder


def test_colcon_sees_an_ament_python_package(workspace: Path) -> None:
    assert (workspace / "list.txt").read_text().split() == ["moire_sensor", "src/moire_sensor", "(ros.ament_python)"]


def test_colcon_installs_executables_and_resources(workspace: Path) -> None:
    prefix = workspace / "install" / "moire_sensor"
    assert {path.name for path in (prefix / "lib" / "moire_sensor").iterdir()} == set(executables())
    assert (prefix / "share/ament_index/resource_index/packages/moire_sensor").is_file()
    for folder in setup_constant("DATA_FOLDERS"):
        wanted = {path.name for path in (ROOT / folder).glob("*.*")}
        installed = (prefix / "share" / "moire_sensor" / folder).iterdir()
        assert {path.name for path in installed if path.is_file()} == wanted


def test_resources_are_found_in_the_colcon_install(workspace: Path) -> None:
    prefix = workspace / "install" / "moire_sensor"
    site_packages = next((prefix / "lib").glob("python3*/site-packages"))
    code = "from moire_sensor.resources import resource_path; print(resource_path('package.xml'))"
    done = subprocess.run(
        [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(site_packages)!r}); {code}"],
        cwd=workspace, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert Path(done.stdout.strip()) == prefix / "share" / "moire_sensor" / "package.xml"


def test_resources_are_found_in_the_checkout() -> None:
    assert resource_path("package.xml") == ROOT / "package.xml"
    with pytest.raises(MoireError, match=r"urdf/no_such\.urdf .* make setup or colcon build"):
        resource_path("urdf/no_such.urdf")


def test_setup_names_a_wrong_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(setup_env, "OLDEST", (3, 99))
    with pytest.raises(setup_env.SetupError, match=r"is too old; Python 3\.11 to 3\.13 is needed"):
        setup_env.check_interpreter("wheels")
    monkeypatch.setattr(setup_env, "OLDEST", (3, 1))
    monkeypatch.setattr(setup_env, "NEWEST", (3, 2))
    with pytest.raises(setup_env.SetupError, match="is too new"):
        setup_env.check_interpreter("wheels")


def test_setup_names_a_missing_module(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(setup_env, "importable", lambda module: module != "ensurepip")
    with pytest.raises(setup_env.SetupError, match=r"lacks the module ensurepip; .*apt install python3-venv"):
        setup_env.check_interpreter("wheels")


@pytest.mark.parametrize(
    ("system", "machine", "libc"),
    [("linux", "aarch64", ("glibc", "2.36")), ("linux", "x86_64", ("glibc", "2.27")), ("darwin", "x86_64", ("", ""))],
)
def test_setup_names_a_machine_without_wheels(system: str, machine: str, libc: tuple[str, str]) -> None:
    with pytest.raises(setup_env.SetupError, match=rf"no ROS 2 wheels for {system} {machine} .*source its setup\.bash"):
        setup_env.check_wheels_exist(system, machine, libc)


def test_setup_accepts_a_machine_with_wheels() -> None:
    setup_env.check_wheels_exist("linux", "x86_64", ("glibc", "2.28"))


@pytest.mark.parametrize(
    ("distro", "message"), [("humble", "jazzy is needed"), ("jazzy", "cannot import its rclpy")]
)
def test_setup_names_an_unusable_ros(tmp_path: Path, distro: str, message: str) -> None:
    bare = tmp_path / "bare"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(bare)], check=True)
    done = subprocess.run(
        [str(bare / "bin" / "python"), str(ROOT / "tools" / "setup_env.py"), "--selected"],
        env={"ROS_DISTRO": distro, "PATH": "/usr/bin:/bin"}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert message in done.stderr
    assert done.stderr.count("\n") == 1


def test_setup_is_needed_again_only_when_package_files_change(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [*setup_env.PACKAGE_FILES, "moire_sensor/__init__.py", "moire_sensor/rig.py"]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    monkeypatch.setattr(setup_env, "ROOT", tmp_path)
    before = setup_env.fingerprint()
    (tmp_path / "moire_sensor" / "rig.py").write_text("changed = True\n")
    assert setup_env.fingerprint() == before
    (tmp_path / "setup.py").write_text("changed = True\n")
    assert setup_env.fingerprint() != before
