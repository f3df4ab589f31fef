"""Errors of what a server reports: the state, polled and streamed, and the clock."""

from __future__ import annotations

from typing import Any

from bosdyn.api import robot_state_pb2
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp

from proof.planted.planting import (
    CLOCK_ERROR_S,
    NAMED,
    SIBLING,
    STATE,
    STREAM,
    TIME_SYNC,
    joint_states,
    kinematics,
    planted,
    rotated,
    scaled,
    shift,
    velocities,
)


@planted(f"{STATE} {STREAM}", source="outside", needs_motion=True)
def body_velocity_negated(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The body's linear velocity has the other sign."""
    for velocity in velocities(answer):
        velocity.linear.x, velocity.linear.y = -velocity.linear.x, -velocity.linear.y


@planted(f"{STATE} {STREAM}", source="outside", needs_motion=True)
def body_velocity_in_body(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The body's linear velocity is expressed in the body, not in odom and vision."""
    if hasattr(answer, "robot_state"):
        edges = answer.robot_state.kinematic_state.transforms_snapshot.child_to_parent_edge_map
        rotations = [(edges[frame].parent_tform_child.rotation, False) for frame in ("odom", "vision")]
    else:
        poses = answer.kinematic_state.odom_tform_body, answer.kinematic_state.vision_tform_body
        rotations = [(pose.rotation, True) for pose in poses]
    for velocity, (rotation, back) in zip(velocities(answer), rotations, strict=True):
        linear = velocity.linear
        linear.x, linear.y, linear.z = rotated(rotation, linear, back=back)


@planted(f"{STATE} {STREAM}", source="outside", needs_motion=True)
def yaw_rate_negated(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The body's yaw rate has the other sign."""
    for velocity in velocities(answer):
        velocity.angular.z = -velocity.angular.z


@planted(STREAM, source="outside", needs_motion=True)
def load_negated_in_stream(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Joint loads of the state stream have the other sign."""
    answer.joint_states.load[:] = [-load for load in answer.joint_states.load]


@planted(STREAM, source="outside")
def packet_stamps_in_another_clock(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The stamps of inertial packets are 199 s off the robot's clock."""
    for packet in answer.inertial_state.packets:
        shift(packet.timestamp, CLOCK_ERROR_S)


@planted(STREAM, source="outside", needs_motion=True)
def contacts_inverted_in_stream(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """A foot on the ground is streamed as lost, one in the air as made."""
    answer.contact_states[:] = [3 - contact for contact in answer.contact_states]


@planted(TIME_SYNC)
def clock_skew_negated(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The clock skew is client minus robot."""
    for estimate in (answer.previous_estimate, answer.state.best_estimate):
        if estimate.HasField("clock_skew"):
            skew = estimate.clock_skew
            skew.FromNanoseconds(-skew.ToNanoseconds())


@planted(TIME_SYNC)
def clock_skew_in_microseconds(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The clock skew is a thousandth of what it is."""
    skew = answer.state.best_estimate.clock_skew
    skew.FromNanoseconds(skew.ToNanoseconds() // 1000)


@planted(TIME_SYNC)
def clock_identifier_changes(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """Each answer gives the client another clock identifier."""
    memory["n"] = memory.get("n", 0) + 1
    answer.clock_identifier = f"{answer.clock_identifier}-{memory['n']}"


@planted(TIME_SYNC)
def round_trip_negative(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The round trip takes less than no time."""
    answer.state.best_estimate.round_trip_time.CopyFrom(Duration(nanos=-3_000_000))


@planted(STATE)
def left_and_right_exchanged(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Polled joints of left legs bear the names of right ones."""
    for joint in joint_states(answer):
        side = {"l": "r", "r": "l"}.get(joint.name[1], joint.name[1])
        joint.name = joint.name[0] + side + joint.name[2:]


@planted(STATE)
def joint_missing(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The last joint is not in the polled state."""
    del joint_states(answer)[11:12]


@planted(STATE)
def no_odom_frame(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The frame tree has no odom."""
    answer.robot_state.kinematic_state.transforms_snapshot.child_to_parent_edge_map.pop("odom", None)


@planted(STATE)
def quaternion_scalar_last_as_first(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The quaternions of the frame tree have their scalar in x."""
    for edge in answer.robot_state.kinematic_state.transforms_snapshot.child_to_parent_edge_map.values():
        q = edge.parent_tform_child.rotation
        q.x, q.y, q.z, q.w = q.w, q.x, q.y, q.z


@planted(STREAM)
def quaternion_not_of_length_one(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Streamed quaternions are 10 % too long."""
    q = answer.kinematic_state.odom_tform_body.rotation
    q.x, q.y, q.z, q.w = (1.1 * part for part in (q.x, q.y, q.z, q.w))


@planted(STATE)
def odom_edge_inverted(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The frame tree says where the body is in odom, not where odom is in the body."""
    pose = answer.robot_state.kinematic_state.transforms_snapshot.child_to_parent_edge_map["odom"].parent_tform_child
    x, y, z = rotated(pose.rotation, pose.position, back=True)
    pose.position.x, pose.position.y, pose.position.z = -x, -y, -z
    pose.rotation.x, pose.rotation.y, pose.rotation.z = -pose.rotation.x, -pose.rotation.y, -pose.rotation.z


@planted(STATE)
def kinematic_stamp_frozen(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """The polled kinematics always bear the stamp of the first."""
    stamp = answer.robot_state.kinematic_state.acquisition_timestamp
    stamp.CopyFrom(memory.setdefault("stamp", Timestamp(seconds=stamp.seconds, nanos=stamp.nanos)))


@planted(STATE)
def kinematic_stamp_in_another_clock(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The polled kinematics' stamp is 199 s off the robot's clock."""
    shift(answer.robot_state.kinematic_state.acquisition_timestamp, CLOCK_ERROR_S)


@planted(STATE)
def feet_reversed(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The feet come in the order hr, hl, fr, fl."""
    feet = list(answer.robot_state.foot_state)[::-1]
    copies = [robot_state_pb2.FootState.FromString(foot.SerializeToString()) for foot in feet]
    del answer.robot_state.foot_state[:]
    answer.robot_state.foot_state.extend(copies)


@planted(STREAM)
def stream_at_half_rate(_request: Any, answer: Any, memory: dict[str, Any]) -> list[Any]:
    """Every second state is left out."""
    memory["n"] = memory.get("n", 0) + 1
    return [answer] if memory["n"] % 2 else []


@planted(STREAM)
def stream_by_joint_kind(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Streamed joints come in Isaac Lab's order: all hx, all hy, all kn."""
    order = [3 * leg + kind for kind in range(3) for leg in range(4)]
    for values in (answer.joint_states.position, answer.joint_states.velocity, answer.joint_states.load):
        values[:] = [values[i] for i in order]


@planted(STREAM)
def acceleration_upside_down(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The inertial unit measures gravity with the other sign."""
    for packet in answer.inertial_state.packets:
        a = packet.acceleration_rt_odom_in_link_frame
        a.x, a.y, a.z = -a.x, -a.y, -a.z


@planted(STREAM)
def acceleration_in_g(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The inertial unit's accelerations are in units of g."""
    for packet in answer.inertial_state.packets:
        a = packet.acceleration_rt_odom_in_link_frame
        a.x, a.y, a.z = a.x / 9.81, a.y / 9.81, a.z / 9.81


@planted(STREAM, needs_motion=True)
def gyro_in_degrees(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The inertial unit's angular velocities are in degrees a second."""
    for packet in answer.inertial_state.packets:
        v = packet.angular_velocity_rt_odom_in_link_frame
        v.x, v.y, v.z = 57.3 * v.x, 57.3 * v.y, 57.3 * v.z


@planted(STREAM)
def one_packet_of_three(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Only the first inertial packet of each state is sent."""
    del answer.inertial_state.packets[1:]


@planted(STREAM)
def states_sent_twice(_request: Any, answer: Any, _memory: dict[str, Any]) -> list[Any]:
    """Every state is sent twice."""
    return [answer, answer]


@planted(STREAM)
def states_out_of_order(_request: Any, answer: Any, memory: dict[str, Any]) -> list[Any]:
    """Of two states, the later is sent first."""
    if "held" not in memory:
        memory["held"] = answer
        return []
    return [answer, memory.pop("held")]


@planted(STREAM)
def joints_frozen(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """All states carry the first's joint positions, velocities and loads, under new stamps."""
    stamp = Timestamp()
    stamp.CopyFrom(answer.joint_states.acquisition_timestamp)
    if "joints" not in memory:
        memory["joints"] = answer.joint_states.SerializeToString()
    answer.joint_states.ParseFromString(memory["joints"])
    answer.joint_states.acquisition_timestamp.CopyFrom(stamp)


@planted(STREAM, source=NAMED, needs_motion=True)
def acceleration_in_odom(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The inertial unit's acceleration is expressed in odom, not in its link."""
    for packet in answer.inertial_state.packets:
        a = packet.acceleration_rt_odom_in_link_frame
        a.x, a.y, a.z = rotated(packet.odom_rot_link, a, back=False)


@planted(STREAM, source=NAMED, needs_motion=True)
def acceleration_negated_sideways(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The inertial unit's horizontal accelerations have the other sign."""
    for packet in answer.inertial_state.packets:
        a = packet.acceleration_rt_odom_in_link_frame
        a.x, a.y = -a.x, -a.y


@planted(STREAM, source=NAMED, needs_motion=True)
def packets_60_ms_old(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """Inertial packets tell what was 60 ms ago, under present stamps."""
    told = memory.setdefault("packets", [])
    stamps = [packet.timestamp.ToNanoseconds() for packet in answer.inertial_state.packets]
    told.append(answer.inertial_state.SerializeToString())
    answer.inertial_state.ParseFromString(told[-21] if len(told) > 20 else told[0])
    for packet, stamp in zip(answer.inertial_state.packets, stamps, strict=True):
        packet.timestamp.FromNanoseconds(stamp)


@planted(STREAM, source=NAMED)
def packets_come_60_ms_late(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Inertial packets are of 60 ms ago, and say so."""
    for packet in answer.inertial_state.packets:
        shift(packet.timestamp, -0.06)


@planted(f"{STATE} {STREAM}", source=NAMED, needs_motion=True)
def contact_stuck(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The left front foot always has contact."""
    if hasattr(answer, "robot_state"):
        answer.robot_state.foot_state[0].contact = robot_state_pb2.FootState.CONTACT_MADE
    else:
        answer.contact_states[0] = robot_state_pb2.FootState.CONTACT_MADE


scaled("loads_halved", "Joint loads are half of what they are.", "load", 0.5, source=NAMED)
scaled("joint_velocities_scaled", "Joint velocities are 0.7 of what they are.", "velocity", 0.7, source=SIBLING)


@planted(f"{STATE} {STREAM}", source=SIBLING, needs_motion=True)
def body_velocities_scaled(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The body's linear velocity is 0.7 of what it is."""
    for velocity in velocities(answer):
        v = velocity.linear
        v.x, v.y, v.z = 0.7 * v.x, 0.7 * v.y, 0.7 * v.z


@planted(STREAM, source=SIBLING, needs_motion=True)
def joints_one_state_late(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """Streamed joints are those of the state before, under present stamps."""
    stamp = answer.joint_states.acquisition_timestamp.ToNanoseconds()
    now = answer.joint_states.SerializeToString()
    answer.joint_states.ParseFromString(memory.get("joints", now))
    answer.joint_states.acquisition_timestamp.FromNanoseconds(stamp)
    memory["joints"] = now


@planted(STATE, source=SIBLING, needs_motion=True)
def polls_80_ms_old(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """Polled kinematics are those of four polls before, under present stamps."""
    kinematics, told = answer.robot_state.kinematic_state, memory.setdefault("polls", [])
    stamp = kinematics.acquisition_timestamp.ToNanoseconds()
    told.append(kinematics.SerializeToString())
    kinematics.ParseFromString(told[-5] if len(told) > 4 else told[0])
    kinematics.acquisition_timestamp.FromNanoseconds(stamp)


@planted(f"{STATE} {STREAM}", source=SIBLING, needs_motion=True)
def quaternions_conjugated(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """All attitudes are those of the frames in the body, not of the body in the frames."""
    if hasattr(answer, "robot_state"):
        edges = answer.robot_state.kinematic_state.transforms_snapshot.child_to_parent_edge_map
        turns = [edges[frame].parent_tform_child.rotation for frame in ("odom", "vision")]
    else:
        told = answer.kinematic_state
        turns = [told.odom_tform_body.rotation, told.vision_tform_body.rotation]
        turns += [packet.odom_rot_link for packet in answer.inertial_state.packets]
    for q in turns:
        q.x, q.y, q.z = -q.x, -q.y, -q.z


@planted(STATE, source=SIBLING, needs_motion=True)
def feet_in_a_level_frame(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Feet are told in a frame at the body that stays level and does not turn."""
    edges = answer.robot_state.kinematic_state.transforms_snapshot.child_to_parent_edge_map
    for foot in answer.robot_state.foot_state:
        at = foot.foot_position_rt_body
        at.x, at.y, at.z = rotated(edges["odom"].parent_tform_child.rotation, at, back=True)


@planted(f"{STATE} {STREAM}", source=SIBLING, needs_motion=True)
def clock_two_percent_fast(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """Stamps of states are of a clock that runs 2 % fast."""
    stamps = [kinematics(answer).acquisition_timestamp]
    if not hasattr(answer, "robot_state"):
        stamps += [answer.joint_states.acquisition_timestamp, *(p.timestamp for p in answer.inertial_state.packets)]
    first_ns = memory.setdefault("first", stamps[0].ToNanoseconds())
    for stamp in stamps:
        shift(stamp, 0.02e-9 * (stamp.ToNanoseconds() - first_ns))


@planted(STREAM, source=SIBLING)
def packets_duplicated(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The second packet of each state is the first once more."""
    answer.inertial_state.packets[1].CopyFrom(answer.inertial_state.packets[0])


@planted(STREAM, source=SIBLING)
def packets_repeated_under_new_stamps(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """All packets of a state tell what the first tells, each under its own stamp."""
    first, *others = answer.inertial_state.packets
    for packet in others:
        stamp = packet.timestamp.ToNanoseconds()
        packet.CopyFrom(first)
        packet.timestamp.FromNanoseconds(stamp)


@planted(f"{STATE} {STREAM}", source=SIBLING, needs_motion=True)
def contacts_exchanged(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The contacts of the front feet are exchanged."""
    if hasattr(answer, "robot_state"):
        one, other, *_ = answer.robot_state.foot_state
        one.contact, other.contact = other.contact, one.contact
    else:
        answer.contact_states[:2] = answer.contact_states[1::-1]


@planted(STREAM, source=SIBLING, needs_motion=True)
def gyro_in_odom(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The inertial unit's turn rate is expressed in odom, not in its link."""
    for packet in answer.inertial_state.packets:
        v = packet.angular_velocity_rt_odom_in_link_frame
        v.x, v.y, v.z = rotated(packet.odom_rot_link, v, back=False)


@planted(STREAM, source=SIBLING, needs_motion=True)
def receipt_in_another_clock(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The time at which the last command was received is 199 s off the robot's clock."""
    if answer.last_command.user_command_key:
        shift(answer.last_command.received_timestamp, CLOCK_ERROR_S)
