"""The vendor's walk, as far as it can be seen from outside: one of this project's policies, stepped in robot time.

It is stepped by the simulation's own thread, so that a walk is the same bit for bit in every run. A step takes a tenth
of a millisecond every 20 ms; the policy is loaded before robot time begins to pass.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from fake_robot.body.sensing import Report
from fake_robot.network.requests import PathPlan, StandPose, Velocity, VelocityPlan, WalkPlan, WalkProgress
from fake_robot.robot.motion.steering import GroundPose, Steering, hold, slewed, steer, turn_towards
from fake_robot.robot.motion.vendor_motion import leg_angles_rad, stand_feet_m
from spot_model.plant.command_channel import ServoCommand
from spot_model.policy.built_in import policy_file
from spot_model.robot import facts
from spot_model.robot.facts import NS_PER_S, Array
from spot_model.robot.rotation import conjugate_wxyz, multiply_wxyz
from spot_model.robot.state import RobotState

if TYPE_CHECKING:
    from spot_model.policy.policy import Policy

_HANDOVER_S: Final = 0.5
"""From the gains and set-points of the stand to those of the policy."""
_RELEASE_S: Final = 0.3
"""And back again: the last steps end where the feet stand."""
_PATH_SLEW: Final[Velocity] = (1.5, 1.5, 2.0)
_STOP_S: Final = (0.5, 2.0)
"""A walk that stops is at rest once the body is slow, after this long at the earliest and at the latest."""
_SLOW_M_S: Final = 0.15
_SLOW_ASKED_RAD_S: Final = 0.06
"""A walk that holds its heading is not at rest while it is asked to turn faster than this."""
_POSE_RATE_PER_S: Final = 0.25
"""Height in m/s and tilt in rad/s at which the body takes on its pose."""
_POSE_BOUND: Final = np.array([0.08, 0.12, 0.12])
"""Height, roll and pitch that a walk can hold."""
_HEIGHT, _ROLL, _PITCH = range(3)


class Walker:
    """Steps a policy along a plan. Times are nanoseconds of robot time since the start.

    Without a file, the policy is the built-in *walk*. ``report`` gives the robot's newest report, ``ground_pose`` where
    the body is in odom; ``stamp_ns`` turns a time into a stamp of the robot's clock, as plans bear them.
    """

    def __init__(
        self,
        policy_path: Path | None,
        report: Callable[[], Report],
        ground_pose: Callable[[], GroundPose],
        stamp_ns: Callable[[int], int],
        stand_height_m: float,
    ) -> None:
        self._path = policy_path or policy_file("walk")
        self._report, self._ground_pose, self._stamp_ns = report, ground_pose, stamp_ns
        self._stand_height_m = stand_height_m
        self._loaded: Policy | None = None
        self._plan: WalkPlan | None = None
        self._plan_start_ns = self._start_ns = self._next_ns = 0
        self._stop_ns: int | None = None
        self._stop_yaw_rad = 0.0
        self._release_ns: int | None = None
        self._start_rad = np.zeros(facts.N_JOINTS)
        self._start_load_nm = np.zeros(facts.N_JOINTS)
        self._velocity: Velocity = (0.0, 0.0, 0.0)
        self._last_action = np.zeros(facts.N_JOINTS, dtype=np.float32)
        self._window: NDArray[np.float32] | None = None
        self._pose = np.zeros(3)
        self._servo: ServoCommand | None = None
        self.progress = WalkProgress.NONE

    def load(self) -> Policy:
        """Read the policy, once. Raises PolicyError: it cannot be read, or does not hold what it must."""
        if self._loaded is None:
            from spot_model.policy.policy import load_policy

            self._loaded = load_policy(self._path)
        return self._loaded

    def start(self, plan: WalkPlan, now_ns: int, position_rad: Array, load_nm: Array) -> None:
        """Begin to walk from a stand whose servos follow these positions and loads, each of shape (12,)."""
        self.load()
        self._start_ns = self._next_ns = now_ns
        self._start_rad, self._start_load_nm = position_rad.copy(), load_nm.copy()
        self._velocity = (0.0, 0.0, 0.0)
        self._last_action = np.zeros(facts.N_JOINTS, dtype=np.float32)
        self._window = None
        self._pose = np.zeros(3)
        self.follow(plan, now_ns)

    def follow(self, plan: WalkPlan, now_ns: int) -> None:
        """Go on with another plan."""
        self._plan, self._plan_start_ns, self._stop_ns, self._release_ns = plan, now_ns, None, None
        self.progress = WalkProgress.WALKING

    def stop(self, now_ns: int) -> None:
        """Come to a stop, wherever the plan would lead, and keep the heading."""
        if self._stop_ns is None:
            self._stop_ns, self._stop_yaw_rad = now_ns, self._ground_pose().yaw_rad

    def is_at_rest(self, now_ns: int) -> bool:
        """Whether a walk that stops has become slow, or has been at it for long enough, and the stand has it again."""
        if self._release_ns is not None:
            return (now_ns - self._release_ns) * 1e-9 > _RELEASE_S
        if self._stop_ns is not None and self._is_slow(now_ns, self._stop_ns):
            self._release_ns = now_ns
        return False

    def _is_slow(self, now_ns: int, stop_ns: int) -> bool:
        stopping_s = (now_ns - stop_ns) * 1e-9
        report = self._report()
        speed = float(np.abs(report.linear_vel_of_body_in_world_m_s[:2]).max())
        turn = abs(float(report.angular_vel_of_body_in_world_rad_s[2]))
        is_slow = max(speed, turn) < _SLOW_M_S and abs(self._velocity[2]) < _SLOW_ASKED_RAD_S
        return stopping_s > _STOP_S[1] or (stopping_s > _STOP_S[0] and is_slow)

    def servo(self, now_ns: int) -> ServoCommand:
        """What the servos follow now; the policy is asked at its own rate."""
        policy = self.load()
        if self._servo is None or now_ns >= self._next_ns:
            period_ns = round(NS_PER_S / policy.contract.rate_hz)
            self._next_ns = max(self._next_ns + period_ns, now_ns)
            self._servo = self._step(policy, now_ns, period_ns * 1e-9)
        return self._servo

    def _step(self, policy: Policy, now_ns: int, dt_s: float) -> ServoCommand:
        share = min((now_ns - self._start_ns) * 1e-9 / _HANDOVER_S, 1.0)
        if self._release_ns is not None:
            share = max(1.0 - (now_ns - self._release_ns) * 1e-9 / _RELEASE_S, 0.0)
        wanted, slew = self._wanted(now_ns, share)
        low, high = policy.contract.velocity_command_low, policy.contract.velocity_command_high
        asked = slewed(self._velocity, wanted, slew, dt_s)
        self._velocity = tuple(np.clip(asked, low, high).tolist())
        offset_rad = self._pose_offset_rad(dt_s)
        state = self._state(offset_rad)
        seen = policy.observe(state, np.array(self._velocity), self._last_action).astype(np.float32)
        self._window = policy.window(seen, self._window)
        self._last_action = policy.act(self._window)
        setpoint_rad = policy.setpoint_rad(self._last_action) + offset_rad
        gains = policy.gains()
        return ServoCommand(
            _mixed(self._start_rad, setpoint_rad, share),
            np.zeros((1, facts.N_JOINTS)),
            _mixed(self._start_load_nm, np.zeros(facts.N_JOINTS), share),
            _mixed(facts.STAND_KP_NM_PER_RAD, gains.kp_nm_per_rad, share),
            _mixed(facts.STAND_KD_NM_S_PER_RAD, gains.kd_nm_s_per_rad, share),
        )

    def _wanted(self, now_ns: int, share: float) -> tuple[Velocity, Velocity]:
        """The velocity to aim at, and how quickly; it grows with the hand-over."""
        plan = self._plan
        if plan is not None and self._stop_ns is None and self._stamp_ns(now_ns) >= plan.limits.end_robot_stamp_ns:
            self.progress = WalkProgress.TIMED_OUT
            self.stop(now_ns)
        if isinstance(plan, PathPlan) and self.progress is WalkProgress.ARRIVED:
            return hold(plan, self._ground_pose()), _PATH_SLEW
        if plan is None or self._stop_ns is not None:
            return (0.0, 0.0, turn_towards(self._stop_yaw_rad, self._ground_pose())), (2.0, 2.0, 4.0)
        slew = plan.slew if isinstance(plan, VelocityPlan) else _PATH_SLEW
        steering = steer(plan, (now_ns - self._plan_start_ns) * 1e-9, self._ground_pose())
        self._note(plan, steering, now_ns)
        forward, left, turn = (share * part for part in steering.velocity)
        return (forward, left, turn), slew

    def _note(self, plan: WalkPlan, steering: Steering, now_ns: int) -> None:
        if steering.is_there:
            self.stop(now_ns)
        if isinstance(plan, PathPlan):
            near = WalkProgress.ARRIVED if steering.is_there else WalkProgress.ARRIVING
            self.progress = near if steering.is_near else WalkProgress.WALKING

    def _pose_offset_rad(self, dt_s: float) -> Array:
        """Joint offsets that hold the body as the plan asks, shape (12,), approached slowly."""
        pose = StandPose() if self._plan is None else self._plan.limits.pose
        goal = np.clip([pose.height_m, pose.roll_rad, pose.pitch_rad], -_POSE_BOUND, _POSE_BOUND)
        if not (goal.any() or self._pose.any()):
            return np.zeros(facts.N_JOINTS)
        step = _POSE_RATE_PER_S * dt_s
        self._pose += np.clip(goal - self._pose, -step, step)
        held = StandPose(height_m=self._pose[_HEIGHT], roll_rad=self._pose[_ROLL], pitch_rad=self._pose[_PITCH])
        feet = np.stack([stand_feet_m(self._stand_height_m, held), stand_feet_m(self._stand_height_m)])
        angles = leg_angles_rad(feet)
        return np.asarray(angles[0] - angles[1])

    def _state(self, offset_rad: Array) -> RobotState:
        """The report as the policy shall see it: without the offsets of the body's pose."""
        report = self._report()
        attitude = report.world_from_body_wxyz
        if self._pose[_ROLL] or self._pose[_PITCH]:
            attitude = multiply_wxyz(attitude, conjugate_wxyz(_tilt_wxyz(self._pose[_ROLL], self._pose[_PITCH])))
        return RobotState(
            robot_stamp_ns=0,
            host_stamp_ns=0,
            position_rad=report.position_rad - offset_rad,
            velocity_rad_s=report.velocity_rad_s,
            load_nm=report.load_nm,
            position_of_body_in_odom_m=report.position_of_body_in_world_m,
            odom_from_body_wxyz=attitude,
            linear_vel_of_body_in_odom_m_s=report.linear_vel_of_body_in_world_m_s,
            angular_vel_of_body_in_odom_rad_s=report.angular_vel_of_body_in_world_rad_s,
            foot_contact=report.foot_contact,
            last_command_key=0,
            last_command_robot_stamp_ns=0,
        )


def _mixed(start: Array, goal: Array, share: float) -> Array:
    return np.asarray(start + share * (goal - start))[np.newaxis]


def _tilt_wxyz(roll_rad: float, pitch_rad: float) -> Array:
    about_x = np.array([np.cos(0.5 * roll_rad), np.sin(0.5 * roll_rad), 0.0, 0.0])
    about_y = np.array([np.cos(0.5 * pitch_rad), 0.0, np.sin(0.5 * pitch_rad), 0.0])
    return np.asarray(multiply_wxyz(about_y, about_x))
