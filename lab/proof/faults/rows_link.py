"""Rows of the network: gaps, delays, jitter, drops, duplicates, streams that end."""

from __future__ import annotations

from typing import Final

import numpy as np

from proof.faults.attempts import Check, all_of, inject, is_told, row
from proof.faults.rows import NS_PER_MS, Finding
from proof.rig import Drive, Rig
from spot_log import Run
from spot_model.io.velocity_sequence import standing_sequence
from spot_tools.sources import ScriptedSource

LONG_TICKS: Final = 15_000
STANDING: Final = ScriptedSource(standing_sequence(), duration_s=6.0)

GAP: Final = inject("state_gap")
CLOSED: Final = inject("state_stream_closed")
JITTER: Final = all_of(inject("state_jitter", mean_s=0.0005), inject("command_jitter", mean_s=0.0005))
"""As much as the measured spread of the link, which is the fake robot's default, on top of it."""
LATE: Final = {ms: inject("state_delay", delay_s=ms / 1e3) for ms in (5, 15, 40)}
LOST: Final = {percent: inject("command_drops", probability=percent / 100.0) for percent in (5, 20)}
DOUBLED: Final = inject("duplicated_states", probability=0.5)
BACK_DATED: Final = inject("back_dated_states", probability=0.2, shift_s=0.03)
"""One message in five: the first comes within fifty but for once in 70,000 runs."""
ALL_BACK_DATED: Final = inject("back_dated_states", probability=1.0, shift_s=5.0)


def last_state_ns(drive: Drive) -> int:
    """Return the stamp of the newest state that was used when the fault had happened, ns."""
    commands = drive.log.commands
    return int(commands.state_robot_stamp_ns[commands.robot_stamp_ns <= drive.happened_ns][-1])


def _age_ms(log: Run, sent: np.ndarray) -> float:
    """Return the median age of the states that these commands answered; ``sent`` chooses commands, shape (n,)."""
    commands = log.commands
    chosen = sent & (commands.state_robot_stamp_ns > 0)
    return float(np.median((commands.robot_stamp_ns - commands.state_robot_stamp_ns)[chosen])) / NS_PER_MS


def is_aged_by(delay_ms: float) -> Check:
    """Make the check that the states' age is told right: as much higher as they come later."""

    def check(_: Rig, drive: Drive, finding: Finding) -> None:
        sent_ns, at_ns = drive.log.commands.robot_stamp_ns, drive.happened_ns
        well_after = (sent_ns > at_ns + 100 * NS_PER_MS) & (sent_ns < at_ns + 600 * NS_PER_MS)
        added_ms = _age_ms(drive.log, well_after) - _age_ms(drive.log, sent_ns < at_ns)
        error_ms = abs(added_ms - delay_ms)
        finding.demand(error_ms <= 1.6, f"{added_ms:.1f} ms of added age were seen")
        finding.reaction_ms = finding.reaction_ms or error_ms

    return check


def tracks(_: Rig, drive: Drive, finding: Finding) -> None:
    """Check that the joints follow as they did before it happened: the distance grows by less than half."""
    states, commands = drive.log.states, drive.log.commands
    at = np.searchsorted(states.robot_stamp_ns, commands.robot_stamp_ns).clip(0, len(states) - 1)
    error_rad = np.abs(commands.position_rad - states.position_rad[at]).mean(axis=1)
    before = error_rad[commands.robot_stamp_ns < drive.happened_ns][-100:].mean()
    after = error_rad[commands.robot_stamp_ns > drive.happened_ns + 500 * NS_PER_MS][:1000].mean()
    finding.demand(bool(after < 1.5 * before + 0.01), "the joints no longer follow")


def ran(ticks: int) -> Check:
    """Make the check that so many ticks ran."""

    def check(_: Rig, drive: Drive, finding: Finding) -> None:
        finding.demand(drive.summary.ticks >= ticks, f"only {drive.summary.ticks} ticks ran")
        finding.reaction = f"completed, {drive.summary.ticks} ticks"

    return check


IS_YOUNG: Final = is_told("state_old", is_wanted=False)
ARRIVE: Final = is_told("commands_lost", is_wanted=False)

ROWS = (
    *(
        row(f"state gap {ms} ms", 40.0, inject("state_gap", ms / 1e3), "completed", way="states_missed", missed=1)
        for ms in (10, 20)
    ),
    row("states stale (≥ 40 ms)", 80.0, GAP, "state_stale", way="damping", since=last_state_ns, is_real_time=True),
    row("states stale (≥ 200 ms)", 250.0, GAP, "state_stale", way="released", since=last_state_ns, is_real_time=True),
    row("state stream closed", 250.0, CLOSED, "state_lost", way="released", since=last_state_ns, is_real_time=True),
    row("state delay + 5 ms", 1.6, LATE[5], "completed", checks=(is_aged_by(5.0), IS_YOUNG)),
    row("state delay + 15 ms", 60.0, LATE[15], "completed", way="state_old", checks=(is_aged_by(15.0),)),
    row("state delay + 40 ms", 80.0, LATE[40], "state_stale", way="damping", since=last_state_ns),
    *(
        row(
            f"jitter as measured, {ticks:,} ticks",
            0.0,
            JITTER,
            "completed",
            missed=0,
            checks=(ran(ticks),),
            is_long=ticks == LONG_TICKS,
            at_s=0.6,
            seconds=ticks / 50.0 + 1.0,
        )
        for ticks in (LONG_TICKS, 300)
    ),
    row("commands dropped 5 %", 0.0, LOST[5], "completed", missed=0, checks=(tracks, ARRIVE), source=STANDING),
    row(
        "commands dropped 20 %",
        6000.0,
        LOST[20],
        "completed",
        way="commands_lost",
        missed=0,
        checks=(tracks,),
        source=STANDING,
    ),
    row("states duplicated", 40.0, DOUBLED, "completed", way="state_rejected"),
    row("states back-dated", 150.0, BACK_DATED, "completed", way="state_rejected"),
    row("states back-dated, all", 40.0, ALL_BACK_DATED, "state_rejected", "state_stale", way="state_rejected"),
)
