import dataclasses

import numpy as np
import pytest

from spot_log.tools.measures import NEVER_NS
from trainer.signals.policy_ticks import script_of, scripts_of
from trainer.signals.recording import RecordingError, record

from .planted import QUIET, START_NS, Truth, planted_runs, walk_sequence
from .stranger import thinned


@pytest.fixture(scope="module")
def run():
    return planted_runs(Truth(noise=QUIET), 1, sequence=walk_sequence(1.0))[0]


def test_every_state_has_its_row(run):
    recording = record(run)
    assert len(recording) == len(run.states)
    assert recording.present.all()
    assert recording.period_s == pytest.approx(0.003)
    assert np.array_equal(recording.position_rad, run.states.position_rad)
    assert recording.imu.age_s == pytest.approx(0.001)


def test_lost_states_leave_holes_and_nothing_moves(run):
    keep = np.ones(len(run.states), dtype=bool)
    keep[[40, 41, 90]] = False
    recording = record(dataclasses.replace(run, states=run.states.rows(keep)))
    assert len(recording) == len(run.states)
    assert np.array_equal(recording.present, keep)
    assert np.isnan(recording.load_nm[40]).all()
    assert np.array_equal(recording.load_nm[keep], run.states.load_nm[keep])


def test_the_command_in_effect_changes_at_the_robots_receipt(run):
    recording = record(run)
    row = recording.command_row()
    seen = run.states.last_command_key
    # The stream reports a receipt at the next state; the command is in effect from the receipt on.
    assert np.array_equal(recording.commands.key[np.maximum(row, 0)][row >= 0], seen[seen > 0])
    change = int(np.flatnonzero(np.diff(row) > 0)[3]) + 1
    received = recording.command_ns[row[change]]
    gap_s = (recording.stamp_ns[change] - received) * 1e-9
    assert 0.0 <= gap_s < 0.003
    assert recording.command_row(-gap_s - 1e-5)[change] == row[change - 1]
    assert recording.command_row(-gap_s + 1e-5)[change] == row[change]


def test_commands_that_never_arrive_never_take_effect(run):
    lost = int(run.commands.key[10])
    states = run.states
    shown = np.where(states.last_command_key == lost, lost - 1, states.last_command_key)
    recording = record(dataclasses.replace(run, states=dataclasses.replace(states, last_command_key=shown)))
    assert recording.command_ns[10] == NEVER_NS
    assert 10 not in recording.command_row()


def test_without_receipts_commands_count_from_when_they_were_sent(run):
    none = np.zeros(len(run.states), dtype=np.int64)
    silent = dataclasses.replace(run.states, last_command_key=none, last_command_robot_stamp_ns=none)
    recording = record(dataclasses.replace(run, states=silent))
    assert not recording.has_receipts
    assert np.array_equal(recording.command_ns, run.commands.robot_stamp_ns)


def test_uneven_stamps_keep_their_instants_and_wide_gaps_are_losses():
    run = planted_runs(Truth(noise=QUIET), 1, sequence=walk_sequence(1.0))[0]
    at = np.concatenate([np.arange(0, 120, 3), np.arange(150, 280, 3)])
    at[1::2] += 1
    recording = record(thinned(run, at))
    np.testing.assert_array_equal(recording.stamp_ns, run.states.robot_stamp_ns[at])
    np.testing.assert_array_equal(recording.position_rad, run.states.position_rad[at])
    assert np.flatnonzero(~recording.present).tolist() == [40]
    row, later = recording.next_row(recording.stamp_ns[[3, 5]] - 1_500_000)
    assert row.tolist() == [3, 5]
    assert later * recording.period_s == pytest.approx(1.5e-3)
    assert recording.rows_at(recording.stamp_ns[[3, 5]] - 1_500_000).tolist() == [3, 5]


def test_quaternions_keep_their_sign_from_row_to_row(run):
    flipped = run.states.odom_from_body_wxyz * np.where(np.arange(len(run.states)) % 2, -1.0, 1.0)[:, None]
    recording = record(dataclasses.replace(run, states=dataclasses.replace(run.states, odom_from_body_wxyz=flipped)))
    assert np.min(np.sum(recording.odom_from_body_wxyz[1:] * recording.odom_from_body_wxyz[:-1], axis=1)) > 0.9


def test_a_missing_signal_is_known_to_be_missing(run):
    bare = dataclasses.replace(
        run.states, load_nm=np.full_like(run.states.load_nm, np.nan), foot_contact=np.zeros((len(run.states), 0), bool)
    )
    recording = record(dataclasses.replace(run, states=bare))
    assert not recording.has("load_nm")
    assert not recording.has("foot_contact")
    assert recording.has("velocity_rad_s")


def test_errors_say_what_is_wrong(run):
    with pytest.raises(RecordingError, match="has 10 states; at least 50"):
        record(dataclasses.replace(run, states=run.states.rows(np.arange(len(run.states)) < 10)))
    stamps = run.states.robot_stamp_ns.copy()
    stamps[60] = stamps[59]
    with pytest.raises(RecordingError, match="does not rise after state 59"):
        record(dataclasses.replace(run, states=dataclasses.replace(run.states, robot_stamp_ns=stamps)))


def test_the_echo_of_another_runs_command_is_no_receipt(run):
    states = run.states
    late = run.commands.key[20]
    echo = states.robot_stamp_ns < states.robot_stamp_ns[0] + 6_000_000
    stale = dataclasses.replace(
        states,
        last_command_key=np.where(echo, late, states.last_command_key),
        last_command_robot_stamp_ns=np.where(echo, START_NS - 5_000_000_000, states.last_command_robot_stamp_ns),
    )
    expected = record(run)
    found = record(dataclasses.replace(run, states=stale))
    # The echo hides nothing but the first states' own keys.
    np.testing.assert_array_equal(found.command_ns[1:], expected.command_ns[1:])
    assert 20 not in found.command_row()[:100]


def test_commands_of_an_uneven_log_are_replayed_at_their_instants():
    run = planted_runs(Truth(noise=QUIET), 1, sequence=walk_sequence(1.3))[0]
    keep = np.flatnonzero(np.arange(len(run.ticks)) % 5 != 2)
    columns = {f.name: getattr(run.ticks, f.name)[keep] for f in dataclasses.fields(run.ticks)}
    script = script_of(dataclasses.replace(run, ticks=type(run.ticks)(**columns)))
    assert script is not None
    # Every fifth tick is missing: the one before it holds, and nothing comes earlier than it did.
    held = np.where(np.arange(len(run.ticks)) % 5 == 2, np.arange(len(run.ticks)) - 1, np.arange(len(run.ticks)))
    np.testing.assert_array_equal(script.velocity_command, run.ticks.velocity_command[held])


@pytest.mark.parametrize(
    ("ticks_ms", "period_s"),
    [
        ((21, 21, 18), 0.020),
        ((18,), 0.018),
        ((18,) * 9 + (21,), 0.018),
        ((17, 17, 17, 16, 33), 0.020),
        ((24, 12), 0.018),
    ],
    ids=["clock", "sixth state", "slips", "states at 60 Hz", "alternating"],
)
def test_a_simulated_run_ticks_as_often_as_the_robots_program(ticks_ms: tuple[int, ...], period_s: float) -> None:
    run = planted_runs(Truth(noise=QUIET), 1, sequence=walk_sequence(1.3))[0]
    steps_ms = np.resize(ticks_ms, len(run.ticks) - 1)
    stamps = run.ticks.robot_stamp_ns[0] + 1_000_000 * np.concatenate([[0], np.cumsum(steps_ms)])
    whole = dataclasses.replace(run, ticks=dataclasses.replace(run.ticks, robot_stamp_ns=stamps))
    lossy = dataclasses.replace(whole, ticks=whole.ticks.rows(np.flatnonzero(np.arange(len(stamps)) % 7 != 3)))
    for log in (whole, lossy):
        script = script_of(log)
        assert script is not None
        assert script.tick_period_s == pytest.approx(period_s)


def test_scripts_of_a_robot_that_was_run_by_two_programs_share_the_period_of_most() -> None:
    run = planted_runs(Truth(noise=QUIET), 1, sequence=walk_sequence(1.3))[0]
    stamps = run.ticks.robot_stamp_ns[0] + 18_000_000 * np.arange(len(run.ticks))
    other = dataclasses.replace(run, ticks=dataclasses.replace(run.ticks, robot_stamp_ns=stamps))
    assert {s.tick_period_s for s in scripts_of([other, run, other])} == {0.018}
    # The commands still come when they came.
    assert len(scripts_of([other, run, other])[1].velocity_command) == round(len(run.ticks) * 20 / 18)
