"""Installs moire_sensor for pip and for colcon (ament_python)."""

from glob import glob

from setuptools import find_packages, setup

PACKAGE = "moire_sensor"
# package.xml names the same libraries by their rosdep keys; test/test_package.py compares the two.
INSTALL_REQUIRES = [
    "numba",
    "numpy>=1.26",
    "opencv-python-headless",
    # The official wheels end with CPython 3.11; the maintained fork has 3.12 and 3.13.
    'pybullet; python_version < "3.12"',
    'pybullet-arm64; python_version >= "3.12"',
    "PyYAML",
    "rosbags>=0.11",
    "tqdm",
]
DEV_REQUIRES = [
    "colcon-common-extensions",
    "hypothesis",
    "matplotlib",
    "mypy",
    "pytest",
    "pytest-xdist",
    "ruff",
    "types-PyYAML",
]
# Not in package.xml: rosdep knows no key for it.
DOCS_REQUIRES = ["mkdocs-material"]
# Nor for this one; the viewer says so where it is missing.
VIEWER_REQUIRES = ["viser>=1.1.1"]
DATA_FOLDERS = ("config", "config/scenes", "launch", "rviz", "urdf")
EXECUTABLES = [
    "virtual_head = moire_commands.start:virtual_head",
    "reconstruction = moire_commands.start:reconstruction",
    "moire_demo = moire_commands.start:moire_demo",
    "capture_player = moire_commands.start:capture_player",
    "record_bag = moire_commands.start:record_bag",
    "reconstruct_bag = moire_commands.start:reconstruct_bag",
    "moire_viewer = moire_commands.start:moire_viewer",
]

setup(
    name=PACKAGE,
    version="0.1.0",
    packages=find_packages(include=["moire_commands", "moire_sensor", "moire_sensor.*", "moire_sim", "moire_sim.*"]),
    package_data={"moire_sensor": ["py.typed"], "moire_sim": ["py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (f"share/{PACKAGE}", ["package.xml"]),
        *((f"share/{PACKAGE}/{folder}", glob(f"{folder}/*.*")) for folder in DATA_FOLDERS),
    ],
    python_requires=">=3.11,<3.14",
    install_requires=INSTALL_REQUIRES,
    # reconstruct_bag --scheduler works on a Dask cluster.
    extras_require={"dev": DEV_REQUIRES, "docs": DOCS_REQUIRES, "viewer": VIEWER_REQUIRES, "cluster": ["distributed"]},
    zip_safe=False,
    maintainer="moire_sensor maintainers",
    maintainer_email="maintainers@example.org",
    description="Open fringe-projection 3D sensor for robots: depth from one stereo pair under projected fringes.",
    license="Apache-2.0",
    entry_points={"console_scripts": EXECUTABLES},
)
