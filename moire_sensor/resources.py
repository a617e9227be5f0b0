"""Where files needed at run time lie: in the checkout, or under ``share/`` of an installation."""

from __future__ import annotations

from pathlib import Path

from moire_sensor.errors import MoireError

PACKAGE = "moire_sensor"


def resource_path(name: str) -> Path:
    """Return the path of a file such as ``"urdf/head.urdf"`` or ``"config/fastdds.xml"``.

    A checkout (also one that is installed editable or with ``colcon build --symlink-install``) comes first, then
    ``share/moire_sensor`` of the prefix that this package is installed under.

    Raises
    ------
    MoireError
        No such file in any of these folders.
    """
    folders = [folder for parent in Path(__file__).resolve().parents for folder in (parent, parent / "share" / PACKAGE)]
    for folder in folders:
        if (folder / "package.xml").is_file() and (folder / name).is_file():
            return folder / name
    raise MoireError(
        f"the file {name} of {PACKAGE} was found neither in a checkout nor under share/{PACKAGE} around "
        f"{Path(__file__).parent}; install the package again with make setup or colcon build"
    )
