"""Checks of what the robot measures: two reports of one thing agree, and figures mean what their fields say."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from bosdyn.api import robot_state_pb2
from bosdyn.client.frame_helpers import get_a_tform_b
from bosdyn.client.math_helpers import Quat, SE3Pose
from bosdyn.client.robot_command import RobotCommandBuilder

from fake_robot.conformance.check import Basis, Needs, check
from fake_robot.conformance.commands import send
from fake_robot.conformance.reports import states
from fake_robot.conformance.server import Server, SkippedError, powered, status_of
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES
from spot_model.robot.state import Array

_STREAM, _POLL = "GetRobotStateStream", "RobotState.GetRobotState"
_STILL_RAD_S = 0.2
_NEAR_S, _NEAR_RAD, _NEAR_M, _NEAR_NM = 1.0, 0.1, 0.1, 10.0
_REST_M_S, _REST_RAD_S = 0.1, 0.2
_PIECES = 10
_GRAVITY_M_S2 = (9.3, 10.3)
MIN_BATTERY_V, MAX_BATTERY_V = 10.0, 100.0
"""Far around a Spot's 42 to 58.8 V, so that only another unit lies beyond."""
_URDF_LINK = re.compile(r"""<link\s[^>]*?name=["']([^"']+)["']""")


def _ns(stamp: Any) -> int:
    return int(stamp.seconds * 10**9 + stamp.nanos)


def _still(server: Server) -> tuple[robot_state_pb2.RobotState, list[robot_state_pb2.RobotStateStreamResponse]]:
    """The polled state and the stream of a robot whose joints are at rest."""
    seen = states(server)
    if any(abs(v) > _STILL_RAD_S for state in seen for v in state.joint_states.velocity):
        raise SkippedError("the robot moves")
    return server.state(), seen


_NAMES = tuple(name.replace("_", ".") for name in JOINT_NAMES)


@check(f"{_POLL}: joint_states.name", "", "fl.hx to hr.kn, each once", source="SDK: joint_control examples, URDF")
def joint_names(server: Server) -> str:
    """The twelve joints of the legs have their names; polled joints are told apart by name, so their order is free."""
    names = [joint.name for joint in server.state().kinematic_state.joint_states]
    wrong = [name for name in _NAMES if names.count(name) != 1]
    return f"not there, or twice: {', '.join(wrong)}" if wrong else "fl.hx to hr.kn, each once"


@check(f"{_STREAM}: joint_states", "a robot at rest", "as polled", source="robot_state.proto")
def stream_agrees_with_poll(server: Server) -> str:
    """The stream's joints, in the SDK's order, its feet and its body are those of the polled state."""
    return _compared(server)


@check(f"{_STREAM}: joint_states", "a robot that stands", "as polled", source="robot_state.proto", needs=Needs.MOTION)
def stream_agrees_while_standing(server: Server) -> str:
    """The same with power, when loads carry the robot, and once it has said that it stands."""
    with powered(server):
        try:
            return _compared(server)
        except SkippedError:
            return "the robot still moves"


def _compared(server: Server) -> str:
    polled, seen = _still(server)
    last, kinematics = seen[-1], polled.kinematic_state
    joints, by_name = last.joint_states, {joint.name: joint for joint in kinematics.joint_states}
    for name, at_rad, load_nm in zip(_NAMES, joints.position, joints.load, strict=False):
        joint = by_name.get(name)
        if joint is None:
            return f"{name} is not polled"
        if abs(at_rad - joint.position.value) > _NEAR_RAD:
            return f"{name}: {at_rad:.2f}, polled {joint.position.value:.2f} rad"
        if abs(load_nm - joint.load.value) > _NEAR_NM:
            return f"{name}: {load_nm:.1f}, polled {joint.load.value:.1f} N·m"
    if polled.foot_state and [foot.contact for foot in polled.foot_state] != list(last.contact_states):
        return "the feet's contacts differ"
    for frame, other in (
        ("odom", last.kinematic_state.odom_tform_body),
        ("vision", last.kinematic_state.vision_tform_body),
    ):
        there, at = get_a_tform_b(kinematics.transforms_snapshot, frame, "body"), SE3Pose.from_proto(other)
        if there is None:
            return f"no frame {frame} is polled"
        if math.dist((there.x, there.y, there.z), (at.x, at.y, at.z)) > _NEAR_M:
            return f"the body is elsewhere in {frame}"
        cosine = abs(sum(getattr(there.rot, axis) * getattr(at.rot, axis) for axis in "wxyz"))
        if cosine < math.cos(0.5 * _NEAR_RAD):
            return f"the body is turned otherwise in {frame}"
    return "as polled"


@check(f"{_STREAM}: joint_states.velocity", "200 messages", "the slope of position", source="robot_state.proto")
def velocity_is_the_slope(server: Server) -> str:
    """Over all messages, each joint travels as far as its velocity says."""
    seen = [state.joint_states for state in states(server)]
    stamps = [_ns(joints.acquisition_timestamp) for joints in seen]
    for index, name in enumerate(_NAMES):
        velocity = [joints.velocity[index] for joints in seen]
        pairs = zip(pairwise(velocity), pairwise(stamps), strict=True)
        travel_rad = sum(0.5 * (a + b) * (until - since) * 1e-9 for (a, b), (since, until) in pairs)
        moved_rad = seen[-1].position[index] - seen[0].position[index]
        if abs(travel_rad - moved_rad) > _NEAR_RAD:
            return f"{name} moved by {moved_rad:.2f} rad, by its velocity {travel_rad:.2f}"
    return "the slope of position"


@check(
    f"{_STREAM}: velocities",
    "a robot that steps and turns",
    "the slopes of positions and attitude",
    source="robot_state.proto",
    needs=Needs.MOTION,
)
def rates_are_slopes(server: Server) -> str:
    """While the robot steps, joints travel as their velocities say, and the body turns as its inertial unit says."""
    with powered(server) as lease:
        sent = send(server, lease, RobotCommandBuilder.synchro_velocity_command(0.2, 0.0, 0.5), end_s=4.0)
        if status_of(sent) != "STATUS_OK":
            raise SkippedError(f"a velocity was answered by {status_of(sent)}")
        time.sleep(1.0)
        seen = states(server)
    ticks = [_ns(state.joint_states.acquisition_timestamp) * 1e-9 for state in seen]
    for index, name in enumerate(_NAMES):
        position = np.array([[state.joint_states.position[index]] for state in seen])
        velocity = np.array([[state.joint_states.velocity[index]] for state in seen])
        if _strays(np.array(ticks), velocity, partial(_travel, position)):
            return f"{name} does not travel as its velocity says"
    packets = [packet for state in seen for packet in state.inertial_state.packets]
    if packets:
        rate = np.array([_xyz(packet.angular_velocity_rt_odom_in_link_frame) for packet in packets])
        turned = [Quat.from_proto(packet.odom_rot_link) for packet in packets]
        stamps = np.array([_ns(packet.timestamp) * 1e-9 for packet in packets])
        if _strays(stamps, rate, lambda a, b: _turn_between(turned[a], turned[b])):
            return "the body does not turn as its inertial unit says"
    return "the slopes of positions and attitude"


def _strays(stamps_s: Array, rate: Array, moved: Callable[[int, int], Array]) -> bool:
    """Whether what was moved differs from the rates' integral by half of itself and more, over pieces of the time."""
    edges = np.linspace(0, len(stamps_s) - 1, _PIECES + 1).astype(int)
    pieces = list(pairwise(int(edge) for edge in edges))
    travelled = [np.trapezoid(rate[a : b + 1], stamps_s[a : b + 1], axis=0) for a, b in pieces]
    path = [moved(a, b) for a, b in pieces]
    length = float(np.linalg.norm(path, axis=1).sum())
    off = float(np.linalg.norm(np.array(path) - np.array(travelled), axis=1).sum())
    return off > max(0.5 * length, _NEAR_RAD)


def _travel(position: Array, first: int, last: int) -> Array:
    return np.asarray(position[last] - position[first])


def _turn_between(first: Quat, last: Quat) -> Array:
    """The turn from one attitude to another, as a rotation vector in the link."""
    turn = first.inverse() * last
    sine = np.array([turn.x, turn.y, turn.z]) * (1.0 if turn.w >= 0.0 else -1.0)
    return np.asarray(2.0 * sine)  # of the small turns of one piece


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z


@check("velocity_of_body", "a robot at rest", "at rest", source="robot_state.proto")
def body_rests(server: Server) -> str:
    """The body of a robot whose joints are still has no velocity, in either frame, polled or streamed."""
    polled, seen = _still(server)
    for source, kinematics in (("polled", polled.kinematic_state), ("streamed", seen[-1].kinematic_state)):
        for frame in ("odom", "vision"):
            velocity = getattr(kinematics, f"velocity_of_body_in_{frame}")
            speed_m_s, turn_rad_s = (math.hypot(v.x, v.y, v.z) for v in (velocity.linear, velocity.angular))
            if not (speed_m_s < _REST_M_S and turn_rad_s < _REST_RAD_S):
                return f"{source}, in {frame}: {speed_m_s:.2f} m/s, {turn_rad_s:.2f} rad/s"
    return "at rest"


@check(
    f"{_POLL}: foot_state", "", "fl, fr, hl, hr: each under its hip", source="robot_state.proto: foot_position_rt_body"
)
def feet_are_in_order(server: Server) -> str:
    """Each foot is before or behind, left or right of the body's middle, as its place in the list says."""
    at = [foot.foot_position_rt_body for foot in server.state().foot_state]
    corners = [("f" if foot.x > 0.0 else "h") + ("l" if foot.y > 0.0 else "r") for foot in at]
    if corners == list(LEG_NAMES) and all(foot.z < 0.0 for foot in at):
        return "fl, fr, hl, hr: each under its hip"
    return (
        "no foot"
        if not at
        else ", ".join(f"{corner} at {foot.z:.2f} m" for corner, foot in zip(corners, at, strict=True))
    )


@check(f"{_STREAM}: contact_states", "200 messages", "made or lost", source="robot_state.proto")
def contacts_are_known(server: Server) -> str:
    """Each foot stands or does not."""
    kinds = {robot_state_pb2.FootState.CONTACT_MADE, robot_state_pb2.FootState.CONTACT_LOST}
    return "made or lost" if {c for state in states(server) for c in state.contact_states} <= kinds else "unknown"


@check(f"{_STREAM}: rotations", "200 messages", "of length 1", source="geometry.proto: Quaternion")
def rotations_are_units(server: Server) -> str:
    """Quaternions of body and inertial unit are rotations."""
    for state in states(server):
        kinematics = state.kinematic_state
        turns = [kinematics.odom_tform_body.rotation, kinematics.vision_tform_body.rotation]
        for turn in [*turns, *(packet.odom_rot_link for packet in state.inertial_state.packets)]:
            length = math.sqrt(turn.w**2 + turn.x**2 + turn.y**2 + turn.z**2)
            if abs(length - 1.0) > 1e-3:
                return f"of length {length:.3f}"
    return "of length 1"


@check(
    f"{_STREAM}: inertial_state",
    "a robot at rest",
    "gravity's reaction, up",
    source="robot_state.proto: rt_odom_in_link",
)
def imu_feels_gravity(server: Server) -> str:
    """The mean acceleration, turned into odom, is 9.8 m/s² upwards."""
    _, seen = _still(server)
    packets = [packet for state in seen for packet in state.inertial_state.packets]
    if not packets:
        return "no packet"
    felt = [
        Quat.from_proto(p.odom_rot_link).transform_point(a.x, a.y, a.z)
        for p in packets
        for a in (p.acceleration_rt_odom_in_link_frame,)
    ]
    x, y, z = (sum(axis) / len(felt) for axis in zip(*felt, strict=True))
    low, high = _GRAVITY_M_S2
    if low < z < high and math.hypot(x, y) < 1.0:
        return "gravity's reaction, up"
    return f"{x:.1f}, {y:.1f}, {z:.1f} m/s²"


@check(
    f"{_STREAM}: inertial_state.packets.timestamp",
    "200 messages",
    "1 ms apart",
    basis=Basis.MEASURED,
    source="a published recording of a robot",
)
def imu_period(server: Server) -> str:
    """The median distance of two samples, to a hundredth; none goes back."""
    stamps = [_ns(packet.timestamp) for state in states(server) for packet in state.inertial_state.packets]
    steps = sorted(b - a for a, b in pairwise(stamps))
    if not steps:
        return "no packet"
    if steps[0] <= 0:
        return "a stamp goes back or stays"
    return f"{round(steps[len(steps) // 2] / 1e6, 2):g} ms apart"


@check(
    f"{_STREAM}: acquisition_timestamp",
    "200 messages",
    "the robot's clock",
    source="robot_state.proto; time_sync.proto",
)
def stamps_are_robot_time(server: Server) -> str:
    """Stamps of joints, body, power, batteries and e-stops agree with the time sync."""
    last, polled = states(server)[-1], server.state()
    now_ns = _ns(server.robot_stamp(0.0))
    stamps = {
        "joints": last.joint_states.acquisition_timestamp,
        "body": last.kinematic_state.acquisition_timestamp,
        "polled": polled.kinematic_state.acquisition_timestamp,
        "power": polled.power_state.timestamp,
        **{f"battery {b.identifier}": b.timestamp for b in polled.battery_states if b.HasField("timestamp")},
        **{f"e-stop {e.name}": e.timestamp for e in polled.estop_states if e.HasField("timestamp")},
    }
    for name, stamp in stamps.items():
        if abs(_ns(stamp) - now_ns) > _NEAR_S * 1e9:
            return f"{name}: {(_ns(stamp) - now_ns) * 1e-9:.1f} s off"
    return "the robot's clock"


@check("any call: header.response_timestamp", "", "the robot's clock", source="header.proto; time_sync.proto")
def headers_are_robot_time(server: Server) -> str:
    """The time of an answer agrees with the time sync."""
    off_ns = _header_ns(server) - _ns(server.robot_stamp(0.0))
    return "the robot's clock" if abs(off_ns) < _NEAR_S * 1e9 else f"{off_ns * 1e-9:.1f} s off"


def _header_ns(server: Server) -> int:
    return _ns(server.ask("robot-state", "GetRobotState").header.response_timestamp)


@check(f"{_POLL}: battery_states", "", "plausible", source="robot_state.proto: percent, volts")
def battery_is_plausible(server: Server) -> str:
    """Of each battery that is in, and of the robot's summary: a charge and a voltage at which a robot answers.

    A charge up to 1 is a share of one, a voltage beyond the bounds is in other units.
    """
    state = server.state()
    batteries = [b for b in state.battery_states if b.status not in {b.STATUS_MISSING, b.STATUS_BOOTING}]
    charges = [b.charge_percentage.value for b in batteries if b.HasField("charge_percentage")]
    if state.power_state.HasField("locomotion_charge_percentage"):
        charges.append(state.power_state.locomotion_charge_percentage.value)
    odd = [f"{charge:g} %" for charge in charges if not 1.0 < charge <= 100.0]
    volts = [b.voltage.value for b in batteries if b.HasField("voltage")]
    odd += [f"{volt:g} V" for volt in volts if not MIN_BATTERY_V < volt < MAX_BATTERY_V]
    return ", ".join(odd) or "plausible"


@check(f"{_POLL}: estop_states", "", "a name, a type and a state each", source="robot_state.proto")
def estops_are_known(server: Server) -> str:
    """Each e-stop says what it is."""
    estops = server.state().estop_states
    is_known = all(estop.name and estop.type and estop.state for estop in estops) and estops
    return "a name, a type and a state each" if is_known else "something is unknown"


@check("RobotState.GetRobotHardwareConfiguration", "", "links of every joint", source="robot_state.proto: skeleton")
def skeleton_has_the_legs(server: Server) -> str:
    """The skeleton has a body and a link behind each joint, under the names that its URDF uses."""
    skeleton = server.robot.ensure_client("robot-state").get_robot_hardware_configuration().skeleton
    links = {link.name for link in skeleton.links}
    if len(links) <= len(_NAMES):
        return f"{len(links)} links"
    unknown = links - set(_URDF_LINK.findall(skeleton.urdf))
    return f"not in the URDF: {', '.join(sorted(unknown))}" if unknown else "links of every joint"


@check("RobotId.GetRobotId", "asked twice", "one robot", source="robot_id.proto")
def robot_id_stays(server: Server) -> str:
    """Serial number, species and version are there, and the same each time."""
    first, second = (server.ask("robot-id", "GetRobotId").robot_id for _ in range(2))
    if not (first.serial_number and first.species and first.software_release.version.major_version):
        return "something is missing"
    return "one robot" if first == second else "two robots"
