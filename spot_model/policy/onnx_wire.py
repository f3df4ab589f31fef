"""Protobuf's wire format, read strictly: one way to write each message, and no other is taken.

Protobuf's own readers are lenient in ways that differ between languages: tags are cut to 32 bits, a number may be
written longer than it needs to be, a single field may come twice and is then merged. Two readers of one file could
therefore see two messages. Whatever is not written the plain way is refused here, so both see the same.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
MAX_TAG: Final = (1 << 32) - 1
_SIZES: Final = {FIXED64: 8, FIXED32: 4}


class WireError(ValueError):
    """The bytes are not a plainly written protobuf message; the message says why."""


class Field(NamedTuple):
    """One field: its number, its wire type, where its value lies, and the value itself if it is a varint."""

    number: int
    wire: int
    at: slice
    value: int


def fields(data: bytes, at: slice) -> Iterator[Field]:
    """Each field of the message that lies in ``data[at]``, in order. Raises WireError."""
    position, end = at.start, at.stop
    while position < end:
        tag, start = _varint(data, position, end)
        number, wire, value, stop = tag >> 3, tag & 7, 0, end + 1
        if tag > MAX_TAG or number == 0:
            raise WireError(f"the tag at byte {position} names no field")
        if wire == VARINT:
            value, stop = _varint(data, start, end)
        elif wire == BYTES:
            size, start = _varint(data, start, end)
            stop = start + size
        elif wire in _SIZES:
            stop = start + _SIZES[wire]
        else:
            raise WireError(f"byte {position} is not what a protobuf message holds there")
        if stop > end:
            raise WireError(f"a field at byte {position} goes beyond its message's end")
        yield Field(number, wire, slice(start, stop), value)
        position = stop


def _varint(data: bytes, at: int, end: int) -> tuple[int, int]:
    value = 0
    for index in range(10):
        if at + index >= end:
            raise WireError("it is cut")
        byte = data[at + index]
        value |= (byte & 0x7F) << (7 * index)
        if byte < 0x80:
            if value >= 1 << 64 or (byte == 0 and index):
                raise WireError(f"the number at byte {at} is not written the shortest way")
            return value, at + index + 1
    raise WireError(f"the number at byte {at} has no end")
