"""What is read from a bag: messages and the topics they belong to."""

from __future__ import annotations

import struct
from dataclasses import dataclass

# No camera's image is larger; a length beyond it is damage, and nothing is allocated for it.
MAX_RECORD_BYTES = 1 << 28


@dataclass(frozen=True)
class BagMessage:
    """A recorded message: its topic, when it was recorded (nanoseconds), and its serialised bytes (CDR)."""

    topic: str
    time_ns: int
    serialized: bytes

    @property
    def stamp_ns(self) -> int:
        """Stamp of the header, nanoseconds; for messages that begin with one."""
        return header_stamp_ns(self.serialized)


@dataclass(frozen=True)
class RecordedTopic:
    """A topic of a bag: its full name, message type such as ``"sensor_msgs/msg/Image"``, encoding and qualities.

    ``qualities`` : what its publishers offered, as the YAML text that bags hold.
    """

    name: str
    type_name: str
    encoding: str
    qualities: str


def header_stamp_ns(serialized: bytes) -> int:
    """Stamp in nanoseconds of a serialised message that begins with a std_msgs/Header.

    CDR starts with four bytes, the second of which tells the byte order; then seconds and nanoseconds.
    """
    order = "<" if serialized[1] & 1 else ">"
    seconds, nanoseconds = struct.unpack_from(order + "iI", serialized, 4)
    return int(seconds) * 10**9 + int(nanoseconds)
