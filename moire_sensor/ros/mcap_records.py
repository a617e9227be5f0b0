"""The records of an MCAP file, taken apart; see https://mcap.dev/spec."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

from moire_sensor.errors import CaptureError
from moire_sensor.ros.bag_unpack import unpack

MAGIC = b"\x89MCAP0\r\n"
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, MESSAGE_INDEX, CHUNK_INDEX, DATA_END = 2, 3, 4, 5, 6, 7, 8, 15
# Those of the format, and those that it leaves to applications.
KINDS = frozenset((*range(1, 16), *range(0x80, 0x100)))
RECORD_HEADER, MESSAGE_HEADER, CHUNK_HEADER = struct.Struct("<BQ"), struct.Struct("<HIQQ"), struct.Struct("<QQQII")


def chunk_content(data: bytes, cut: bool) -> bytes:
    """Return the records in a chunk, uncompressed and checked; of one cut short, those that are left.

    Raises
    ------
    CaptureError
        A wrong checksum or size, or data that cannot be uncompressed.
    """
    _, _, size, checksum, _ = CHUNK_HEADER.unpack_from(data)
    compression, offset = text_at(data, CHUNK_HEADER.size - 4)
    (stored,) = struct.unpack_from("<Q", data, offset)
    offset += 8
    if stored > len(data) - offset and not cut:
        raise CaptureError(f"its data claim {stored} bytes, it has {len(data) - offset}")
    content = unpack(data[offset : offset + stored], compression, size)
    if not cut and len(content) != size:
        raise CaptureError(f"it holds {len(content)} bytes, {size} are promised")
    if not cut and checksum and zlib.crc32(content) != checksum:
        raise CaptureError("its checksum is wrong")
    return content


def records_of(content: bytes) -> Iterator[tuple[int, bytes]]:
    """Yield kind and content of each record; raises CaptureError where one is not whole."""
    offset = 0
    while offset < len(content):
        if len(content) - offset < RECORD_HEADER.size:
            raise CaptureError("it ends within a record")
        kind, length = RECORD_HEADER.unpack_from(content, offset)
        offset += RECORD_HEADER.size
        if length > len(content) - offset:
            raise CaptureError(f"a record claims {length} bytes, {len(content) - offset} are left")
        yield kind, content[offset : offset + length]
        offset += length


def text_at(data: bytes, offset: int) -> tuple[str, int]:
    """Return a text that follows its length, and the offset behind it."""
    (length,) = struct.unpack_from("<I", data, offset)
    offset += 4
    (text,) = struct.unpack_from(f"{min(length, len(data) + 1)}s", data, offset)
    return text.decode(), offset + length


def pairs_in(data: bytes) -> dict[str, str]:
    """Return names and values, each a text, up to the end of the data."""
    pairs: dict[str, str] = {}
    offset = 0
    while offset < len(data):
        name, offset = text_at(data, offset)
        pairs[name], offset = text_at(data, offset)
    return pairs
