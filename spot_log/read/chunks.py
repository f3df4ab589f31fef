"""The chunks of an MCAP file: found, decompressed within a budget, and counted only where their check sum holds."""

from __future__ import annotations

import re
import struct
import zlib
from typing import Final, NamedTuple

import lz4.frame as lz4  # type: ignore[import-untyped]
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode

from spot_log.read.columns import on_all_cores
from spot_log.write.mcap_file import MAGIC

RECORD_HEAD: Final = struct.Struct("<BQ")
CHUNK_HEAD: Final = struct.Struct("<QQQII")
COMPRESSIONS: Final = ("zstd", "lz4", "")
MAX_CHUNK_BYTES: Final = 1 << 26
"""What any chunk may hold; a larger one must have the bytes for it: a few could ask for all of a computer's memory."""

PARSE_ERRORS: Final = (struct.error, ValueError, OverflowError, zstandard.ZstdError, MemoryError, McapError)
_U32, _U64 = struct.Struct("<I"), struct.Struct("<Q")
# Opcode and length, two times, size, check sum: then comes the compression's name, which marks a chunk.
_MARK_OFFSET: Final = RECORD_HEAD.size + 28
_MARK: Final = re.compile(b"|".join(re.escape(_U32.pack(len(name)) + name.encode()) for name in COMPRESSIONS if name))


FREE_BYTES: Final = 16 << 20
MAX_EXPANSION: Final = 64
"""Our own logs hold four to eight times their size."""


class Budget:
    """How much one file may expand to: a few kB must neither fill a computer's memory nor keep it busy for minutes."""

    def __init__(self, file_bytes: int) -> None:
        """Allow :data:`FREE_BYTES`, and :data:`MAX_EXPANSION` times the file's size."""
        self.limit = self.left = FREE_BYTES + MAX_EXPANSION * file_bytes

    def take(self, size: int) -> bool:
        """Whether this many more bytes are allowed; after a refusal, none are."""
        self.left = self.left - size if size <= self.left else 0
        return self.left > 0

    @property
    def is_spent(self) -> bool:
        """Whether nothing more is allowed."""
        return self.left <= 0


class Chunk(NamedTuple):
    """The uncompressed content of a chunk, and the offset of the record after it."""

    content: bytes
    end: int


def read_chunk(data: bytes, offset: int, budget: Budget) -> Chunk | str:
    """Read the chunk at ``offset`` by its own head, whatever the record's head says; else tell what is wrong.

    Every attempt is charged to ``budget``, also a failed one.
    """
    at = offset + RECORD_HEAD.size
    try:
        _, _, size, crc, name_length = CHUNK_HEAD.unpack_from(data, at)
        compression = data[at + CHUNK_HEAD.size : at + CHUNK_HEAD.size + min(name_length, 8)].decode()
        at += CHUNK_HEAD.size + name_length
        (length,) = _U64.unpack_from(data, at)
    except PARSE_ERRORS:
        return "its head is cut"
    start, end = at + 8, at + 8 + length
    if compression not in COMPRESSIONS or len(compression) != name_length:
        return f"its compression {compression[:16]!r} is not one of zstd, lz4 and none"
    if end > len(data):
        return "it is cut"
    if size > (most := max(MAX_CHUNK_BYTES, MAX_EXPANSION * length)):
        return f"its size of {size} bytes is more than {most}"
    try:
        content = _decompress(compression, data[start:end], size, budget)
    except (*PARSE_ERRORS, RuntimeError) as error:
        return f"it cannot be decompressed ({error})"
    if len(content) != size:
        return f"it holds {len(content)} bytes and says {size}"
    if crc and zlib.crc32(content) != crc:
        return "its check sum does not hold"
    return Chunk(content, end)


def _decompress(compression: str, data: bytes, size: int, budget: Budget) -> bytes:
    """Decompress at most ``size`` bytes. What is known to be wrong before costs nothing; all else is paid for."""
    if compression == "" or not data:  # an empty chunk may hold an empty frame, or none
        return data
    if compression == "zstd":
        declared = zstandard.get_frame_parameters(data).content_size
        is_known = declared != zstandard.CONTENTSIZE_UNKNOWN
    else:
        declared = int(lz4.get_frame_info(data)["content_size"])
        is_known = declared > 0
    if is_known and declared != size:
        raise ValueError(f"frame of {declared} bytes in a chunk of {size}")
    if not budget.take(size + len(data)):
        raise ValueError(f"the file would expand to more than {budget.limit} bytes")
    if compression == "zstd":
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    return bytes(lz4.LZ4FrameDecompressor().decompress(data, max_length=size))


def read_ahead(data: bytes) -> dict[int, Chunk]:
    """The good chunks before the first damage to the chain of records, by offset; all cores read them."""
    offsets, offset, budget = [], len(MAGIC), Budget(len(data))
    while offset + RECORD_HEAD.size + CHUNK_HEAD.size <= len(data):
        opcode, length = RECORD_HEAD.unpack_from(data, offset)
        if opcode == Opcode.CHUNK:
            if not budget.take(CHUNK_HEAD.unpack_from(data, offset + RECORD_HEAD.size)[2]):
                break
            offsets.append(offset)
        offset += RECORD_HEAD.size + length
    found = on_all_cores(lambda at: read_chunk(data, at, Budget(len(data))), offsets)
    return {at: chunk for at, chunk in zip(offsets, found, strict=True) if isinstance(chunk, Chunk)}


def find_chunk(data: bytes, offset: int, budget: Budget) -> tuple[int, Chunk] | None:
    """Find the next whole chunk that starts at or after ``offset``, by the mark in its head; None if there is none."""
    # One pass for all marks: a search for each would go through the whole file again for one that is not there.
    for mark in _MARK.finditer(data, offset + _MARK_OFFSET):
        start = mark.start() - _MARK_OFFSET
        chunk = read_chunk(data, start, budget)
        if isinstance(chunk, Chunk):
            return start, chunk
        if budget.is_spent:
            return None
    return None
