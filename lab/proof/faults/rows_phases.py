"""Rows by the phase of a run, from before the start to sitting down, and of two or three faults at once."""

from __future__ import annotations

import signal
from typing import Any, Final

from proof.faults.attempts import SOFT, all_of, damped, inject, is_off, power_was_cut, raise_signals, row
from proof.faults.rows import Finding, Row, settle
from proof.faults.rows_robot import EXPIRED, FELL, PRESSED, QUIT, STOLEN
from proof.faulty import FaultyHal, raise_as_fault
from proof.rig import Drive, Rig
from spot_runtime.config import RobotConfig
from spot_runtime.control.modes import TAKE_HOLD_S, Mode

GAP: Final = inject("state_gap")
NAN: Final = inject("nan_sensor", signal="position")
AHEAD: Final = inject("clock_jump", jump_s=1.0)
BACK: Final = inject("clock_jump", jump_s=-1.0)
LOW: Final = inject("low_battery", percent=4.0)
DROPS: Final = inject("command_drops", probability=0.5)
FROZEN: Final = inject("frozen_sensors")
CUT: Final = inject("network_cut", 1.0)
TERM: Final = signal.SIGTERM
DAMPED: Final = (
    "state_stale",
    "state_not_finite",
    "clock_jumped",
    "state_rejected",
    "command_unconfirmed",
    "state_frozen",
)
ASKED_MS: Final = 1e3 / RobotConfig().slow_state_rate_hz
"""Battery, temperatures and faults are asked for so often: how long it takes until they are known depends on luck."""

EARLY_S: Final = TAKE_HOLD_S + 0.1
"""Robot time after joint control began at which whatever is asked for so often becomes known before the ramp's end."""

IN_RAMP: Final[dict[str, Any]] = {"at_s": 0.1}
AS_IT_BEGINS: Final[dict[str, Any]] = {"at_s": 0.0}
ON_THE_WAY_BACK: Final[dict[str, Any]] = {"at_s": 1.45, "seconds": 1.0}
"""A run of one second."""


def before_start(fault: str, outcome: str, name: str, **parameters: str) -> Row:
    """Make a row of a fault before the run, which is refused with a reason and takes neither joints nor a lease."""

    def attempt(rig: Rig) -> Finding:
        rig.inject(fault, **parameters)
        owner = rig.status().lease_owner
        drive = rig.drive(seconds=1.0)
        summary, finding = drive.summary, Finding(drive.summary.outcome)
        finding.demand(summary.outcome == outcome, f"ended {summary.outcome}: {summary.sentence}")
        finding.demand(0 < summary.exit_code < 100, f"exit code {summary.exit_code}")
        finding.demand(len(summary.sentence) > 10, "it does not say why")
        finding.log_ok = drive.opened[0] is not None
        # A tick without the policy may be due between the request for joint control and the robot's refusal.
        ran = sorted(
            {mode.value for mode in Mode if mode.runs_policy} & set(drive.log.ticks.mode if finding.log_ok else ())
        )
        finding.demand(not ran, f"the policy ran in {', '.join(ran)}")
        finding.demand(rig.status().lease_owner == owner, f"the lease is now {rig.status().lease_owner}'s")
        return finding

    return Row(name, 0.0, attempt)


def settles_without_power(rig: Rig, drive: Drive, finding: Finding) -> None:
    """Check that it ends without power, though the vendor's controller had the joints."""
    settle(rig)
    is_off(rig, drive, finding)


def term_then_quit(_: Rig, hal: FaultyHal) -> None:
    """Raise SIGTERM, and the e-stop right after, which still counts."""
    hal.plan(0.01, lambda: raise_as_fault(signal.SIGQUIT))
    raise_as_fault(TERM)


UP: Final[dict[str, Any]] = {"when": "up", "at_s": 0.3, "seconds": 0.3, "incident": False}
DOWN: Final[dict[str, Any]] = {**UP, "when": "down"}
OFF: Final = (settles_without_power,)
CUT_OFF: Final = (settles_without_power, power_was_cut)

ROWS = (
    before_start("estop_pressed", "estop_pressed", "e-stop pressed before the start"),
    before_start("lease_stolen", "lease_held", "lease held by another before the start", owner="tablet-7"),
    before_start("license_invalid", "activation_failed", "no licence before the start", state="missing"),
    row("battery low in the ramp", ASKED_MS + 25.0, LOW, "battery_low", way="ramping_out", at_s=EARLY_S),
    row("clock + 1 s on the way back", 100.0, AHEAD, "clock_jumped", "command_refused", way=SOFT, **ON_THE_WAY_BACK),
    row("NaN on the way back", 25.0, NAN, "state_not_finite", way=SOFT, **ON_THE_WAY_BACK),
    row("stale on the way back", 100.0, GAP, "state_stale", way=SOFT, **ON_THE_WAY_BACK),
    row(
        "SIGTERM and SIGQUIT in the ramp",
        40.0,
        raise_signals(TERM, signal.SIGQUIT),
        "operator_estop",
        checks=(damped,),
        **IN_RAMP,
    ),
    row("SIGTERM twice in the ramp", 40.0, raise_signals(TERM, TERM), "operator_damp", checks=(damped,), **IN_RAMP),
    row("network cut while it stands up", 0.0, CUT, "robot_error", checks=OFF, **UP),
    row("network cut while it sits down", 0.0, CUT, "completed", checks=OFF, **DOWN),
    row("lease revoked while it stands up", 0.0, EXPIRED, "lease_held", "motion_failed", checks=OFF, **UP),
    row("lease revoked while it sits down", 0.0, EXPIRED, "completed", checks=OFF, **{**DOWN, **IN_RAMP}),
    row("behaviour fault while it stands up", 0.0, FELL, "motion_failed", "robot_fault", checks=OFF, **UP),
    row("SIGQUIT while it stands up", 0.0, QUIT, "operator_estop", checks=CUT_OFF, **UP),
    row("SIGQUIT while it sits down", 0.0, QUIT, "operator_estop", checks=CUT_OFF, **DOWN),
    row(
        "SIGTERM, then SIGQUIT while it sits down",
        0.0,
        term_then_quit,
        "operator_estop",
        checks=(power_was_cut,),
        **{**DOWN, **IN_RAMP},
    ),
    row("lease stolen in the ramp", 100.0, STOLEN, "lease_lost", way=SOFT, **IN_RAMP),
    row("NaN in the ramp", 25.0, NAN, "state_not_finite", way=SOFT, **IN_RAMP),
    row("stale as joint control begins", 80.0, GAP, "state_stale", way=SOFT, **AS_IT_BEGINS),
    row("e-stop as joint control begins", 100.0, PRESSED, "estopped", way=SOFT, **AS_IT_BEGINS),
    row("commands lost and stale in the ramp", 100.0, all_of(DROPS, GAP), *DAMPED, way=SOFT, **IN_RAMP),
    *(
        row(name, bound_ms, all_of(*acts), *outcomes, way=SOFT)
        for name, bound_ms, acts, outcomes in (
            ("stale and lease stolen at once", 100.0, (GAP, STOLEN), ("state_stale", "lease_lost")),
            ("NaN and e-stop at once", 100.0, (NAN, PRESSED), ("state_not_finite", "estopped")),
            ("battery low, then no states", 300.0, (LOW, GAP), ("battery_low", "state_stale")),
            ("clock back and behaviour fault at once", 100.0, (BACK, FELL), ("behavior_fault", "state_rejected")),
            ("frozen, commands lost and lease stolen", 100.0, (FROZEN, DROPS, STOLEN), ("lease_lost", "state_frozen")),
            ("NaN, behaviour fault and low battery", 100.0, (NAN, FELL, LOW), ("state_not_finite", "behavior_fault")),
        )
    ),
)
