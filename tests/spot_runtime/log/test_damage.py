"""Cut and damaged logs: read as far as they go, recovered, or refused in words; never a crash, never wrong data."""

from __future__ import annotations

import fcntl
import os
import shutil

import numpy as np
import pytest

from spot_log import read_run, recover_leftovers, recover_log
from spot_log.errors import LogExistsError, LogReadError, MissingHeaderError, NotAnMcapError
from spot_log.read import recover
from spot_log.read.mcap_scan import scan_mcap
from spot_log.write.run_writer import RunWriter, active_path


@pytest.fixture(scope="module")
def log_bytes(synthetic_log):
    return synthetic_log.read_bytes()


@pytest.fixture(scope="module")
def true_messages(log_bytes):
    return set(scan_mcap(log_bytes).messages)


def check(path, tmp_path, true_messages):
    """Read and recover one damaged log; return what happened, and what a scan finds in it."""
    scan = scan_mcap(path.read_bytes())
    assert set(scan.messages) <= true_messages, "a message that nobody wrote"
    result = tmp_path / f"{path.stem}-recovered.mcap"
    try:
        run = read_run(path)
    except LogReadError:
        with pytest.raises(LogReadError, match=str(path)):
            recover_log(path, result)
        assert not result.exists()
        return "refused", scan
    recovery = recover_log(path, result)
    again = read_run(result)
    assert len(again.states) == len(run.states) == recovery.kept["state"]
    np.testing.assert_array_equal(again.states.position_rad, run.states.position_rad)
    assert not active_path(result).exists()
    assert bool(recovery.damage) == bool(scan.damage)
    result.unlink()
    return "read", scan


def test_fifty_cuts(log_bytes, true_messages, tmp_path):
    rng = np.random.default_rng(7)
    cuts = [0, 5, 8, 9, len(log_bytes) - 1, *rng.integers(10, len(log_bytes), size=45)]
    outcomes = {"read": 0, "refused": 0}
    counts = []
    for n, cut in enumerate(sorted(int(c) for c in cuts)):
        path = tmp_path / f"cut{n}.mcap"
        path.write_bytes(log_bytes[:cut])
        outcome, scan = check(path, tmp_path, true_messages)
        outcomes[outcome] += 1
        counts.append(len(scan.messages))
        if cut < len(log_bytes) - 40_000:
            assert scan.is_cut
    assert counts == sorted(counts)
    assert outcomes["read"] >= 44


def test_eighty_flipped_bits(log_bytes, true_messages, tmp_path):
    rng = np.random.default_rng(11)
    worst = len(true_messages)
    for n in range(80):
        data = bytearray(log_bytes)
        bit = int(rng.integers(0, 8 * len(data)))
        data[bit // 8] ^= 1 << (bit % 8)
        path = tmp_path / f"flip{n}.mcap"
        path.write_bytes(data)
        if n % 4 == 0:
            outcome, scan = check(path, tmp_path, true_messages)
            assert outcome == "read"
        else:
            scan = scan_mcap(bytes(data))
            assert set(scan.messages) <= true_messages
            read_run(path)
        worst = min(worst, len(scan.messages))
        path.unlink()
    # One bit costs one chunk of at most 300 records and their viewer copies at most.
    assert worst >= len(true_messages) - 500


def test_every_bit_of_a_chunks_head(log_bytes, true_messages):
    """Opcode, length, times, sizes, check sum, compression: wherever it hits, at most this chunk is lost."""
    second = log_bytes.index(b"\x04\x00\x00\x00zstd", 40_000) - 37
    assert log_bytes[second] == 6
    for bit in range(8 * 60):
        data = bytearray(log_bytes)
        data[second + bit // 8] ^= 1 << (bit % 8)
        scan = scan_mcap(bytes(data))
        assert set(scan.messages) <= true_messages
        assert len(scan.messages) >= len(true_messages) - 500, bit


def test_an_index_whose_kind_is_damaged_is_no_message(log_bytes, true_messages):
    """One bit makes a message of a message index; outside a chunk nothing has a check sum, so nothing is believed."""
    at, tried = 0, 0
    while (at := log_bytes.find(b"\x07", at + 1)) >= 0 and tried < 40:
        if log_bytes[at + 3 : at + 9] != bytes(6):
            continue
        tried += 1
        data = bytearray(log_bytes)
        data[at] ^= 2
        assert set(scan_mcap(bytes(data)).messages) <= true_messages, at
    assert tried > 20


def test_a_lost_chunk_is_counted_by_its_index(log_bytes, tmp_path):
    at = log_bytes.index(b"\x04\x00\x00\x00zstd", 40_000) + 200
    data = bytearray(log_bytes)
    data[at] ^= 0xFF
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    run = read_run(path)
    scan = scan_mcap(bytes(data))
    assert not scan.is_cut
    lost = scan.lost["/state"]
    assert lost > 100
    assert len(run.states) == 667 - lost
    assert f"lost for certain: {lost} of /state" in run.damage
    assert run.truncated


def test_a_log_without_its_first_chunk_takes_the_header_from_its_copy(synthetic_run, log_bytes, tmp_path):
    at = log_bytes.index(b"\x04\x00\x00\x00zstd") + 40
    data = bytearray(log_bytes)
    data[at] ^= 0xFF
    path = tmp_path / "damaged.mcap"
    path.write_bytes(data)
    assert read_run(path).header == synthetic_run().header
    recover_log(path, tmp_path / "new.mcap")
    assert read_run(tmp_path / "new.mcap").header == synthetic_run().header


def test_a_cut_log_says_what_is_missing(log_bytes, tmp_path):
    path = tmp_path / "cut.mcap"
    path.write_bytes(log_bytes[: len(log_bytes) // 2])
    run = read_run(path)
    assert run.truncated
    assert "cannot be read" in run.damage[0]
    assert run.damage[-1] == "the log has no footer: it was not closed, and its last half second may be missing"
    assert run.outcome.startswith("unknown")
    recovery = recover_log(path, tmp_path / "new.mcap")
    again = read_run(tmp_path / "new.mcap")
    assert again.outcome.startswith("recovered: ")
    assert again.truncated
    assert again.footer is not None
    assert again.footer.messages["state"] == recovery.kept["state"] == len(run.states)


def test_refusals(synthetic_run, tmp_path):
    empty, text, foreign = tmp_path / "empty.mcap", tmp_path / "text.mcap", tmp_path / "foreign.mcap"
    empty.write_bytes(b"")
    text.write_text("joint,position\n" * 100)
    from mcap.writer import Writer

    with foreign.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("foo", "jsonschema", b"{}")
        channel = writer.register_channel("/foo", "json", schema)
        writer.add_message(channel, 1, b"{}", 1)
        writer.finish()
    with pytest.raises(NotAnMcapError, match=r"empty\.mcap is empty; expected a log written by spot-rl"):
        read_run(empty)
    with pytest.raises(NotAnMcapError, match=r"text\.mcap \(1500 bytes\) is not an MCAP file"):
        read_run(text)
    with pytest.raises(MissingHeaderError, match=r"no /header record.*topics found: /foo.*spot-rl log import"):
        read_run(foreign)
    from dataclasses import replace

    other = tmp_path / "other.mcap"
    RunWriter(other, replace(synthetic_run().header, schema="spot-rl/log/99")).close({}, "completed")
    with pytest.raises(LogReadError, match="records of schema 'spot-rl/log/99'; this program reads 'spot-rl/log/1'"):
        read_run(other)
    for path in (empty, text, foreign, other):
        with pytest.raises(LogReadError):
            recover_log(path, tmp_path / "new.mcap")
    assert not (tmp_path / "new.mcap").exists()


def test_recovery_never_overwrites(synthetic_log, tmp_path):
    taken = tmp_path / "taken.mcap"
    taken.write_text("precious")
    with pytest.raises(LogExistsError):
        recover_log(synthetic_log, taken)
    assert taken.read_text() == "precious"


def test_recovering_a_whole_log_changes_no_message(synthetic_log, tmp_path):
    recovery = recover_log(synthetic_log, tmp_path / "new.mcap")
    assert recovery.damage == ()
    assert recovery.kept["state"] == 667
    old, new = scan_mcap(synthetic_log.read_bytes()), scan_mcap((tmp_path / "new.mcap").read_bytes())
    assert old.messages == new.messages
    assert not read_run(tmp_path / "new.mcap").truncated


def test_leftovers_of_a_crash_are_recovered_and_live_logs_left_alone(synthetic_run, log_bytes, tmp_path):
    (tmp_path / "crashed.mcap.active").write_bytes(log_bytes[: len(log_bytes) // 2])
    (tmp_path / "hopeless.mcap.active").write_bytes(b"")
    live = RunWriter(tmp_path / "live.mcap", synthetic_run().header)
    [recovery] = recover_leftovers(tmp_path)
    assert recovery.result.name == "crashed.mcap"
    assert len(read_run(recovery.result).states) > 100
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["crashed.mcap", "hopeless.mcap.active", "live.mcap.active"]
    live.close({}, "completed")
    assert recover_leftovers(tmp_path) == []


def test_a_leftover_whose_name_is_taken_gets_another(synthetic_log, log_bytes, tmp_path):
    shutil.copy(synthetic_log, tmp_path / "run.mcap")
    (tmp_path / "run.mcap.active").write_bytes(log_bytes[: len(log_bytes) // 2])
    [recovery] = recover_leftovers(tmp_path)
    assert recovery.result.name == "run.recovered-1.mcap"
    assert (tmp_path / "run.mcap").read_bytes() == log_bytes


def test_a_recovery_that_is_interrupted_leaves_everything_as_it_was(log_bytes, tmp_path, monkeypatch):
    leftover = tmp_path / "run.mcap.active"
    leftover.write_bytes(log_bytes[:-500])

    def interrupt(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(recover, "_verify", interrupt)
        with pytest.raises(KeyboardInterrupt):
            recover_leftovers(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap.active"]
    assert len(recover_leftovers(tmp_path)) == 1


@pytest.mark.parametrize("begun", [None, 3000])
def test_a_recovery_that_was_killed_is_done_again(log_bytes, tmp_path, begun):
    (tmp_path / "run.mcap.damaged").write_bytes(log_bytes[:-500])
    if begun is not None:
        (tmp_path / "run.mcap.active").write_bytes(log_bytes[:begun])
    [recovery] = recover_leftovers(tmp_path)
    assert recovery.kept["state"] > 600
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap"]


def test_a_log_under_both_of_its_names_is_no_leftover(synthetic_log, log_bytes, tmp_path):
    os.link(synthetic_log, active_path(synthetic_log))
    assert recover_leftovers(synthetic_log.parent) == []
    assert synthetic_log.read_bytes() == log_bytes
    assert not active_path(synthetic_log).exists()


def test_a_leftover_that_somebody_recovers_is_left_to_them(log_bytes, tmp_path):
    aside = tmp_path / "run.mcap.damaged"
    aside.write_bytes(log_bytes)
    with aside.open("rb") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert recover_leftovers(tmp_path) == []
    assert [path.name for path in tmp_path.iterdir()] == ["run.mcap.damaged"]


def test_random_bytes_are_refused_in_words(tmp_path):
    rng = np.random.default_rng(3)
    for n in range(200):
        data = rng.bytes(int(rng.integers(0, 400)))
        if n % 2:
            data = b"\x89MCAP0\r\n" + data
        path = tmp_path / "random.mcap"
        path.write_bytes(data)
        with pytest.raises(LogReadError):
            read_run(path)
