"""Read every message of an MCAP file, whole or damaged: what is damaged is skipped and named, the rest is given.

No bit of the file is trusted. A chunk counts when its check sum holds; after damage the scan looks for the next chunk
by the pattern of its head, and goes on there.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from mcap.opcode import Opcode

from spot_log.format.topics import ALL_TOPICS
from spot_log.read.mcap_chunk import PARSE_ERRORS, RECORD_HEAD, Budget, Chunk, find_chunk, read_chunk, read_string
from spot_log.write.mcap_tail import MAGIC

MESSAGE_BYTES: Final = 256
"""What a message costs in memory beside its content."""

_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")
_U16, _U32, _U64 = struct.Struct("<H"), struct.Struct("<I"), struct.Struct("<Q")


class RawMessage(NamedTuple):
    """One message as it is in the file."""

    topic: str
    schema_name: str
    sequence: int
    log_ns: int
    publish_ns: int
    data: bytes


@dataclass
class Scan:
    """What a file holds."""

    messages: list[RawMessage] = field(default_factory=list)
    attachments: dict[str, bytes] = field(default_factory=dict)
    damage: list[str] = field(default_factory=list)
    """One sentence for each place that could not be read, in the order of the file."""
    lost: Counter[str] = field(default_factory=Counter)
    """Messages known to be lost, by topic; what a cut took away is not known."""
    is_cut: bool = False
    """The file ends before the data section does."""
    is_mcap: bool = True
    """The file begins as an MCAP file does, or at least one chunk of it could be read."""

    def by_topic(self) -> dict[str, list[RawMessage]]:
        """The messages of each topic, in the order of the file."""
        topics: dict[str, list[RawMessage]] = {}
        for message in self.messages:
            topics.setdefault(message.topic, []).append(message)
        return topics


def scan_mcap(data: bytes) -> Scan:
    """Read all that can be read of ``data``, the content of an MCAP file. Never raises on bad content."""
    return _Scanner(data).run()


class _Scanner:
    def __init__(self, data: bytes) -> None:
        self._data = data
        self._scan = Scan()
        self._budget = Budget(len(data))
        # Numbers are fixed in our own files, so channels are known even where their records are lost.
        self._topics = {topic.channel_id: topic.name for topic in ALL_TOPICS}
        self._schema_of_channel = {topic.channel_id: topic.channel_id for topic in ALL_TOPICS}
        self._schemas = {topic.channel_id: topic.schema_name for topic in ALL_TOPICS}
        self._lost_chunk = False

    def run(self) -> Scan:
        data, scan = self._data, self._scan
        is_magic = data[: len(MAGIC)] == MAGIC
        if not is_magic:
            scan.damage.append("the first 8 bytes are not those of an MCAP file")
        offset = len(MAGIC)
        is_ended = False
        while offset < len(data) and not is_ended and not self._budget.is_spent:
            step = self._record(offset)
            if step is None:
                offset = self._skip_damage(offset)
                continue
            offset, is_ended = step
        if self._budget.is_spent:
            scan.is_cut = True
            scan.damage.append(
                f"{len(data)} bytes expand to more than {self._budget.limit}: what comes after is not read"
            )
        elif not is_ended and not scan.is_cut:
            scan.is_cut = True
            scan.damage.append(f"the file ends at byte {len(data)} without an end of data")
        scan.is_mcap = is_magic or bool(scan.messages)
        return scan

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
                return end, False
            self._lost_chunk = False
            if opcode in (Opcode.DATA_END, Opcode.FOOTER):
                return (end, True) if length in (4, 20) else None
            return (end, False) if self._other_record(opcode, start, end) else None
        except PARSE_ERRORS:
            return None

    def _other_record(self, opcode: int, start: int, end: int) -> bool:
        data = self._data
        if opcode == Opcode.ATTACHMENT:
            self._attachment(start, end)
        elif opcode == Opcode.HEADER:
            _, at = read_string(data, start, end)
            _, at = read_string(data, at, end)
            return at <= end
        else:
            # Messages outside chunks have no check sum, and this program writes none: what looks like one is an index
            # whose kind is damaged.
            return opcode == Opcode.METADATA
        return True

    def _chunk_record(self, offset: int) -> tuple[int, bool] | None:
        chunk = read_chunk(self._data, offset, self._budget)
        if isinstance(chunk, Chunk):
            return self._take_chunk(offset, chunk), False
        # The chunk is bad; if its length is good, its index follows and tells what was in it.
        _, length = RECORD_HEAD.unpack_from(self._data, offset)
        end = offset + RECORD_HEAD.size + length
        if not _is_record_head(self._data, end):
            return None
        self._scan.damage.append(f"chunk of {length} bytes at byte {offset}: {chunk}")
        self._lost_chunk = True
        return end, False

    def _take_chunk(self, offset: int, chunk: Chunk) -> int:
        self._lost_chunk = False
        before = len(self._scan.messages)
        try:
            self._content(chunk.content)
        except PARSE_ERRORS as error:
            self._scan.damage.append(f"chunk at byte {offset}: {error}")
        self._budget.take(MESSAGE_BYTES * (len(self._scan.messages) - before))
        return chunk.end

    def _content(self, content: bytes) -> None:
        offset, end = 0, len(content)
        append, topics = self._scan.messages.append, self._topics
        head_size, message_head_size = RECORD_HEAD.size, _MESSAGE_HEAD.size
        while offset + head_size <= end:
            opcode, length = RECORD_HEAD.unpack_from(content, offset)
            start = offset + head_size
            offset = start + length
            if offset > end:
                raise ValueError(f"a record of {length} bytes is longer than what is left of its chunk")
            if opcode == Opcode.MESSAGE:
                channel, sequence, log_ns, publish_ns = _MESSAGE_HEAD.unpack_from(content, start)
                topic = topics.get(channel)
                if topic is None:
                    self._scan.lost[f"channel {channel}"] += 1
                    continue
                schema = self._schemas.get(self._schema_of_channel[channel], "")
                body = content[start + message_head_size : offset]
                append(RawMessage(topic, schema, sequence, log_ns, publish_ns, body))
            elif opcode == Opcode.CHANNEL:
                (channel,), (schema_id,) = _U16.unpack_from(content, start), _U16.unpack_from(content, start + 2)
                topics[channel], _ = read_string(content, start + 4, offset)
                self._schema_of_channel[channel] = schema_id
            elif opcode == Opcode.SCHEMA:
                (schema_id,) = _U16.unpack_from(content, start)
                self._schemas[schema_id], _ = read_string(content, start + 2, offset)

    def _message_index(self, start: int, length: int) -> None:
        (channel,), (size,) = _U16.unpack_from(self._data, start), _U32.unpack_from(self._data, start + 2)
        if size + 6 != length or size % 16:
            raise ValueError("a message index has a wrong length")
        if self._lost_chunk:
            self._scan.lost[self._topics.get(channel, f"channel {channel}")] += size // 16

    def _attachment(self, start: int, end: int) -> None:
        (crc,) = _U32.unpack_from(self._data, end - 4)
        if crc and zlib.crc32(self._data[start : end - 4]) != crc:
            self._scan.damage.append(f"attachment at byte {start}: its check sum does not hold")
            return
        name, at = read_string(self._data, start + 16, end)
        _, at = read_string(self._data, at, end)
        (size,) = _U64.unpack_from(self._data, at)
        self._scan.attachments[name] = self._data[at + 8 : at + 8 + size]


def _is_record_head(data: bytes, offset: int) -> bool:
    if offset + RECORD_HEAD.size > len(data):
        return False
    opcode, length = RECORD_HEAD.unpack_from(data, offset)
    return bool(1 <= opcode <= max(Opcode)) and offset + RECORD_HEAD.size + length <= len(data)
