"""Writes a rosbag2 folder in parts: what is committed stays readable whatever happens afterwards."""

from __future__ import annotations

import fcntl
import os
import shutil
import sqlite3
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from rclpy.qos import QoSProfile
from rosbags.interfaces import Connection
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.errors import WriterError
from rosbags.typesys import Stores, get_typestore

from moire_sensor.errors import CaptureError, SettingsError
from moire_sensor.ros.bag_metadata import FILE, ROOT, load
from moire_sensor.ros.bag_parts import BAG_VERSION, bag_quality, empty_information, merged
from moire_sensor.ros.bag_reader import storage_files

STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}
MEGABYTE = 1 << 20


class DiskFullError(CaptureError):
    """The disk has no room for more; what was written is complete once the writer is closed."""


@dataclass(frozen=True)
class Limits:
    """``part_bytes``: size from which a part is complete; ``reserve_bytes``: free space that is left on the disk."""

    part_bytes: int = 1024 * MEGABYTE
    reserve_bytes: int = 64 * MEGABYTE


class BagWriter:
    """One bag, written part by part; :meth:`commit` completes a part, and only whole parts belong to the bag.

    A part grows in a folder of its own inside the bag's, is moved up, and then named in metadata.yaml, which is
    replaced in one step.

    Parameters
    ----------
    folder : the bag; must not exist. With ``journal`` it may be empty, or hold such a bag, which is then continued.
    storage : ``"mcap"`` or ``"sqlite3"``.
    limits : when a part is complete, and when the disk counts as full.
    journal : name of the custom text by which a bag that was broken off is known as one to go on with.

    Raises
    ------
    SettingsError
        The folder holds something else or cannot be written.
    """

    def __init__(self, folder: Path, storage: str = "mcap", limits: Limits | None = None, journal: str = "") -> None:
        self.folder = folder
        self._limits = limits or Limits()
        self._storage = storage
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        self._part: Writer | None = None
        self._written = 0
        self._lock = -1
        try:
            self._information = information_of(folder, journal) or empty_information(storage)
            folder.mkdir(parents=True, exist_ok=bool(journal))
            self._lock = locked(folder)
            self._remove_leftovers()
            self.ensure_room()
        except OSError as error:
            raise SettingsError(f"cannot write a bag to {folder}: {error}; choose a new folder") from error

    @property
    def custom(self) -> dict[str, str]:
        """The texts of the last commit."""
        return dict(self._information.get("custom_data") or {})

    @property
    def is_due(self) -> bool:
        """Whether the part is as large as it should become."""
        return self._written >= self._limits.part_bytes

    def knows(self, type_name: str) -> bool:
        """Tell whether a message type is one of ROS 2 Jazzy, whose definition goes into the bag."""
        return type_name in self._typestore.fielddefs

    def ensure_room(self, coming_bytes: int = 0) -> None:
        """Raise DiskFullError where less space than the limits say is left for ``coming_bytes`` more."""
        free = shutil.disk_usage(self.folder).free
        if free < self._limits.reserve_bytes + coming_bytes:
            raise DiskFullError(
                f"the disk of {self.folder} is full: {free // MEGABYTE} MB are left, "
                f"{self._limits.reserve_bytes // MEGABYTE} MB are kept free; what was written before is whole"
            )

    def write(self, topic: str, type_name: str, qualities: Sequence[QoSProfile], time_ns: int, data: bytes) -> None:
        """Append a serialised message; ``qualities`` are what its publishers offer.

        Raises
        ------
        CaptureError
            The file cannot be written; the part is broken off, the ones before it are whole.
        """
        try:
            connection = self._connections.get(topic) or self._connect(topic, type_name, qualities)
            if self._part is not None:
                self._part.write(connection, time_ns, data)
        except (OSError, sqlite3.Error, WriterError) as error:
            raise self._lost(error) from error
        self._written += len(data)

    def commit(self, custom: dict[str, str] | None = None) -> None:
        """Complete the part, and name it in the metadata, with ``custom`` texts; raises CaptureError."""
        try:
            if self._part is not None or not self._information["files"]:
                part = self._part or self._begin()
                part.close()
                self._adopt(part.path)
            self.note(custom or self.custom)
        except (OSError, sqlite3.Error, WriterError) as error:
            raise self._lost(error) from error
        self._part = None
        self._connections.clear()
        self._written = 0

    def note(self, custom: dict[str, str]) -> None:
        """Write the metadata of the parts so far, with these texts."""
        self._information["custom_data"] = custom or None
        path = self.folder / FILE
        draft = path.with_suffix(".tmp")
        draft.write_text(yaml.safe_dump({ROOT: self._information}, sort_keys=False), encoding="utf-8")
        draft.replace(path)

    def close(self) -> None:
        """Drop what is not committed, and let others write to the folder."""
        self.abandon()
        if self._lock >= 0:
            os.close(self._lock)
            self._lock = -1

    def abandon(self) -> None:
        """Drop the part that is not committed, and give its space back."""
        self._break_off()
        self._remove_leftovers()

    def _begin(self) -> Writer:
        """Begin a part."""
        self._part = Writer(self._part_folder(), version=BAG_VERSION, storage_plugin=STORAGES[self._storage])
        self._part.open()
        return self._part

    def _part_folder(self) -> Path:
        """Return the folder in which the next part grows."""
        return self.folder / f"{self.folder.name}_{len(self._information['files'])}"

    def _connect(self, topic: str, type_name: str, qualities: Sequence[QoSProfile]) -> Connection:
        """Return the connection of a topic in the current part, which is begun if need be."""
        part = self._part or self._begin()
        offered = [bag_quality(quality) for quality in qualities]
        connection = part.add_connection(topic, type_name, typestore=self._typestore, offered_qos_profiles=offered)
        self._connections[topic] = connection
        return connection

    def _adopt(self, part: Path) -> None:
        """Move the file of a complete part into the bag, and add what it holds to the bag's metadata."""
        added = load(part)
        (name,) = added["relative_file_paths"]
        (part / name).replace(self.folder / name)
        shutil.rmtree(part)
        self._information = merged(self._information, added)

    def _remove_leftovers(self) -> None:
        """Remove parts that were broken off, and one that was moved but not named yet."""
        named = {self.folder / name for name in self._information["relative_file_paths"]}
        for path in storage_files(self.folder):
            if path.parent != self.folder:
                shutil.rmtree(path.parent)
            elif path not in named:
                path.unlink()
        # One that had no file yet, or whose file was moved already.
        if self._part_folder().is_dir():
            shutil.rmtree(self._part_folder())

    def _lost(self, error: Exception) -> CaptureError:
        """Break off the part that could not be written, and say so."""
        self._break_off()
        files = len(self._information["files"])
        return CaptureError(
            f"cannot write to the bag {self.folder}: {error}; its {files} complete parts are whole, what follows is "
            "readable as far as it goes: free space, or choose another disk"
        )

    def _break_off(self) -> None:
        """Close the file of the current part as it is."""
        part, self._part = self._part, None
        self._connections.clear()
        if part is not None:
            # Closing writes what is left in the buffer, which fails on a full disk as well.
            with suppress(OSError, sqlite3.Error):
                part.abort()


def locked(folder: Path) -> int:
    """Return a file descriptor that locks a folder for as long as it is open; raises SettingsError."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        os.close(descriptor)
        raise SettingsError(f"somebody else is writing to {folder}; wait, or choose a new folder") from error
    except OSError:
        # A file system without locks: two runs into one folder are then the user's affair.
        os.close(descriptor)
        return -1
    return descriptor


def information_of(folder: Path, journal: str) -> dict[str, Any] | None:
    """Return the metadata of a bag to go on with, None for a new one.

    Raises
    ------
    SettingsError
        The folder exists and is no such bag: nothing that somebody else wrote is touched.
    """
    if not folder.exists() or (journal and folder.is_dir() and not any(folder.iterdir())):
        return None
    information = load(folder) if journal and (folder / FILE).exists() else {}
    if journal not in (information.get("custom_data") or {}):
        raise SettingsError(f"cannot write a bag to {folder}: it exists and holds something else; choose a new folder")
    return information
