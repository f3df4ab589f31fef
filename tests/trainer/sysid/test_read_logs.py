from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spot_log.read.run import Run, RunFooter, TickTable
from spot_model.errors import BadInputError
from spot_model.policy.policy import Policy, policy_from_bytes
from trainer.sysid.logs import choose_compared, read_identification_logs, run_from_log

from .conftest import MakeLogs, oscillator_bytes


def as_log(logged: Run, policy: Policy, *, outcome: str = "completed", damage: tuple[str, ...] = ()) -> Run:
    """The run as the log's reader would give it, with two ticks of another mode before and after."""
    ticks = logged.ticks
    first, last = int(ticks.robot_stamp_ns[0]), int(ticks.robot_stamp_ns[-1])
    widths = {"joints": 12, "#": 48}
    ramp, stop = (
        TickTable.of(
            2, widths, robot_stamp_ns=np.array(stamps), mode=np.full(2, mode), velocity_command=np.zeros((2, 3))
        )
        for stamps, mode in (
            ([first - 40_000_000, first - 20_000_000], "ramping_in"),
            ([last + 1, last + 2], "soft_stop"),
        )
    )
    following = replace(ticks, mode=np.full(len(ticks), "active"))
    columns = {
        name: np.concatenate([getattr(part, name) for part in (ramp, following, stop)]) for name in TickTable.columns()
    }
    return Run(
        path=logged.path,
        header=replace(logged.header, policy_name=policy.contract.name, policy_contract_json=policy.contract.to_json()),
        states=logged.states,
        commands=logged.commands,
        ticks=TickTable(**columns),
        slow_states=logged.slow_states,
        events=(),
        footer=RunFooter(0, {}, {}, outcome) if outcome else None,
        damage=damage,
    )


def of_policy(run: Run, sha256: str) -> Run:
    return replace(run, header=replace(run.header, policy_sha256=sha256))


def fallen_at(run: Run, tick: int) -> Run:
    """The run of a robot that lies on its side from one tick on."""
    attitude = run.states.odom_from_body_wxyz.copy()
    attitude[run.states.robot_stamp_ns >= run.ticks.robot_stamp_ns[tick]] = np.sqrt([0.5, 0.5, 0.0, 0.0])
    return replace(run, states=replace(run.states, odom_from_body_wxyz=attitude))


@pytest.fixture(scope="module")
def long_run(make_logs: MakeLogs, strong_truth: object, policy: Policy) -> Run:
    calm = policy_from_bytes(oscillator_bytes(swing=0.3, lift=0.5, rate_hz=2.0), source="calm")
    run = make_logs(strong_truth, sequences={"a": 0.0}, n_ticks=400, n_repeats=1, with_policy=calm)[0]  # type: ignore[arg-type]
    return of_policy(run, policy.sha256)


def test_the_stretch_under_the_policy_is_taken_as_it_is(long_run: Run, policy: Policy) -> None:
    found, notes = run_from_log(as_log(long_run, policy), policy)
    assert np.array_equal(found.ticks.action, long_run.ticks.action)
    assert np.array_equal(found.ticks.robot_stamp_ns, long_run.ticks.robot_stamp_ns)
    assert found.states.robot_stamp_ns[[0, -1]].tolist() == long_run.ticks.robot_stamp_ns[[0, -1]].tolist()
    assert (found.header.command_sequence, found.header.repeat, notes) == ("a", 0, ())


def test_a_log_of_another_policy_is_refused(long_run: Run, policy: Policy) -> None:
    other = policy_from_bytes(oscillator_bytes(swing=0.7, name="other"), source="other")
    log = as_log(of_policy(long_run, other.sha256), other)
    with pytest.raises(BadInputError, match=rf"made with policy other \(sha256 {other.sha256[:12]}…\), not with stamp"):
        run_from_log(log, policy)


def test_the_same_network_at_other_gains_lends_its_torques(long_run: Run, policy: Policy) -> None:
    contract = policy.contract.model_copy(update={"kp_nm_per_rad": (50.0,) * 12})
    log = as_log(of_policy(long_run, "0" * 64), replace(policy, contract=contract))
    found, notes = run_from_log(log, policy)
    assert "made at other gains" in notes[0]
    compared, _ = choose_compared([found, long_run], policy)
    assert [r.header.policy_sha256 for r in compared] == [policy.sha256]


def test_a_fall_cuts_the_run_before_it(long_run: Run, policy: Policy) -> None:
    found, notes = run_from_log(as_log(fallen_at(long_run, 300), policy, outcome="robot_fell"), policy)
    assert len(found.ticks.action) == 275
    assert notes == ("the robot fell after 6.0 s of the sequence; used up to 0.5 s before",)


def test_a_run_that_was_stopped_while_it_tilted_loses_its_end(long_run: Run, policy: Policy) -> None:
    found, notes = run_from_log(as_log(long_run, policy, outcome="tilt"), policy)
    assert len(found.ticks.action) == 375
    assert notes == ("the run ended with tilt; used up to 0.5 s before",)
    stopped, why = run_from_log(as_log(long_run, policy, outcome="operator_stop"), policy)
    assert len(stopped.ticks.action) == 400
    assert why == ("the run did not end as planned (operator_stop); used 400 ticks",)


def test_an_early_fall_leaves_too_little(long_run: Run, policy: Policy) -> None:
    with pytest.raises(
        BadInputError, match=r"has 75 ticks of the policy \(1\.5 s\); at least 250 are needed \(the robot fell"
    ):
        run_from_log(as_log(fallen_at(long_run, 100), policy), policy)


def test_a_log_that_was_cut_short_says_so(long_run: Run, policy: Policy) -> None:
    _, notes = run_from_log(as_log(long_run, policy, outcome="", damage=("the end is missing",)), policy)
    assert "did not end as planned" in notes[0]


def test_short_runs_and_other_commands_are_not_compared(long_run: Run, policy: Policy) -> None:
    t = long_run.ticks
    short = replace(long_run, path=Path("short"), ticks=t.rows(slice(300)))
    other = replace(long_run, path=Path("other"), ticks=replace(t, velocity_command=t.velocity_command + 1.0))
    compared, warnings = choose_compared([long_run, replace(long_run), short, other], policy)
    assert len(compared) == 2
    assert any("short: 300 of 400 ticks" in w for w in warnings)
    assert any("other had other velocity commands" in w for w in warnings)


def test_one_run_of_a_sequence_has_no_floor_and_that_is_said(long_run: Run, policy: Policy) -> None:
    _, warnings = choose_compared([long_run], policy)
    assert len(warnings) == 1
    assert warnings[0].startswith("sequence a has one run: how far two real runs differ is not known")
    assert warnings[0].endswith("record at least two, better five repeats")


def test_the_recording_of_an_incident_is_part_of_its_log(
    tmp_path: Path, long_run: Run, policy: Policy, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "incidents").mkdir()
    whole, end = tmp_path / "a.mcap", tmp_path / "incidents" / "a.mcap"
    log = as_log(long_run, policy)
    for file in (whole, end):
        file.touch()
    last = replace(log, states=log.states.rows(slice(100, None)))
    monkeypatch.setattr("trainer.signals.log_files.read_run", lambda f: replace(last if f == end else log, path=f))
    found = read_identification_logs([tmp_path], policy)
    assert [run.path for run in found.runs] == [whole]
    assert found.warnings[0] == f"{end}: left out: its states are in {whole}, too"


def test_nothing_usable_is_an_error_with_all_reasons(tmp_path: Path, policy: Policy) -> None:
    (tmp_path / "a.mcap").write_bytes(b"not a log")
    with pytest.raises(BadInputError, match=r"(?s)no log can be used:.*a\.mcap: left out"):
        read_identification_logs([tmp_path], policy)
    (tmp_path / "none").mkdir()
    with pytest.raises(BadInputError, match=r"has no \.mcap file"):
        read_identification_logs([tmp_path / "none"], policy)
