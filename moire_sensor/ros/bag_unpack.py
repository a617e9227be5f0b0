"""Decompression with a bound: what claims to be small and is not never fills the memory or the disk."""

from __future__ import annotations

import sys
from pathlib import Path

# Both come with rosbags.
import lz4.frame

from moire_sensor.errors import CaptureError
from moire_sensor.ros.bag_message import MAX_RECORD_BYTES

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"
BLOCK_BYTES = 1 << 20


def unpack(data: bytes, compression: str, size: int) -> bytes:
    """Return ``size`` bytes of compressed data, fewer where it ends early.

    ``compression`` : ``""``, ``"zstd"`` or ``"lz4"``.

    Raises
    ------
    CaptureError
        Damaged data, more than ``size``, a size beyond reason, or another compression.
    """
    if size > MAX_RECORD_BYTES:
        raise CaptureError(f"it claims {size} bytes uncompressed; at most {MAX_RECORD_BYTES} are read")
    try:
        if compression == "zstd":
            content = zstd.ZstdDecompressor().decompress(data, max_length=size + 1)
        elif compression == "lz4":
            content = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1)
        elif not compression:
            content = data
        else:
            raise CaptureError(f"its compression is {compression!r}; zstd, lz4 and none are read")
    except (zstd.ZstdError, RuntimeError, EOFError) as error:
        raise CaptureError(f"it cannot be uncompressed: {error}") from error
    if len(content) > size:
        raise CaptureError(f"it holds more than the {size} bytes it claims")
    return bytes(content)


def unpack_message(data: bytes) -> bytes:
    """Return a message as it is, or uncompressed where the bag compresses each; raises CaptureError.

    The first byte of a serialised message is always 0, so that the two cannot be taken for each other.
    """
    if data[:4] != ZSTD_MAGIC:
        return data
    decompressor = zstd.ZstdDecompressor()
    try:
        content = decompressor.decompress(data, max_length=MAX_RECORD_BYTES)
    except zstd.ZstdError as error:
        raise CaptureError(f"a message cannot be uncompressed: {error}") from error
    if not decompressor.eof:
        raise CaptureError(f"a compressed message is cut, or larger than {MAX_RECORD_BYTES} bytes")
    return bytes(content)


def unpack_file(source: Path, target: Path, most_bytes: int) -> str:
    """Uncompress a zstd file up to ``most_bytes``; return what is wrong with it, or nothing.

    Raises
    ------
    OSError
        A file that cannot be read or written.
    """
    written = 0
    with target.open("wb") as out, zstd.open(source) as packed:
        try:
            while block := packed.read(BLOCK_BYTES):
                written += len(block)
                if written > most_bytes:
                    return f"holds more than the {most_bytes} bytes there is room for; the rest is not read"
                out.write(block)
        except (zstd.ZstdError, EOFError) as error:
            return f"cannot be uncompressed beyond {written} bytes: {error}"
    return ""
