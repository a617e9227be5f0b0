"""One MCAP file, whole or damaged: everything that can be read is, in the order of time, and the rest is named.

Libraries refuse a file without its end, and stop at the first bad chunk. Here each chunk stands for itself. The format
is that of https://mcap.dev/spec; nothing is allocated for a length before the file is known to hold it.
"""

from __future__ import annotations

import heapq
import struct
from collections.abc import Collection, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

from moire_sensor.errors import CaptureError
from moire_sensor.ros.bag_message import MAX_RECORD_BYTES, BagMessage, RecordedTopic
from moire_sensor.ros.mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_HEADER,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    KINDS,
    MAGIC,
    MESSAGE,
    MESSAGE_HEADER,
    MESSAGE_INDEX,
    RECORD_HEADER,
    SCHEMA,
    chunk_content,
    pairs_in,
    records_of,
    text_at,
)

FOOTER_BYTES = RECORD_HEADER.size + 20 + len(MAGIC)
QUALITIES = "offered_qos_profiles"


@dataclass
class Unit:
    """A chunk, or a message outside of any: where its content lies in the file, and its earliest time.

    ``cut`` tells that the file ends within it; ``count`` is the number of messages that its index promises.
    """

    time_ns: int
    offset: int
    length: int
    is_chunk: bool
    cut: bool = False
    count: int = 0


@dataclass
class McapFile:
    """Topics and messages of a file; ``damages`` says what could not be read, and grows while messages are.

    Raises
    ------
    CaptureError
        No MCAP file at all.
    """

    path: Path
    topics: dict[str, RecordedTopic] = field(default_factory=dict)
    damages: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._units: dict[int, Unit] = {}
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, str] = {}
        self._size = self.path.stat().st_size
        self._file: BinaryIO = self.path.open("rb")
        if self._file.read(len(MAGIC)) != MAGIC:
            self._file.close()
            raise CaptureError(f"{self.path} does not begin as an MCAP file does; it is something else or damaged")
        self._walk(len(MAGIC))
        self._read_summary()
        if not self._channels:
            self._look_into_chunks()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def messages(self, topics: Collection[str]) -> Iterator[BagMessage]:
        """Yield the messages of some topics in the order of their record time."""
        waiting: list[tuple[int, int, int, BagMessage]] = []
        units = sorted(self._units.values(), key=lambda unit: (unit.time_ns, unit.offset))
        for number, unit in enumerate(units):
            while waiting and waiting[0][0] < unit.time_ns:
                yield heapq.heappop(waiting)[-1]
            for order, message in enumerate(self._messages_of(unit)):
                if message.topic in topics:
                    heapq.heappush(waiting, (message.time_ns, number, order, message))
        while waiting:
            yield heapq.heappop(waiting)[-1]

    def _walk(self, offset: int) -> None:
        """Note the chunks and messages from an offset on, up to the end of the data or to what is no record."""
        while True:
            self._file.seek(offset)
            head = self._file.read(RECORD_HEADER.size)
            if len(head) < RECORD_HEADER.size:
                self.damages.append(f"ends at byte {self._size} without an index; what came after is lost")
                return
            kind, length = RECORD_HEADER.unpack(head)
            if kind in (DATA_END, FOOTER):
                return
            offset += RECORD_HEADER.size
            left = self._size - offset
            if length > left or kind not in KINDS:
                start = offset - RECORD_HEADER.size
                self.damages.append(f"no whole record at byte {start}, {left} bytes before its end")
                if kind in (MESSAGE, CHUNK):
                    self._note(kind, offset, left, cut=True)
                return
            self._note(kind, offset, length)
            offset += length

    def _note(self, kind: int, offset: int, length: int, cut: bool = False) -> None:
        """Remember what a record of the data section holds."""
        if kind == CHUNK and length >= CHUNK_HEADER.size:
            (time_ns,) = struct.unpack("<Q", self._file.read(8))
            self._units[offset] = Unit(time_ns, offset, length, is_chunk=True, cut=cut)
        elif kind == MESSAGE and length >= MESSAGE_HEADER.size and not cut:
            time_ns = MESSAGE_HEADER.unpack(self._file.read(MESSAGE_HEADER.size))[2]
            self._units[offset] = Unit(time_ns, offset, length, is_chunk=False)
        elif kind == MESSAGE_INDEX and self._units and length >= 6:
            self._units[next(reversed(self._units))].count += struct.unpack("<HI", self._file.read(6))[1] // 16
        elif kind in (SCHEMA, CHANNEL) and length <= MAX_RECORD_BYTES:
            self._define(kind, self._file.read(length))

    def _read_summary(self) -> None:
        """Take topics from the file's summary, and the chunks that lie behind a damaged record."""
        self._file.seek(max(0, self._size - FOOTER_BYTES))
        tail = self._file.read()
        if len(tail) < FOOTER_BYTES or tail[-len(MAGIC) :] != MAGIC or tail[0] != FOOTER:
            return
        (offset,) = struct.unpack_from("<Q", tail, RECORD_HEADER.size)
        end = self._size - FOOTER_BYTES
        while 0 < offset <= end - RECORD_HEADER.size:
            self._file.seek(offset)
            kind, length = RECORD_HEADER.unpack(self._file.read(RECORD_HEADER.size))
            offset += RECORD_HEADER.size + length
            if offset > end or length > MAX_RECORD_BYTES:
                return
            if kind == CHUNK_INDEX and length >= 32:
                time_ns, _, start, size = struct.unpack("<QQQQ", self._file.read(32))
                start += RECORD_HEADER.size
                known = self._units.get(start)
                if (known is None or known.cut) and CHUNK_HEADER.size < size <= end - start:
                    self._units[start] = Unit(time_ns, start, size - RECORD_HEADER.size, is_chunk=True)
            elif kind in (SCHEMA, CHANNEL):
                self._define(kind, self._file.read(length))

    def _look_into_chunks(self) -> None:
        """Find the topics of a file without a summary; what is damaged is named when the messages are read."""
        named = len(self.damages)
        for unit in self._units.values():
            for _ in self._messages_of(unit):
                pass
        del self.damages[named:]

    def _define(self, kind: int, data: bytes) -> None:
        """Take a schema (the name of a message type) or a channel (a topic of a type, with its quality)."""
        try:
            if kind == SCHEMA:
                self._schemas[struct.unpack_from("<H", data)[0]] = text_at(data, 2)[0]
                return
            channel, schema = struct.unpack_from("<HH", data)
            name, offset = text_at(data, 4)
            encoding, offset = text_at(data, offset)
            pairs = pairs_in(data[offset + 4 :])
        except (struct.error, UnicodeDecodeError) as error:
            self.damages.append(f"a damaged description of a topic: {error}")
            return
        if channel not in self._channels:
            self._channels[channel] = name
            self.topics.setdefault(
                name, RecordedTopic(name, self._schemas.get(schema, ""), encoding, pairs.get(QUALITIES, ""))
            )

    def _messages_of(self, unit: Unit) -> Iterator[BagMessage]:
        """Yield the messages of a chunk, or the one message; a damage is noted and ends the chunk."""
        if unit.length > MAX_RECORD_BYTES:
            self.damages.append(f"a record of {unit.length} bytes at {unit.offset}; {MAX_RECORD_BYTES} are allowed")
            return
        self._file.seek(unit.offset)
        data = self._file.read(unit.length)
        if not unit.is_chunk:
            yield from self._message(data)
            return
        read = 0
        try:
            for kind, record in records_of(chunk_content(data, unit.cut)):
                if kind == MESSAGE and len(record) >= MESSAGE_HEADER.size:
                    read += 1
                    yield from self._message(record)
                elif kind in (SCHEMA, CHANNEL):
                    self._define(kind, record)
        except (CaptureError, struct.error, UnicodeDecodeError) as error:
            whole = f" of {unit.count}" if unit.count else ""
            self.damages.append(f"chunk of {unit.length} bytes at {unit.offset}: {error}; {read}{whole} messages read")

    def _message(self, record: bytes) -> Iterator[BagMessage]:
        channel, _, time_ns, _ = MESSAGE_HEADER.unpack_from(record)
        if channel in self._channels:
            yield BagMessage(self._channels[channel], time_ns, record[MESSAGE_HEADER.size :])
        else:
            self.damages.append(f"a message of the unknown channel {channel}")
