"""An MCAP file that is complete after every flush: one write per chunk, undone if it fails.

The ``mcap`` package's records are used as they are; its writer is not, because it has no public flush, keeps schemas
and channels in the first chunk only, and leaves half a chunk behind on a full disk.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
import zlib
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    MessageIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from spot_log.errors import LogExistsError
from spot_log.format.codec import Topic

MAGIC: Final = b"\x89MCAP0\r\n"


def encode(*records: McapRecord) -> bytes:
    """Records as they stand in the file."""
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]


LIBRARY: Final = "spot-rl"
CHUNK_BYTES: Final = 1 << 20
_MESSAGE_HEAD: Final = struct.Struct("<BQHIQQ")
_MESSAGE_FIXED_BYTES: Final = 22


class McapFile:
    """Append messages to a new file; :meth:`flush` makes them durable, :meth:`finish` adds the index.

    Raises:
        LogExistsError: The file exists.
        OSError: It cannot be created.
    """

    def __init__(self, path: Path, topics: Iterable[Topic]) -> None:
        self.path = path
        # By its descriptor the folder is found again where somebody moves it.
        self._folder = os.open(path.parent, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
        self._fd = -1
        self.place: Path | None = path
        """Where it was at the last :meth:`look`, or at its end."""
        flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        try:
            self._fd = os.open(path.name, flags, 0o644, dir_fd=self._folder)
        except FileExistsError as error:
            self.close()
            raise LogExistsError(path) from error
        except OSError:
            self.close()
            raise
        # The lock tells this file from a leftover of a crash.
        fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        self._size = 0
        self._compressor = zstandard.ZstdCompressor(level=3)
        self._channels: dict[int, Channel] = {}
        self._schemas: dict[int, Schema] = {}
        for topic in topics:
            schema = Schema(topic.channel_id, topic.schema_data(), "protobuf", topic.schema_name)
            self.declare(Channel(topic.channel_id, topic.name, "protobuf", {}, schema.id), schema)
        self._chunk_indices: list[ChunkIndex] = []
        self._attachment_indices: list[AttachmentIndex] = []
        self._metadata_indices: list[MetadataIndex] = []
        self._counts: Counter[int] = Counter()
        self._start_ns, self._end_ns = 0, 0
        self._begin_chunk()
        try:
            self._append(MAGIC + encode(Header(profile="", library=LIBRARY)))
        except OSError:
            self.give_up()
            raise

    def declare(self, channel: Channel, schema: Schema | None) -> None:
        """Add a channel to those whose messages may come; its schema, if any, has its number."""
        self._channels[channel.id] = channel
        if schema is not None:
            self._schemas[channel.id] = schema

    def _begin_chunk(self) -> None:
        self._parts: list[bytes] = []
        self._offset = 0
        self._message_times: dict[int, list[tuple[int, int]]] = {}
        self._chunk_start_ns, self._chunk_end_ns = 0, 0

    @property
    def buffered_bytes(self) -> int:
        """Bytes that the next flush will write, before compression."""
        return self._offset

    @property
    def buffered_counts(self) -> Counter[int]:
        """Messages that the next flush will write, by channel."""
        return Counter({channel: len(times) for channel, times in self._message_times.items()})

    @property
    def written_counts(self) -> Counter[int]:
        """Messages in the file, by channel."""
        return Counter(self._counts)

    def add(self, channel_id: int, data: bytes, *, log_ns: int, publish_ns: int, sequence: int) -> None:
        """Add a message to the chunk in the making."""
        times = self._message_times.get(channel_id)
        if times is None:
            times = self._message_times[channel_id] = []
            self._add_channel(channel_id)
        if not self._chunk_start_ns or log_ns < self._chunk_start_ns:
            self._chunk_start_ns = log_ns
        self._chunk_end_ns = max(self._chunk_end_ns, log_ns)
        times.append((log_ns, self._offset))
        length = _MESSAGE_FIXED_BYTES + len(data)
        self._parts.append(_MESSAGE_HEAD.pack(Opcode.MESSAGE, length, channel_id, sequence, log_ns, publish_ns))
        self._parts.append(data)
        self._offset += _MESSAGE_HEAD.size + len(data)

    def _add_channel(self, channel_id: int) -> None:
        """Repeat the channel in every chunk, so that each can be read if the others are lost; the schema once."""
        is_first = not self._counts[channel_id]
        schemas: list[McapRecord] = [self._schemas[channel_id]] if is_first and channel_id in self._schemas else []
        self._parts.append(encode(*schemas, self._channels[channel_id]))
        self._offset += len(self._parts[-1])

    def flush(self) -> None:
        """Write the chunk in the making to disk. On failure its messages are gone, the file is as before.

        Raises:
            OSError: The disk is full, or gone.
        """
        if not self._parts:
            return
        data = b"".join(self._parts)
        times, start_ns, end_ns = self._message_times, self._chunk_start_ns, self._chunk_end_ns
        self._begin_chunk()
        chunk = Chunk(
            compression="zstd",
            data=self._compressor.compress(data),
            message_end_time=end_ns,
            message_start_time=start_ns,
            uncompressed_crc=zlib.crc32(data),
            uncompressed_size=len(data),
        )
        encoded = [encode(chunk)]
        offsets: dict[int, int] = {}
        length = len(encoded[0])
        for channel_id, records in times.items():
            offsets[channel_id] = self._size + length
            encoded.append(encode(MessageIndex(channel_id, records)))
            length += len(encoded[-1])
        index = ChunkIndex(
            chunk_length=len(encoded[0]),
            chunk_start_offset=self._size,
            compression="zstd",
            compressed_size=len(chunk.data),
            message_end_time=end_ns,
            message_index_length=length - len(encoded[0]),
            message_index_offsets=offsets,
            message_start_time=start_ns,
            uncompressed_size=len(data),
        )
        self._append(b"".join(encoded))
        self._chunk_indices.append(index)
        self._counts.update({channel: len(records) for channel, records in times.items()})
        self._start_ns = min(self._start_ns or start_ns, start_ns)
        self._end_ns = max(self._end_ns, end_ns)

    def discard(self) -> None:
        """Forget the chunk in the making."""
        self._begin_chunk()

    def attach(self, name: str, media_type: str, data: bytes, log_ns: int) -> None:
        """Add an attachment, outside any chunk and with a check sum of its own. Raises OSError."""
        self.keep(Attachment(log_ns, log_ns, name, media_type, data))

    def keep(self, record: Attachment | Metadata) -> None:
        """Add a record as it is, outside any chunk. Raises OSError: the disk is full, or gone."""
        encoded, place = encode(record), self._size
        self._append(encoded)
        if isinstance(record, Metadata):
            self._metadata_indices.append(MetadataIndex(place, len(encoded), record.name))
            return
        told = record.log_time, record.create_time, len(record.data), record.name, record.media_type
        self._attachment_indices.append(AttachmentIndex(place, len(encoded), *told))

    def finish(self, final_name: str = "") -> None:
        """Flush, add the index, and close. A file that is not finished can still be read, slower.

        The file is called ``final_name`` from now on, in its folder; where that is empty, as before.

        Raises:
            OSError: The disk is full, or gone; the file is closed all the same.
        """
        try:
            self.flush()
            self._append(self._tail())
            if final_name:
                # A link refuses to overwrite, a rename would not. By descriptor: something else may have the old name.
                os.link(f"/proc/self/fd/{self._fd}", final_name, dst_dir_fd=self._folder)
                if self._is_in(self._folder, self.path.name):
                    os.unlink(self.path.name, dir_fd=self._folder)
                self.path = self.path.with_name(final_name)
                self.place = self._find()
        finally:
            self.close()

    @property
    def free_bytes(self) -> int:
        """Room that is left for this user on the file's disk."""
        status = os.fstatvfs(self._fd)
        return status.f_bavail * status.f_frsize

    def look(self) -> Path | None:
        """Where the file is by now; None where no name leads to it: it was deleted, or its disk was unmounted."""
        self.place = self._find()
        return self.place

    def _find(self) -> Path | None:
        """Where it should be, or where its folder or itself was moved to."""
        if self._is_in(None, self.path):
            return self.path
        folder, file = (Path(f"/proc/self/fd/{fd}").readlink() for fd in (self._folder, self._fd))
        return next((path for path in (folder / self.path.name, file) if self._is_in(None, path)), None)

    def _is_in(self, folder: int | None, name: str | Path) -> bool:
        """Whether this name is the file's, and no other's or a link's."""
        try:
            return os.path.samestat(os.stat(name, dir_fd=folder, follow_symlinks=False), os.fstat(self._fd))
        except OSError:
            return False

    def close(self) -> None:
        """Close without an index; harmless after :meth:`finish`."""
        for descriptor in (self._fd, self._folder):
            if descriptor >= 0:
                os.close(descriptor)
        self._fd = self._folder = -1

    def give_up(self) -> None:
        """Close and remove a file that holds nothing yet."""
        with contextlib.suppress(OSError):
            os.unlink(self.path.name, dir_fd=self._folder)
        self.close()

    def _tail(self) -> bytes:
        """Everything behind the data: end of data, summary, offsets, footer."""
        used = sorted(self._counts)
        schemas = [self._schemas[i] for i in used if i in self._schemas]
        statistics = Statistics(
            attachment_count=len(self._attachment_indices),
            channel_count=len(used),
            channel_message_counts=dict(self._counts),
            chunk_count=len(self._chunk_indices),
            message_count=self._counts.total(),
            message_end_time=self._end_ns,
            message_start_time=self._start_ns,
            metadata_count=len(self._metadata_indices),
            schema_count=len(schemas),
        )
        groups: tuple[tuple[Opcode, Sequence[McapRecord]], ...] = (
            (Opcode.SCHEMA, schemas),
            (Opcode.CHANNEL, [self._channels[i] for i in used]),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, self._chunk_indices),
            (Opcode.ATTACHMENT_INDEX, self._attachment_indices),
            (Opcode.METADATA_INDEX, self._metadata_indices),
        )
        data_end = encode(DataEnd(0))
        summary_start = self._size + len(data_end)
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

    def _append(self, data: bytes) -> None:
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._fd, view) :]
            os.fdatasync(self._fd)
        except OSError:
            os.ftruncate(self._fd, self._size)
            os.lseek(self._fd, self._size, os.SEEK_SET)
            raise
        self._size += len(data)
