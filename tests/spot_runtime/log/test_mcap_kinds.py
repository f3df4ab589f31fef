"""Every way in which the specification lets a log be written: whole to us, and recovered with all that mcap reads."""

from __future__ import annotations

import io
import struct
import zlib
from collections import Counter
from pathlib import Path

import lz4.frame
import pytest
from mcap.reader import NonSeekingReader, SeekingReader, make_reader
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, Message, Schema
from mcap.writer import CompressionType, Writer

from spot_log import open_run, read_run
from spot_log.errors import LogReadError
from spot_log.format import codec
from spot_log.read.mcap_scan import scan_mcap
from spot_log.read.recover import recover_log
from spot_log.write.mcap_file import MAGIC, encode
from spot_log.write.run_writer import RunWriter
from spot_model.console.command_line import main
from spot_protos import log_pb2

HOUR_NS = 3600 * 10**9


def rows(log: Path, attachments: bool = False):
    with log.open("rb") as file:
        reader = make_reader(file)
        return list(reader.iter_attachments() if attachments else reader.iter_messages(log_time_order=False))


def write(out: Path, *logs: Path, foreign: bool = False, odd: bool = False, **options) -> Path:
    """What ``mcap``'s own writer makes of logs; ``odd`` puts attachments and metadata between the chunks."""
    with out.open("wb") as file:
        writer, ids = Writer(file, **options), {}
        writer.start()
        if foreign:
            camera = writer.register_channel("camera", "json", writer.register_schema("img", "jsonschema", b"{}"))
            bare = writer.register_channel("/bare", "raw", 0, {"k": "v"})
        for k, log in enumerate(logs):
            for n, (schema, channel, m) in enumerate(rows(log)):
                if (k, channel.id) not in ids:
                    number = writer.register_schema(schema.name, schema.encoding, schema.data)
                    ids[k, channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
                times = {"log_time": m.log_time + k * HOUR_NS, "publish_time": m.publish_time + k * HOUR_NS}
                writer.add_message(ids[k, channel.id], data=m.data, sequence=m.sequence, **times)
                if odd and n % 300 == 0:
                    writer.add_metadata("note", {"n": str(n)})
                    writer.add_attachment(n, n, "photo", "image/png", bytes([n % 256]) * 50)
                if foreign and n % 100 == 0:
                    writer.add_message(camera, n, b"{}", n)
                    writer.add_message(bare, n, b"\x00", n)
            for a in rows(log, attachments=True):
                writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        writer.finish()
    return out


def chunk(body: bytes, compression: str = "", data: bytes | None = None) -> bytes:
    return encode(Chunk(compression, body if data is None else data, 1, 1, zlib.crc32(body), len(body)))


def by_hand(log: Path, kind: str) -> bytes:
    """Files that the specification allows and ``mcap``'s writer does not write."""
    messages, schemas, channels = [], {}, {}
    for schema, channel, m in rows(log):
        schemas[schema.id] = encode(Schema(schema.id + 40, schema.data, schema.encoding, schema.name))
        channels[channel.id] = encode(Channel(channel.id + 40, channel.topic, "protobuf", {}, schema.id + 40))
        messages.append(encode(Message(channel.id + 40, m.log_time, m.data, m.publish_time, m.sequence)))
    declared, half = b"".join([*schemas.values(), *channels.values()]), len(messages) // 2
    old, new = b"".join(messages[:half]), b"".join(messages[half:])
    private = struct.pack("<BQ", 0x90, 5) + b"hello"
    parts = {
        "schemas before the chunks": [declared, chunk(old + new)],
        "schemas after their channels": [*channels.values(), *schemas.values(), chunk(old + new)],
        "schemas repeated": [declared, chunk(declared + old), declared, chunk(declared + new)],
        "a private record": [declared, private, chunk(old), private, new],
        "empty chunks": [
            declared,
            chunk(b""),
            chunk(b"", "lz4", lz4.frame.compress(b"")),
            chunk(b"", "zstd"),
            chunk(old + new),
        ],
        "messages after chunks": [declared, chunk(old), new],
        "schemas in the summary alone": [chunk(old + new)],
    }[kind]
    data = MAGIC + encode(Header("", "by hand")) + b"".join(parts)
    data += encode(DataEnd(zlib.crc32(data)))
    start = len(data) if "alone" in kind else 0
    return data + (declared if start else b"") + encode(Footer(start, 0, 0)) + MAGIC


def theirs(data: bytes, reader=NonSeekingReader) -> Counter:
    return Counter((c.topic, m.sequence, m.log_time, m.data) for _, c, m in reader(io.BytesIO(data)).iter_messages())


WRITERS = {
    "without chunks": {"use_chunking": False, "odd": True},
    "without chunks, with check sums": {"use_chunking": False, "enable_data_crcs": True},
    "not compressed": {"compression": CompressionType.NONE, "chunk_size": 4000, "odd": True},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 4000, "odd": True},
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 4000},
    "no message index": {"index_types": 0, "chunk_size": 4000},
    "no summary": {"repeat_channels": False, "repeat_schemas": False, "use_statistics": False},
    "foreign topics": {"foreign": True, "odd": True, "chunk_size": 4000},
}


@pytest.mark.parametrize("kind", WRITERS)
def test_what_mcap_writes_is_a_whole_log(kind: str, synthetic_log: Path, tmp_path: Path) -> None:
    options = dict(WRITERS[kind])
    if "index_types" in options:
        from mcap.writer import IndexType

        options["index_types"] = IndexType.NONE
    other = write(tmp_path / "other.mcap", synthetic_log, **options)
    whole(other, synthetic_log, tmp_path, theirs(other.read_bytes()))


@pytest.mark.parametrize(
    "kind",
    [
        "schemas before the chunks",
        "schemas after their channels",
        "schemas repeated",
        "a private record",
        "empty chunks",
        "messages after chunks",
        "schemas in the summary alone",
    ],
)
def test_what_the_specification_allows_is_a_whole_log(kind: str, synthetic_log: Path, tmp_path: Path) -> None:
    (tmp_path / "other.mcap").write_bytes(by_hand(synthetic_log, kind))
    whole(tmp_path / "other.mcap", synthetic_log, tmp_path, theirs(synthetic_log.read_bytes()))


def whole(other: Path, log: Path, folder: Path, expected: Counter) -> None:
    run, original = read_run(other), read_run(log)
    assert run.damage == ()
    assert (run.states.position_rad == original.states.position_rad).all()
    assert (len(run.ticks), len(run.events), run.outcome) == (len(original.ticks), 3, original.outcome)
    assert recover_log(other, folder / "recovered.mcap").damage == ()
    data, recovered = other.read_bytes(), (folder / "recovered.mcap").read_bytes()
    assert theirs(recovered) == theirs(recovered, SeekingReader) == expected
    kept, given = scan_mcap(recovered), scan_mcap(data)
    assert kept.metadata == given.metadata
    assert [a for a in kept.attachments if a.name == "photo"] == [a for a in given.attachments if a.name == "photo"]
    for key in {("camera", "img"), ("/bare", "")} & set(given.channels):
        (channel, schema), (old_channel, old_schema) = kept.channels[key], given.channels[key]
        assert (channel.metadata, channel.message_encoding) == (old_channel.metadata, old_channel.message_encoding)
        assert (schema and schema.data) == (old_schema and old_schema.data)


def test_a_cut_file_without_chunks_keeps_all_that_mcap_reads(synthetic_log: Path, tmp_path: Path) -> None:
    other = write(tmp_path / "other.mcap", synthetic_log, use_chunking=False)
    data = other.read_bytes()[: other.stat().st_size // 2]
    (tmp_path / "cut.mcap").write_bytes(data)
    found = []
    with pytest.raises(Exception):  # noqa: B017, PT011 - the reader says that the file is cut
        found.extend(m.data for _, _, m in NonSeekingReader(io.BytesIO(data)).iter_messages(log_time_order=False))
    assert [m.data for m in scan_mcap(data).messages][: len(found)] == found
    assert recover_log(tmp_path / "cut.mcap", tmp_path / "kept.mcap").kept["state"] > 10


def test_a_changed_byte_outside_the_chunks_is_found_by_the_check_sum(synthetic_log: Path, tmp_path: Path) -> None:
    other = write(tmp_path / "other.mcap", synthetic_log, use_chunking=False, enable_data_crcs=True)
    data = bytearray(other.read_bytes())
    at = data.index(scan_mcap(bytes(data)).of("/state").data()[5]) + 40
    data[at] ^= 1
    other.write_bytes(data)
    assert "check sum of the" in read_run(other).damage[0]


def changed(log: Path, out: Path, **header) -> Path:
    """A second run: the same messages under another header."""
    scan = scan_mcap(log.read_bytes())
    new = log_pb2.Header.FromString(scan.of("/header").data()[0])
    for name, value in header.items():
        setattr(new, name, value)
    writer = RunWriter(out, codec.header_from_proto(new))
    for message in (m for m in scan.messages if m.topic == "/state"):
        writer.add(log_pb2.State.FromString(message.data), message.sequence)
    writer.close({}, "completed")
    return out


@pytest.mark.parametrize("how", ["merged", "appended"])
def test_two_runs_in_one_file_are_refused_by_name(how: str, synthetic_log: Path, tmp_path: Path, capsys) -> None:
    second = changed(synthetic_log, tmp_path / "second.mcap", run_id="walk-2", robot_id="another")
    both = tmp_path / "both.mcap"
    if how == "merged":
        write(both, synthetic_log, second)
    else:
        both.write_bytes(synthetic_log.read_bytes() + second.read_bytes())
    told = r"holds 2 runs.*run walk-2 of another; give the logs that it was made from"
    for read in (read_run, open_run):
        with pytest.raises(LogReadError, match=told):
            read(both)
    with pytest.raises(LogReadError, match=told):
        recover_log(both, tmp_path / "out.mcap")
    for command in (["log", "info", str(both)], ["log", "export", str(both), "--out", str(tmp_path / "t")]):
        with pytest.raises(SystemExit) as left:
            main(command)
        assert left.value.code == 2
        assert "holds 2 runs" in capsys.readouterr().err.replace("\n", " ")


def test_the_same_log_twice_in_one_file_is_noticed(synthetic_log: Path, tmp_path: Path) -> None:
    both = tmp_path / "both.mcap"
    both.write_bytes(synthetic_log.read_bytes() * 2)
    assert any("were written" in text for text in read_run(both).damage)
