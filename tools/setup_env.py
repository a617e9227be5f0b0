"""Make the virtual environment ``.venv``; does nothing when it is fresh. Needs the standard library only.

Written for Python 3.6 and newer, so that an old interpreter is told what is wrong instead of failing to parse.
"""

import argparse
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Dict, List, Optional, Tuple

Stamp = Dict[str, str]

ROOT = Path(__file__).resolve().parent.parent
VENV = ROOT / ".venv"
STAMP = VENV / "moire_setup.json"
LOG = ROOT / ".setup.log"
OLDEST, NEWEST = (3, 11), (3, 13)
ROS_DISTRO = "jazzy"
ROS_WHEELS = ["ros-jazzy-rclpy", "ros-jazzy-common-interfaces", "ros-jazzy-rmw-fastrtps-cpp"]
OLDEST_GLIBC = (2, 28)
PACKAGE_FILES = ["package.xml", "setup.py", "setup.cfg", "tools/setup_env.py"]
DATA_FOLDERS = ["config", "launch", "rviz", "urdf"]
# Run at each start of the environment's interpreter: the ROS resource index looks only where this variable points.
AMENT_PTH = (
    "import os, sys; p = os.environ.get('AMENT_PREFIX_PATH', '').split(os.pathsep); os.environ['AMENT_PREFIX_PATH'] = "
    "os.pathsep.join(q for q in ([] if sys.prefix in p else [sys.prefix]) + p if q)\n"
)


class SetupError(Exception):
    """What is missing, and what to do, in one sentence."""


def main() -> int:
    """Make or refresh the environment; exit code 1 with one sentence when something is missing."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--selected", action="store_true", help="this interpreter was asked for by name")
    selected = parser.parse_args().selected
    try:
        stamp = read_stamp()
        if not selected and stamp and stamp["python"] != sys.executable and os.access(stamp["python"], os.X_OK):
            os.execv(stamp["python"], [stamp["python"], str(Path(__file__).resolve())])
        ros = find_ros()
        wanted = {
            "python": sys.executable,
            "version": platform.python_version(),
            "folder": str(VENV),
            "ros": ros,
            "files": fingerprint(),
        }
        if stamp != wanted:
            check_interpreter(ros)
            build(wanted, stamp)
    except SetupError as error:
        print("set-up: " + str(error), file=sys.stderr)
        return 1
    return 0


def read_stamp() -> Optional[Stamp]:
    """Return what the environment was made from, or None when there is no whole one."""
    try:
        stamp: Stamp = json.loads(STAMP.read_text())
    except (OSError, ValueError):
        return None
    return stamp


def fingerprint() -> str:
    """Digest of what decides the installation; code is installed editable, so only the list of packages counts."""
    digest = hashlib.sha256()
    packages = sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("moire_*/**/__init__.py"))
    digest.update("\0".join(packages).encode())
    for name in PACKAGE_FILES:
        digest.update((ROOT / name).read_bytes() + b"\0")
    return digest.hexdigest()


def find_ros() -> str:
    """Return the prefixes of a sourced ROS 2 Jazzy, or "wheels"."""
    distro = os.environ.get("ROS_DISTRO", "")
    if not distro:
        return "wheels"
    if distro != ROS_DISTRO:
        raise SetupError(
            f"ROS 2 {distro} is sourced, but {ROS_DISTRO} is needed; source that, or use a terminal without ROS"
        )
    if subprocess.run([sys.executable, "-c", "import rclpy"], stderr=subprocess.DEVNULL).returncode:
        raise SetupError(
            f"ROS 2 {distro} is sourced, but Python {platform.python_version()} ({sys.executable}) cannot import its "
            "rclpy; choose ROS's own interpreter with PYTHON=/usr/bin/python3, or use a terminal without ROS"
        )
    return os.environ.get("AMENT_PREFIX_PATH", distro)


def check_interpreter(ros: str) -> None:
    """Raise SetupError when this interpreter or machine cannot carry the environment."""
    if not OLDEST <= sys.version_info[:2] <= NEWEST:
        age = "old" if sys.version_info[:2] < OLDEST else "new"
        raise SetupError(
            f"Python {platform.python_version()} ({sys.executable}) is too {age}; Python 3.11 to 3.13 is needed: "
            "install one and name it, for example PYTHON=python3.12 make setup"
        )
    missing = [name for name in ("venv", "ensurepip") if not importable(name)]
    if missing:
        raise SetupError(
            f"Python {platform.python_version()} ({sys.executable}) lacks the module {' and '.join(missing)}; "
            "install it, on Debian and Ubuntu with: apt install python3-venv"
        )
    if ros == "wheels":
        check_wheels_exist(sys.platform, platform.machine(), platform.libc_ver())


def check_wheels_exist(system: str, machine: str, libc: Tuple[str, str]) -> None:
    """Raise SetupError where the registry has no ROS 2 wheels: they are made for Linux on x86_64 with glibc."""
    name, version = libc
    glibc = tuple(int(part) for part in version.split(".")[:2]) if name == "glibc" else (0, 0)
    if system != "linux" or machine != "x86_64" or glibc < OLDEST_GLIBC:
        raise SetupError(
            f"there are no ROS 2 wheels for {system} {machine} {name} {version} (only for Linux x86_64 with glibc 2.28 "
            "or newer); install ROS 2 Jazzy, source its setup.bash and run this again"
        )


def importable(module: str) -> bool:
    """Tell whether this interpreter has a module."""
    return subprocess.run([sys.executable, "-c", "import " + module], stderr=subprocess.DEVNULL).returncode == 0


def build(wanted: Stamp, stamp: Optional[Stamp]) -> None:
    """Make the environment anew, or install again into it when only package files changed."""
    same = ("python", "version", "folder", "ros")
    if not stamp or any(stamp.get(key) != wanted[key] for key in same):
        shutil.rmtree(VENV, ignore_errors=True)
        print("set-up: making .venv with Python " + wanted["version"], flush=True)
        options = [] if wanted["ros"] == "wheels" else ["--system-site-packages"]
        run([sys.executable, "-m", "venv", *options, str(VENV)])
    if STAMP.exists():
        STAMP.unlink()
    (VENV / "COLCON_IGNORE").touch()
    constraints = ros_constraints(wanted["ros"])
    ros_wheels = ROS_WHEELS if wanted["ros"] == "wheels" else []
    print("set-up: installing the libraries, about a minute the first time", flush=True)
    run([venv_python(), "-m", "pip", "install", "-q", *constraints, *ros_wheels, "-e", str(ROOT) + "[dev,docs,viewer]"])
    link_for_ros()
    STAMP.write_text(json.dumps(wanted))
    print("set-up: ready", flush=True)


def venv_python() -> str:
    """Path of the environment's interpreter."""
    return str(VENV / "bin" / "python")


def ros_constraints(ros: str) -> List[str]:
    """Pip options that suit a sourced ROS: the numpy its message types were compiled against, and a pytest that its
    launch_testing plug-in, loaded by every test run, can work with."""
    if ros == "wheels":
        return []
    found = subprocess.run([sys.executable, "-c", "import numpy; print(numpy.__version__)"], stdout=subprocess.PIPE)
    path = VENV / "constraints.txt"
    path.write_text(f"numpy=={found.stdout.decode().strip()}\npytest<9\n")
    return ["-c", str(path)]


def link_for_ros() -> None:
    """Lay out the environment as ROS expects a prefix: ``lib/`` for ``ros2 run``, ``share/`` and the resource index.

    Links, so that a changed launch file or URDF needs no new set-up; pip does not know them and never removes a target.
    """
    site_packages = next((VENV / "lib").glob("python3*/site-packages"))
    (site_packages / "moire_sensor_ament.pth").write_text(AMENT_PTH)
    entries = next(site_packages.glob("moire_sensor-*.dist-info")) / "entry_points.txt"
    lines = [line.partition(" = ") for line in entries.read_text().splitlines()]
    links = {"lib/moire_sensor/" + name: VENV / "bin" / name for name, separator, _ in lines if separator}
    links.update({"share/moire_sensor/" + name: ROOT / name for name in ["package.xml", *DATA_FOLDERS]})
    links["share/ament_index/resource_index/packages/moire_sensor"] = ROOT / "resource" / "moire_sensor"
    for folder in ("lib", "share"):
        shutil.rmtree(str(VENV / folder / "moire_sensor"), ignore_errors=True)
    for name, target in links.items():
        link = VENV / name
        link.parent.mkdir(parents=True, exist_ok=True)
        if link.is_symlink():
            link.unlink()
        link.symlink_to(target)


def run(command: List[str]) -> None:
    """Run a command with its output in the log; raise SetupError with its last error line when it fails."""
    with LOG.open("a") as log:
        log.write("$ " + " ".join(command) + "\n")
        log.flush()
        done = subprocess.run(command, stdout=log, stderr=subprocess.PIPE, universal_newlines=True)
        log.write(done.stderr)
    if done.returncode:
        lines = [line for line in done.stderr.splitlines() if line.startswith("ERROR")] or done.stderr.splitlines()
        reason = lines[-1] if lines else f"exit code {done.returncode}"
        raise SetupError(f"{' '.join(command[1:4])} failed: {reason} (the whole output is in {LOG})")


if __name__ == "__main__":
    sys.exit(main())
