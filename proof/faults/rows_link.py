"""Rows of the network: gaps, delays, jitter, drops, duplicates, streams that end."""

from __future__ import annotations

import numpy as np

from proof.faults.drive import Drive
from proof.faults.rig import Rig
from proof.faults.rows import NS_PER_MS, Finding, Row, happens, judge, reacted, tried_with, went_on
from spot_model.io.velocity_sequence import standing_sequence
from spot_tools.run.scripted import ScriptedSource

LONG_TICKS = 15_000


@tried_with
def gap(rig: Rig, duration_s: float) -> Finding:
    """A few states never come: the run goes on, and says so."""
    drive = rig.drive(happens(lambda: rig.inject("state_gap", duration_s)), seconds=2.0)
    return reacted(drive, went_on(drive, judge(drive, "completed"), missed=1), "states_missed")


def last_state_ns(drive: Drive) -> int:
    """Stamp of the newest state that was used when the fault had happened."""
    if drive.log is None:
        return drive.happened_ns
    stamps = drive.log.commands.state_robot_stamp_ns
    return int(stamps[drive.log.commands.robot_stamp_ns <= drive.happened_ns][-1])


def stale(rig: Rig) -> Finding:
    """No state comes any more: damping."""
    drive = rig.drive(happens(lambda: rig.inject("state_gap")))
    return reacted(drive, judge(drive, "state_stale"), "damping", last_state_ns(drive))


def lost(rig: Rig) -> Finding:
    """No state for long: silence."""
    drive = rig.drive(happens(lambda: rig.inject("state_gap")))
    return reacted(drive, judge(drive, "state_stale"), "released", last_state_ns(drive))


def closed(rig: Rig) -> Finding:
    """The robot ends the state stream."""
    drive = rig.drive(happens(lambda: rig.inject("state_stream_closed")))
    return reacted(drive, judge(drive, "state_lost"), "released", last_state_ns(drive))


def ages_ms(drive: Drive, *, after: bool) -> float:
    """Median age of the state that commands answered, before it happened or well after."""
    assert drive.log is not None  # noqa: S101 - judged before
    commands = drive.log.commands
    sent_ns = commands.robot_stamp_ns
    at_ns = drive.happened_ns
    chosen = (sent_ns > at_ns + 100 * NS_PER_MS) & (sent_ns < at_ns + 600 * NS_PER_MS) if after else sent_ns < at_ns
    chosen &= commands.state_robot_stamp_ns > 0
    return float(np.median((sent_ns - commands.state_robot_stamp_ns)[chosen])) / NS_PER_MS


@tried_with
def delay(rig: Rig, delay_s: float, *, warns: bool) -> Finding:
    """States come later: their age is told right, and warned of above 15 ms."""
    drive = rig.drive(happens(lambda: rig.inject("state_delay", delay_s=delay_s)), seconds=2.0)
    finding = judge(drive, "completed")
    if drive.log is None:
        return finding
    added_ms = ages_ms(drive, after=True) - ages_ms(drive, after=False)
    finding.demand(abs(added_ms - delay_s * 1e3) <= 1.6, f"{added_ms:.1f} ms of added age were seen")
    warned = drive.event_ns("state_old") is not None
    finding.demand(warned == warns, "it was " + ("warned of" if warned else "not warned of"))
    if warns:
        return reacted(drive, finding, "state_old")
    finding.reaction_ms = abs(added_ms - delay_s * 1e3)
    return finding


def delay_too_long(rig: Rig) -> Finding:
    """States that come 40 ms late are too old to walk on."""
    drive = rig.drive(happens(lambda: rig.inject("state_delay", delay_s=0.04)))
    return reacted(drive, judge(drive, "state_stale"), "damping", last_state_ns(drive))


@tried_with
def jitter(rig: Rig, ticks: int) -> Finding:
    """The measured spread of the link, which is the fake robot's default, and as much again."""

    def act() -> None:
        rig.inject("state_jitter", mean_s=0.0005)
        rig.inject("command_jitter", mean_s=0.0005)

    drive = rig.drive(happens(act), seconds=ticks / 50.0 + 1.0, at_s=0.6)
    finding = went_on(drive, judge(drive, "completed"))
    finding.demand(drive.summary.ticks >= ticks, f"only {drive.summary.ticks} ticks ran")
    finding.reaction = f"completed, {drive.summary.ticks} ticks"
    return finding


@tried_with
def drops(rig: Rig, share: float, *, alarms: bool) -> Finding:
    """Commands are lost: the robot goes on following, and too many losses are reported."""
    source = ScriptedSource(standing_sequence(), duration_s=6.0)
    drive = rig.drive(happens(lambda: rig.inject("command_drops", probability=share)), source=source)
    finding = went_on(drive, judge(drive, "completed"))
    warned = drive.event_ns("commands_lost") is not None
    finding.demand(warned == alarms, "the alarm " + ("came" if warned else "did not come"))
    finding.demand(tracks(drive), "the joints no longer follow")
    return reacted(drive, finding, "commands_lost") if alarms else finding


def tracks(drive: Drive) -> bool:
    """Whether the joints follow after it happened as they did before: the distance grows by less than half."""
    assert drive.log is not None  # noqa: S101 - judged before
    states, commands = drive.log.states, drive.log.commands
    at = np.searchsorted(states.robot_stamp_ns, commands.robot_stamp_ns).clip(0, len(states) - 1)
    error_rad = np.abs(commands.position_rad - states.position_rad[at]).mean(axis=1)
    before = error_rad[commands.robot_stamp_ns < drive.happened_ns][-100:].mean()
    after = error_rad[commands.robot_stamp_ns > drive.happened_ns + 500 * NS_PER_MS][:1000].mean()
    return bool(after < 1.5 * before + 0.01)


@tried_with
def never_used(rig: Rig, /, fault: str, outcomes: tuple[str, ...], **parameters: float) -> Finding:
    """Duplicated and back-dated states: none is ever used."""
    drive = rig.drive(happens(lambda: rig.inject(fault, **parameters)), seconds=2.0)
    return reacted(drive, judge(drive, outcomes), "state_rejected")


ROWS = (
    Row("state gap 10 ms", 40.0, gap(0.010)),
    Row("state gap 20 ms", 40.0, gap(0.020)),
    Row("states stale (≥ 40 ms)", 80.0, stale, is_real_time=True),
    Row("states stale (≥ 200 ms)", 250.0, lost, is_real_time=True),
    Row("state stream closed", 250.0, closed, is_real_time=True),
    Row("state delay + 5 ms", 1.6, delay(0.005, warns=False)),
    Row("state delay + 15 ms", 60.0, delay(0.015, warns=True)),
    Row("state delay + 40 ms", 80.0, delay_too_long),
    Row("jitter as measured, 15,000 ticks", 0.0, jitter(LONG_TICKS), is_long=True),
    Row("jitter as measured, 300 ticks", 0.0, jitter(300)),
    Row("commands dropped 5 %", 0.0, drops(0.05, alarms=False)),
    Row("commands dropped 20 %", 6000.0, drops(0.2, alarms=True)),
    Row("states duplicated", 40.0, never_used("duplicated_states", ("completed",), probability=0.5)),
    # One message in five: the first comes within fifty but for once in 70,000 runs.
    Row("states back-dated", 150.0, never_used("back_dated_states", ("completed",), probability=0.2, shift_s=0.03)),
    Row(
        "states back-dated, all",
        40.0,
        never_used("back_dated_states", ("state_rejected", "state_stale"), probability=1.0, shift_s=5.0),
    ),
)
