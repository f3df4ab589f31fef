"""Rows of what a robot says that cannot be true, and of a stream of a third of the rate."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import count

import numpy as np

from proof.faults.faulty_hal import FaultyHal, When
from proof.faults.rig import AT_S, OVERTURNED_RAD, Rig, tilt_rad
from proof.faults.rows import Finding, Row, judge, reacted, tried_with, went_on
from proof.faults.search.signals import SpoiltSignal
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import RobotState, SlowState
from spot_tools.run.scripted import ScriptedSource

THIRD = 3
KNEE = 2
BRISK = VelocitySequence(name="brisk", duration_s=600.0, waypoints=(Waypoint(time_s=0.0, v_x_m_s=0.8),))
KNEES = [2, 5, 8, 11]


def at_100_hz(hal: FaultyHal) -> None:
    """Let only each third state arrive."""
    numbers = count()
    hal.thin(lambda _: next(numbers) % THIRD == 0)


def slower(rig: Rig) -> Finding:
    """A stream of 100 Hz is enough."""
    drive = rig.drive(at_100_hz)
    return went_on(drive, judge(drive, "completed"))


@tried_with
def slower_and_spoilt(rig: Rig, signal: str, way: str, *outcomes: str) -> Finding:
    """A lie is found at 100 Hz, too."""

    def happens(hal: FaultyHal) -> None:
        at_100_hz(hal)
        hal.spoil(SpoiltSignal(signal, way, KNEE, 0.0), 0.0)

    drive = rig.drive(happens)
    return reacted(drive, judge(drive, outcomes), "damping")


@tried_with
def unused(rig: Rig, spoilt: Callable[[RobotState], RobotState]) -> Finding:
    """A signal that nothing in control reads is wrong: that is told, and nothing stops."""
    drive = rig.drive(lambda hal: hal.spoil(spoilt, 0.0), source=ScriptedSource(BRISK, duration_s=8.0))
    finding = went_on(drive, judge(drive, "completed"))
    finding.demand(drive.event_ns("signal_doubted") is not None, "nothing was told of it")
    return finding


@tried_with
def joints_elsewhere(
    rig: Rig, joints: Sequence[int], reported: Callable[[RobotState], np.ndarray], name: str
) -> Finding:
    """Joints are reported elsewhere than their servos see them, from before the robot stands."""

    def spoilt(state: RobotState) -> RobotState:
        position = state.position_rad.copy()
        position[list(joints)] = reported(state)
        return replace(state, position_rad=position)

    drive = rig.drive(lambda hal: hal.spoil(spoilt, 0.0), at_s=0.0, when="up")
    finding = judge(drive, ("position_refused", "signals_contradict"))
    finding.demand(name in drive.summary.sentence, f"{name} is not named: {drive.summary.sentence}")
    modes = "".join(event.text for event in drive.log.events) if drive.log is not None else ""
    finding.demand("→ ramping_in" not in modes, "the policy got the joints")
    finding.demand(tilt_rad(rig.truth()) < OVERTURNED_RAD, "the robot was overturned")
    return finding


@tried_with
def drifting(rig: Rig, joints: Sequence[int], rate_rad_s: float, when: When) -> Finding:
    """Encoders drift, too slowly for the joints' velocities to tell."""
    began_ns = 0

    def spoilt(state: RobotState) -> RobotState:
        nonlocal began_ns
        began_ns = began_ns or state.robot_stamp_ns
        position = state.position_rad.copy()
        position[list(joints)] += rate_rad_s * (state.robot_stamp_ns - began_ns) / NS_PER_S
        return replace(state, position_rad=position)

    drive = rig.drive(lambda hal: hal.spoil(spoilt, 0.0), at_s=0.0 if when == "up" else AT_S, when=when, seconds=12.0)
    finding = judge(drive, ("position_refused", "signals_contradict"))
    finding.demand(tilt_rad(rig.truth()) < OVERTURNED_RAD, "the robot was overturned")
    return reacted(drive, finding, "damping") if when == "control" else finding


def _with_imu(state: RobotState, stamp_error_s: float) -> RobotState:
    late_ns = round(stamp_error_s * NS_PER_S)
    packets = [replace(packet, robot_stamp_ns=packet.robot_stamp_ns + late_ns) for packet in state.imu]
    return replace(state, imu=tuple(packets))


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
        "100 Hz, and a knee's position frozen",
        300.0,
        slower_and_spoilt("position_rad", "one frozen", "signal_frozen", "signals_contradict"),
    ),
    Row("100 Hz, and the attitude frozen", 300.0, slower_and_spoilt("odom_from_body_wxyz", "frozen", "signal_frozen")),
    Row("100 Hz, and velocities of zero", 300.0, slower_and_spoilt("velocity_rad_s", "zero", "signals_contradict")),
    Row("inertial unit falls silent", 0.0, unused(lambda state: replace(state, imu=()))),
    Row("packets of the inertial unit 199 s late", 0.0, unused(lambda state: _with_imu(state, -199.0))),
    Row("all contacts for ever", 0.0, unused(lambda state: replace(state, foot_contact=np.ones(4, dtype=np.bool_)))),
    Row("contacts inverted", 0.0, unused(lambda state: replace(state, foot_contact=~state.foot_contact))),
    Row("no loads any more", 0.0, unused(lambda state: replace(state, load_nm=np.zeros(12)))),
    Row("a hip mirrored", 0.0, joints_elsewhere([10], lambda state: -state.position_rad[[10]], "hr_hy mirrored")),
    Row("two joints exchanged", 0.0, joints_elsewhere([0, 1], lambda state: state.position_rad[[1, 0]], "exchanged")),
    Row("knees off by 0.3 rad", 0.0, joints_elsewhere(KNEES, lambda state: state.position_rad[KNEES] + 0.3, "fl_kn")),
    Row("knees off by −0.3 rad", 0.0, joints_elsewhere(KNEES, lambda state: state.position_rad[KNEES] - 0.3, "_kn")),
    Row("knees drift before the take-over", 0.0, drifting(KNEES, 0.19, "up")),
    Row("knees drift while it walks", 8000.0, drifting(KNEES, 0.1, "control")),
    Row("a hip drifts while it walks", 8000.0, drifting([10], 0.15, "control")),
    Row("battery's charge leaps", 3300.0, polled(lambda slow: replace(slow, battery_charge_percent=31.0))),
    Row("temperatures are missing", 3300.0, polled(lambda slow: replace(slow, motor_temperature_c={}))),
    Row("no charge in any poll", 3300.0, polled(lambda slow: replace(slow, battery_charge_percent=math.nan))),
    Row("no charge, voltage and temperatures for a second", 0.0, unknown_for_a_second),
)
