"""The robot in robot time: physics, modes, sensors, channels and faults, one thread, no waiting."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fake_robot.body.arm import Arm
from fake_robot.body.body import Body
from fake_robot.body.clock import RobotClock
from fake_robot.body.energy import Energy
from fake_robot.body.sensing import Frame, Report, Sensing
from fake_robot.body.truth import Extremes
from fake_robot.faults.active_faults import ActiveFaults, active_system_faults
from fake_robot.faults.fault import Fault
from fake_robot.network.status import MotorPower, SystemFault
from fake_robot.network.streams import DelayLine
from fake_robot.robot.joint_control import JointControl, Stream
from fake_robot.robot.modes import Modes
from fake_robot.robot.motion.motion_sequence import MotionSequence
from fake_robot.robot.motion.steering import GroundPose
from fake_robot.robot.motion.vendor_motion import stand_feet_m
from fake_robot.robot.motion.walker import Walker
from fake_robot.robot.state_message import StateMessageBuilder
from fake_robot.robot.streamed_command import StreamedCommand
from fake_robot.scenario.scenario import Scenario
from spot_model.effects.base import CommandEffect, SoftwareEffect
from spot_model.plant.command_channel import ServoCommand
from spot_model.robot.arm import N_ARM_JOINTS
from spot_model.robot.facts import N_JOINTS, NS_PER_S, STATE_PERIOD_NS
from spot_model.robot.leg_kinematics import foot_position_in_body_m

_STAND_FEET_M = stand_feet_m(0.5)[:, :2]
"""Where the feet of a stand are, seen from above: shape (4, 2), their mean is 0."""


class Simulation:
    """Everything that moves with robot time. Not thread-safe: :class:`fake_robot.robot.robot.Robot` guards it.

    The clock is told how far robot time has been simulated; ``deliver`` is called with every state message (acquisition
    stamp, bytes) when it reaches the client.
    """

    def __init__(self, scenario: Scenario, clock: RobotClock, deliver: Callable[[int, bytes], None]) -> None:
        seeds = np.random.SeedSequence(scenario.seed).spawn(7)
        rngs = [np.random.default_rng(seed) for seed in seeds]
        self.scenario = scenario
        self.now_ns = 0
        self.body = Body(scenario, rngs[0])
        self.sensing = Sensing(scenario, self.body, rngs[1])
        self._arm = Arm(np.array(scenario.arm.position_rad), scenario.sensors, rngs[6]) if scenario.has_arm else None
        self.n_joints = N_JOINTS + (N_ARM_JOINTS if scenario.has_arm else 0)
        self.joint_control = JointControl(scenario.joint_control, clock.stamp_ns)
        self.walker = Walker(
            None if scenario.motion.walking_policy is None else Path(scenario.motion.walking_policy),
            lambda: self.report,
            self._pose_over_feet,
            clock.stamp_ns,
            scenario.motion.stand_height_m,
        )
        motion = MotionSequence(scenario, self.body, self.joint_control, self.walker, self._pose_on_ground)
        self.modes = Modes(scenario, self.body, self.joint_control, motion)
        self.energy = Energy(scenario.battery, scenario.motors)
        self.faults = ActiveFaults()
        self.extremes = Extremes()
        self.odom = Frame(scenario.frames.odom_position_m, scenario.frames.odom_yaw_rad)
        self.vision = Frame(scenario.frames.vision_position_m, scenario.frames.vision_yaw_rad)
        self.distance_m = 0.0
        self.time_moving_s = 0.0
        self.time_powered_s = 0.0
        self.has_diverged = False
        self._states: DelayLine[tuple[int, bytes]] = DelayLine(scenario.state_channel, rngs[2])
        self._commands: DelayLine[tuple[Stream, StreamedCommand]] = DelayLine(scenario.command_channel, rngs[3])
        self._fault_rng, self._effect_rng = rngs[4], rngs[5]
        self._clock = clock
        self._deliver = deliver
        self._messages = StateMessageBuilder(scenario, self.odom, self.vision)
        self._n_substeps = scenario.physics.substeps_per_state
        self._step_ns = STATE_PERIOD_NS // self._n_substeps
        self._substep = 0
        self._clock_offset_ns = 0
        effects = [effect for effect in scenario.robot_model.effects if not effect.is_null]
        like = np.zeros((1, 12))
        self._software = [e.arrays_like(like) for e in effects if isinstance(e, SoftwareEffect)]
        self._command_effects = [e.arrays_like(like) for e in effects if isinstance(e, CommandEffect)]
        self.report = self._report()

    # Commands ---------------------------------------------------------------------------------------------------------

    def send_command(self, stream: Stream, command: StreamedCommand, sent_ns: int) -> None:
        """A command leaves the client now; it arrives after the channel's delay, or never."""
        for software in self._software:
            servo = command.servo
            position = software.setpoint_rad(servo.position_rad)
            servo = ServoCommand(
                position, servo.velocity_rad_s, servo.load_nm, servo.kp_nm_per_rad, servo.kd_nm_s_per_rad
            )
            command = StreamedCommand(**{**vars(command), "servo": servo})
        delay_s = np.zeros(1)
        for effect in self._command_effects:
            delay_s = np.asarray(effect.arrival_s(delay_s, self._effect_rng)).reshape(1)
        if np.isfinite(delay_s[0]):
            self._commands.send((stream, command), sent_ns + round(float(delay_s[0]) * NS_PER_S))

    # Faults -----------------------------------------------------------------------------------------------------------

    def inject(self, fault: Fault, duration_s: float | None) -> int:
        """A fault begins now."""
        until_ns = None if duration_s is None else self.now_ns + round(duration_s * NS_PER_S)
        fault_id = self.faults.add(fault, self._clock.stamp_ns(self.now_ns), until_ns)
        self._apply_faults()
        fault.start(self)
        return fault_id

    def clear_faults(self, fault_ids: tuple[int, ...]) -> list[int]:
        """End faults by number; all, if empty."""
        cleared = self.faults.clear(fault_ids or None)
        self._apply_faults()
        return cleared

    def system_faults(self) -> tuple[SystemFault, ...]:
        """System faults that are active now."""
        return active_system_faults(self.scenario, self.energy, self.faults.effects, self.has_diverged)

    # Time passes ------------------------------------------------------------------------------------------------------

    def advance_to(self, until_ns: int) -> None:
        """Simulate whole physics steps up to, but not beyond, an instant of robot time since the start."""
        while self.now_ns + self._step_ns <= until_ns:
            self.step()

    def deliver_states(self, until_ns: int) -> None:
        """Hand over the state messages that arrive by then."""
        for _, _, (stamp_ns, message) in self._states.receive(until_ns):
            self._deliver(stamp_ns, message)

    @property
    def next_arrival_ns(self) -> int | None:
        """When the next state message reaches the client."""
        return self._states.next_arrival_ns

    @property
    def next_state_ns(self) -> int:
        """When the next state is sampled."""
        return self.now_ns + (self._n_substeps - self._substep) * self._step_ns

    def step(self) -> None:
        """One physics step; after the last one of a period, one state message."""
        now_ns = self.now_ns
        if self._commands.next_arrival_ns is not None:
            for arrival_ns, _, (stream, command) in self._commands.receive(now_ns):
                self.joint_control.receive(stream, command, arrival_ns, self.body.joint_position_rad)
        servo = self.modes.servo(now_ns)
        self.body.step(servo)
        if self._arm is not None:
            self._arm.step(servo, self.joint_control.arm_servo(), self._step_ns * 1e-9)
        self.sensing.sample(self._substep)
        self._substep += 1
        self.now_ns = now_ns = now_ns + self._step_ns
        if self._substep == self._n_substeps:
            self._substep = 0
            self._end_period()
        self._clock.set_simulated_ns(now_ns)
        if self._states.next_arrival_ns is not None:
            self.deliver_states(now_ns)

    # Private ----------------------------------------------------------------------------------------------------------

    def _end_period(self) -> None:
        now_ns, body = self.now_ns, self.body
        if self.faults.active and self.faults.end_due(now_ns):
            self._apply_faults()
        if body.has_diverged():
            self._recover()
        self.modes.tick(now_ns)
        if self.energy.shown_percent(self.faults.effects) <= self.scenario.battery.critical_percent:
            self.modes.give_up("the battery is critically low")
        is_powered = self.modes.motor_power is MotorPower.ON
        period_s = STATE_PERIOD_NS * 1e-9
        self.energy.step(body.motor_torque_nm, body.joint_velocity_rad_s, period_s, is_powered=is_powered)
        self._count(period_s, is_powered=is_powered)
        self.extremes.note(body)
        self.report = self._report()
        self._send_state(now_ns)

    def _report(self) -> Report:
        report = self.sensing.report(self.now_ns, self.faults.effects)
        return report if self._arm is None else report._replace(arm=self._arm.report())

    def _send_state(self, now_ns: int) -> None:
        fault_effects, stamp_ns = self.faults.effects, self._clock.stamp_ns(now_ns)
        if fault_effects.has_state_gap:
            return
        if fault_effects.back_date_probability > 0.0 and self._fault_rng.random() < fault_effects.back_date_probability:
            stamp_ns -= round(fault_effects.back_date_s * NS_PER_S)
        control = self.joint_control
        last_stamp_ns = self._clock.stamp_ns(control.last_received_ns)
        message = self._messages.build(self.report, stamp_ns, control.last_key, last_stamp_ns)
        self._states.send((stamp_ns, message), now_ns)
        if fault_effects.duplicate_probability > 0.0 and self._fault_rng.random() < fault_effects.duplicate_probability:
            self._states.send((stamp_ns, message), now_ns)

    def _count(self, period_s: float, *, is_powered: bool) -> None:
        if not is_powered:
            return
        vx, vy = self.body.base_velocity[:2].tolist()
        speed_m_s = (vx * vx + vy * vy) ** 0.5
        self.distance_m += speed_m_s * period_s
        self.time_powered_s += period_s
        if speed_m_s > 0.05:
            self.time_moving_s += period_s

    def _pose_on_ground(self) -> GroundPose:
        """Where the body is in odom, as reported."""
        x_m, y_m, _ = self.odom.point(self.report.position_of_body_in_world_m.tolist())
        w, x, y, z = self.odom.rotation(self.report.world_from_body_wxyz.tolist())
        return GroundPose(x_m, y_m, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z)))

    def _pose_over_feet(self) -> GroundPose:
        """Where the body would be in odom if it stood over its feet now, and which way it would look."""
        pose = self._pose_on_ground()
        feet = foot_position_in_body_m(self.report.position_rad)[:, :2]
        ahead_m, left_m = feet.mean(axis=0).tolist()
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        # The turn that lays the feet of a stand over these best, in the sense of least squares.
        x, y = (feet - feet.mean(axis=0)).T
        turn_rad = math.atan2(_STAND_FEET_M[:, 0] @ y - _STAND_FEET_M[:, 1] @ x, (_STAND_FEET_M * feet).sum())
        return GroundPose(
            pose.x_m + cos * ahead_m - sin * left_m, pose.y_m + sin * ahead_m + cos * left_m, pose.yaw_rad + turn_rad
        )

    def _apply_faults(self) -> None:
        fault_effects = self.faults.effects
        self._states.fault, self._commands.fault = fault_effects.states, fault_effects.commands
        self.body.torque_gain = fault_effects.motor_gain if (fault_effects.motor_gain != 1.0).any() else None
        offset_ns = round(fault_effects.clock_offset_s * NS_PER_S)
        if offset_ns != self._clock_offset_ns:
            self._clock.jump(offset_ns - self._clock_offset_ns)
            self._clock_offset_ns = offset_ns

    def _recover(self) -> None:
        """The numbers broke: put the body back where it lay, without power, and say so in a system fault."""
        self.has_diverged = True
        self.body.recover()
        self.modes.power_off("the simulation diverged")
        self.modes.add_behavior_fault("hardware", "the simulation diverged")
