"""Reads any rosbag2: MCAP or SQLite, compressed or not, a folder or a lone file, whole or damaged."""

from __future__ import annotations

import re
import shutil
from collections import Counter
from collections.abc import Collection, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from types import TracebackType

from moire_sensor.errors import CaptureError
from moire_sensor.ros.bag_mcap import McapFile
from moire_sensor.ros.bag_message import BagMessage, RecordedTopic
from moire_sensor.ros.bag_metadata import FILE, Metadata, read_metadata
from moire_sensor.ros.bag_sqlite import SqliteFile, copy_of_cut_file, missing_bytes
from moire_sensor.ros.bag_unpack import unpack_file, unpack_message

STORAGES: dict[str, type[McapFile] | type[SqliteFile]] = {".mcap": McapFile, ".db3": SqliteFile}
PACKED = ".zstd"
# Of the free disk space, what an uncompressed file may take.
SPACE_SHARE = 0.8


class Bag:
    """The messages of a bag in the order they were recorded; a context that removes its temporary files.

    ``damages`` names what could not be read, file by file, and grows while messages are read. ``promised`` are the
    numbers of messages by topic that metadata.yaml tells, ``sizes`` the bytes of each file.

    Parameters
    ----------
    path : folder, or one storage file (.mcap, .db3, also with .zstd).
    scratch : folder for what has to be uncompressed to be read; the system's own by default.

    Raises
    ------
    CaptureError
        No bag there, or none of its files can be read at all.
    """

    def __init__(self, path: Path, scratch: Path | None = None) -> None:
        self.path = path
        self.damages: list[str] = []
        self.topics: dict[str, RecordedTopic] = {}
        self.promised: dict[str, int] = {}
        self.sizes: dict[str, int] = {}
        self._scratch_parent = scratch
        self._scratch: TemporaryDirectory[str] | None = None
        self._files: list[McapFile | SqliteFile] = []
        try:
            for file in self._storage_files():
                self._open(file)
            if not self._files:
                found = "; ".join(self.damages) or "no .mcap or .db3 file in it"
                raise CaptureError(f"cannot read the bag {path}: {found}; give a rosbag2 folder, .mcap or .db3")
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Bag:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Close the files and remove what was uncompressed."""
        for file in self._files:
            file.close()
        if self._scratch is not None:
            self._scratch.cleanup()

    def messages(self, topics: Collection[str] | None = None) -> Iterator[BagMessage]:
        """Yield the messages of some topics, or of all; compares with the promised numbers at the end."""
        wanted = frozenset(self.topics if topics is None else topics)
        read: Counter[str] = Counter()
        for file in self._files:
            told = len(file.damages)
            for message in file.messages(wanted):
                read[message.topic] += 1
                try:
                    serialized = unpack_message(message.serialized)
                except CaptureError as error:
                    self.damages.append(f"{file.path.name}: {message.topic}: {error}")
                    continue
                yield BagMessage(message.topic, message.time_ns, serialized)
            self.damages.extend(f"{file.path.name}: {text}" for text in file.damages[told:])
        for topic in sorted(wanted & self.promised.keys()):
            if read[topic] < self.promised[topic]:
                self.damages.append(f"{read[topic]} of {self.promised[topic]} messages of {topic} are there")

    def _storage_files(self) -> list[Path]:
        """Return the storage files in order, those that metadata.yaml names or, without it, those that are there."""
        if not self.path.exists():
            raise CaptureError(f"cannot read the bag {self.path}: there is no such file or folder")
        if self.path.is_file():
            return [self.path]
        metadata = Metadata(())
        try:
            metadata = read_metadata(self.path)
        except CaptureError as error:
            self.damages.append(f"{error}" if (self.path / FILE).exists() else f"{FILE} is missing")
        self.promised = metadata.counts
        for name in metadata.files:
            if not (self.path / name).is_file():
                self.damages.append(f"{name} is missing")
        listed = [self.path / name for name in metadata.files if (self.path / name).is_file()]
        if not listed:
            return storage_files(self.path)
        broken_off = [path for path in storage_files(self.path) if path.parent != self.path]
        self.damages.extend(f"{path.name} was broken off while it was written" for path in broken_off)
        return listed + broken_off

    def _open(self, path: Path) -> None:
        """Open one storage file; what is wrong with it is noted."""
        try:
            kind = self._kind(path)
            file = STORAGES[kind](self._prepared(path, kind))
        except (CaptureError, OSError) as error:
            self.damages.append(str(error))
            return
        self._files.append(file)
        self.sizes[path.name] = path.stat().st_size
        self.damages.extend(f"{path.name}: {text}" for text in file.damages)
        for topic in file.topics.values():
            self.topics.setdefault(topic.name, topic)

    def _kind(self, path: Path) -> str:
        kind = Path(path.name.removesuffix(PACKED)).suffix
        if kind not in STORAGES:
            raise CaptureError(f"{path} is no .mcap or .db3 file")
        return kind

    def _prepared(self, path: Path, kind: str) -> Path:
        """Return the file or, where it is compressed or cut short, a copy in the scratch folder that can be read."""
        if path.suffix == PACKED:
            target = self._scratch_folder() / f"{len(self._files)}_{path.name.removesuffix(PACKED)}"
            room = int(SPACE_SHARE * shutil.disk_usage(target.parent).free)
            problem = unpack_file(path, target, room)
            if problem:
                self.damages.append(f"{path.name} {problem}")
            path = target
        if kind == ".db3" and (missing := missing_bytes(path)):
            self.damages.append(f"{path.name}: its last {missing} bytes are missing")
            path = copy_of_cut_file(path, self._scratch_folder() / f"{len(self._files)}_{path.name}.cut")
        return path

    def _scratch_folder(self) -> Path:
        if self._scratch is None:
            self._scratch = TemporaryDirectory(prefix="bag_", dir=self._scratch_parent)
        return Path(self._scratch.name)


def storage_files(folder: Path) -> list[Path]:
    """Return the storage files in a folder by name, part 2 before part 10; also those a broken-off recorder left."""
    kinds = tuple(kind + packed for kind in STORAGES for packed in ("", PACKED))
    found = [path for path in (*folder.glob("*"), *folder.glob("*/*")) if path.name.endswith(kinds)]
    return sorted(found, key=lambda path: [int(part) if part.isdigit() else part for part in _parts(path.name)])


def _parts(name: str) -> list[str]:
    """Split a name into digits and what lies between, beginning with the latter."""
    return re.split(r"(\d+)", name)


def read_messages(path: Path) -> Iterator[BagMessage]:
    """Yield all messages of a bag in the order they were recorded; raises CaptureError where it is not whole."""
    with Bag(path) as bag:
        yield from bag.messages()
        if bag.damages:
            raise CaptureError(f"the bag {path} is damaged: {'; '.join(bag.damages)}")
