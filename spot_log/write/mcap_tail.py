"""The end of an MCAP file: its index, which lets readers seek."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping, Sequence
from typing import Final

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    AttachmentIndex,
    Channel,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Schema,
    Statistics,
    SummaryOffset,
)

MAGIC: Final = b"\x89MCAP0\r\n"


def tail(
    size: int,
    schemas: Sequence[Schema],
    channels: Sequence[Channel],
    chunks: Sequence[ChunkIndex],
    attachments: Sequence[AttachmentIndex],
    counts: Mapping[int, int],
    times_ns: tuple[int, int],
) -> bytes:
    """Everything behind the data: end of data, summary, offsets, footer."""
    statistics = Statistics(
        attachment_count=len(attachments),
        channel_count=len(channels),
        channel_message_counts=dict(counts),
        chunk_count=len(chunks),
        message_count=sum(counts.values()),
        message_end_time=times_ns[1],
        message_start_time=times_ns[0],
        metadata_count=0,
        schema_count=len(schemas),
    )
    groups: tuple[tuple[Opcode, Sequence[McapRecord]], ...] = (
        (Opcode.SCHEMA, schemas),
        (Opcode.CHANNEL, channels),
        (Opcode.STATISTICS, [statistics]),
        (Opcode.CHUNK_INDEX, chunks),
        (Opcode.ATTACHMENT_INDEX, attachments),
    )
    data_end = encode(DataEnd(0))
    summary_start = size + len(data_end)
    body = b""
    offsets: list[SummaryOffset] = []
    for opcode, records in groups:
        encoded = encode(*records)
        if encoded:
            offsets.append(SummaryOffset(opcode, summary_start + len(body), len(encoded)))
        body += encoded
    offset_start = summary_start + len(body)
    body += encode(*offsets)
    # The checksum covers the summary and the footer up to the checksum itself.
    footer_head = struct.pack("<BQQQ", Opcode.FOOTER, 20, summary_start, offset_start)
    footer = Footer(summary_start, offset_start, zlib.crc32(footer_head, zlib.crc32(body)))
    return data_end + body + encode(footer) + MAGIC


def encode(*records: McapRecord) -> bytes:
    """Records as they stand in the file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
