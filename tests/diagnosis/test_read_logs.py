"""What is read and what is left out, in words: empty and cut logs, policies that are not the logs'."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.read import apart_by_gains, find_policy, find_policy_file, read_all, read_logs
from diagnosis.read.segments import cut
from diagnosis.session import DiagnosisRequest
from spot_log import read_run
from spot_log.importing import Mapping, import_log
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import load_policy
from spot_model.robot.facts import DEFAULT_POSITION_RAD, JOINT_NAMES
from trainer.signals.recording import record

POLICIES = Path(__file__).parents[2] / "policies"


def _log(
    folder: Path, name: str, n: int = 400, *, is_commanded: bool = False, joints: Sequence[str] = ("hip",), of: str = ""
) -> Path:
    signals = {"position": {"from": "q", "unit": "rad"}}
    if is_commanded:
        signals["setpoint_position"] = signals["position"]
    time_s = np.arange(n) * 0.005
    rest_rad = 0.0 if len(joints) == 1 else DEFAULT_POSITION_RAD
    np.savez(folder / "data.npz", t=time_s, q=rest_rad + 0.1 * np.sin(time_s + sum((of or name).encode()))[:, None])
    mapping = Mapping.model_validate(
        {
            "schema": "spot-rl/import/1",
            "joint_names": list(joints),
            "foot_names": [],
            "time": {"from": "t"},
            "signals": signals,
        }
    )
    import_log(mapping, folder / "data.npz", folder / name)
    return folder / name


def test_bad_files_are_left_out_and_said(tmp_path: Path) -> None:
    _log(tmp_path, "a.mcap")
    _log(tmp_path, "short.mcap", 10)
    whole = _log(tmp_path, "cut.mcap").read_bytes()
    (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
    (tmp_path / "empty.mcap").write_bytes(b"")
    (tmp_path / "notes.txt").write_text("no log")
    told: list[float] = []
    runs, warnings = read_all([tmp_path, tmp_path / "missing.mcap"], told.append)
    assert {r.path.name for r in runs} <= {"a.mcap", "cut.mcap"}
    text = "\n".join(warnings)
    assert "short.mcap: left out: " in text
    assert "has 10 states; at least 50 are needed" in text
    assert "empty.mcap: left out: " in text
    assert "missing.mcap: left out: " in text
    assert "cut.mcap: " in text
    assert told == sorted(told)


def test_one_log_of_another_robot_and_policy_is_set_aside_in_what_follows_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    logs = [_log(tmp_path, name, is_commanded=True, joints=JOINT_NAMES) for name in ("a.mcap", "b.mcap")]
    other = _log(tmp_path, "other.mcap", is_commanded=True)
    walk = load_policy(POLICIES / "walk.onnx")

    def read(file: Path) -> Run:
        return _by(read_run(file), "1" * 64 if file == other else walk.sha256, "walk")

    monkeypatch.setattr("trainer.signals.log_files.read_run", read)
    runs, notes = read_logs([*logs, other])
    assert [run.path for run in runs] == logs
    assert any(note.startswith("other.mcap: set aside: it has joints hip; robot spot has") for note in notes)
    DiagnosisRequest(logs=tuple(map(str, [*logs, other])), nominal="ideal").save(tmp_path)
    monkeypatch.chdir(POLICIES.parent)
    assert find_policy_file(None, runs) == policy_file("walk")


def test_a_copy_of_a_log_is_no_repeat(tmp_path: Path) -> None:
    log = _log(tmp_path, "walk.mcap", is_commanded=True)
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(log.read_bytes())
    runs, warnings = read_all([log, copy])
    assert [r.path.name for r in runs] == ["walk.mcap"]
    assert f"{copy}: left out: its states are in {log}, too" in warnings


def test_a_robot_that_got_no_command_says_nothing_beside_one_that_did(tmp_path: Path) -> None:
    idle, other = _log(tmp_path, "idle.mcap"), _log(tmp_path, "other.mcap")
    commanded = _log(tmp_path, "walk.mcap", is_commanded=True)
    runs, warnings = read_all([idle, commanded])
    assert [r.path.name for r in runs] == ["walk.mcap"]
    assert "idle.mcap: left out: the robot got no command in it" in warnings
    # Recordings without any commands are diagnosed all the same.
    assert len(read_all([idle, other])[0]) == 2


def test_a_log_whose_clock_runs_backwards_is_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sound, bad = _log(tmp_path, "sound.mcap"), _log(tmp_path, "backwards.mcap")
    states = read_run(bad).states
    stamps = states.robot_stamp_ns.copy()
    stamps[200:] -= 1_000_000_000

    def read(file: Path) -> Run:
        run = read_run(file)
        return replace(run, states=replace(run.states, robot_stamp_ns=stamps)) if file == bad else run

    monkeypatch.setattr("trainer.signals.log_files.read_run", read)
    runs, warnings = read_all([sound, bad])
    assert [run.path.name for run in runs] == ["sound.mcap"]
    assert "backwards.mcap: left out: " in warnings[0]
    assert "does not rise after state 199" in warnings[0]


def test_a_run_that_is_in_two_files_counts_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where its last seconds were kept apart."""
    whole, last = _log(tmp_path, "whole.mcap"), _log(tmp_path, "last.mcap", of="whole.mcap")

    def read(file: Path) -> Run:
        run = read_run(file)
        return replace(run, states=run.states.rows(slice(200, None))) if file == last else run

    monkeypatch.setattr("trainer.signals.log_files.read_run", read)
    runs, warnings = read_all([last, whole])
    assert [run.path.name for run in runs] == ["whole.mcap"]
    assert warnings == (f"{last}: left out: its states are in {whole}, too",)


def test_nothing_left_is_one_error_with_every_reason(tmp_path: Path) -> None:
    (tmp_path / "empty.mcap").write_bytes(b"")
    folder = tmp_path / "none"
    folder.mkdir()
    with pytest.raises(BadInputError, match=r"no log can be used:\n.*none has no .mcap file\n.*empty.mcap") as told:
        read_all([folder, tmp_path / "empty.mcap"])
    assert "Traceback" not in str(told.value)


@pytest.fixture
def run(tmp_path: Path) -> Run:
    return read_all([_log(tmp_path, "a.mcap")])[0][0]


def _by(run: Run, sha256: str, name: str) -> Run:
    return replace(run, header=replace(run.header, policy_sha256=sha256, policy_name=name))


def test_the_policy_must_be_the_logs(run: Run) -> None:
    walk = load_policy(POLICIES / "walk.onnx")
    mine = _by(run, walk.sha256, "walk")
    found = find_policy(None, [mine])
    assert found is not None
    assert found.sha256 == walk.sha256
    assert find_policy_file(None, [mine]) == policy_file("walk")
    assert find_policy(POLICIES / "walk.onnx", [mine]) is not None
    # A log that names no policy is taken at the user's word.
    assert find_policy(POLICIES / "baseline.onnx", [run]) is not None
    assert find_policy(None, [run]) is None
    with pytest.raises(BadInputError, match=r"baseline.onnx has SHA-256 .*a.mcap was made by walk .*leave --policy"):
        find_policy(POLICIES / "baseline.onnx", [mine])
    with pytest.raises(BadInputError, match=r"logs of 2 policies: a.mcap: .*diagnose logs of one policy at a time"):
        find_policy(None, [mine, _by(run, "0" * 64, "other")])


def test_logs_of_one_network_at_other_gains_stand_beside_the_policys_own(run: Run) -> None:
    """The variant's contract differs in gains and name; its log keeps out of closed loops under a name of its own."""
    walk = load_policy(POLICIES / "walk.onnx")
    stiff = walk.contract.model_copy(update={"name": "walk-kp80", "kp_nm_per_rad": (80.0,) * 12})
    logs = []
    for sha, contract in ((walk.sha256, walk.contract), (walk.sha256, walk.contract), ("1" * 64, stiff)):
        own = replace(run.header, policy_sha256=sha, policy_contract_json=contract.to_json(), policy_name=contract.name)
        logs.append(replace(run, header=replace(own, command_sequence="ahead")))
    found = find_policy(None, logs)
    assert found is not None
    assert found.sha256 == walk.sha256
    apart, notes = apart_by_gains(logs, found)
    assert [r.header.command_sequence for r in apart] == ["ahead", "ahead", "ahead, walk-kp80"]
    assert len(notes) == 1


def test_a_log_without_commands_is_used_from_its_first_state(run: Run) -> None:
    recording = record(run)
    assert set(recording.command_row()) == {-1}
    cut_up = cut(recording)
    assert cut_up.used.all()
    assert cut_up.segments == ()
