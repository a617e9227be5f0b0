"""metadata.yaml of a bag: a helpful hint, never trusted. The storage files alone tell what a bag holds."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import yaml

from moire_sensor.errors import CaptureError

FILE = "metadata.yaml"
ROOT = "rosbag2_bagfile_information"
# Enough for thousands of files. The fast loader of PyYAML is not used: deep nesting ends the process in it.
MAX_BYTES = 1 << 22
MAX_FILES = 100_000


@dataclass(frozen=True)
class Metadata:
    """Storage files in order, messages promised by topic, and free texts by name."""

    files: tuple[str, ...]
    counts: dict[str, int] = field(default_factory=dict)
    custom: dict[str, str] = field(default_factory=dict)


def read_metadata(folder: Path) -> Metadata:
    """Return what the metadata of a bag say.

    Raises
    ------
    CaptureError
        A file that is missing, too large, or does not describe a bag.
    """
    information = load(folder)
    try:
        # Only names: a path that leads out of the folder is not followed. Old bags name the folder too.
        files = tuple(PurePosixPath(str(name)).name for name in information["relative_file_paths"][:MAX_FILES])
        counts: dict[str, int] = {}
        for topic in information["topics_with_message_count"]:
            name = str(topic["topic_metadata"]["name"])
            counts[name] = counts.get(name, 0) + int(topic["message_count"])
        custom = {str(key): str(text) for key, text in (information.get("custom_data") or {}).items()}
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise CaptureError(f"{folder / FILE} does not describe a bag: {error!r}") from error
    return Metadata(files, counts, custom)


def load(folder: Path) -> dict[str, Any]:
    """Return the content of a metadata file; raises CaptureError."""
    path = folder / FILE
    try:
        size = path.stat().st_size
        if size > MAX_BYTES:
            raise CaptureError(f"{path} has {size} bytes; at most {MAX_BYTES} are read")
        content = yaml.safe_load(path.read_text(encoding="utf-8"))
        information = content[ROOT]
    except (OSError, ValueError, yaml.YAMLError, RecursionError, KeyError, TypeError) as error:
        text = " ".join(str(error).split())
        raise CaptureError(f"{path} cannot be read: {type(error).__name__} {text}") from error
    if not isinstance(information, dict):
        raise CaptureError(f"{path} does not describe a bag")
    return information
