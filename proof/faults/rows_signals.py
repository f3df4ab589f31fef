"""Rows of what a robot says that cannot be true, and of a stream of a third of the rate."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import count

from proof.faults.faulty_hal import FaultyHal
from proof.faults.rig import Rig
from proof.faults.rows import Finding, Row, judge, reacted, tried_with, went_on
from proof.faults.search.signals import SpoiltSignal
from spot_model.robot.state import RobotState, SlowState

THIRD = 3
KNEE = 2


def at_100_hz(hal: FaultyHal) -> None:
    """Let only each third state arrive."""
    numbers = count()
    hal.thin(lambda _: next(numbers) % THIRD == 0)


def slower(rig: Rig) -> Finding:
    """A stream of 100 Hz is enough."""
    drive = rig.drive(at_100_hz)
    return went_on(drive, judge(drive, "completed"))


@tried_with
def slower_and_spoilt(rig: Rig, signal: str, way: str, outcome: str) -> Finding:
    """A lie is found at 100 Hz, too."""

    def happens(hal: FaultyHal) -> None:
        at_100_hz(hal)
        hal.spoil(SpoiltSignal(signal, way, KNEE, 0.0), 0.0)

    drive = rig.drive(happens)
    return reacted(drive, judge(drive, outcome), "damping")


def silent_imu(rig: Rig) -> Finding:
    """The inertial unit sends no packet any more."""

    def silent(state: RobotState) -> RobotState:
        return replace(state, imu=())

    drive = rig.drive(lambda hal: hal.spoil(silent, 0.0))
    return reacted(drive, judge(drive, "signal_doubted"), "soft_stop")


@tried_with
def polled(rig: Rig, spoilt: Callable[[SlowState], SlowState]) -> Finding:
    """What is polled cannot follow from what was polled before."""
    drive = rig.drive(lambda hal: hal.spoil_slow(spoilt, 0.0), seconds=6.0)
    return reacted(drive, judge(drive, "battery_unknown"), "soft_stop")


def unknown_for_a_second(rig: Rig) -> Finding:
    """Some polls without a battery are passed over."""

    def without(slow: SlowState) -> SlowState:
        nothing = math.nan
        return replace(slow, battery_charge_percent=nothing, battery_voltage_v=nothing, motor_temperature_c={})

    drive = rig.drive(lambda hal: hal.spoil_slow(without, 1.0))
    return went_on(drive, judge(drive, "completed"))


ROWS = (
    Row("states at 100 Hz", 0.0, slower),
    Row(
        "100 Hz, and a knee's position frozen", 300.0, slower_and_spoilt("position_rad", "one frozen", "signal_frozen")
    ),
    Row("100 Hz, and the attitude frozen", 300.0, slower_and_spoilt("odom_from_body_wxyz", "frozen", "signal_frozen")),
    Row("100 Hz, and velocities of zero", 300.0, slower_and_spoilt("velocity_rad_s", "zero", "signals_contradict")),
    Row("inertial unit falls silent", 700.0, silent_imu),
    Row("battery's charge leaps", 3300.0, polled(lambda slow: replace(slow, battery_charge_percent=31.0))),
    Row("temperatures are missing", 3300.0, polled(lambda slow: replace(slow, motor_temperature_c={}))),
    Row("no charge in any poll", 3300.0, polled(lambda slow: replace(slow, battery_charge_percent=math.nan))),
    Row("no charge, voltage and temperatures for a second", 0.0, unknown_for_a_second),
)
