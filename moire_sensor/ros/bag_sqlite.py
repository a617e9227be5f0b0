"""One SQLite file of a bag, whole or damaged: every row that can be read is, and the rest is named."""

from __future__ import annotations

import shutil
import sqlite3
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

import numpy as np
import numpy.typing as npt

from moire_sensor.errors import CaptureError
from moire_sensor.ros.bag_message import MAX_RECORD_BYTES, BagMessage, RecordedTopic

# Page size, change counter, number of pages, and the change that this number is valid for.
HEADER = struct.Struct(">16xH6xII60xI")
PAGES_OFFSET, LARGEST_PAGE_BYTES = 28, 65536
# A damaged table does not tell its length: so many unreadable rows after another are taken for its end.
GAP_ROWS = 1000


def missing_bytes(path: Path) -> int:
    """Return how many bytes of an SQLite file are missing at its end, by what its header tells."""
    with path.open("rb") as file:
        header = file.read(HEADER.size)
    if len(header) < HEADER.size:
        return 0
    page_bytes, changes, pages, valid_for = HEADER.unpack(header)
    # An old library leaves the number of pages as it was; then the file's own size is what counts.
    promised = pages * (page_bytes if page_bytes > 1 else LARGEST_PAGE_BYTES) if changes == valid_for else 0
    return max(0, int(promised) - path.stat().st_size)


def copy_of_cut_file(path: Path, target: Path) -> Path:
    """Copy a file cut short so that the library refuses what is missing; it would read zeros instead."""
    shutil.copyfile(path, target)
    with target.open("r+b") as file:
        page_bytes = HEADER.unpack(file.read(HEADER.size))[0]
        pages = target.stat().st_size // (page_bytes if page_bytes > 1 else LARGEST_PAGE_BYTES)
        file.seek(PAGES_OFFSET)
        file.write(pages.to_bytes(4, "big"))
    return target


@dataclass
class SqliteFile:
    """Topics and messages of a file; ``damages`` says what could not be read, and grows while messages are.

    Raises
    ------
    CaptureError
        No SQLite bag, or one whose list of topics is lost.
    """

    path: Path
    topics: dict[str, RecordedTopic] = field(default_factory=dict)
    damages: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        # A bag that is still being written, or whose recorder was killed, has a log of changes beside it.
        unwritten = self.path.with_name(self.path.name + "-wal").exists()
        mode = "mode=ro" if unwritten else "mode=ro&immutable=1"
        self._database = sqlite3.connect(f"file:{quote(str(self.path.resolve()))}?{mode}", uri=True)
        self._database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, MAX_RECORD_BYTES)
        self._names: dict[int, str] = {}
        try:
            # Nothing in the file may run: no view or function of its own behind the names we ask for.
            self._database.execute("PRAGMA trusted_schema = OFF")
            self._read_topics()
        except (sqlite3.Error, UnicodeDecodeError) as error:
            self._database.close()
            raise CaptureError(f"{self.path} is no SQLite bag, or its list of topics is damaged: {error}") from error

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Yield the messages of some topics in the order of their record time."""
        wanted = {number: name for number, name in self._names.items() if name in topics}
        lost = 0
        for row in self._rows_in_order(wanted):
            try:
                found = self._database.execute(
                    "SELECT topic_id, timestamp, data FROM messages WHERE id = ?", (int(row),)
                ).fetchone()
            except sqlite3.Error:
                lost += 1
                continue
            if found is None or not isinstance(found[1], int) or not isinstance(found[2], bytes):
                lost += 1
            elif found[0] in wanted:
                yield BagMessage(wanted[found[0]], found[1], found[2])
        if lost:
            self.damages.append(f"{lost} rows of messages are damaged")

    def _read_topics(self) -> None:
        tables = {name for (name,) in self._database.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if not {"topics", "messages"} <= tables:
            raise sqlite3.DatabaseError("it has no tables topics and messages")
        columns = {row[1] for row in self._database.execute("PRAGMA table_info(topics)")}
        quality = "offered_qos_profiles" if "offered_qos_profiles" in columns else "''"
        rows = self._database.execute(f"SELECT id, name, type, serialization_format, {quality} FROM topics")
        for number, *texts in rows:
            name, type_name, encoding, qualities = map(str, texts)
            self._names[int(number)] = name
            self.topics.setdefault(name, RecordedTopic(name, type_name, encoding, qualities))

    def _rows_in_order(self, wanted: Collection[int]) -> npt.NDArray[np.int64]:
        """Return the numbers of the rows of some topics by record time; of a damaged table, of all that may exist."""
        marks = ", ".join("?" * len(wanted))
        query = f"SELECT id FROM messages WHERE topic_id IN ({marks}) ORDER BY timestamp, id"
        try:
            rows = self._database.execute(query, tuple(wanted))
            return np.fromiter((row[0] for row in rows), dtype=np.int64)
        except (sqlite3.Error, ValueError, TypeError, OverflowError) as error:
            self.damages.append(f"the table of messages is damaged ({error}); it is read row by row")
            return self._rows_that_answer()

    def _rows_that_answer(self) -> npt.NDArray[np.int64]:
        """Return the numbers of all rows up to the last one that can be read, by record time."""
        times: dict[int, int] = {}
        row, last = 1, 0
        while row - last <= GAP_ROWS:
            try:
                found = self._database.execute("SELECT timestamp FROM messages WHERE id = ?", (row,)).fetchone()
            except sqlite3.Error:
                found = None
            if found is not None and isinstance(found[0], int):
                last, times[row] = row, found[0]
            row += 1
        return np.array(sorted(times, key=lambda one: (times[one], one)), dtype=np.int64)
