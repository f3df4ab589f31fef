"""What the robot may do: power, e-stop and behaviour faults, and how they begin and end its motions."""

from __future__ import annotations

from fake_robot.body.body import Body
from fake_robot.network.status import BehaviorFault, EstopLevel, Mode, MotorPower, StanceProgress, StreamFailure
from fake_robot.robot.joint_control import JointControl
from fake_robot.robot.motion.motion_sequence import MotionSequence
from fake_robot.robot.streamed_command import INACTIVE
from fake_robot.scenario.scenario import Scenario
from spot_model.errors import SpotRlError
from spot_model.plant.command_channel import ServoCommand
from spot_model.robot.facts import NS_PER_S

_DOWN = (Mode.LIMP, Mode.SITTING, Mode.RIGHTING, Mode.DAMPING)
"""Modes in which a behaviour fault does not let the robot sink to the ground."""


class MotionRefusedError(SpotRlError):
    """The robot cannot do this now; the message says why."""


class Modes:
    """The mode machine of one robot. Times are nanoseconds of robot time since the start."""

    def __init__(self, scenario: Scenario, body: Body, joint_control: JointControl, motion: MotionSequence) -> None:
        self._power, self._fall_tilt_rad = scenario.power, scenario.motion.fall_tilt_rad
        self._is_stopped_by_fall = scenario.joint_control.is_stopped_by_fall
        self._body, self._joint_control, self._motion = body, joint_control, motion
        self.motor_power = MotorPower.OFF
        self.estop_level = EstopLevel.NONE
        self.behavior_faults: list[BehaviorFault] = []
        self._next_fault_id = 1
        self._power_until_ns = 0
        self._is_cut_when_down = False
        """Whether the motors lose their power once the robot sits; a newer command withdraws it."""

    @property
    def mode(self) -> Mode:
        """What the robot is doing."""
        return self._motion.mode

    @property
    def stance_progress(self) -> StanceProgress:
        """How far the feet have come to their places."""
        return self._motion.stance_progress

    # Asked for by services --------------------------------------------------------------------------------------------

    def power_on(self) -> None:
        """Start to power the motors."""
        if self.motor_power in (MotorPower.ON, MotorPower.POWERING_ON):
            return
        if self.estop_level is not EstopLevel.NONE:
            raise MotionRefusedError(f"the e-stop level is {self.estop_level.value}; release it before power on")
        self.motor_power = MotorPower.POWERING_ON
        self._power_until_ns = self._after(self._power.power_on_s)

    def power_off(self, reason: str = "the motors were powered off") -> None:
        """Cut the motors' power now."""
        if self.motor_power is MotorPower.OFF:
            return
        self._motion.end_joint_control(StreamFailure(INACTIVE, reason))
        self._motion.go_limp()
        self._is_cut_when_down = False
        self.motor_power = MotorPower.POWERING_OFF
        self._power_until_ns = self._after(self._power.power_off_s)

    def safe_power_off(self) -> None:
        """Sit down, then cut power."""
        if self.motor_power is not MotorPower.ON or self.mode is Mode.SITTING:
            self.power_off()
        else:
            self._motion.sit()
            self._is_cut_when_down = True

    def give_up(self, reason: str) -> None:
        """Sit down and cut power by itself, unless it is doing so or has no power."""
        if self.motor_power is not MotorPower.ON or self._is_cut_when_down:
            return
        self._motion.end_joint_control(StreamFailure(INACTIVE, reason))
        if self.mode in (Mode.DAMPING, Mode.RIGHTING):
            self._is_cut_when_down = True
        else:
            self.safe_power_off()

    def begin(self, verb: str, *, on_feet: bool = False) -> MotionSequence:
        """The motions, one of which may begin now. With behaviour faults it may move, but not get on its feet.

        Raises:
            MotionRefusedError: The robot cannot move now.
        """
        if self.motor_power is not MotorPower.ON:
            raise MotionRefusedError(f"{verb}: the motors are {self.motor_power.value}; power them on first")
        if on_feet and self.behavior_faults:
            causes = ", ".join(f"{f.cause} ({f.fault_id})" for f in self.behavior_faults)
            raise MotionRefusedError(f"{verb}: behaviour faults are active: {causes}; clear them first")
        if self.estop_level is not EstopLevel.NONE:
            raise MotionRefusedError(f"{verb}: the e-stop level is {self.estop_level.value}; release it first")
        self._is_cut_when_down = False
        return self._motion

    def stop(self) -> None:
        """From a walk, joint control or freezing back to the stand; else, or with behaviour faults, nothing."""
        if self.mode in (Mode.WALKING, Mode.JOINT_CONTROL, Mode.FROZEN) and not self.behavior_faults:
            self.begin("stand", on_feet=True).stand()

    def set_estop_level(self, level: EstopLevel) -> None:
        """Follow the e-stop: cut power, or settle on the ground first."""
        previous, self.estop_level = self.estop_level, level
        if level is EstopLevel.NONE or level is previous or self.motor_power is MotorPower.OFF:
            return
        reason = f"the e-stop was pressed ({level.value})"
        if level is EstopLevel.CUT or self.motor_power is not MotorPower.ON:
            self.power_off(reason)
            return
        self._motion.end_joint_control(StreamFailure(INACTIVE, reason))
        if self.mode in (Mode.DAMPING, Mode.RIGHTING, Mode.LIMP) or self._body.tilt_rad() > self._fall_tilt_rad:
            self._motion.damp()
        else:
            self._motion.sit_at_once()
        self._is_cut_when_down = True

    def add_behavior_fault(self, cause: str, message: str = "") -> BehaviorFault:
        """Something went wrong while moving: end joint control, sink to the ground."""
        stamp_ns = self._joint_control.stamp_ns(self._motion.now_ns)
        fault = BehaviorFault(self._next_fault_id, stamp_ns, cause)
        self._next_fault_id += 1
        self.behavior_faults.append(fault)
        if self.motor_power is MotorPower.ON and self.mode not in _DOWN:
            self._motion.end_joint_control(StreamFailure(INACTIVE, f"behaviour fault {cause}: {message}".rstrip(": ")))
            self._motion.damp()
        return fault

    def clear_behavior_fault(self, fault_id: int) -> bool:
        """Clear a fault; False if there is none with this number, or it cannot be cleared."""
        kept = [f for f in self.behavior_faults if f.fault_id != fault_id or not f.is_clearable]
        is_cleared = len(kept) < len(self.behavior_faults)
        self.behavior_faults = kept
        return is_cleared

    # Time passes ------------------------------------------------------------------------------------------------------

    def servo(self, now_ns: int) -> ServoCommand | None:
        """What the servos follow in the physics step that starts now; None without power."""
        self._motion.now_ns = now_ns
        return self._motion.servo() if self.motor_power is MotorPower.ON else None

    def tick(self, now_ns: int) -> None:
        """Once a state message: what is due by itself, and what went wrong."""
        self._motion.now_ns = now_ns
        if not self._joint_control.is_active and self._joint_control.streams:
            self._joint_control.end_idle_streams(now_ns, self.mode.value.replace("_", " "))
        if self.motor_power is MotorPower.OFF:
            return
        if self.motor_power is not MotorPower.ON:
            self._tick_power()
            return
        self._motion.tick()
        if self._is_cut_when_down and self.mode is Mode.SITTING:
            self.power_off()
        else:
            self._watch()

    # Private ----------------------------------------------------------------------------------------------------------

    def _tick_power(self) -> None:
        if self._motion.now_ns < self._power_until_ns:
            return
        if self.motor_power is MotorPower.POWERING_OFF:
            self.motor_power = MotorPower.OFF
            return
        self.motor_power = MotorPower.ON
        self._motion.hold()

    def _watch(self) -> None:
        """Falls, and joints beyond the velocity safety limit."""
        if self.mode is Mode.JOINT_CONTROL:
            excess = self._joint_control.excess_velocity(self._body.joint_velocity_rad_s)
            if excess is not None:
                self.add_behavior_fault("command_failure", excess)
                return
        why = self._motion.why_fallen()
        if why is not None and (self.mode is not Mode.JOINT_CONTROL or self._is_stopped_by_fall):
            self.add_behavior_fault("fall", why)

    def _after(self, seconds: float) -> int:
        return self._motion.now_ns + round(seconds * NS_PER_S)
