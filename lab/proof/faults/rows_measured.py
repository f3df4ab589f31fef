"""Rows of what a robot measures: no numbers, no rotation, frozen, tilted, collapsed, contradictory, a slow stream."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from typing import Any, Final

import numpy as np

from proof.faults.attempts import AT_ONCE_MS, SOFT, Act, Check, all_of, inject, is_told, row, spoil, spoil_slow
from proof.faults.rows import Finding, Row
from proof.faults.spoilt_signal import SpoiltSignal
from proof.faulty import FaultyHal
from proof.rig import Drive, Rig
from proof.robot import OVERTURNED_RAD
from spot_log import Run
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import JointCommand, RobotState, SlowState
from spot_runtime.control.safety.body_height import body_height_m
from spot_runtime.control.safety.signals.wiring import NAMES, readings
from spot_tools.sources import ScriptedSource

BRISK: Final = VelocitySequence(name="brisk", duration_s=600.0, waypoints=(Waypoint(time_s=0.0, v_x_m_s=0.8),))
KNEE: Final = 2
KNEES: Final = [2, 5, 8, 11]
MISPLACED: Final = ("position_refused", "signals_contradict")
"""How a run may end whose joints are reported elsewhere."""


# Broken values: damping, and only finite numbers are ever sent -------------------------------------------------------


def first_ns(holds: Callable[[Run], np.ndarray]) -> Callable[[Drive], int]:
    """Find the stamp of the first state after it happened in which something holds, ns."""

    def find(drive: Drive) -> int:
        stamps = drive.log.states.robot_stamp_ns
        shown = holds(drive.log) & (stamps >= drive.happened_ns)
        return int(stamps[np.argmax(shown)]) if shown.any() else drive.happened_ns

    return find


def is_tilted(log: Run) -> np.ndarray:
    """Return which states tilt by more than 45°, shape (n,)."""
    x, y = log.states.odom_from_body_wxyz[:, 1], log.states.odom_from_body_wxyz[:, 2]
    tilted: np.ndarray = 1.0 - 2.0 * (x * x + y * y) < np.cos(0.785398)
    return tilted


def is_low(log: Run) -> np.ndarray:
    """Return which states show a body below 0.25 m, shape (n,)."""
    pairs = zip(log.states.position_rad, log.states.odom_from_body_wxyz, strict=True)
    return np.array([body_height_m(position, wxyz) < 0.25 for position, wxyz in pairs])


PUSH_OVER: Final = inject("push", roll_rad_s=12.0, up_m_s=2.5)
PUSH_DOWN: Final = inject("push", up_m_s=-6.0)
NOISE_FOR_A_STATE: Final = inject("nan_sensor", 0.0031, signal="attitude")
"""The states after it are sound: the robot is damped all the same, and does not walk on."""

ROWS = (
    *(
        row(
            f"{name} is NaN",
            AT_ONCE_MS,
            inject("nan_sensor", signal=name.replace(" ", "_")),
            "state_not_finite",
            way="damping",
        )
        for name in ("position", "velocity", "load", "attitude", "body velocity")
    ),
    *(
        row(f"attitude is {name}", AT_ONCE_MS, inject("bad_quaternion", scale=scale), "state_attitude", way="damping")
        for name, scale in (("no rotation", 0.5), ("all zeros", 0.0))
    ),
    row("values frozen", 60.0, inject("frozen_sensors"), "state_frozen", way="damping"),
    row("tilt > 45°", AT_ONCE_MS, PUSH_OVER, "tilt", way="damping", since=first_ns(is_tilted), seconds=6.0),
    row("body low", AT_ONCE_MS, PUSH_DOWN, "body_low", way="damping", since=first_ns(is_low), seconds=6.0),
    *(
        row(f"states {name}", 80.0, inject("malformed_states", kind=kind), "state_lost", way=SOFT)
        for name, kind in (
            ("with 11 joints", "eleven_joints"),
            ("cut mid-message", "cut"),
            ("that are noise", "noise"),
            ("that are empty", "empty"),
        )
    ),
    row("NaN in one state", AT_ONCE_MS, NOISE_FOR_A_STATE, "state_not_finite", way="damping"),
)


# Signals that cannot be true -----------------------------------------------------------------------------------------


def each_third(_: Rig, hal: FaultyHal) -> None:
    """Let only each third state arrive."""
    numbers = count()
    hal.spoil(lambda state: state if next(numbers) % 3 == 0 else None)


def slow_and(signal: str, way: str) -> Act:
    """Make the act of a stream of 100 Hz with a signal spoilt in it."""
    return all_of(each_third, lambda _, hal: hal.spoil(SpoiltSignal(signal, way, KNEE, 0.0)))


def imu_late(late_s: float) -> Callable[[RobotState], RobotState]:
    """Return a change of the stamps of the inertial unit's packets."""

    def spoilt(state: RobotState) -> RobotState:
        packets = [replace(p, robot_stamp_ns=p.robot_stamp_ns + round(late_s * NS_PER_S)) for p in state.imu]
        return replace(state, imu=tuple(packets))

    return spoilt


def unused(fault: str, spoilt: Callable[[RobotState], RobotState]) -> Row:
    """Make a row of a wrong signal that nothing in control reads: it is told, and nothing stops."""
    source = ScriptedSource(BRISK, duration_s=5.0)
    return row(fault, 0.0, spoil(spoilt), "completed", missed=0, checks=(is_told("signal_doubted"),), source=source)


def is_upright(rig: Rig, _: Drive, finding: Finding) -> None:
    """Check that nobody has overturned the robot."""
    finding.demand(rig.tilt_rad() < OVERTURNED_RAD, "the robot was overturned")


def nothing(_: Rig, __: FaultyHal) -> None:
    """Do nothing: the fault is there from the beginning."""


def is_named(name: str) -> Check:
    """Make the check that the last words name an error."""
    return lambda _, drive, finding: finding.demand(name in drive.summary.sentence, drive.summary.sentence)


def is_refused(name: str) -> Check:
    """Make the check that the policy never got the joints, and that the run names them."""

    def check(_: Rig, drive: Drive, finding: Finding) -> None:
        finding.demand(name in drive.summary.sentence, f"{name} is not named: {drive.summary.sentence}")
        modes = "".join(event.text for event in drive.log.events)
        finding.demand("→ ramping_in" not in modes, "the policy got the joints")

    return check


def elsewhere(fault: str, joints: list[int], reported: Callable[[np.ndarray], np.ndarray], name: str) -> Row:
    """Make a row of joints that are reported elsewhere than their servos see them, from before the robot stands."""

    def spoilt(state: RobotState) -> RobotState:
        position = state.position_rad.copy()
        position[joints] = reported(state.position_rad[joints])
        return replace(state, position_rad=position)

    return row(fault, 0.0, spoil(spoilt), *MISPLACED, checks=(is_refused(name), is_upright), at_s=0.0, when="up")


class MiswiredHal(FaultyHal):
    """An adapter that errs alike in all that it reports and sends: see :data:`wiring.NAMES`."""

    error = ""

    def _read(self, joints: np.ndarray) -> Any:
        return readings(joints)[NAMES.index(self.error)]

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """Report every joint wrong."""
        read = self._read
        return [
            replace(
                state,
                position_rad=read(state.position_rad),
                velocity_rad_s=read(state.velocity_rad_s),
                load_nm=read(state.load_nm),
            )
            for state in super().receive(until_robot_ns, timeout_s)
        ]

    def begin_joint_control(self, first: JointCommand) -> None:
        """Send the first command wrong."""
        super().begin_joint_control(self._sent(first))

    def send(self, command: JointCommand) -> None:
        """Send a command wrong."""
        super().send(self._sent(command))

    def _sent(self, command: JointCommand) -> JointCommand:
        return replace(command, position_rad=self._read(command.position_rad), load_nm=self._read(command.load_nm))


def miswired(name: str) -> Row:
    """Make a row of such an adapter, which is found while the policy takes over; the robot is damped on its feet.

    A robot of its own makes every run alike: about one in a hundred tips over before enough has been felt.
    """
    kind = type("Miswired", (MiswiredHal,), {"error": name})
    options: dict[str, Any] = {"make_faulty": kind, "handover": {"ramp_in_s": 2.0}, "seconds": 4.0, "is_alone": True}
    checks = (is_upright, is_named(name))
    return row(
        f"in all signals: {name}", 2500.0, nothing, "signals_contradict", way="damping", checks=checks, **options
    )


def drift(joints: list[int], rate_rad_s: float) -> Act:
    """Make the act of encoders that drift, too slowly for the joints' velocities to tell."""

    def act(_: Rig, hal: FaultyHal) -> None:
        began_ns = hal.robot_now_ns()

        def spoilt(state: RobotState) -> RobotState:
            position = state.position_rad.copy()
            position[joints] += rate_rad_s * max(0, state.robot_stamp_ns - began_ns) / NS_PER_S
            return replace(state, position_rad=position)

        hal.spoil(spoilt)

    return act


def polled(fault: str, spoilt: Callable[[SlowState], SlowState]) -> Row:
    """Make a row in which what is polled cannot follow from what was polled before."""
    return row(fault, 3300.0, spoil_slow(spoilt), "battery_unknown", way="soft_stop", seconds=6.0)


def without_battery(slow: SlowState) -> SlowState:
    """Return a poll without a battery; some of them are passed over."""
    return replace(slow, battery_charge_percent=math.nan, battery_voltage_v=math.nan, motor_temperature_c={})


FROZEN_KNEE: Final = slow_and("position_rad", "one frozen")
FROZEN_ATTITUDE: Final = slow_and("odom_from_body_wxyz", "frozen")
NO_VELOCITY: Final = slow_and("velocity_rad_s", "zero")
A_SECOND_WITHOUT: Final = spoil_slow(without_battery, 1.0)

SIGNAL_ROWS = (
    row("states at 100 Hz", 0.0, each_third, "completed", missed=0),
    row(
        "100 Hz, and a knee's position frozen",
        300.0,
        FROZEN_KNEE,
        "signal_frozen",
        "signals_contradict",
        way="damping",
    ),
    row("100 Hz, and the attitude frozen", 300.0, FROZEN_ATTITUDE, "signal_frozen", way="damping"),
    row("100 Hz, and velocities of zero", 300.0, NO_VELOCITY, "signals_contradict", way="damping"),
    unused("inertial unit falls silent", lambda state: replace(state, imu=())),
    unused("packets of the inertial unit 199 s late", imu_late(-199.0)),
    unused("all contacts for ever", lambda state: replace(state, foot_contact=np.ones(4, dtype=np.bool_))),
    unused("contacts inverted", lambda state: replace(state, foot_contact=~state.foot_contact)),
    unused("no loads any more", lambda state: replace(state, load_nm=np.zeros(12))),
    elsewhere("a hip mirrored", [10], lambda position: -position, "hr_hy mirrored"),
    elsewhere("two joints exchanged", [0, 1], lambda position: position[::-1], "exchanged"),
    elsewhere("knees off by 0.3 rad", KNEES, lambda position: position + 0.3, "fl_kn"),
    elsewhere("knees off by −0.3 rad", KNEES, lambda position: position - 0.3, "_kn"),
    row(
        "knees drift before the take-over",
        0.0,
        drift(KNEES, 0.19),
        *MISPLACED,
        checks=(is_upright,),
        at_s=0.0,
        when="up",
        seconds=12.0,
    ),
    *(
        row(name, 8000.0, drift(joints, rate_rad_s), *MISPLACED, way="damping", checks=(is_upright,), seconds=12.0)
        for name, joints, rate_rad_s in (
            ("knees drift while it walks", KNEES, 0.1),
            ("a hip drifts while it walks", [10], 0.15),
            ("two hips drift sideways while it walks", [0, 6], -0.19),
        )
    ),
    *(
        miswired(name)
        for name in (
            "fl_hx, fr_hx, hl_hx, hr_hx mirrored",
            "fl_hy and fr_hy exchanged",
            "hl_kn and hr_kn exchanged",
            "left and right legs exchanged",
        )
    ),
    polled("battery's charge leaps", lambda slow: replace(slow, battery_charge_percent=31.0)),
    polled("temperatures are missing", lambda slow: replace(slow, motor_temperature_c={})),
    polled("no charge in any poll", lambda slow: replace(slow, battery_charge_percent=math.nan)),
    row("no charge, voltage and temperatures for a second", 0.0, A_SECOND_WITHOUT, "completed", missed=0, seconds=3.0),
)
