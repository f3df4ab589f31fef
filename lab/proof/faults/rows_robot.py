"""Rows of the robot and of its other clients: faults, e-stops, leases, power, battery, tokens, clocks, reboots."""

from __future__ import annotations

import signal
import time
from typing import Any, Final

import numpy as np

from proof.faults.attempts import SOFT, Check, damped, inject, is_off, raise_signals, row
from proof.faults.rows import NS_PER_MS, Finding, Row, judge
from proof.faulty import FaultyHal, raise_as_fault
from proof.rig import Drive, Rig
from spot_runtime.hal.errors import HalError
from spot_tools.sources import GamepadSource, PadReading

END_TIME_JUMP_MS: Final = 5.0
CUT: Final = ("state_lost", "command_refused", "link_lost")
REACH_S: Final = 60.0
"""Host time after which the robot is no longer tried."""

OUR_ESTOP: Final = {"estop": "own"}
DEFAULT_RAMPS: Final = {"ramp_out_s": 1.0, "soft_stop_s": 1.0, "soft_stop_settle_s": 0.6}
OVERHEARD: Final = ("lease_lost", "motors_off", "command_refused")
JUMPED: Final = ("clock_jumped", "state_rejected", "state_stale", "command_refused")
QUIT: Final = raise_signals(signal.SIGQUIT)


def runs_again(outcome: str, **changes: Any) -> Check:
    """Make the check that the next run ends so."""

    def check(rig: Rig, _: Drive, finding: Finding) -> None:
        summary = rig.drive(seconds=1.0, **changes).summary
        finding.demand(summary.outcome == outcome, f"the next run ended {summary.outcome}: {summary.sentence}")

    return check


def is_left_to_the_thief(rig: Rig, _: Drive, finding: Finding) -> None:
    """Check that the lease is never taken back."""
    owner = rig.status().lease_owner
    finding.demand(owner == "tablet-7", f"the lease is now {owner}'s")


def is_damped(rig: Rig, drive: Drive, finding: Finding) -> None:
    """Check what the operator's own e-stop does: damping at once, then no power."""
    finding.reaction += " → damping"
    damped(rig, drive, finding)
    rig.step(2.0)
    is_off(rig, drive, finding)


def is_pressed(rig: Rig, _: Drive, finding: Finding) -> None:
    """Check that our own e-stop holds the robot."""
    finding.demand(rig.is_estopped, "the e-stop is not pressed")


def sits(_: Rig, drive: Drive, finding: Finding) -> None:
    """Time a good end: in place, back to the vendor's stand, then it sits."""
    hal = drive.hal
    finding.reaction += " → sits"
    finding.reaction_ms = (hal.power_off_ns - hal.happened_ns) / NS_PER_MS
    finding.demand(hal.power_off_ns > 0, "it was never told to sit")
    finding.demand(hal.truth is not None and hal.truth.body_height_min_m > 0.3, "the body dropped on the way")


def end_times(_: Rig, drive: Drive, finding: Finding) -> None:
    """Measure the largest jump between the end times of two commands, against the host's clock."""
    commands = drive.log.commands
    offset_ns = commands.end_robot_stamp_ns - commands.host_stamp_ns
    finding.reaction_ms = float(np.abs(np.diff(offset_ns)).max()) / NS_PER_MS
    finding.reaction += ", end times" if "→" in finding.reaction else ""


def is_reached_again(rig: Rig, _: Drive, finding: Finding) -> None:
    """Check that the robot can be reached again soon after, and that nothing moves until somebody asks."""
    began_s = time.monotonic()
    rig.step(0.2)  # what was on the wire arrives
    commands = rig.status().commands_received
    while not (is_reached := _can_log_in(rig)) and time.monotonic() - began_s < REACH_S:
        time.sleep(0.2)
    finding.reaction += " → reached again"
    finding.reaction_ms = (time.monotonic() - began_s) * 1e3
    finding.demand(is_reached, "it was not reached again")
    rig.step(1.0)
    finding.demand(rig.status().commands_received == commands, "commands were sent that nobody asked for")


def _can_log_in(rig: Rig) -> bool:
    try:
        rig.clear_behavior_faults()
    except HalError:
        return False
    return True


class SilentPad:
    """A gamepad whose stick is pushed, until it is gone."""

    is_attached = True

    def read(self) -> PadReading:
        """Full speed ahead while it is there."""
        return PadReading((0.0, -1.0, 0.0, 0.0), (False,) * 4 + (True,), self.is_attached)

    def close(self) -> None:
        """Nothing to give back."""


def dead_man(rig: Rig) -> Finding:
    """Let the operator's pad fall silent: the velocity command is zero soon after."""
    pad = SilentPad()

    def fall_silent(hal: FaultyHal) -> None:
        pad.is_attached = False
        hal.plan(1.0, lambda: raise_as_fault(signal.SIGTERM))

    drive = rig.drive(fall_silent, at_s=1.5, source=GamepadSource(rig.config().operator, pad))
    finding = judge(drive, "operator_stop")
    ticks = drive.log.ticks
    speed = np.abs(ticks.velocity_command[:, 0])
    before = speed[ticks.robot_stamp_ns <= drive.happened_ns]
    finding.demand(before.max(initial=0.0) > 0.3, "the robot was never told to move")
    still = (ticks.robot_stamp_ns > drive.happened_ns) & (speed == 0.0)
    finding.demand(bool(still.any()), "the command never became zero")
    finding.reaction = "velocity command zero"
    finding.reaction_ms = (int(ticks.robot_stamp_ns[np.argmax(still)]) - drive.happened_ns) / NS_PER_MS
    return finding


def next_after_own_estop(rig: Rig) -> Finding:
    """A run that held the e-stop itself takes its endpoint back, so that the next does not rely on a silent one."""
    first = rig.drive(seconds=0.5, robot=OUR_ESTOP).summary
    finding = Finding(f"{first.outcome}, then {rig.status().estop_level}")
    finding.demand(first.outcome == "completed", f"the first ended: {first.sentence}")
    finding.demand(rig.is_estopped, "the endpoint is left behind, released, and nobody feeds it")
    second = rig.drive(seconds=0.5).summary
    finding.demand(second.outcome == "completed", f"the second ended: {second.sentence}")
    return finding


FELL: Final = inject("behavior_fault", cause="fall")
STOLEN: Final = inject("lease_stolen", owner="tablet-7")
PRESSED: Final = inject("estop_pressed")
EXPIRED: Final = inject("lease_expired")
REFUSED: Final = (runs_again("robot_fault"),)

ROWS = (
    row("behaviour fault", 100.0, FELL, "behavior_fault", way=SOFT, checks=REFUSED),
    row("software e-stop", 40.0, QUIT, "operator_estop", checks=(is_damped,), is_real_time=True),
    row("e-stopped elsewhere", 100.0, PRESSED, "estopped", way=SOFT, is_real_time=True),
    row("lease stolen", 100.0, STOLEN, "lease_lost", way=SOFT, checks=(is_left_to_the_thief,), is_real_time=True),
    row("lease revoked", 100.0, EXPIRED, *OVERHEARD, way=SOFT),
    row("motor power lost", 100.0, inject("power_loss"), "motors_off", way=SOFT),
    *(
        row(name, 2000.0, act, outcome, checks=(sits,), seconds=8.0, handover=DEFAULT_RAMPS)
        for name, act, outcome in (
            ("battery low", inject("low_battery", percent=5.0), "battery_low"),
            ("motor hot", inject("motor_over_temperature", temperature_c=85.0), "motor_hot"),
            ("system fault, critical", inject("system_fault", severity="critical"), "system_fault"),
        )
    ),
    row("token expired", END_TIME_JUMP_MS, inject("token_expired"), "completed", missed=0, checks=(end_times,)),
    *(
        row(
            f"robot's clock {sign} {name}",
            END_TIME_JUMP_MS,
            inject("clock_jump", jump_s=seconds if sign == "+" else -seconds),
            *JUMPED,
            way=SOFT,
            checks=(end_times,),
        )
        for name, seconds in (("1 s", 1.0), ("1 h", 3600.0))
        for sign in "+−"
    ),
    *(
        row(name, 10_000.0, inject(fault, 5.0), *outcomes, checks=(is_reached_again,), is_host_time=True)
        for name, fault, outcomes in (
            ("network cut for 5 s", "network_cut", CUT),
            ("reboot", "reboot", (*CUT, "motors_off")),
        )
    ),
    Row("dead-man silent", 350.0, dead_man),
)

ALONE = (
    row(
        "software e-stop, our own endpoint",
        40.0,
        QUIT,
        "operator_estop",
        checks=(is_damped, is_pressed),
        is_alone=True,
        robot=OUR_ESTOP,
    ),
    Row("a run after one with its own e-stop", 0.0, next_after_own_estop, is_alone=True),
)
"""Our endpoint replaces the operator's, and the next client has to set up another."""
