"""What the joints follow, and what comes after it: stand, steps, walk, sit, joint control, damping, righting."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from fake_robot.body.body import SIT_POSITION_RAD, Body
from fake_robot.body.drive import damping_servo, stand_servo, torque_servo
from fake_robot.network.requests import StandPose, WalkPlan
from fake_robot.network.status import Mode, StanceProgress, StreamFailure
from fake_robot.robot.joint_control import Expiry, JointControl
from fake_robot.robot.motion.stance import AIM_SHARE, MAX_ROUNDS, REACH_M, stance_path
from fake_robot.robot.motion.steering import GroundPose
from fake_robot.robot.motion.vendor_motion import Path, hold_path, sit_path, stand_path
from fake_robot.robot.motion.walker import Walker
from fake_robot.robot.streamed_command import EXPIRED
from fake_robot.scenario.scenario import Scenario
from spot_model.plant.command_channel import ServoCommand
from spot_model.robot.arm import ARM_MASS_KG
from spot_model.robot.facts import NS_PER_S, TOTAL_MASS_KG, Array
from spot_model.robot.leg_kinematics import foot_position_in_body_m

_LYING_BODY_M = 0.2
_LYING_S = 0.25
_TILT_COUNTS = (Mode.STANDING_UP, Mode.STANDING, Mode.STEPPING, Mode.FROZEN, Mode.WALKING, Mode.JOINT_CONTROL)
_LYING_COUNTS = (Mode.STANDING, Mode.STEPPING, Mode.WALKING, Mode.JOINT_CONTROL)


class FallWatch:
    """Looks at the body once a state message. Times are nanoseconds of robot time since the start."""

    def __init__(self, body: Body, fall_tilt_rad: float) -> None:
        self._body, self._fall_tilt_rad = body, fall_tilt_rad
        self._lying_since_ns: int | None = None

    def reset(self) -> None:
        """Another mode begins."""
        self._lying_since_ns = None

    def why_fallen(self, mode: Mode, now_ns: int) -> str | None:
        """What makes this a fall; None while the robot is up, or need not be."""
        if mode not in _TILT_COUNTS:
            self.reset()
            return None
        tilt_rad = self._body.tilt_rad()
        if tilt_rad > self._fall_tilt_rad:
            return f"the body is tilted by {math.degrees(tilt_rad):.0f} degrees"
        if mode in _LYING_COUNTS and self._has_lain(now_ns):
            return "the body lies on the ground"
        return None

    def _has_lain(self, now_ns: int) -> bool:
        if not (self._body.height_m() < _LYING_BODY_M and self._body.is_lying()):
            self._lying_since_ns = None
            return False
        if self._lying_since_ns is None:
            self._lying_since_ns = now_ns
        return (now_ns - self._lying_since_ns) * 1e-9 > _LYING_S


_LOW_BODY_M = 0.32
"""Below it a stand first puts the feet in place."""
_SETTLED_S = 0.2
_RIGHTING_S = 3.0
_RIGHTING_NM_PER_RAD, _RIGHTING_NM_S_PER_RAD = 70.0, 15.0


class MotionSequence:
    """One motion after another, each of them a mode. Times are nanoseconds of robot time since the start.

    It takes for granted that the motors have power; :class:`fake_robot.robot.modes.Modes` decides what may begin.
    """

    def __init__(
        self,
        scenario: Scenario,
        body: Body,
        joint_control: JointControl,
        walker: Walker,
        body_on_ground: Callable[[], GroundPose],
    ) -> None:
        self._motion, self._policy = scenario.motion, scenario.joint_control
        self._body = body
        self._joint_control, self._walker = joint_control, walker
        self._body_on_ground = body_on_ground
        self._falls = FallWatch(body, scenario.motion.fall_tilt_rad)
        self._mass_kg = TOTAL_MASS_KG + scenario.payload.mass_kg + (ARM_MASS_KG if scenario.has_arm else 0.0)
        self.mode = Mode.LIMP
        self.stance_progress = StanceProgress.MOVING
        self.now_ns = 0
        """Set by the owner, before whatever it asks for."""
        self._next: Callable[[], None] | None = None
        self._until_ns = 0
        self._servo: ServoCommand = damping_servo(0.0)
        self._path: Path = hold_path(SIT_POSITION_RAD)
        self._path_start_ns = 0
        self._is_path_done = True
        self._is_up = False
        """Whether a stand began with the body up, so that a walk need not wait for its end."""

    # Begin ------------------------------------------------------------------------------------------------------------

    def stand(self, course: Sequence[StandPose] = ()) -> None:
        """Start to stand, or to change the pose of a stand, and then to follow a course of poses."""
        if self._is_stopped_first(lambda: self.stand(course)):
            return
        self.end_joint_control(None)
        is_low = not self._body.height_m() > _LOW_BODY_M
        duration_s = self._motion.stand_s if is_low else 0.5 * self._motion.stand_s
        path = stand_path(
            self._body.joint_position_rad.copy(),
            is_low=is_low,
            duration_s=duration_s,
            body_height_m=self._motion.stand_height_m,
            mass_kg=self._mass_kg,
            course=course or (StandPose(),),
        )
        self._follow(Mode.STANDING_UP, path)
        self._is_up = not is_low

    def walk(self, plan: WalkPlan) -> None:
        """Start to walk, from a stand if need be, or go on walking with another plan."""
        self.end_joint_control(None)
        if self.mode is Mode.WALKING:
            self._next = None
            self._walker.follow(plan, self.now_ns)
        elif self.mode is Mode.STANDING or (self.mode is Mode.STANDING_UP and self._is_up):
            self._begin_walk(plan)
        else:
            if self.mode is not Mode.STANDING_UP:
                self.stand()
            self._next = lambda: self._begin_walk(plan)

    def place_feet(self, feet_in_odom_m: Array, accuracy_m: float) -> None:
        """Step until the feet stand at these places, shape (4, 2), from a stand if need be; not if they are too far."""
        if self.mode is Mode.STEPPING:
            return
        if self.mode is Mode.STANDING:
            self._begin_steps(feet_in_odom_m, accuracy_m, feet_in_odom_m)
        else:
            self.stand()
            self._next = lambda: self._begin_steps(feet_in_odom_m, accuracy_m, feet_in_odom_m)

    def sit(self) -> None:
        """Start to sit down; a walk comes to a stop first."""
        if self._is_stopped_first(self.sit):
            return
        self.end_joint_control(None)
        self.sit_at_once()

    def sit_at_once(self) -> None:
        """Start to sit down from wherever the joints are, also out of a walk."""
        start = self._body.joint_position_rad.copy()
        self._follow(Mode.SITTING_DOWN, sit_path(start, duration_s=self._motion.sit_s, mass_kg=self._mass_kg))

    def freeze(self) -> None:
        """Hold the joints where they are."""
        self.end_joint_control(None)
        self._follow(Mode.FROZEN, hold_path(self._body.joint_position_rad.copy()))

    def right(self) -> None:
        """Turn the body over, legs folded; the turning itself is a torque from outside."""
        self.end_joint_control(None)
        rows = np.stack([self._body.joint_position_rad.copy(), SIT_POSITION_RAD])
        self._follow(Mode.RIGHTING, Path(rows, np.zeros_like(rows), 1.0))
        self._until_ns = self._after(_RIGHTING_S)

    def enter_joint_control(self) -> None:
        """From now on, the newest command of the streams takes effect; until it comes, hold the pose."""
        if self.mode is Mode.JOINT_CONTROL:
            return
        position, load = self._path.at(self._path_time_s())
        keeps = self.mode in (Mode.SITTING, Mode.STANDING, Mode.STANDING_UP, Mode.FROZEN)
        path = Path(np.stack([position] * 2), np.stack([load] * 2), 1.0)
        self._follow(Mode.JOINT_CONTROL, path if keeps else hold_path(self._body.joint_position_rad.copy()))
        self._joint_control.enter(self.now_ns)

    def end_joint_control(self, failure: StreamFailure | None) -> None:
        """Let streams move the joints no longer; with a failure, end the streams."""
        if self._joint_control.is_active:
            self._joint_control.leave(self.now_ns, failure)
        elif failure is not None:
            self._joint_control.fail_streams(failure)

    def damp(self) -> None:
        """Only damp the joints: the robot sinks to the ground."""
        self._enter(Mode.DAMPING)
        self._servo, self._is_path_done = damping_servo(self._motion.damping_nm_s_per_rad), True
        self._until_ns = self._after(self._motion.damping_s)

    def hold(self) -> None:
        """Hold the joints where they are, on the ground."""
        self._follow(Mode.SITTING, hold_path(self._body.joint_position_rad.copy()))

    def go_limp(self) -> None:
        """Nothing moves the joints any more."""
        self._enter(Mode.LIMP)

    # Time passes ------------------------------------------------------------------------------------------------------

    def servo(self) -> ServoCommand:
        """What the servos follow in the physics step that starts now."""
        if self.mode is Mode.JOINT_CONTROL:
            command = self._joint_control.servo(self.now_ns)
            if isinstance(command, Expiry):
                self._expire(command)
            elif command is not None:
                return command
        elif self.mode is Mode.WALKING:
            return self._walker.servo(self.now_ns)
        if not self._is_path_done:
            time_s = self._path_time_s()
            self._servo = stand_servo(*self._path.at(time_s))
            self._is_path_done = time_s >= self._path.duration_s
        return self._servo

    def tick(self) -> None:
        """Begin what is due by itself; called once a state message."""
        is_settled = self._path_time_s() > self._path.duration_s + _SETTLED_S
        if (self.mode is Mode.STANDING_UP and is_settled) or (self.mode is Mode.STEPPING and is_settled):
            self._stand_is_reached()
        elif self.mode is Mode.WALKING and self._walker.is_at_rest(self.now_ns):
            self._end_walk()
        elif self.mode is Mode.SITTING_DOWN and is_settled:
            self._enter(Mode.SITTING)
        elif self.mode is Mode.DAMPING and self.now_ns >= self._until_ns:
            self.hold()
        elif self.mode is Mode.FROZEN and self._until_ns and self.now_ns >= self._until_ns:
            self.damp()
        elif self.mode is Mode.RIGHTING:
            self._turn_over()
        elif self.mode is Mode.JOINT_CONTROL and self._joint_control.has_waited_too_long(self.now_ns):
            self.stand()

    def why_fallen(self) -> str | None:
        """What makes this a fall; None while the robot is up, or need not be."""
        return self._falls.why_fallen(self.mode, self.now_ns)

    # Private ----------------------------------------------------------------------------------------------------------

    def _stand_is_reached(self) -> None:
        do_next = self._next
        self._enter(Mode.STANDING)
        if do_next is not None:
            do_next()

    def _begin_walk(self, plan: WalkPlan) -> None:
        position, load = self._path.at(self._path_time_s())
        self._walker.start(plan, self.now_ns, position, load)
        self._enter(Mode.WALKING)

    def _begin_steps(
        self, feet_in_odom_m: Array, accuracy_m: float, aim_in_odom_m: Array, rounds: int = MAX_ROUNDS
    ) -> None:
        """Step to ``aim_in_odom_m``, which moves by what each round has missed: feet slip as they land."""
        pose = self._body_on_ground()
        cos, sin = math.cos(pose.yaw_rad), math.sin(pose.yaw_rad)
        body_from_odom = np.array([[cos, -sin], [sin, cos]])
        place_m = np.array([pose.x_m, pose.y_m])
        position_rad = self._body.joint_position_rad.copy()
        feet_in_body_m = foot_position_in_body_m(position_rad)[:, :2]
        missed_m = feet_in_odom_m - place_m - feet_in_body_m @ body_from_odom.T
        distance_m = float(np.linalg.norm(missed_m, axis=1).max())
        if distance_m <= accuracy_m:
            self.stance_progress = StanceProgress.REACHED
        elif distance_m > REACH_M or rounds == 0:
            self.stance_progress = StanceProgress.TOO_FAR
        else:
            self.stance_progress = StanceProgress.MOVING
            aim_m = aim_in_odom_m + AIM_SHARE * missed_m if rounds < MAX_ROUNDS else aim_in_odom_m
            goal_m = (aim_m - place_m) @ body_from_odom
            self._follow(Mode.STEPPING, stance_path(position_rad, goal_m, mass_kg=self._mass_kg))
            self._next = lambda: self._begin_steps(feet_in_odom_m, accuracy_m, aim_m, rounds - 1)

    def _is_stopped_first(self, do_next: Callable[[], None]) -> bool:
        """Whether the robot walks, so that it has to come to a stop before it does something else."""
        if self.mode is not Mode.WALKING:
            return False
        self._walker.stop(self.now_ns)
        self._next = do_next
        return True

    def _end_walk(self) -> None:
        do_next = self._next
        self._enter(Mode.STANDING)
        if do_next is None:
            self.stand()
        else:
            do_next()

    def _turn_over(self) -> None:
        # About z × up, in proportion to the tilt; a body on its back is turned about its x axis.
        x, y = _up_in_body(self._body)
        sine = math.hypot(x, y)
        axis = np.array([-y / sine, x / sine, 0.0]) if sine > 0.05 else np.array([1.0, 0.0, 0.0])
        torque_in_body = _RIGHTING_NM_PER_RAD * self._body.tilt_rad() * axis
        torque_in_body -= _RIGHTING_NM_S_PER_RAD * self._body.base_velocity[3:]
        is_over = self.now_ns >= self._until_ns
        self._body.set_external_torque_in_body(np.zeros(3) if is_over else torque_in_body)
        if is_over:
            self.hold()

    def _expire(self, expiry: Expiry) -> None:
        self.end_joint_control(StreamFailure(EXPIRED, expiry.message))
        policy = self._policy.on_command_expiry
        if policy == "hold_vendor_stand":
            self.stand()
        elif policy == "freeze_torque":
            self._enter(Mode.FROZEN)
            self._servo, self._is_path_done = torque_servo(self._body.motor_torque_nm), True
            self._until_ns = self._after(self._policy.freeze_torque_s)
        else:
            self.damp()

    def _enter(self, mode: Mode) -> None:
        if self.mode is Mode.RIGHTING:
            self._body.set_external_torque_in_body(np.zeros(3))
        self.mode = mode
        self._until_ns = 0
        self._next = None
        self._falls.reset()

    def _follow(self, mode: Mode, path: Path) -> None:
        self._enter(mode)
        self._path, self._path_start_ns, self._is_path_done = path, self.now_ns, False

    def _after(self, seconds: float) -> int:
        return self.now_ns + round(seconds * NS_PER_S)

    def _path_time_s(self) -> float:
        return (self.now_ns - self._path_start_ns) * 1e-9


def _up_in_body(body: Body) -> tuple[float, float]:
    """The x and y components of the world's upward direction in the body frame."""
    w, x, y, z = body.base_wxyz.tolist()
    return 2.0 * (x * z - w * y), 2.0 * (y * z + w * x)
