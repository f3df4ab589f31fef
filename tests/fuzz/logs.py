"""Logs: reader, recovery, and the hand-off to the log's process.

The first byte of an input says what the rest is: a file as it is, or the content of a chunk, which is then given a
head, a length and a check sum that hold, so that the fuzzer need not guess a CRC.
"""

from __future__ import annotations

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
from support import Target, folder, refusing

HEADER_RECORD = struct.pack("<BQII", 1, 8, 0, 0)
NOW_NS = 1_700_000_000_000_000_000


def file_of(data: bytes) -> bytes:
    """The file that an input means."""
    from spot_log.write.mcap_file import MAGIC

    kind, rest = (data[:1] or b"\0")[0] % 2, data[1:]
    return MAGIC + HEADER_RECORD + chunk_of(rest) if kind else rest


def chunk_of(content: bytes) -> bytes:
    """A chunk's record, uncompressed."""
    head = struct.pack("<QQQII", NOW_NS, NOW_NS, len(content), zlib.crc32(content), 0)
    body = head + struct.pack("<Q", len(content)) + content
    return struct.pack("<BQ", 6, len(body)) + body


def log_reader(data: bytes) -> None:
    """The reader: whatever it is, it is read as far as it goes, or refused."""
    from spot_log.read.mcap_scan import scan_mcap
    from spot_log.read.reader import header_of, run_of

    path = Path("fuzzed.mcap")
    scan = scan_mcap(file_of(data))
    with refusing():
        run_of(path, header_of(path, scan), scan)


def log_recovery(data: bytes) -> None:
    """Recovery: a whole log comes out, or a refusal, and never half a file."""
    recover(file_of(data))


def recover(log: bytes) -> None:
    """Recover a file, and read what came of it."""
    from spot_log import read_run, recover_log
    from spot_log.write.run_writer import active_path

    source, result = folder() / "damaged.mcap", folder() / "recovered.mcap"
    source.write_bytes(log)
    try:
        with refusing():
            recover_log(source, result)
            read_run(result)
        if active_path(result).exists():
            raise AssertionError("a half-written result was left")
    finally:
        result.unlink(missing_ok=True)
        active_path(result).unlink(missing_ok=True)


def log_seeds() -> list[bytes]:
    """The content of a chunk with one record of each topic, a file of it, and a log of ours without its index."""
    from spot_log.write.mcap_file import MAGIC

    content = b"".join(message_record(*message) for message in own_messages())
    header = content[: len(message_record(*own_messages()[0]))]
    whole = small_log()
    return [
        b"\x01" + content,
        b"\x01" + header,
        b"\x00" + MAGIC + HEADER_RECORD + chunk_of(header),
        b"\x00" + whole[:4000],
    ]


def message_record(channel: int, data: bytes) -> bytes:
    """One message as it lies in a chunk."""
    body = struct.pack("<HIQQ", channel, 0, NOW_NS, NOW_NS) + data
    return struct.pack("<BQ", 5, len(body)) + body


def own_messages() -> list[tuple[int, bytes]]:
    """One message of each of our topics."""
    from spot_log.format.records import SCHEMA_NAME
    from spot_protos import log_pb2 as pb

    twelve, three = [0.1] * 12, [0.1] * 3
    messages: list[Any] = [
        pb.Header(schema=SCHEMA_NAME, run_id="seed", started_host_stamp_ns=NOW_NS),
        pb.State(robot_stamp_ns=NOW_NS, host_stamp_ns=NOW_NS, position_rad=twelve, velocity_rad_s=twelve),
        pb.Command(key=1, position_rad=twelve, kp_nm_per_rad=twelve),
        pb.Tick(index=1, mode="active", action=twelve, velocity_command=three),
        pb.SlowState(battery_voltage_v=55.0, motor_temperature_c={"fl_kn": 40.0}, system_faults=["a"]),
        pb.Event(severity="INFO", name="mode", text="ready → active", values={"a": 1.0}),
        pb.Footer(outcome="completed", messages={"state": 1}),
    ]
    return [(channel, message.SerializeToString()) for channel, message in enumerate(messages, start=1)]


def small_log() -> bytes:
    """A log with one record of each topic."""
    from spot_log.format.records import CommandRecord, EventRecord, RunHeader, Severity, TickRecord
    from spot_log.write import hand_off
    from spot_log.write.run_writer import RunWriter
    from spot_model.robot.state import Gains, JointCommand, RobotState, SlowState

    path, zeros, now_ns = folder() / "seed.mcap", np.zeros(12), NOW_NS
    path.unlink(missing_ok=True)
    writer = RunWriter(path, RunHeader("seed", now_ns), min_free_bytes=0)
    three, level, feet = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.ones(4, dtype=np.bool_)
    state = RobotState(zeros, zeros, zeros, three, level, three, three, feet, now_ns, now_ns, 1, now_ns)
    command = JointCommand(1, zeros, zeros, zeros, Gains.policy(), now_ns + 50_000_000)
    small = np.zeros(12, dtype=np.float32)
    observation = np.zeros(48, dtype=np.float32)
    tick = TickRecord(1, now_ns, now_ns, "active", observation, small, three, 0.0, 0.0, 0.0, 1, 0)
    for packed in (
        hand_off.pack(0, state),
        hand_off.pack(0, CommandRecord(command, zeros, now_ns, now_ns, now_ns)),
        hand_off.pack(0, tick),
        hand_off.pack(0, SlowState(now_ns, now_ns, True, False, 80.0, 55.0, -5.0, (30.0,), {"fl_kn": 40.0})),
        hand_off.pack(0, EventRecord(now_ns, now_ns, Severity.INFO, "mode", "ready → activating", {"a": 1.0})),
    ):
        message: Any = hand_off.unpack(packed).message
        writer.add(message, 0)
    writer.close({}, "completed")
    return path.read_bytes()


def datagram(data: bytes) -> None:
    """What the log's process is handed."""
    from google.protobuf.message import DecodeError

    from spot_log.write.hand_off import unpack

    with refusing(ValueError, struct.error, DecodeError):
        unpack(data)


def datagram_seeds() -> list[bytes]:
    head = struct.Struct("<BI")
    return [head.pack(kind, 0) + bytes(size) for kind, size in ((1, 8), (3, 676), (4, 76), (5, 4), (6, 4), (7, 0))]


MCAP_WORDS = (b"\x89MCAP0\r\n", b"zstd", b"lz4", b"\xff" * 8, b"\x04\x00\x00\x00zstd", b"spot-rl header")
LOG = ("spot_log",)
LOGS = {
    "log_reader": Target(log_reader, log_seeds, LOG, 4096, MCAP_WORDS, "some fifty arrays a log"),
    "log_recovery": Target(
        log_recovery, log_seeds, LOG, 4096, MCAP_WORDS, "writes a whole log with its schemas and reads it twice"
    ),
    "datagram": Target(datagram, datagram_seeds, LOG, 1024),
}
