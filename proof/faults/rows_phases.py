"""Rows by the phase of a run, from before the start to sitting down, and of two or three faults at once."""

from __future__ import annotations

import signal
from collections.abc import Callable

from proof.bench_signals import raise_as_fault
from proof.faults.faulty_hal import FaultyHal, When
from proof.faults.rig import AT_S, Rig
from proof.faults.rows import NS_PER_MS, Finding, Row, happens, judge, reacted, settle, tried_with
from proof.faults.rows_robot import first_damping_ns
from proof.faults.rows_state import drive_way
from spot_runtime.config import RobotConfig
from spot_runtime.control.modes import TAKE_HOLD_S

Named = tuple[str, dict[str, float | str]]
GAP: Named = ("state_gap", {})
NAN: Named = ("nan_sensor", {"signal": "position"})
AHEAD: Named = ("clock_jump", {"jump_s": 1.0})
LOW: Named = ("low_battery", {"percent": 4.0})
STOLEN: Named = ("lease_stolen", {"owner": "tablet-7"})
ESTOP: Named = ("estop_pressed", {})
DROPS: Named = ("command_drops", {"probability": 0.5})
FALL: Named = ("behavior_fault", {"cause": "fall"})
FROZEN: Named = ("frozen_sensors", {})
BACK: Named = ("clock_jump", {"jump_s": -1.0})
DAMPED = ("state_stale", "state_not_finite", "clock_jumped", "state_rejected", "command_unconfirmed", "state_frozen")
ASKED_MS = 1e3 / RobotConfig().slow_state_rate_hz
"""Battery, temperatures and faults are asked for so often: how long it takes until they are known depends on luck."""

EARLY_S = TAKE_HOLD_S + 0.1
"""Robot time after joint control began at which whatever is asked for so often becomes known before the ramp's end."""

BACK_S = 1.45
"""Robot time after joint control began at which a run of one second is on its way back."""


def cut(rig: Rig) -> None:
    """The network is away for a second."""
    rig.inject("network_cut", 1.0)


@tried_with
def before_start(rig: Rig, /, fault: str, outcomes: tuple[str, ...], **parameters: float | str) -> Finding:
    """Wrong before a run begins: it is refused with a reason, and neither joints nor anybody's lease are taken."""
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


@tried_with
def together(
    rig: Rig, *faults: Named, outcomes: tuple[str, ...], at_s: float, seconds: float = 3.0, way: str = ""
) -> Finding:
    """Some faults in one instant, wherever the run then is."""
    acts = [lambda name=name, parameters=parameters: rig.inject(name, **parameters) for name, parameters in faults]
    drive = rig.drive(happens(*acts), at_s=at_s, seconds=seconds)
    finding = judge(drive, outcomes)
    return reacted(drive, finding, way or drive_way(drive))


def two_signals(first: signal.Signals, then: signal.Signals, outcome: str) -> Callable[[Rig], Finding]:
    """Two signals in one instant of the ramp: the stronger counts."""

    def act(_: FaultyHal) -> None:
        raise_as_fault(first)
        raise_as_fault(then)

    def attempt(rig: Rig) -> Finding:
        drive = rig.drive(act, at_s=0.1)
        finding = judge(drive, outcome)
        finding.reaction_ms = max(0.0, (first_damping_ns(drive) - drive.happened_ns) / NS_PER_MS)
        return finding

    return attempt


@tried_with
def outside_control(
    rig: Rig,
    when: When,
    act: Callable[[Rig], object],
    outcomes: tuple[str, ...],
    *,
    at_s: float = 0.3,
    cuts: bool = False,
) -> Finding:
    """Something happens while the vendor's controller has the joints: it ends without power all the same."""
    drive = rig.drive(happens(lambda: act(rig)), when=when, at_s=at_s, seconds=0.3)
    finding = judge(drive, outcomes, incident=False)
    settle(rig)
    finding.demand(rig.status().motor_power.lower().endswith("off"), "the motors still have power")
    finding.demand(not cuts or drive.was_off, "power was not cut, the robot was asked to sit")
    return finding


def estop_after_stop(rig: Rig) -> Finding:
    """SIGTERM while it sits down, and the e-stop right after: that still counts."""

    def act(hal: FaultyHal) -> None:
        hal.prepare(rig, lambda _: raise_as_fault(signal.SIGQUIT), 0.1, "down")
        hal.happened_ns = 0
        raise_as_fault(signal.SIGTERM)

    drive = rig.drive(act, when="down", at_s=0.1, seconds=0.3)
    finding = judge(drive, "operator_estop")
    finding.demand(drive.was_off, "power was not cut, the robot was asked to sit")
    return finding


ROWS = (
    Row("e-stop pressed before the start", 0.0, before_start("estop_pressed", ("estop_pressed",))),
    Row("lease held by another before the start", 0.0, before_start("lease_stolen", ("lease_held",), owner="tablet-7")),
    Row("no licence before the start", 0.0, before_start("license_invalid", ("activation_failed",), state="missing")),
    Row(
        "battery low in the ramp",
        ASKED_MS + 25.0,
        together(LOW, outcomes=("battery_low",), at_s=EARLY_S, way="ramping_out"),
    ),
    Row(
        "clock + 1 s on the way back",
        100.0,
        together(AHEAD, outcomes=("clock_jumped", "command_refused"), at_s=BACK_S, seconds=1.0),
    ),
    Row("NaN on the way back", 25.0, together(NAN, outcomes=("state_not_finite",), at_s=BACK_S, seconds=1.0)),
    Row("stale on the way back", 100.0, together(GAP, outcomes=("state_stale",), at_s=BACK_S, seconds=1.0)),
    Row("SIGTERM and SIGQUIT in the ramp", 40.0, two_signals(signal.SIGTERM, signal.SIGQUIT, "operator_estop")),
    Row("SIGTERM twice in the ramp", 40.0, two_signals(signal.SIGTERM, signal.SIGTERM, "operator_damp")),
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
        outside_control("down", lambda rig: rig.inject("lease_expired"), ("completed",), at_s=0.1),
    ),
    Row(
        "behaviour fault while it stands up",
        0.0,
        outside_control("up", lambda rig: rig.inject("behavior_fault", cause="fall"), ("motion_failed", "robot_fault")),
    ),
    Row(
        "SIGQUIT while it stands up",
        0.0,
        outside_control("up", lambda _: raise_as_fault(signal.SIGQUIT), ("operator_estop",), cuts=True),
    ),
    Row(
        "SIGQUIT while it sits down",
        0.0,
        outside_control("down", lambda _: raise_as_fault(signal.SIGQUIT), ("operator_estop",), cuts=True),
    ),
    Row("SIGTERM, then SIGQUIT while it sits down", 0.0, estop_after_stop),
    Row("lease stolen in the ramp", 100.0, together(STOLEN, outcomes=("lease_lost",), at_s=0.1)),
    Row("NaN in the ramp", 25.0, together(NAN, outcomes=("state_not_finite",), at_s=0.1)),
    Row("stale as joint control begins", 80.0, together(GAP, outcomes=("state_stale",), at_s=0.0)),
    Row("e-stop as joint control begins", 100.0, together(ESTOP, outcomes=("estopped",), at_s=0.0)),
    Row(
        "stale and lease stolen at once",
        100.0,
        together(GAP, STOLEN, outcomes=("state_stale", "lease_lost"), at_s=AT_S),
    ),
    Row("NaN and e-stop at once", 100.0, together(NAN, ESTOP, outcomes=("state_not_finite", "estopped"), at_s=AT_S)),
    Row(
        "battery low, then no states",
        300.0,
        together(LOW, GAP, outcomes=("battery_low", "state_stale"), at_s=AT_S),
    ),
    Row(
        "clock back and behaviour fault at once",
        100.0,
        together(BACK, FALL, outcomes=("behavior_fault", "state_rejected"), at_s=AT_S),
    ),
    Row("commands lost and stale in the ramp", 100.0, together(DROPS, GAP, outcomes=DAMPED, at_s=0.1)),
    Row(
        "frozen, commands lost and lease stolen",
        100.0,
        together(FROZEN, DROPS, STOLEN, outcomes=("lease_lost", "state_frozen"), at_s=AT_S),
    ),
    Row(
        "NaN, behaviour fault and low battery",
        100.0,
        together(NAN, FALL, LOW, outcomes=("state_not_finite", "behavior_fault"), at_s=AT_S),
    ),
)
