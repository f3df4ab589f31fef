"""Small files that expand to a lot: read as far as a file of their size may, quickly, and said so."""

from __future__ import annotations

import struct
import zlib

import pytest
import zstandard
from mcap.opcode import Opcode

from spot_log import read_run
from spot_log.errors import LogReadError
from spot_log.read.chunks import FREE_BYTES, MAX_EXPANSION, Budget
from spot_log.read.mcap_scan import scan_mcap
from spot_log.write.mcap_file import MAGIC


def chunk_of(content: bytes, *, crc: int | None = None) -> bytes:
    data = zstandard.compress(content, 19)
    crc = zlib.crc32(content) if crc is None else crc
    head = struct.pack("<QQQI", 0, 0, len(content), crc) + struct.pack("<I", 4) + b"zstd" + struct.pack("<Q", len(data))
    return struct.pack("<BQ", Opcode.CHUNK, len(head) + len(data)) + head + data


def message_of(body: bytes, channel: int = 2) -> bytes:
    return struct.pack("<BQHIQQ", Opcode.MESSAGE, 22 + len(body), channel, 0, 1, 1) + body


def allowed(data: bytes) -> int:
    return FREE_BYTES + MAX_EXPANSION * len(data)


@pytest.mark.parametrize("name", ["many chunks", "bad check sums", "overlapping heads", "empty messages"])
def test_a_small_file_that_expands_is_read_to_its_bound(name: str) -> None:
    zeros = message_of(bytes(4_000_000))
    files = {
        "many chunks": MAGIC + chunk_of(zeros) * 60,
        "bad check sums": MAGIC + chunk_of(zeros, crc=1) * 60,
        "overlapping heads": MAGIC + b"\xff" * 20 + chunk_of(zeros, crc=1)[:60] * 500 + zstandard.compress(zeros),
        "empty messages": MAGIC + chunk_of(message_of(b"") * 400_000),
    }
    data = files[name]
    assert len(data) < 60_000
    scan = scan_mcap(data)
    assert sum(len(message.data) for message in scan.messages) <= allowed(data)
    assert len(scan.messages) <= 400_000
    assert scan.is_cut
    assert len(scan.damage) < 100
    if name != "overlapping heads":
        assert f"expand to more than {allowed(data)}" in scan.damage[-1]


def test_a_budget_is_spent_once() -> None:
    budget = Budget(0)
    assert budget.take(FREE_BYTES - 1)
    assert not budget.take(2)
    assert budget.is_spent
    assert not budget.take(0)


def test_a_log_that_compresses_well_is_read_whole(tmp_path, synthetic_run) -> None:
    """One minute of states that never change, the most that an honest log can be compressed."""
    from spot_log.write.run_writer import RunWriter
    from spot_protos import log_pb2

    run = synthetic_run()
    writer = RunWriter(tmp_path / "still.mcap", run.header)
    for number in range(20_000):
        writer.add(log_pb2.State(robot_stamp_ns=1 + number, host_stamp_ns=1 + number, position_rad=[0.0] * 12), number)
        if writer.is_chunk_full:
            writer.flush()
    writer.close({}, "completed")
    log = read_run(tmp_path / "still.mcap")
    assert len(log.states) == 20_000
    assert log.damage == ()


def test_a_state_with_a_flood_of_packets_is_refused(tmp_path, synthetic_run) -> None:
    from spot_log.write.run_writer import RunWriter
    from spot_protos import log_pb2

    writer = RunWriter(tmp_path / "flood.mcap", synthetic_run().header)
    state = log_pb2.State(robot_stamp_ns=1, host_stamp_ns=1)
    state.imu.extend([type(state.imu.add())()] * 10_000)
    writer.add(state, 0)
    writer.close({}, "completed")
    with pytest.raises(LogReadError, match=r"IMU packets; allowed: at most 256"):
        read_run(tmp_path / "flood.mcap")
