"""Laws that a robot's reports obey: at rest, standing, walking. Each is judged from a recording alone."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from bosdyn.api import robot_state_pb2

from fake_robot.conformance import session as motions
from fake_robot.conformance.check import Basis, ConformanceCheck, Needs
from fake_robot.conformance.paths import angle, edges, late_s, slope, strays, turns
from fake_robot.conformance.power import has_power
from fake_robot.conformance.recording import AT_REST, FRAMES, G_M_S2, NAMES, RecordedPart, axes, is_unit, record_rest
from fake_robot.conformance.server import OpenError, Server, stamp_ns
from spot_model.robot.arm import ARM_JOINT_NAMES
from spot_model.robot.facts import LEG_NAMES
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.rotation import conjugate_wxyz, multiply_wxyz, rotate_inverse_wxyz, rotate_wxyz, yaw_rad

_STREAM, _POLL, _PROTO = "GetRobotStateStream", "RobotState.GetRobotState", "robot_state.proto"
_NEAR_RAD, _NEAR_M, _NEAR_NM, _NEAR_RAD_S, _NEAR_M_S = 0.1, 0.1, 10.0, 0.4, 0.15
_REST_M_S, _REST_RAD_S = 0.1, 0.2
_PIECE_S = {"position": 0.5, "turn": 0.2, "joint": 0.1}
_FOOT_M = 0.05
"""Half the least distance that a wrong sign or leg makes; a foot's radius is 0.036 m."""
_WEIGHTS = (0.7, 1.6)
"""Of the robot's own weight: the legs' own part is not in their loads, payloads add up to half, friction a fifth."""
_STANCE = (0.1, 0.95)
"""Share of a walk for which a foot stands."""
_OLD_S, _CLOCK_RATE = 0.025, 0.01
"""Filters of estimators lag by 10 ms and more, and a state 40 ms old stops a run; clocks drift by some millionths."""
_SLOWEST = 0.2
"""Share of a commanded way that a robot makes at least."""
_SIGNS = {robot_state_pb2.BatteryState.STATUS_CHARGING: 1, robot_state_pb2.BatteryState.STATUS_DISCHARGING: -1}
_CELSIUS, _VOLTS = (-40.0, 150.0), (10.0, 100.0)
"""Far around a Spot's 42 to 58.8 V, so that only another unit lies beyond."""
_TREE = ("odom", "vision", "body", "flat_body", "gpe")
_WITH_ARM = (*NAMES, *(n.replace("_", ".") for n in ARM_JOINT_NAMES)), (*_TREE, "hand", "arm0.link_wr1")
"""Frame tree of a robot at rest; names and tree with an arm. Source: the SDK's frame_helpers, robot_state.proto."""
_CONTACTS = {robot_state_pb2.FootState.CONTACT_MADE, robot_state_pb2.FootState.CONTACT_LOST}

Judge = Callable[[RecordedPart], str]


def law(
    rpc: str, expects: str, *whiles: str, source: str = _PROTO, basis: Basis = Basis.DOCUMENTED
) -> Callable[[Judge], tuple[ConformanceCheck, ...]]:
    """Make checks of a judge, which returns what is wrong, or nothing: one of the robot at rest, one of its motion."""

    def make(judge: Judge) -> tuple[ConformanceCheck, ...]:
        rest, moving = (tuple(w for w in whiles if (w == AT_REST) == is_rest) for is_rest in (True, False))
        name = judge.__name__
        return tuple(
            ConformanceCheck(name, rpc, f"a robot {', '.join(parts)}", (expects,), basis, source, needs, "", probe)
            for name, parts, needs in ((name, rest, Needs.NOTHING), (f"{name}_in_motion", moving, Needs.MOTION))
            if parts
            for probe in (functools.partial(_probe, judge, parts, expects),)
        )

    return make


def _probe(judge: Judge, parts: Sequence[str], holds: str, server: Server) -> str:
    for part in parts:
        if part == AT_REST:
            seen = judge(server.once(record_rest))
        else:
            session = server.once(motions.drive)
            seen = judge(session.got(session.pieces, part))
        if seen:
            return seen if len(parts) == 1 else f"{part}: {seen}"
    return holds


@law(f"{_STREAM}: joint_states, contact_states, kinematic_state", "complete", AT_REST, motions.WALKING)
def stream_is_complete(recording: RecordedPart) -> str:
    """Each message has positions, velocities and loads of its joints, four feet, and rotations that are some."""
    for state in recording.states:
        joints, body = state.joint_states, state.kinematic_state
        sizes = {len(joints.position), len(joints.velocity), len(joints.load)}
        if not (sizes <= {len(NAMES)} or sizes <= {len(_WITH_ARM[0])}):
            return f"joints: {sorted(sizes)}"
        if len(state.contact_states) != 4 or not set(state.contact_states) <= _CONTACTS:
            return f"feet: {list(state.contact_states)}"
        if not (body.HasField("odom_tform_body") and body.HasField("vision_tform_body")):
            return "a frame is missing"
        rotations = [body.odom_tform_body.rotation, body.vision_tform_body.rotation]
        if not all(map(is_unit, [*rotations, *(p.odom_rot_link for p in state.inertial_state.packets)])):
            return "a rotation's length is not 1"
        if bool(state.last_command.user_command_key) != bool(stamp_ns(state.last_command.received_timestamp)):
            return f"last_command: key {state.last_command.user_command_key}, and no time of receipt, or no key"
    return _lack(lambda: (recording.streamed, recording.imu_wxyz))


@law(f"{_POLL}", "complete", AT_REST, motions.WALKING)
def polled_state_is_complete(recording: RecordedPart) -> str:
    """Power, battery, e-stops, joints by name, frames and feet; with a manipulator, its joints in the stream, too."""
    state = recording.polls[-1]
    joints, tree = _WITH_ARM if state.HasField("manipulator_state") else (NAMES, _TREE)
    frames = state.kinematic_state.transforms_snapshot.child_to_parent_edge_map
    names = [joint.name for joint in state.kinematic_state.joint_states]
    estops = state.estop_states
    wanted: dict[str, Any] = {
        "motor power": state.power_state.motor_power_state,
        "batteries": len(state.battery_states),
        "e-stops with a name, a type and a state": estops and all(e.name and e.type and e.state for e in estops),
        **{f"joint {name} once": names.count(name) == 1 for name in joints},
        f"{len(joints)} streamed joints": len(recording.states[-1].joint_states.position) == len(joints),
        **{f"frame {name}": name in frames for name in tree},
        "rotations of length 1": all(
            is_unit(e.parent_tform_child.rotation) for e in frames.values() if e.parent_frame_name
        ),
        "four feet, made or lost": [foot.contact in _CONTACTS for foot in state.foot_state] == [True] * 4,
    }
    missing = [name for name, is_there in wanted.items() if not is_there]
    return f"missing: {', '.join(missing)}" if missing else _lack(lambda: recording.polled)


def _lack(read: Callable[[], object]) -> str:
    try:
        read()
    except OpenError as error:
        return str(error)
    return ""


@law(f"{_STREAM}, {_POLL}: acquisition_timestamp", "rising", AT_REST, motions.WALKING)
def stamps_rise(recording: RecordedPart) -> str:
    """Stamps of streamed joints and of packets rise, headers' do not fall, and a later poll is of a later state."""
    joints = [stamp_ns(s.joint_states.acquisition_timestamp) for s in recording.states]
    packets = [stamp_ns(p.timestamp) for p in recording.packets]
    headers = [stamp_ns(s.header.response_timestamp) for s in recording.states]
    polls = [stamp_ns(p.kinematic_state.acquisition_timestamp) for p in recording.polls]
    if any(a >= b for stamps in (joints, packets) for a, b in pairwise(stamps)) or headers != sorted(headers):
        return "a streamed stamp goes back or stays"
    return "" if polls == sorted(polls) and polls[0] < polls[-1] else "a polled stamp goes back or stays"


@law(_STREAM, "3 ms apart, three packets", AT_REST, basis=Basis.MEASURED, source="a published recording of a robot")
def stream_period(recording: RecordedPart) -> str:
    """The median distances of two stamps of states and of inertial packets, to a hundredth; the rate is a period."""
    counts = {len(state.inertial_state.packets) for state in recording.states}
    states = [stamp_ns(s.joint_states.acquisition_timestamp) for s in recording.states]
    packets = [stamp_ns(p.timestamp) for p in recording.packets] or [0, 0]
    state_ms, packet_ms = (round(float(np.median(np.diff(stamps))) / 1e6, 2) for stamps in (states, packets))
    rate = recording.states[-1].inertial_state.packet_rate
    if (state_ms, packet_ms, counts, round(rate, 4)) == (3.0, 1.0, {3}, 0.001):
        return ""
    return f"{state_ms:g} ms apart, {sorted(counts)} packets {packet_ms:g} ms apart, packet_rate {rate:g}"


@law(f"{_STREAM}, {_POLL}: joints, feet, body", "one robot", AT_REST, motions.STANDING, motions.WALKING)
def stream_agrees_with_poll(recording: RecordedPart) -> str:
    """Each polled state is the stream's at the same time: joints in the SDK's order, contacts, body, velocities."""
    one, other = recording.streamed, recording.polled
    at = np.abs(one.stamps_s[None, :] - other.stamps_s[:, None]).argmin(axis=1)
    is_still = bool(np.median(np.abs(one.velocity_rad_s).max(axis=1)) < 0.2)
    for what, a, b, near in (
        ("position, rad", one.position_rad[at], other.position_rad, _NEAR_RAD),
        ("velocity, rad/s", one.velocity_rad_s[at], other.velocity_rad_s, _NEAR_RAD_S),
        ("load, N·m", one.load_nm[at], other.load_nm, _NEAR_NM if is_still else math.inf),
    ):
        off = np.median(np.abs(a - b), axis=0)
        if off.max() > near:
            i = int(off.argmax())
            return f"{NAMES[i]}: {what}: {np.median(a[:, i]):.2f}, polled {np.median(b[:, i]):.2f}"
    if (one.contacts[at] == other.contacts).mean() < 0.75:
        return "the feet's contacts differ"
    for frame in FRAMES:
        here, there = one.body[frame], other.body[frame]
        for what, off, near in (
            ("is elsewhere", np.linalg.norm(here.position_m[at] - there.position_m, axis=1), _NEAR_M),
            ("is turned otherwise", angle(here.wxyz[at], there.wxyz), _NEAR_RAD),
            ("travels otherwise", np.linalg.norm(here.linear_m_s[at] - there.linear_m_s, axis=1), _NEAR_M_S),
            ("turns otherwise", np.linalg.norm(here.angular_rad_s[at] - there.angular_rad_s, axis=1), _NEAR_RAD_S),
        ):
            if np.median(off) > near:
                return f"the body {what} in {frame}"
    return ""


@law("joint_states.velocity", "the slope of position", AT_REST, motions.WALKING)
def joint_velocity_is_the_slope(recording: RecordedPart) -> str:
    """Each streamed joint travels as its velocity says."""
    motion = recording.streamed
    pieces = edges(motion.stamps_s, _PIECE_S["joint"])
    for i, name in enumerate(NAMES):
        way = np.diff(motion.position_rad[pieces][:, [i]], axis=0)
        if strays(motion.stamps_s, motion.velocity_rad_s[:, [i]], pieces, way, _NEAR_RAD):
            return f"{name} does not travel as its velocity says"
    return ""


@law(f"{_POLL}: foot_state", "where the joints put them", AT_REST, motions.STANDING, motions.LEANING, motions.WALKING)
def feet_are_where_the_joints_put_them(recording: RecordedPart) -> str:
    """By the legs' kinematics, feet in the order fl, fr, hl, hr."""
    off_m = np.abs(recording.feet_in_body_m - foot_position_in_body_m(recording.polled.position_rad))
    off_m[..., 2] = np.maximum(0.0, off_m[..., 2] - 0.04)  # of the sphere's centre, or of where it touches the ground
    median_m = np.median(off_m, axis=0).max(axis=1)
    leg = int(median_m.argmax())
    return f"{LEG_NAMES[leg]} is {median_m[leg]:.2f} m elsewhere" if median_m[leg] > _FOOT_M else ""


@law("contact_states, foot_state.contact", "made", motions.STANDING)
def feet_stand(recording: RecordedPart) -> str:
    """Three feet and more of a robot that stands are on the ground, in both reports."""
    for motion in recording.motions:
        made = (motion.contacts == robot_state_pb2.FootState.CONTACT_MADE).mean(axis=0) > 0.5
        if made.sum() < 3:
            return f"{motion.source}: {made.sum()} feet"
    return ""


@law("contact_states, foot_state.contact", "each foot steps, and carries while it stands", motions.WALKING)
def feet_step(recording: RecordedPart) -> str:
    """No contact of a robot that walks stays as it is, and a leg's loads carry more with contact than without."""
    for motion in recording.motions:
        made = motion.contacts == robot_state_pb2.FootState.CONTACT_MADE
        force_n = motion.leg_forces_n()
        for leg, name in enumerate(LEG_NAMES):
            stands = made[:, leg]
            if not _STANCE[0] < stands.mean() < _STANCE[1]:
                return f"{motion.source}: {name} has contact for {100 * stands.mean():.0f} % of the time"
            if force_n[stands, leg].mean() < force_n[~stands, leg].mean():
                return f"{motion.source}: {name} carries more without contact"
    return ""


@law("joint_states.load", "the legs carry the robot", motions.STANDING)
def loads_carry_the_weight(recording: RecordedPart) -> str:
    """The force of the ground that the legs' loads balance is the robot's weight, upwards, in both reports."""
    for motion in recording.motions:
        if not _WEIGHTS[0] < motion.share_of_weight() < _WEIGHTS[1]:
            return f"{motion.source}: {motion.share_of_weight():.2f} of its own weight"
    return ""


@law("RobotCommand: footprint_R_body", "as it was told to", motions.LEANING, source="basic_command.proto")
def leans_as_it_is_told(recording: RecordedPart) -> str:
    """The streamed attitude rolls and pitches to the side that it was told to."""
    up = rotate_inverse_wxyz(recording.streamed.body["odom"].wxyz, np.array([0.0, 0.0, 1.0])).mean(axis=0)
    rolled, pitched = math.asin(up[1]), -math.asin(up[0])
    is_right = all(seen > told / 3.0 for seen, told in zip((rolled, pitched), motions.LEAN_RAD, strict=False))
    return "" if is_right else f"roll {rolled:.2f} rad, pitch {pitched:.2f} rad"


@law(f"{_STREAM}, {_POLL}: every stamp", "as old as what it stands on", motions.WALKING)
def contents_are_of_their_stamps(recording: RecordedPart) -> str:
    """What two reports tell of one motion, and what a rate and its path tell, coincides without a shift in time."""
    one = recording.streamed
    body = one.body["odom"]
    pairs = [
        ("velocities of joints", one.stamps_s, one.velocity_rad_s, slope(one.stamps_s, one.position_rad)),
        ("velocities of the body", one.stamps_s, body.linear_m_s, slope(one.stamps_s, body.position_m)),
    ]
    if recording.packets:
        rates = np.array([axes(p.angular_velocity_rt_odom_in_link_frame) for p in recording.packets])
        turning = rotate_wxyz(recording.imu_wxyz, rates)
        pairs.append(("inertial packets", recording.packet_stamps_s, turning, body.angular_rad_s))
    if len(recording.motions) > 1:
        pairs.append(("polled joints", recording.polled.stamps_s, recording.polled.position_rad, one.position_rad))
    for what, stamps_s, seen, known in pairs:
        if abs(late := late_s(stamps_s, seen, one.stamps_s, known)) > _OLD_S:
            return f"{what} are {1e3 * late:.0f} ms late"
    return ""


@law(f"{_STREAM}: every stamp", "a second a second", motions.MOVING)
def clock_runs_true(recording: RecordedPart) -> str:
    """From its first to its last tenth, the stamps of a motion go on as fast as this computer's clock."""
    late_s = np.array(recording.arrived_ns) * 1e-9 - recording.streamed.stamps_s
    tenth = max(1, len(late_s) // 10)
    gained = (late_s[:tenth].min() - late_s[-tenth:].min()) / np.ptp(recording.streamed.stamps_s)
    return "" if abs(gained) < _CLOCK_RATE else f"{100 * gained:.1f} % fast"


@law("velocity_of_body", "at rest", AT_REST, motions.STOPPED)
def body_rests(recording: RecordedPart) -> str:
    """The body of a robot that does not move has no velocity, in either frame and report."""
    for motion in recording.motions:
        for frame, body in motion.body.items():
            speed_m_s, turn_rad_s = (np.linalg.norm(v.mean(axis=0)) for v in (body.linear_m_s, body.angular_rad_s))
            if not (speed_m_s < _REST_M_S and turn_rad_s < _REST_RAD_S):
                return f"{motion.source}, in {frame}: {speed_m_s:.2f} m/s, {turn_rad_s:.2f} rad/s"
    return ""


@law("velocity_of_body", "the slopes of position and attitude", motions.WALKING)
def body_velocity_is_the_slope(recording: RecordedPart) -> str:
    """The body travels and turns in odom and in vision as its streamed velocities there say."""
    stamps_s = recording.streamed.stamps_s
    for frame, body in recording.streamed.body.items():
        pieces = edges(stamps_s, _PIECE_S["position"])
        if strays(stamps_s, body.linear_m_s, pieces, np.diff(body.position_m[pieces], axis=0), _NEAR_M):
            return f"the body does not travel in {frame} as its velocity says"
        pieces = edges(stamps_s, _PIECE_S["turn"])
        turn = rotate_wxyz(body.wxyz[pieces[:-1]], turns(body.wxyz[pieces]))
        if strays(stamps_s, body.angular_rad_s, pieces, turn, _NEAR_RAD):
            return f"the body does not turn in {frame} as its velocity says"
    return ""


@law(f"{_STREAM}: inertial_state", "gravity's reaction, up", AT_REST, motions.STANDING, motions.LEANING)
def imu_feels_gravity(recording: RecordedPart) -> str:
    """The mean acceleration, turned into odom, is 9.8 m/s² upwards."""
    if not recording.packets:
        return "no packet"
    felt = np.array([axes(p.acceleration_rt_odom_in_link_frame) for p in recording.packets])
    x, y, z = rotate_wxyz(recording.imu_wxyz, felt).mean(axis=0)
    return "" if abs(z - G_M_S2) < 0.5 and math.hypot(x, y) < 1.0 else f"{x:.1f}, {y:.1f}, {z:.1f} m/s²"


@law(f"{_STREAM}: inertial_state", "turns as the body does", motions.WALKING)
def imu_turns_with_the_body(recording: RecordedPart) -> str:
    """Its attitude is the body's but for how it is mounted, and its turn rate is that attitude's slope."""
    if not recording.packets:
        return "no packet"
    wxyz = recording.imu_wxyz
    stamps_s = recording.packet_stamps_s
    rate = np.array([axes(p.angular_velocity_rt_odom_in_link_frame) for p in recording.packets])
    pieces = edges(stamps_s, _PIECE_S["turn"])
    if strays(stamps_s, rate, pieces, turns(wxyz[pieces]), _NEAR_RAD):
        return "it does not turn as its own rate says"
    body = recording.streamed
    at = np.abs(stamps_s[None, :] - body.stamps_s[:, None]).argmin(axis=1)
    mounted = multiply_wxyz(conjugate_wxyz(body.body["odom"].wxyz), wxyz[at])
    return "" if angle(mounted, mounted[:1]).max() < 2.0 * _NEAR_RAD else "it turns otherwise than the body"


@law("RobotCommand: se2_velocity_request", "where it was told to", motions.WALKING, source="basic_command.proto")
def walks_where_it_is_told(recording: RecordedPart) -> str:
    """Forward, to the left and turning left, each at least a fifth of what was asked for."""
    motion = recording.streamed
    body, lasted_s = motion.body["odom"], motion.stamps_s[-1] - motion.stamps_s[0]
    way = rotate_inverse_wxyz(body.wxyz[:-1], np.diff(body.position_m, axis=0)).sum(axis=0)
    turned_rad = np.ptp(np.unwrap(yaw_rad(body.wxyz))) * np.sign(np.diff(np.unwrap(yaw_rad(body.wxyz))).sum())
    made = np.array([way[0], way[1], turned_rad]) / lasted_s
    if np.all(made > _SLOWEST * np.array(motions.VELOCITY_M_S_RAD_S)):
        return ""
    asked = ", ".join(f"{v:g}" for v in motions.VELOCITY_M_S_RAD_S)
    return f"{made[0]:.2f}, {made[1]:.2f} m/s, {made[2]:.2f} rad/s; asked for {asked}"


@law("RobotCommand: se2_trajectory_request", "as far as it was told", motions.GOING, source="basic_command.proto")
def goes_as_far_as_it_is_told(recording: RecordedPart) -> str:
    """The goal ahead in the body's frame is reached, to a third of the way."""
    position_m = recording.streamed.body["odom"].position_m
    ahead = rotate_inverse_wxyz(recording.streamed.body["odom"].wxyz[0], position_m[-1] - position_m[0])
    is_there = math.dist(ahead[:2], (motions.WAY_M, 0.0)) < motions.WAY_M / 3.0
    return "" if is_there else f"{ahead[0]:.2f} m ahead, {ahead[1]:.2f} m left"


@law("StandCommand.Feedback: status", "it stands when it says so", motions.SETTLING, source="basic_command.proto")
def stands_when_it_says_so(recording: RecordedPart) -> str:
    """Once it has said that it stands, no joint moves any more, for 2 s."""
    moved_rad = np.ptp(recording.streamed.position_rad, axis=0)
    return "" if moved_rad.max() < 2.0 * _NEAR_RAD else f"{NAMES[int(moved_rad.argmax())]} still moved"


@law(f"{_POLL}: power and behavior", "on while it stands, then off", AT_REST, motions.STANDING, motions.OFF)
def power_and_behavior_agree(recording: RecordedPart) -> str:
    """A robot stands with power alone; one that was switched off has none."""
    state = recording.polls[-1]
    power, behavior, is_on = state.power_state, state.behavior_state, has_power(state)
    is_up = behavior.state in {behavior.STATE_STANDING, behavior.STATE_STEPPING}
    is_right = {
        AT_REST: is_on or not is_up,
        motions.STANDING: is_on and (is_up or behavior.state == behavior.STATE_UNKNOWN),
        motions.OFF: not (is_on or is_up),
    }[recording.part]
    told = f"{power.MotorPowerState.Name(power.motor_power_state)}, {behavior.State.Name(behavior.state)}"
    return "" if is_right else told


@law(f"{_POLL}: battery_states, motor_temperatures", "percent, volts, amperes, Celsius", AT_REST, motions.STANDING)
def units_are_plausible(recording: RecordedPart) -> str:
    """Charges, voltages and temperatures that a robot can have, and currents of the sign of their battery's status.

    A charge up to 1 is a share of one, a voltage or a temperature beyond the bounds is in another unit.
    """
    state = recording.polls[-1]
    batteries = [b for b in state.battery_states if b.status not in {b.STATUS_MISSING, b.STATUS_BOOTING}]
    charges = [b.charge_percentage.value for b in batteries if b.HasField("charge_percentage")]
    if state.power_state.HasField("locomotion_charge_percentage"):
        charges.append(state.power_state.locomotion_charge_percentage.value)
    volts = [b.voltage.value for b in batteries if b.HasField("voltage")]
    warm = [motor.temperature for motor in state.system_state.motor_temperatures]
    warm += [celsius for b in batteries for celsius in b.temperatures]
    odd = [f"{charge:g} %" for charge in charges if not 1.0 < charge <= 100.0]
    odd += [f"{volt:g} V" for volt in volts if not _VOLTS[0] < volt < _VOLTS[1]]
    odd += [f"{celsius:g} °C" for celsius in warm if not _CELSIUS[0] <= celsius <= _CELSIUS[1]]
    odd += [f"{b.current.value:g} A" for b in batteries if b.current.value * _SIGNS.get(b.status, 0) < 0]
    return ", ".join(odd)
