"""Rows of the robot and of its other clients: faults, e-stops, leases, power, battery, tokens, clocks, reboots."""

from __future__ import annotations

import signal
import time
from typing import Final

import numpy as np

from proof.bench_signals import raise_as_fault
from proof.faults.drive import Drive
from proof.faults.faulty_hal import FaultyHal
from proof.faults.rig import Rig
from proof.faults.rows import NS_PER_MS, Finding, Row, happens, judge, reacted, tried_with, went_on
from proof.faults.rows_state import drive_way
from spot_runtime.hal.errors import HalError
from spot_tools.run.gamepad import GamepadSource, PadReading

END_TIME_JUMP_MS = 5.0


@tried_with
def stopped(rig: Rig, /, fault: str, outcome: str | tuple[str, ...], **parameters: float | str) -> Finding:
    """The robot, or somebody at it, ends the run."""
    drive = rig.drive(happens(lambda: rig.inject(fault, **parameters)))
    return reacted(drive, judge(drive, outcome), drive_way(drive))


def behaviour_fault(rig: Rig) -> Finding:
    """A behaviour fault stays until a person clears it."""
    finding = stopped("behavior_fault", "behavior_fault", cause="fall")(rig)
    again = rig.drive(seconds=1.0)
    finding.demand(again.summary.outcome == "robot_fault", f"a second run ended {again.summary.outcome}")
    return finding


def lease_stolen(rig: Rig) -> Finding:
    """Another client takes the lease: it is never taken back."""
    finding = stopped("lease_stolen", "lease_lost", owner="tablet-7")(rig)
    finding.demand(rig.status().lease_owner == "tablet-7", f"the lease is now {rig.status().lease_owner}'s")
    return finding


def first_damping_ns(drive: Drive) -> int:
    """Robot stamp of the first command without stiffness."""
    if drive.log is None:
        return 0
    commands = drive.log.commands
    soft = (commands.kp_nm_per_rad == 0.0).all(axis=1)
    return int(commands.robot_stamp_ns[np.argmax(soft)]) if soft.any() else 0


@tried_with
def software_estop(rig: Rig, endpoint: str) -> Finding:
    """The operator's own e-stop: damping at once, then no power."""
    drive = rig.drive(lambda _: raise_as_fault(signal.SIGQUIT), robot={"estop": endpoint})
    finding = judge(drive, "operator_estop")
    finding.reaction = "operator_estop → damping"
    finding.reaction_ms = (first_damping_ns(drive) - drive.happened_ns) / NS_PER_MS
    finding.demand(finding.reaction_ms >= 0.0, "nothing was damped")
    rig.step(2.0)
    finding.demand(rig.status().motor_power.lower().endswith("off"), "the motors still have power")
    finding.demand(endpoint != "own" or not is_released(rig), "the e-stop is not pressed")
    return finding


@tried_with
def hand_back(rig: Rig, /, fault: str, outcome: str, **parameters: float | str) -> Finding:
    """Something that leaves time for a good end: in place, back to the vendor's stand, then it sits."""
    drive = rig.drive(happens(lambda: rig.inject(fault, **parameters)), seconds=8.0, handover=DEFAULT_RAMPS)
    finding = judge(drive, outcome)
    finding.reaction = f"{drive.summary.outcome} → sits"
    finding.reaction_ms = (drive.released_power_ns - drive.happened_ns) / NS_PER_MS
    finding.demand(drive.released_power_ns > 0, "it was never told to sit")
    is_up = drive.truth is not None and drive.truth.body_height_min_m > 0.3
    finding.demand(is_up, "the body dropped on the way")
    return finding


DEFAULT_RAMPS = {"ramp_out_s": 1.0, "soft_stop_s": 1.0, "soft_stop_settle_s": 0.6}


def end_time_jump_ms(drive: Drive) -> float:
    """Largest jump between the end times of two commands, against the host's clock."""
    if drive.log is None:
        return float("inf")
    commands = drive.log.commands
    offset_ns = commands.end_robot_stamp_ns - commands.host_stamp_ns
    return float(np.abs(np.diff(offset_ns)).max()) / NS_PER_MS


def token_expired(rig: Rig) -> Finding:
    """Every token becomes invalid: the run logs in again and goes on."""
    drive = rig.drive(happens(lambda: rig.inject("token_expired")), seconds=3.0)
    finding = went_on(drive, judge(drive, "completed"))
    finding.reaction_ms = end_time_jump_ms(drive)
    return finding


@tried_with
def clock_jump(rig: Rig, jump_s: float) -> Finding:
    """Somebody sets the robot's clock: no end time jumps with it."""
    drive = rig.drive(happens(lambda: rig.inject("clock_jump", jump_s=jump_s)))
    finding = judge(drive, ("clock_jumped", "state_rejected", "state_stale", "command_refused"))
    finding.reaction_ms = end_time_jump_ms(drive)
    finding.reaction = f"{finding.reaction} → {drive_way(drive)}, end times"
    finding.demand(drive.event_ns(drive_way(drive)) is not None, "nothing happened")
    return finding


CUT: Final = ("state_lost", "command_refused", "link_lost")
REACH_S: Final = 60.0
"""Host time after which the robot is no longer tried."""


@tried_with
def away(rig: Rig, fault: str, outcomes: tuple[str, ...]) -> Finding:
    """The robot is away for 5 s: soon after, it can be reached again, and nothing moves until somebody asks."""
    drive = rig.drive(happens(lambda: rig.inject(fault, 5.0)))
    finding = judge(drive, outcomes)
    began_s = time.monotonic()
    rig.step(0.2)  # what was on the wire arrives
    commands = rig.status().commands_received
    while not (reached := is_reached(rig)) and time.monotonic() - began_s < REACH_S:
        time.sleep(0.2)
    finding.reaction = f"{finding.reaction} → reached again"
    finding.reaction_ms = (time.monotonic() - began_s) * 1e3
    finding.demand(reached, "it was not reached again")
    rig.step(1.0)
    finding.demand(rig.status().commands_received == commands, "commands were sent that nobody asked for")
    return finding


def is_reached(rig: Rig) -> bool:
    """Whether a client can log in."""
    try:
        with rig.environment():
            rig.clear_behavior_faults()
    except HalError:
        return False
    return True


class SilentPad:
    """A gamepad whose stick is pushed, until it is gone."""

    def __init__(self) -> None:
        self.is_attached = True

    def read(self) -> PadReading:
        """Full speed ahead while it is there."""
        return PadReading((0.0, -1.0, 0.0, 0.0), (False,) * 4 + (True,), self.is_attached)

    def close(self) -> None:
        """Nothing to give back."""


def dead_man(rig: Rig) -> Finding:
    """The operator's pad falls silent: the velocity command is zero soon after."""
    pad = SilentPad()
    source = GamepadSource(rig.config().operator, pad)

    def act(hal: FaultyHal) -> None:
        pad.is_attached = False
        hal.later(1.0, lambda: raise_as_fault(signal.SIGTERM))

    drive = rig.drive(act, at_s=1.5, source=source)
    finding = judge(drive, "operator_stop")
    if drive.log is None:
        return finding
    ticks = drive.log.ticks
    speed = np.abs(ticks.velocity_command[:, 0])
    before = speed[ticks.robot_stamp_ns <= drive.happened_ns]
    finding.demand(before.max(initial=0.0) > 0.3, "the robot was never told to move")
    still = (ticks.robot_stamp_ns > drive.happened_ns) & (speed == 0.0)
    finding.demand(bool(still.any()), "the command never became zero")
    finding.reaction = "velocity command zero"
    finding.reaction_ms = (int(ticks.robot_stamp_ns[np.argmax(still)]) - drive.happened_ns) / NS_PER_MS
    return finding


ROWS = (
    Row("behaviour fault", 100.0, behaviour_fault),
    Row("software e-stop", 40.0, software_estop("auto"), is_real_time=True),
    Row("e-stopped elsewhere", 100.0, stopped("estop_pressed", "estopped"), is_real_time=True),
    Row("lease stolen", 100.0, lease_stolen, is_real_time=True),
    Row("lease revoked", 100.0, stopped("lease_expired", ("lease_lost", "motors_off", "command_refused"))),
    Row("motor power lost", 100.0, stopped("power_loss", "motors_off")),
    Row("battery low", 2000.0, hand_back("low_battery", "battery_low", percent=5.0)),
    Row("motor hot", 2000.0, hand_back("motor_over_temperature", "motor_hot", temperature_c=85.0)),
    Row("system fault, critical", 2000.0, hand_back("system_fault", "system_fault", severity="critical")),
    Row("token expired", END_TIME_JUMP_MS, token_expired),
    Row("robot's clock + 1 s", END_TIME_JUMP_MS, clock_jump(1.0)),
    Row("robot's clock − 1 s", END_TIME_JUMP_MS, clock_jump(-1.0)),
    Row("network cut for 5 s", 10_000.0, away("network_cut", CUT), is_host_time=True),
    Row("reboot", 10_000.0, away("reboot", (*CUT, "motors_off")), is_host_time=True),
    Row("dead-man silent", 350.0, dead_man),
    Row("robot's clock + 1 h", END_TIME_JUMP_MS, clock_jump(3600.0)),
    Row("robot's clock − 1 h", END_TIME_JUMP_MS, clock_jump(-3600.0)),
)


def next_after_own_estop(rig: Rig) -> Finding:
    """A run that held the e-stop itself takes its endpoint back, so that the next does not rely on a silent one."""
    first = rig.drive(seconds=0.5, robot={"estop": "own"})
    finding = Finding(f"{first.summary.outcome}, then {rig.status().estop_level}")
    finding.demand(first.summary.outcome == "completed", f"the first ended: {first.summary.sentence}")
    finding.demand(not is_released(rig), "the endpoint is left behind, released, and nobody feeds it")
    second = rig.drive(seconds=0.5)
    finding.demand(second.summary.outcome == "completed", f"the second ended: {second.summary.sentence}")
    return finding


def is_released(rig: Rig) -> bool:
    """Whether no e-stop holds the robot."""
    return rig.status().estop_level.lower() in ("none", "estop_level_none")


ALONE = (
    Row("software e-stop, our own endpoint", 40.0, software_estop("own"), is_alone=True),
    Row("a run after one with its own e-stop", 0.0, next_after_own_estop, is_alone=True),
)
"""Our endpoint replaces the operator's, and the next client has to set up another."""
