"""Read every message of an MCAP file, whole or damaged: what is damaged is skipped and named, the rest is given.

No bit of the file is trusted. A chunk counts when its check sum holds; after damage the scan looks for the next chunk
by the pattern of its head, and goes on there.
"""

from __future__ import annotations

import contextlib
import struct
import zlib
from array import array
from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from io import BytesIO
from typing import Final, NamedTuple

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Header, Metadata, Schema

from spot_log.format.codec import ALL_TOPICS
from spot_log.format.tables import Ints
from spot_log.read.chunks import (
    MAX_CHUNK_BYTES,
    PARSE_ERRORS,
    RECORD_HEAD,
    Budget,
    Chunk,
    find_chunk,
    read_ahead,
    read_chunk,
)
from spot_log.read.columns import Bytes, numbers_at
from spot_log.write.mcap_file import MAGIC

_U16, _U32 = struct.Struct("<H"), struct.Struct("<I")
MESSAGE_BYTES: Final = 256
"""What a message costs in memory beside its content."""

_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
_NUMBERED: Final = struct.Struct("<BQH")
"""The head of a record that begins with the number of its channel."""
_MESSAGE: Final = struct.Struct("<BQHIQQ")
_FOOTER: Final = struct.Struct("<BQQQI")


class RawMessage(NamedTuple):
    """One message as it is in the file."""

    topic: str
    schema_name: str
    sequence: int
    log_ns: int
    publish_ns: int
    data: bytes


class Rows(NamedTuple):
    """Messages of one topic, in the order of the file."""

    buffer: Bytes
    starts: Ints
    lengths: Ints
    sequence: Ints
    schema_names: set[str]

    def data(self) -> list[bytes]:
        """The content of each."""
        return [self.buffer[i : i + n].tobytes() for i, n in zip(self.starts, self.lengths, strict=True)]


@dataclass
class Scan:
    """What a file holds."""

    attachments: list[Attachment] = field(default_factory=list)
    metadata: list[Metadata] = field(default_factory=list)
    contents: list[bytes] = field(default_factory=list)
    """Of the chunks, and of messages outside of them."""
    places: array[int] = field(default_factory=lambda: array("q"))
    """Where each message's record begins in all contents together."""
    kinds: array[int] = field(default_factory=lambda: array("q"))
    """Which of the declared channels each message is of."""
    declared: list[tuple[Channel, Schema | None]] = field(default_factory=list)
    damage: list[str] = field(default_factory=list)
    """One sentence for each place that could not be read, in the order of the file."""
    lost: Counter[str] = field(default_factory=Counter)
    """Messages known to be lost, by topic; what a cut took away is not known."""
    is_cut: bool = False
    """The file ends before the data section does."""
    is_mcap: bool = True
    """The file begins as an MCAP file does, or at least one chunk of it could be read."""

    @cached_property
    def buffer(self) -> Bytes:
        """All contents, and 16 bytes more."""
        joined = b"".join([*self.contents, bytes(16)])
        self.contents.clear()
        return np.frombuffer(joined, np.uint8)

    @property
    def names(self) -> list[tuple[str, str]]:
        """Topic and name of the schema of each declared channel."""
        return [(channel.topic, "" if schema is None else schema.name) for channel, schema in self.declared]

    @property
    def channels(self) -> dict[tuple[str, str], tuple[Channel, Schema | None]]:
        """Of its messages, by topic and name of the schema; what was declared first counts."""
        names = self.names
        return {names[kind]: self.declared[kind] for kind in sorted(set(self.kinds), reverse=True)}

    @cached_property
    def messages(self) -> list[RawMessage]:
        """All messages, in the order of the file."""
        names, found, content = self.names, [], self.buffer.data
        for place, kind in zip(self.places, self.kinds, strict=True):
            _, length, _, sequence, log_ns, publish_ns = _MESSAGE.unpack_from(content, place)
            body = bytes(content[place + _MESSAGE.size : place + RECORD_HEAD.size + length])
            found.append(RawMessage(*names[kind], sequence, log_ns, publish_ns, body))
        return found

    @property
    def counts(self) -> Counter[str]:
        """Messages by topic."""
        names = self.names
        return sum((Counter({names[k][0]: n}) for k, n in Counter(self.kinds).items()), Counter())

    def of(self, topic: str, schema_name: str | None = None) -> Rows:
        """The messages of one topic, and of one schema if it is given."""
        chosen = {k: of for k, (name, of) in enumerate(self.names) if name == topic and schema_name in (None, of)}
        kinds = np.array(self.kinds, dtype=np.int64)
        is_chosen = np.isin(kinds, list(chosen))
        places = np.array(self.places, dtype=np.int64)[is_chosen]
        lengths = numbers_at(self.buffer, places + 1, "<u8").astype(np.int64) - _MESSAGE_HEAD.size
        sequence = numbers_at(self.buffer, places + RECORD_HEAD.size + 2, "<u4").astype(np.int64)
        names = {chosen[kind] for kind in np.unique(kinds[is_chosen]).tolist()}
        return Rows(self.buffer, places + _MESSAGE.size, lengths, sequence, names)


def scan_mcap(data: bytes) -> Scan:
    """Read all that can be read of ``data``, the content of an MCAP file. Never raises on bad content."""
    return _Scanner(data).run()


class _Scanner:
    def __init__(self, data: bytes) -> None:
        self._data = data
        self._scan = Scan()
        self._budget = Budget(len(data))
        self._ahead, self._size = read_ahead(data), 0
        self._lost_chunk = self._in_index = False
        self._begin(0)

    def _begin(self, offset: int) -> None:
        """A file begins here. Numbers are fixed in our own files, so channels are known even where none is declared."""
        self._start = offset
        self._channels = {t.channel_id: Channel(t.channel_id, t.name, "", {}, t.channel_id) for t in ALL_TOPICS}
        self._schemas = {t.channel_id: Schema(t.channel_id, b"", "", t.schema_name) for t in ALL_TOPICS}
        self._kinds: dict[int, int] = {}
        """Place of a channel among those declared, by its number."""

    def run(self) -> Scan:
        data, scan = self._data, self._scan
        is_magic = data[: len(MAGIC)] == MAGIC
        if not is_magic:
            scan.damage.append("the first 8 bytes are not those of an MCAP file")
        self._read_summary()
        offset = len(MAGIC)
        is_ended = False
        while offset < len(data) and not is_ended and not self._budget.is_spent:
            step = self._record(offset)
            if step is None:
                offset = self._skip_damage(offset)
                continue
            offset, is_ended = step
            if is_ended and (joint := data.find(MAGIC + MAGIC, offset)) >= 0:
                self._begin(joint + len(MAGIC))  # files that were appended to one another
                offset, is_ended = self._start + len(MAGIC), False
        if self._budget.is_spent:
            scan.is_cut = True
            scan.damage.append(
                f"{len(data)} bytes expand to more than {self._budget.limit}: what comes after is not read"
            )
        elif not is_ended and not scan.is_cut:
            scan.is_cut = True
            scan.damage.append(f"the file ends at byte {len(data)} without an end of data")
        scan.is_mcap = is_magic or bool(scan.places)
        return scan

    def _read_summary(self) -> None:
        """Learn the channels that a whole summary repeats: a file may declare them there alone."""
        footer = len(self._data) - _FOOTER.size - len(MAGIC)
        if footer < 0 or self._data[-len(MAGIC) :] != MAGIC:
            return
        opcode, length, start, _, crc = _FOOTER.unpack_from(self._data, footer)
        is_whole = opcode == Opcode.FOOTER and length == _FOOTER.size - RECORD_HEAD.size and 0 < start <= footer
        if is_whole and crc in (0, zlib.crc32(self._data[start : footer + _FOOTER.size - 4])):
            with contextlib.suppress(*PARSE_ERRORS):
                self._content(self._data[start:footer])
            del self._scan.places[:], self._scan.kinds[:]
            self._scan.lost.clear()

    def _skip_damage(self, offset: int) -> int:
        """Go on at the next whole chunk, whatever its record's head says; return the offset after it."""
        found = find_chunk(self._data, offset, self._budget)
        end = len(self._data) if found is None else found[0]
        self._scan.is_cut = found is None
        where = "to the end of the file" if found is None else "up to the next whole chunk"
        self._scan.damage.append(f"{end - offset} bytes from byte {offset} {where} cannot be read")
        return end if found is None else self._take_chunk(*found)

    def _record(self, offset: int) -> tuple[int, bool] | None:
        """Read the record at ``offset``; return the next offset and whether the data ended, None if it is damaged."""
        data = self._data
        if offset + RECORD_HEAD.size > len(data):
            return None
        opcode, length = RECORD_HEAD.unpack_from(data, offset)
        start, end = offset + RECORD_HEAD.size, offset + RECORD_HEAD.size + length
        if opcode == Opcode.CHUNK:
            return self._chunk_record(offset)
        if end > len(data):
            return None
        try:
            if opcode == Opcode.MESSAGE_INDEX:
                self._message_index(start, length)
                self._in_index = True
                return end, False
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                if length not in (4, 20):
                    return None
                self._check_data(opcode, start)
                return end, True
            is_good = self._other_record(opcode, start, end)
        except PARSE_ERRORS:
            return None
        self._lost_chunk = self._in_index = False
        return (end, False) if is_good else None

    def _check_data(self, opcode: int, start: int) -> None:
        (crc,) = _U32.unpack_from(self._data, start)
        data = self._data[self._start : start - RECORD_HEAD.size]
        if opcode == Opcode.DATA_END and crc and not self._scan.damage and zlib.crc32(data) != crc:
            self._scan.damage.append(f"the check sum of the {len(data)} bytes of data does not hold")

    def _other_record(self, opcode: int, start: int, end: int) -> bool:
        """Take a record; return whether it is whole. A kind that the format does not know is for others, and passed."""
        if opcode == Opcode.ATTACHMENT:
            self._attachment(start, end)
        elif opcode == Opcode.METADATA:
            self._scan.metadata.append(Metadata.read(_stream(self._data, start, end)))
        elif opcode == Opcode.HEADER:
            header = _stream(self._data, start, end)
            Header.read(header)
            return header.count <= end - start
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            if self._in_index and self._is_index(start, end):
                return False
            self._content(self._data[start - RECORD_HEAD.size : end])
        else:
            # Not a chunk or an index whose kind is damaged, and not chance: another record follows.
            is_chunk = isinstance(read_chunk(self._data, start - RECORD_HEAD.size, self._budget), Chunk)
            return bool(opcode) and not is_chunk and not self._is_index(start, end) and _is_record_head(self._data, end)
        return True

    def _is_index(self, start: int, end: int) -> bool:
        """Whether these bytes are a message index, whatever the record's head says: channel, size, a stamp, a place."""
        if end - start < _MESSAGE_HEAD.size:
            return False
        _, size, _, place = _MESSAGE_HEAD.unpack_from(self._data, start)
        return bool(size + 6 == end - start and size % 16 == 0 and place < MAX_CHUNK_BYTES)

    def _chunk_record(self, offset: int) -> tuple[int, bool] | None:
        ahead = self._ahead.pop(offset, None)
        is_allowed = ahead and self._budget.take(len(ahead.content) + ahead.end - offset)
        chunk = ahead if ahead and is_allowed else read_chunk(self._data, offset, self._budget)
        if isinstance(chunk, Chunk):
            return self._take_chunk(offset, chunk), False
        # The chunk is bad; if its length is good, its index follows and tells what was in it.
        _, length = RECORD_HEAD.unpack_from(self._data, offset)
        end = offset + RECORD_HEAD.size + length
        if not _is_record_head(self._data, end):
            return None
        self._scan.damage.append(f"chunk of {length} bytes at byte {offset}: {chunk}")
        self._lost_chunk = self._in_index = True
        return end, False

    def _take_chunk(self, offset: int, chunk: Chunk) -> int:
        self._lost_chunk, self._in_index = False, True
        before = len(self._scan.places)
        try:
            self._content(chunk.content)
        except PARSE_ERRORS as error:
            self._scan.damage.append(f"chunk at byte {offset}: {error}")
        self._budget.take(MESSAGE_BYTES * (len(self._scan.places) - before))
        return chunk.end

    def _content(self, content: bytes) -> None:
        begin, offset, end = self._size, 0, len(content)
        self._scan.contents.append(content)
        self._size += end
        # This loop takes most of what one core alone has to do, so it looks nothing up.
        keep, keep_kind, kinds, is_message = (
            self._scan.places.append,
            self._scan.kinds.append,
            self._kinds,
            int(Opcode.MESSAGE),
        )
        unpack, head_size, message_size = _NUMBERED.unpack_from, RECORD_HEAD.size, _MESSAGE_HEAD.size
        while offset + head_size <= end:
            # What is shorter has no number, and is no message.
            opcode, length, number = unpack(content if offset + 11 <= end else content + b"\0\0", offset)
            start = offset + head_size
            if start + length > end:
                raise ValueError(f"a record of {length} bytes is longer than what is left of its chunk")
            if opcode == is_message:
                if length < message_size:
                    raise ValueError(f"a message of {length} bytes is shorter than its head")
                kind = kinds.get(number)
                if kind is None:
                    kind = self._new_kind(number)
                if kind >= 0:
                    keep(begin + offset)
                    keep_kind(kind)
            elif opcode == Opcode.CHANNEL:
                channel = _channel(content[start : start + length])
                if self._channels.get(channel.id) != channel:
                    self._channels[channel.id] = channel
                    kinds.pop(channel.id, None)
            elif opcode == Opcode.SCHEMA:
                schema = Schema.read(_stream(content, start, start + length))
                self._schemas[schema.id] = schema
                kinds.clear()
            offset = start + length

    def _new_kind(self, number: int) -> int:
        """Place of a channel among those declared; -1 where it is not, and the message is lost."""
        channel = self._channels.get(number)
        if channel is None:
            self._scan.lost[f"channel {number}"] += 1
            return -1
        self._scan.declared.append((channel, self._schemas.get(channel.schema_id)))
        return self._kinds.setdefault(number, len(self._scan.declared) - 1)

    def _message_index(self, start: int, length: int) -> None:
        (channel,), (size,) = _U16.unpack_from(self._data, start), _U32.unpack_from(self._data, start + 2)
        if size + 6 != length or size % 16:
            raise ValueError("a message index has a wrong length")
        if self._lost_chunk:
            known = self._channels.get(channel)
            self._scan.lost[known.topic if known else f"channel {channel}"] += size // 16

    def _attachment(self, start: int, end: int) -> None:
        (crc,) = _U32.unpack_from(self._data, end - 4)
        if crc and zlib.crc32(self._data[start : end - 4]) != crc:
            self._scan.damage.append(f"attachment at byte {start}: its check sum does not hold")
            return
        self._scan.attachments.append(Attachment.read(_stream(self._data, start, end)))


@lru_cache(256)
def _channel(body: bytes) -> Channel:
    """A channel; each chunk of our own repeats those of its messages."""
    channel: Channel = Channel.read(_stream(body, 0, len(body)))
    return channel


def _stream(data: bytes, start: int, end: int) -> ReadDataStream:
    """A record's body for ``mcap``'s own records to read."""
    return ReadDataStream(BytesIO(data[start:end]))


def _is_record_head(data: bytes, offset: int) -> bool:
    if offset + RECORD_HEAD.size > len(data):
        return False
    opcode, length = RECORD_HEAD.unpack_from(data, offset)
    return bool(1 <= opcode <= max(Opcode)) and offset + RECORD_HEAD.size + length <= len(data)
