"""Rows that no matrix lists: what is wrong before the start, in the ramps and on the way back, and more at once."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from proof.faults.rig import Drive, Meddler, Rig, When, read_log
from proof.faults.rows import NS_PER_MS, Finding, Row, happens, judge, reacted, settle, went_on
from proof.faults.rows_log import Logger
from proof.faults.rows_policy import FLUNG, Actions, changeable, wrong
from proof.faults.rows_robot import END_TIME_JUMP_MS, clock_jump, first_damping_ns
from proof.faults.rows_state import drive_way
from spot_log import LogError
from spot_log.format.records import RunHeader
from spot_log.write.logger_process import LoggerProcess
from spot_log.write.sink import LogSink
from spot_model.io.velocity_sequence import standing_sequence
from spot_runtime.config import RobotConfig
from spot_runtime.sources.scripted import ScriptedSource

Named = tuple[str, dict[str, float | str]]
TWO_TICKS = 2
FOUR = 4.0
"""Times the scale of 0.2 rad, that is just beyond the stop of a hip's first joint, 0.785 rad."""


def cut(rig: Rig) -> None:
    """The network is away for a second."""
    rig.inject("network_cut", 1.0)


def before_start(fault: str, outcomes: tuple[str, ...], **parameters: float | str) -> Callable[[Rig], Finding]:
    """Wrong before a run begins: refused in words, the joints are never taken, nobody's lease is."""

    def attempt(rig: Rig) -> Finding:
        rig.inject(fault, **parameters)
        owner = rig.status().lease_owner
        drive = rig.drive(seconds=1.0)
        finding = Finding(drive.summary.outcome)
        finding.demand(drive.summary.outcome in outcomes, f"ended {drive.summary.outcome}: {drive.summary.sentence}")
        finding.demand(0 < drive.summary.exit_code < 100, f"exit code {drive.summary.exit_code}")
        finding.demand(len(drive.summary.sentence) > 10, "it does not say why")
        finding.log_ok = drive.log is not None
        finding.demand(drive.summary.ticks == 0, "the policy ran")
        finding.demand(rig.status().lease_owner == owner, f"the lease is now {rig.status().lease_owner}'s")
        return finding

    return attempt


def no_log(name: Callable[[Rig], Path]) -> Callable[[Rig], Finding]:
    """A log that cannot be begun: refused before anything is sent to the robot."""

    def attempt(rig: Rig) -> Finding:
        path = name(rig)
        calls, finding = rig.status().commands_received, Finding("refused to begin")

        def make_sink(_: Path, header: RunHeader) -> LogSink:
            return LoggerProcess.start(path, header)

        try:
            rig.drive(make_sink=make_sink, seconds=0.5)
        except (LogError, OSError) as error:
            finding.demand(path.name in str(error) or str(path.parent) in str(error), f"it does not say which: {error}")
        else:
            finding.problems.append("it ran without a log")
        finding.demand(rig.status().commands_received == calls, "the robot was commanded")
        return finding

    return attempt


def _in_a_file(rig: Rig) -> Path:
    taken = rig.folder / "a-file"
    taken.write_text("precious", encoding="utf-8")
    return taken / "run.mcap"


def _a_pipe(rig: Rig) -> Path:
    path = rig.folder / "pipe.mcap"
    if not path.exists():
        os.mkfifo(path)
    return path


def together(
    *faults: Named, outcomes: tuple[str, ...], at_s: float, seconds: float = 3.0, way: str = ""
) -> Callable[[Rig], Finding]:
    """Some faults in one instant, wherever the run then is."""

    def attempt(rig: Rig) -> Finding:
        acts = [lambda name=name, parameters=parameters: rig.inject(name, **parameters) for name, parameters in faults]
        drive = rig.drive(happens(*acts), at_s=at_s, seconds=seconds)
        finding = judge(drive, outcomes)
        return reacted(drive, finding, way or drive_way(drive))

    return attempt


def one_bad_message(rig: Rig) -> Finding:
    """A single state holds no number; the next are sound: damped, and nobody walks on."""
    drive = rig.drive(happens(lambda: rig.inject("nan_sensor", 0.0031, signal="attitude")))
    return reacted(drive, judge(drive, "state_not_finite"), "damping")


def estop_without_logger(rig: Rig) -> Finding:
    """The operator's e-stop after the log's process has died: the log is not in its way."""
    logger = Logger()

    def act(meddler: Meddler) -> None:
        logger.kill()
        meddler.later(0.2, lambda: signal.raise_signal(signal.SIGQUIT))

    drive = rig.drive(act, make_sink=logger.start)
    finding = judge(drive, "operator_estop")
    return _damped_by_incident(drive, finding, since_ns=drive.happened_ns + 200 * NS_PER_MS)


def _damped_by_incident(drive: Drive, finding: Finding, since_ns: int) -> Finding:
    """When damping began, from the incident file: it does not depend on the log."""
    kept = drive.incident
    finding.demand(kept is not None, "there is no incident file")
    if kept is None:
        return finding
    soft_ns = first_damping_ns(replace(drive, log=kept))
    finding.reaction = f"{finding.reaction} → damping"
    finding.reaction_ms = (soft_ns - since_ns) / NS_PER_MS
    finding.demand(finding.reaction_ms >= 0.0, "nothing was damped")
    return finding


def a_short_overshoot(rig: Rig) -> Finding:
    """One joint beyond its stop for two ticks: cut, told and logged, and the run goes on."""
    policy = changeable(rig.policy)

    class Twice:
        left = TWO_TICKS

        def __call__(self, action: Actions) -> Actions:
            self.left -= 1
            return np.where(np.arange(action.shape[1]) == 0, np.float32(FOUR), action) if self.left >= 0 else action

    def act(_: Meddler) -> None:
        policy.change.act = Twice()

    source = ScriptedSource(standing_sequence(), duration_s=3.0)
    drive = rig.drive(act, policy=policy, source=source)
    finding = went_on(drive, judge(drive, "completed"))
    finding.demand(drive.event_ns("setpoint_cut") is not None, "nobody says that it was cut")
    if drive.log is not None:
        commands = drive.log.commands
        asked = np.abs(commands.requested_position_rad - commands.position_rad).max()
        finding.demand(asked > 0.05, "the log does not hold what was asked")
    return finding


def two_signals(first: signal.Signals, then: signal.Signals, outcome: str) -> Callable[[Rig], Finding]:
    """Two signals in one instant of the ramp: the stronger counts."""

    def act(_: Meddler) -> None:
        signal.raise_signal(first)
        signal.raise_signal(then)

    def attempt(rig: Rig) -> Finding:
        drive = rig.drive(act, at_s=0.1)
        finding = judge(drive, outcome)
        finding.reaction_ms = max(0.0, (first_damping_ns(drive) - drive.happened_ns) / NS_PER_MS)
        return finding

    return attempt


def full_when_restarted(rig: Rig) -> Finding:
    """The disk fills up, and the next run's log is whole where there is room again."""
    logger = Logger()
    first = rig.drive(lambda _: logger.fill_disk(), make_sink=logger.start, seconds=2.0)
    finding = went_on(first, judge(first, "completed"))
    second = rig.drive(seconds=0.5)
    finding.demand(second.summary.outcome == "completed", f"the next run ended {second.summary.sentence}")
    finding.demand(read_log(second.log_path)[0] is not None, "the next log does not open")
    return finding


def outside_control(
    when: When, act: Callable[[Rig], object], outcomes: tuple[str, ...], *, at_s: float = 0.3, cuts: bool = False
) -> Callable[[Rig], Finding]:
    """Something happens while the vendor's controller has the joints: it ends without power all the same."""

    def attempt(rig: Rig) -> Finding:
        drive = rig.drive(happens(lambda: act(rig)), when=when, at_s=at_s, seconds=0.3)
        finding = judge(drive, outcomes, incident=False)
        settle(rig)
        finding.demand(rig.status().motor_power.lower().endswith("off"), "the motors still have power")
        finding.demand(not cuts or drive.was_off, "power was not cut, the robot was asked to sit")
        return finding

    return attempt


def estop_after_stop(rig: Rig) -> Finding:
    """SIGTERM while it sits down, and the e-stop right after: that still counts."""

    def act(meddler: Meddler) -> None:
        meddler.prepare(rig, lambda _: signal.raise_signal(signal.SIGQUIT), 0.1, "down")
        meddler.happened_ns = 0
        signal.raise_signal(signal.SIGTERM)

    drive = rig.drive(act, when="down", at_s=0.1, seconds=0.3)
    finding = judge(drive, "operator_estop")
    finding.demand(drive.was_off, "power was not cut, the robot was asked to sit")
    return finding


GAP: Named = ("state_gap", {})
NAN: Named = ("nan_sensor", {"signal": "position"})
DROPS: Named = ("command_drops", {"probability": 0.5})
AHEAD: Named = ("clock_jump", {"jump_s": 1.0})
LOW: Named = ("low_battery", {"percent": 4.0})
STOLEN: Named = ("lease_stolen", {"owner": "tablet-7"})
FALL: Named = ("behavior_fault", {"cause": "fall"})
FROZEN: Named = ("frozen_sensors", {})
DAMPED = ("state_stale", "state_not_finite", "clock_jumped", "state_rejected", "command_unconfirmed", "state_frozen")
ASKED_MS = 1e3 / RobotConfig().slow_state_rate_hz
"""Battery, temperatures and faults are asked for so often: how long it takes until they are known depends on luck."""

EARLY_S = 0.05
"""Robot time after joint control began at which whatever is asked for so often becomes known before the ramp's end."""

BACK_S = 1.45
"""Robot time after joint control began at which a run of one second is on its way back."""

ROWS = (
    Row("e-stop pressed before the start", 0.0, before_start("estop_pressed", ("estop_pressed",))),
    Row("lease held by another before the start", 0.0, before_start("lease_stolen", ("lease_held",), owner="tablet-7")),
    Row("no licence before the start", 0.0, before_start("license_invalid", ("activation_failed",), state="missing")),
    Row("no log: its folder is a file", 0.0, no_log(_in_a_file)),
    Row("no log: its name is a pipe", 0.0, no_log(_a_pipe)),
    Row("no log: a file system without room", 0.0, no_log(lambda _: Path("/proc/spot-rl.mcap"))),
    Row("commands lost and stale in the ramp", 100.0, together(DROPS, GAP, outcomes=DAMPED, at_s=0.1)),
    Row(
        "battery low in the ramp",
        ASKED_MS + 25.0,
        together(LOW, outcomes=("battery_low",), at_s=EARLY_S, way="ramping_out"),
    ),
    Row("clock + 1 s on the way back", 100.0, together(AHEAD, outcomes=("clock_jumped",), at_s=BACK_S, seconds=1.0)),
    Row("NaN on the way back", 25.0, together(NAN, outcomes=("state_not_finite",), at_s=BACK_S, seconds=1.0)),
    Row("stale on the way back", 100.0, together(GAP, outcomes=("state_stale",), at_s=BACK_S, seconds=1.0)),
    Row(
        "frozen, commands lost and lease stolen",
        100.0,
        together(FROZEN, DROPS, STOLEN, outcomes=("lease_lost", "state_frozen"), at_s=0.8),
    ),
    Row(
        "NaN, behaviour fault and low battery",
        100.0,
        together(NAN, FALL, LOW, outcomes=("state_not_finite", "behavior_fault"), at_s=0.8),
    ),
    Row("NaN in one state", 25.0, one_bad_message),
    Row("e-stop while the logger is dead", 40.0, estop_without_logger),
    Row("SIGTERM and SIGQUIT in the ramp", 40.0, two_signals(signal.SIGTERM, signal.SIGQUIT, "operator_estop")),
    Row("SIGTERM twice in the ramp", 40.0, two_signals(signal.SIGTERM, signal.SIGTERM, "operator_damp")),
    Row("policy beyond the stops for two ticks", 0.0, a_short_overshoot),
    Row("policy gives 1e38", 125.0, wrong(lambda a: a * 0 + np.float32(1e38), FLUNG, cuts=True)),
    Row(
        "policy gives minus infinity for one joint",
        45.0,
        wrong(lambda a: np.where(np.arange(a.shape[1]) == 0, np.float32(-np.inf), a), "policy_not_finite"),
    ),
    Row("disk full, then another run", 0.0, full_when_restarted),
    Row("robot's clock + 1 h", END_TIME_JUMP_MS, clock_jump(3600.0)),
    Row("robot's clock − 1 h", END_TIME_JUMP_MS, clock_jump(-3600.0)),
    Row("network cut while it stands up", 0.0, outside_control("up", cut, ("robot_error",))),
    Row("network cut while it sits down", 0.0, outside_control("down", cut, ("completed",))),
    Row(
        "lease revoked while it stands up",
        0.0,
        outside_control("up", lambda rig: rig.inject("lease_expired"), ("lease_held", "motion_failed")),
    ),
    Row(
        "lease revoked while it sits down",
        0.0,
        outside_control("down", lambda rig: rig.inject("lease_expired"), ("power_off_failed",), at_s=0.1),
    ),
    Row(
        "behaviour fault while it stands up",
        0.0,
        outside_control("up", lambda rig: rig.inject("behavior_fault", cause="fall"), ("motion_failed", "robot_fault")),
    ),
    Row(
        "SIGQUIT while it stands up",
        0.0,
        outside_control("up", lambda _: signal.raise_signal(signal.SIGQUIT), ("operator_estop",), cuts=True),
    ),
    Row(
        "SIGQUIT while it sits down",
        0.0,
        outside_control("down", lambda _: signal.raise_signal(signal.SIGQUIT), ("operator_estop",), cuts=True),
    ),
    Row("SIGTERM, then SIGQUIT while it sits down", 0.0, estop_after_stop),
)
