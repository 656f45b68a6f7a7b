"""The ``.tlog`` container: time-stamped MAVLink packets, found even where bytes are missing.

A record is the ground station's time (8 bytes, big-endian, microseconds since 1970) and one MAVLink
packet, version 1 or 2 (mavlink.io, "MAVLink serialization"). Nothing separates records, so after
damage the next one is found by its looks and proved by its checksum.
"""

import mmap
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

TIME_BYTES = 8
_MAGIC_V1, _MAGIC_V2 = 0xFE, 0xFD
_HEADER_V1_BYTES, _HEADER_V2_BYTES = 6, 10
_CHECKSUM_BYTES, _SIGNATURE_BYTES = 2, 13
_SIGNED_FLAG = 0x01

_RECORD_START = re.compile(rb"\x00[\x00-\x0e].{6}[\xfd\xfe]", re.DOTALL)
"""A time between 1970 and 2100, then a packet's first byte."""

_FOREIGN = (
    (b"\xa3\x95", "an ArduPilot dataflash log (.bin), written on board"),
    (b"FMT, ", "an ArduPilot dataflash log as text (.log)"),
    (b"ULog\x01", "a PX4 ULog (.ulg), written on board"),
    (b"\x1f\x8b", "gzip-compressed: unpack it first"),
    (b"PK\x03\x04", "a zip archive: unpack it first"),
)
_RAW = "raw MAVLink without the times of its records (.raw)"

Buffer = bytes | mmap.mmap
Message = TypeVar("Message")


@dataclass(frozen=True, slots=True)
class Packet:
    """Where one MAVLink packet lies in a buffer, and what its header says."""

    start: int
    end: int
    message_id: int
    system: int
    component: int


def foreign_format(data: Buffer) -> str | None:
    """Return what kind of file its beginning gives away, or None if it may be a ``.tlog``.

    A ``.tlog`` that lost its beginning may start with a packet too: there a record follows.
    """
    head = data[:16]
    if head[:1] in (bytes([_MAGIC_V1]), bytes([_MAGIC_V2])):
        first = _packet_from(data, 0)
        is_cut = first is not None and _RECORD_START.match(data, first.end) is not None
        return None if is_cut else _RAW
    return next((kind for magic, kind in _FOREIGN if head.startswith(magic)), None)


def record_time_s(data: Buffer, packet: Packet) -> float:
    """Return the ground station's time of a record in seconds since 1970."""
    return int.from_bytes(data[packet.start - TIME_BYTES : packet.start], "big") * 1e-6


def iterate_packets(
    data: Buffer, wanted: frozenset[int], decode: Callable[[Packet], Message | None]
) -> Iterator[tuple[int, Packet, Message]]:
    """Yield ``(ordinal, packet, message)`` of every wanted packet that ``decode`` accepts.

    A packet of another kind is stepped over unread if a record (or the end) follows it; otherwise
    its length cannot be trusted and the search goes on one byte further.
    """
    position: int | None = 0
    ordinal = 0
    while position is not None:
        packet = _packet_at(data, position)
        if packet is None:
            position = _next_start(data, position + 1)
            continue
        if packet.message_id in wanted:
            message = decode(packet)
            sound = message is not None
            if message is not None:
                yield ordinal, packet, message
        else:
            sound = _record_follows(data, packet.end)
        ordinal += 1
        position = packet.end if sound else _next_start(data, position + 1)


def _packet_at(data: Buffer, position: int) -> Packet | None:
    """Return the packet of the record that starts at ``position``, if one fits there whole."""
    if _RECORD_START.match(data, position) is None:
        return None
    return _packet_from(data, position + TIME_BYTES)


def _packet_from(data: Buffer, start: int) -> Packet | None:
    """Return the packet whose first byte is at ``start``, if it fits there whole."""
    header = data[start : start + _HEADER_V2_BYTES]
    if len(header) < _HEADER_V1_BYTES:
        return None
    if header[0] == _MAGIC_V1:
        end = start + _HEADER_V1_BYTES + header[1] + _CHECKSUM_BYTES
        packet = Packet(start, end, header[5], header[3], header[4])
    elif len(header) == _HEADER_V2_BYTES:
        signature = _SIGNATURE_BYTES if header[2] & _SIGNED_FLAG else 0
        end = start + _HEADER_V2_BYTES + header[1] + _CHECKSUM_BYTES + signature
        message_id = int.from_bytes(header[7:10], "little")
        packet = Packet(start, end, message_id, header[5], header[6])
    else:
        return None
    return packet if packet.end <= len(data) else None


def _record_follows(data: Buffer, position: int) -> bool:
    return position == len(data) or _RECORD_START.match(data, position) is not None


def _next_start(data: Buffer, position: int) -> int | None:
    found = _RECORD_START.search(data, position)
    return None if found is None else found.start()
