"""Read one chunk of an MCAP file by its own head, trusting nothing but its check sum."""

from __future__ import annotations

import re
import struct
import zlib
from typing import Final, NamedTuple

import lz4.frame as lz4  # type: ignore[import-untyped]
import zstandard

RECORD_HEAD: Final = struct.Struct("<BQ")
CHUNK_HEAD: Final = struct.Struct("<QQQII")
COMPRESSIONS: Final = ("zstd", "lz4", "")
MAX_CHUNK_BYTES: Final = 1 << 26
"""Our own have 1 MiB; a few bytes could ask for more memory than a robot's computer has."""

PARSE_ERRORS: Final = (struct.error, UnicodeDecodeError, ValueError, OverflowError, zstandard.ZstdError, MemoryError)
_U32, _U64 = struct.Struct("<I"), struct.Struct("<Q")
# Opcode and length, two times, size, check sum: then comes the compression's name, which marks a chunk.
_MARK_OFFSET: Final = RECORD_HEAD.size + 28
_MARK: Final = re.compile(b"|".join(re.escape(_U32.pack(len(name)) + name.encode()) for name in COMPRESSIONS if name))


class Chunk(NamedTuple):
    """The uncompressed content of a chunk, and the offset of the record after it."""

    content: bytes
    end: int


def read_chunk(data: bytes, offset: int) -> Chunk | str:
    """Read the chunk at ``offset`` by its own head, whatever the record's head says; else tell what is wrong."""
    at = offset + RECORD_HEAD.size
    try:
        _, _, size, crc, name_length = CHUNK_HEAD.unpack_from(data, at)
        compression, at = read_string(data, at + 28, min(len(data), at + 64))
        (length,) = _U64.unpack_from(data, at)
    except PARSE_ERRORS:
        return "its head is cut"
    start, end = at + 8, at + 8 + length
    if compression not in COMPRESSIONS or name_length > 8:
        return f"its compression {compression[:16]!r} is not one of zstd, lz4 and none"
    if end > len(data):
        return "it is cut"
    if size > MAX_CHUNK_BYTES:
        return f"its size of {size} bytes is more than {MAX_CHUNK_BYTES}"
    try:
        content = _decompress(compression, data[start:end], size)
    except (*PARSE_ERRORS, RuntimeError) as error:
        return f"it cannot be decompressed ({error})"
    if len(content) != size:
        return f"it holds {len(content)} bytes and says {size}"
    if crc and zlib.crc32(content) != crc:
        return "its check sum does not hold"
    return Chunk(content, end)


def _decompress(compression: str, data: bytes, size: int) -> bytes:
    if compression == "zstd":
        declared = zstandard.get_frame_parameters(data).content_size
        if declared not in (size, zstandard.CONTENTSIZE_UNKNOWN):
            raise ValueError(f"frame of {declared} bytes in a chunk of {size}")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    if compression == "lz4":
        return bytes(lz4.LZ4FrameDecompressor().decompress(data, max_length=size))
    return data


def find_chunk(data: bytes, offset: int) -> int | None:
    """Find the next whole chunk that starts at or after ``offset``, by the mark in its head; None if there is none."""
    # One pass for all marks: a search for each would go through the whole file again for one that is not there.
    for mark in _MARK.finditer(data, offset + _MARK_OFFSET):
        start = mark.start() - _MARK_OFFSET
        if isinstance(read_chunk(data, start), Chunk):
            return start
    return None


def read_string(data: bytes, start: int, end: int) -> tuple[str, int]:
    """Read a text with its length before it; return it and the offset after it.

    Raises:
        ValueError: It does not end before ``end``.
    """
    (length,) = _U32.unpack_from(data, start)
    stop = start + 4 + length
    if stop > end:
        raise ValueError(f"a text of {length} bytes is longer than its record")
    return data[start + 4 : stop].decode(), stop
