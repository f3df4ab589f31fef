from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from spot_log.format.records import RunHeader
from spot_log.write.run_writer import RunWriter
from spot_model.errors import BadInputError
from spot_model.io.velocity_sequence import load_sequence
from spot_model.policy.policy import load_policy
from trainer.collect.collect_run import (
    PAPER_SEQUENCES,
    USER_SEQUENCE,
    Collection,
    FoundRun,
    missing_runs,
    parse_gains,
    plan_runs,
    run_arguments,
    sequence_sources,
    write_gain_variant,
)
from trainer.collect.user_sequence import TOLERANCE, sequence_of_commands

from .sysid.conftest import oscillator_bytes


@pytest.fixture
def policy_path(tmp_path: Path) -> Path:
    path = tmp_path / "stamp.onnx"
    path.write_bytes(oscillator_bytes())
    return path


def test_all_are_the_papers_four() -> None:
    assert PAPER_SEQUENCES == ("forward", "six_directions", "random", "user")
    assert sequence_sources("all") == ("forward", "six_directions", "random", str(USER_SEQUENCE))
    assert sequence_sources("forward, x.yaml") == ("forward", "x.yaml")
    with pytest.raises(BadInputError, match="names none"):
        sequence_sources(" , ")


def test_the_shipped_user_sequence_is_valid_and_moves_in_all_directions() -> None:
    commands = load_sequence(str(USER_SEQUENCE)).sampled(50.0)
    assert len(commands) == 1000
    assert np.all(commands.max(axis=0) > 0.5)
    assert np.all(commands.min(axis=0) < -0.5)


def test_a_plan_makes_whole_repeats_first_and_keeps_within_the_policy(policy_path: Path) -> None:
    plan = plan_runs(("forward", "standing"), 2, load_policy(policy_path))
    assert [(p.sequence.name, p.repeat) for p in plan] == [
        ("forward", 1),
        ("standing", 1),
        ("forward", 2),
        ("standing", 2),
    ]
    assert plan[0].sequence.sampled(50.0)[:, 0].max() == pytest.approx(4.0)
    with pytest.raises(BadInputError, match="two sequences are called forward"):
        plan_runs(("forward", "forward"), 1, load_policy(policy_path))


def test_what_is_whole_is_not_made_again(policy_path: Path) -> None:
    plan = plan_runs(("forward",), 3, load_policy(policy_path))
    found = (FoundRun(Path("a"), "forward", 1), FoundRun(Path("b"), "forward", 2, "it ended with robot_fell"))
    assert [p.repeat for p in missing_runs(plan, found)] == [2, 3]


def test_a_run_that_leaves_no_log_is_tried_again_and_ends_the_collection(policy_path: Path, tmp_path: Path) -> None:
    collection = Collection.prepare(
        policy=policy_path, folder=tmp_path / "logs", sequences="standing", repeats=2, other_gains=None
    )
    started: list[list[str]] = []
    said: list[str] = []

    def start(arguments: list[str]) -> int:
        started.append(arguments)
        return 3

    left = collection.record(["--robot", "host"], start, attempts=2, say=said.append)
    assert [(p.sequence.name, p.repeat) for p in left] == [("standing", 1), ("standing", 2)]
    assert len(started) == 2
    assert said[-1] == "no run can begin, for the reason above; after that is mended, give the command again"
    assert started[0][:5] == ["run", "--policy", str(policy_path), "--sequence", "standing"]
    assert started[0][-2:] == ["--robot", "host"]
    assert "attempt 2 of 2 does not count: it left no log (exit code 3)" in said


def test_a_robot_with_a_fault_is_not_asked_again(policy_path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    collection = Collection.prepare(
        policy=policy_path, folder=folder, sequences="standing,forward", repeats=2, other_gains=None
    )
    started: list[list[str]] = []

    def start(arguments: list[str]) -> int:
        started.append(arguments)
        header = RunHeader(
            run_id="x",
            started_host_stamp_ns=1,
            policy_sha256=collection.parts[0].policy.sha256,
            command_sequence="standing",
            repeat=1,
        )
        RunWriter(folder / "x.mcap", header).close({}, "robot_fault")
        return 86

    said: list[str] = []
    left = collection.record([], start, attempts=3, say=said.append)
    assert len(started) == 1
    assert len(left) == collection.n_planned == 4
    assert said[-1] == "the robot reports a fault that a person must clear; after that, give the command again"


def test_a_log_that_cannot_be_read_does_not_count(policy_path: Path, tmp_path: Path) -> None:
    folder = tmp_path / "logs"
    collection = Collection.prepare(
        policy=policy_path, folder=folder, sequences="standing", repeats=1, other_gains=None
    )

    def start(_: list[str]) -> int:
        (folder / "x.mcap").write_bytes(b"torn")
        return 0

    said: list[str] = []
    assert collection.record([], start, attempts=1, say=said.append)
    assert any("does not count: cannot be read" in text for text in said)


def test_other_gains_are_a_second_part_with_the_same_network(policy_path: Path, tmp_path: Path) -> None:
    collection = Collection.prepare(
        policy=policy_path, folder=tmp_path / "logs", sequences="forward,standing", repeats=2, other_gains="50,1"
    )
    assert collection.n_planned == 6
    variant = collection.parts[1].policy
    assert variant.contract.kp_nm_per_rad == (50.0,) * 12
    assert variant.contract.kd_nm_s_per_rad == (1.0,) * 12
    assert variant.contract.stored_pair == collection.parts[0].policy.contract.stored_pair
    assert variant.sha256 != collection.parts[0].policy.sha256


def test_a_variant_that_is_there_is_kept(policy_path: Path, tmp_path: Path) -> None:
    path = write_gain_variant(policy_path, tmp_path / "v.onnx", 50.0, 1.0)
    before = path.stat().st_mtime_ns
    assert write_gain_variant(policy_path, path, 50.0, 1.0).stat().st_mtime_ns == before


@pytest.mark.parametrize("text", ["50", "a,b", "0,1", "50,-1", "1,2,3"])
def test_bad_gains_are_refused(text: str) -> None:
    with pytest.raises(BadInputError, match=f"--other-gains '{text}'"):
        parse_gains(text)


def test_shared_arguments_reach_every_run() -> None:
    options = {"--robot": "h", "--config": None, "--ca-file": Path("ca"), "--lock-step": "x"}
    arguments = run_arguments(options, ["a=b"])
    assert arguments == ["--robot", "h", "--ca-file", "ca", "--lock-step", "x", "--label", "a=b"]


def test_recorded_commands_come_back_within_the_tolerance() -> None:
    time_s = np.arange(500) * 0.02
    command = np.stack([np.clip(np.sin(time_s), -0.5, 0.5), 0.0 * time_s, np.round(time_s / 3) * 0.3], axis=1)
    sequence = sequence_of_commands(time_s, command, "user")
    played = np.array([sequence.at(float(t)) for t in time_s])
    assert np.abs(played - command).max() <= TOLERANCE + 1e-3
    assert len(sequence.waypoints) < 100


def test_a_ctrl_c_ends_the_collection_after_the_run_has_ended(tmp_path: Path) -> None:
    """The run gets the terminal's Ctrl-C itself and is waited for: nothing kills it while the robot comes to rest."""
    slow = """
import signal, sys, time
signal.signal(signal.SIGINT, lambda *_: (time.sleep(1.0), open("rested", "w"), sys.exit(7)))
print("up", flush=True)
time.sleep(60)
"""
    child = [sys.executable, "-c", slow]
    parent = f"from spot_model.process.signals import run_in_foreground; print(run_in_foreground({child!r}))"
    with subprocess.Popen(
        [sys.executable, "-c", parent], cwd=tmp_path, stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        os.killpg(process.pid, signal.SIGINT)
        told, _ = process.communicate(timeout=60)
    assert told == "Ended(code=7, is_interrupted=True)\n"
    assert (tmp_path / "rested").exists()
