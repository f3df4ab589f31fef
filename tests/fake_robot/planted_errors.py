"""Errors that a server of Spot's API can have, each as a change of what a right one receives or answers.

They were listed from the vendor's API, not from the checks of ``spot-rl fake-robot conformance``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bosdyn.api import (
    estop_pb2,
    header_pb2,
    lease_pb2,
    license_pb2,
    power_pb2,
    robot_command_pb2,
    robot_state_pb2,
)
from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp

NS_PER_S = 1_000_000_000
CLOCK_ERROR_S = 199.0

AUTH = "AuthService/GetAuthToken"
ROBOT_ID = "RobotIdService/GetRobotId"
SERVICES = "DirectoryService/ListServiceEntries"
SERVICE = "DirectoryService/GetServiceEntry"
LICENCE = "LicenseService/GetLicenseInfo"
FEATURES = "LicenseService/GetFeatureEnabled"
TIME_SYNC = "TimeSyncService/TimeSyncUpdate"
STATE = "RobotStateService/GetRobotState"
HARDWARE = "RobotStateService/GetRobotHardwareConfiguration"
STREAM = "RobotStateStreamingService/GetRobotStateStream"
ACQUIRE = "LeaseService/AcquireLease"
TAKE = "LeaseService/TakeLease"
RETURN = "LeaseService/ReturnLease"
RETAIN = "LeaseService/RetainLease"
LEASES = "LeaseService/ListLeases"
ESTOP_REGISTER = "EstopService/RegisterEstopEndpoint"
ESTOP_CHECK_IN = "EstopService/EstopCheckIn"
ESTOP_STATUS = "EstopService/GetEstopSystemStatus"
POWER = "PowerService/PowerCommand"
POWER_FEEDBACK = "PowerService/PowerCommandFeedback"
COMMAND = "RobotCommandService/RobotCommand"
FEEDBACK = "RobotCommandService/RobotCommandFeedback"
CLEAR_FAULT = "RobotCommandService/ClearBehaviorFault"
JOINTS = "RobotCommandStreamingService/JointControlStream"
FAULT_CLEAR = "FaultService/ClearServiceFault"
ANY = "*"

Hook = Callable[[Any, Any, dict[str, Any]], Any]
"""Changes an answer or a stream's message in place, or returns what is sent instead: (request, answer, memory)."""


@dataclass
class PlantedError:
    """One error.

    Attributes:
        name: Unique.
        what: What is wrong with the server.
        source: ``outside`` or, later, ``named`` if others planted it and it was missed; ``sibling`` if it is a relative
            of one that was, ``own`` otherwise.
        needs_motion: Whether it shows only on a robot with power.
        asks: What it changes in requests before the right server sees them, by method.
        answers: What it changes in answers and streams, by method.
    """

    name: str
    what: str
    source: str
    needs_motion: bool
    asks: dict[str, Hook] = field(default_factory=dict)
    answers: dict[str, Hook] = field(default_factory=dict)


ERRORS: dict[str, PlantedError] = {}


def planted(
    answers: str = "", *, asks: str = "", source: str = "own", needs_motion: bool = False, of: str = ""
) -> Callable[[Hook], Hook]:
    """Enter a function as an error, or as a further part of the error ``of``; method names are separated by spaces."""

    def enter(hook: Hook) -> Hook:
        name = of or hook.__name__
        error = ERRORS.setdefault(name, PlantedError(name, hook.__doc__ or "", source, needs_motion))
        error.asks |= dict.fromkeys(asks.split(), hook)
        error.answers |= dict.fromkeys(answers.split(), hook)
        return hook

    return enter


def _changed(
    name: str, what: str, methods: str, path: str, value: Any, *, source: str = "own", needs_motion: bool = False
) -> None:
    """Enter an error of one field: another value, what a function makes of it, or None for none at all.

    A star in the path stands for every element of a repeated field.
    """
    *parents, field_name = path.split(".")

    def change(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
        messages = [answer]
        for parent in parents:
            found = messages if parent == "*" else [getattr(message, parent) for message in messages]
            messages = [part for message in found for part in message] if parent == "*" else found
        for message in messages:
            if value is None:
                message.ClearField(field_name)
            else:
                setattr(message, field_name, value(getattr(message, field_name)) if callable(value) else value)

    change.__name__, change.__doc__ = name, what
    planted(methods, source=source, needs_motion=needs_motion)(change)


def _shift(stamp: Timestamp, seconds: float) -> None:
    stamp.FromNanoseconds(stamp.ToNanoseconds() + round(seconds * NS_PER_S))


def _kinematics(answer: Any) -> Any:
    return answer.robot_state.kinematic_state if hasattr(answer, "robot_state") else answer.kinematic_state


def _velocities(answer: Any) -> list[Any]:
    kinematics = _kinematics(answer)
    return [kinematics.velocity_of_body_in_odom, kinematics.velocity_of_body_in_vision]


def _rotated(q: Any, v: Any, *, back: bool) -> tuple[float, float, float]:
    w, x, y, z = q.w, q.x, q.y, q.z
    if back:
        x, y, z = -x, -y, -z
    tx, ty, tz = 2 * (y * v.z - z * v.y), 2 * (z * v.x - x * v.z), 2 * (x * v.y - y * v.x)
    return (
        v.x + w * tx + y * tz - z * ty,
        v.y + w * ty + z * tx - x * tz,
        v.z + w * tz + x * ty - y * tx,
    )


def _joint_states(answer: Any) -> Any:
    return answer.robot_state.kinematic_state.joint_states


# ---- missed by the suite before, in the words of those who planted them ----


@planted(f"{STATE} {STREAM}", source="outside", needs_motion=True)
def body_velocity_negated(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The body's linear velocity has the other sign."""
    for velocity in _velocities(answer):
        velocity.linear.x, velocity.linear.y = -velocity.linear.x, -velocity.linear.y


@planted(f"{STATE} {STREAM}", source="outside", needs_motion=True)
def body_velocity_in_body(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """The body's linear velocity is expressed in the body, not in odom and vision."""
    if hasattr(answer, "robot_state"):
        edges = answer.robot_state.kinematic_state.transforms_snapshot.child_to_parent_edge_map
        rotations = [(edges[frame].parent_tform_child.rotation, False) for frame in ("odom", "vision")]
    else:
        poses = answer.kinematic_state.odom_tform_body, answer.kinematic_state.vision_tform_body
        rotations = [(pose.rotation, True) for pose in poses]
    for velocity, (rotation, back) in zip(_velocities(answer), rotations, strict=True):
        linear = velocity.linear
        linear.x, linear.y, linear.z = _rotated(rotation, linear, back=back)


@planted(f"{STATE} {STREAM}", source="outside", needs_motion=True)
def yaw_rate_negated(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The body's yaw rate has the other sign."""
    for velocity in _velocities(answer):
        velocity.angular.z = -velocity.angular.z


@planted(STREAM, source="outside", needs_motion=True)
def load_negated_in_stream(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Joint loads of the state stream have the other sign."""
    answer.joint_states.load[:] = [-load for load in answer.joint_states.load]


@planted(STREAM, source="outside")
def packet_stamps_in_another_clock(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The stamps of inertial packets are 199 s off the robot's clock."""
    for packet in answer.inertial_state.packets:
        _shift(packet.timestamp, CLOCK_ERROR_S)


@planted(STREAM, source="outside", needs_motion=True)
def contacts_inverted_in_stream(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """A foot on the ground is streamed as lost, one in the air as made."""
    answer.contact_states[:] = [3 - contact for contact in answer.contact_states]


@planted(ESTOP_CHECK_IN, source="outside")
def estop_challenge_unchecked(request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The e-stop accepts a check-in with a wrong response to its challenge."""
    if answer.status == estop_pb2.EstopCheckInResponse.STATUS_INCORRECT_CHALLENGE_RESPONSE:
        answer.status = estop_pb2.EstopCheckInResponse.STATUS_OK


@planted(FEEDBACK, source="outside", needs_motion=True)
def velocity_command_never_ends(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """A velocity command is processed for ever, past its end time."""
    mobility = answer.feedback.synchronized_feedback.mobility_command_feedback
    if mobility.WhichOneof("feedback") == "se2_velocity_feedback":
        mobility.status = 1  # STATUS_PROCESSING


@planted(asks=COMMAND, of="velocity_command_never_ends")
def _ends_late(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    mobility = request.command.synchronized_command.mobility_command
    if mobility.WhichOneof("command") == "se2_velocity_request":
        _shift(mobility.se2_velocity_request.end_time, 5.0)


@planted(ANY, source="outside")
def headers_not_echoed(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Answers do not echo the request's header."""
    if hasattr(answer, "header"):
        answer.header.ClearField("request_header")


# ---- auth, identity, directory, licence, headers ----


@planted(AUTH)
def any_password_will_do(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """A wrong password gets a token."""
    memory["token"] = answer.token or memory.get("token", "")
    if not answer.token:
        answer.status, answer.token = 1, memory["token"] or "token"


@planted()
def no_token_needed(_request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """Calls without a token are served; the server fills in the token that it knows."""


@planted(SERVICES)
def directory_lacks_joint_control(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """robot-command-streaming is not in the directory."""
    kept = [entry for entry in answer.service_entries if entry.name != "robot-command-streaming"]
    del answer.service_entries[:]
    answer.service_entries.extend(kept)


@planted(SERVICES)
def directory_of_a_wrong_type(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The service robot-state is listed with the type of another."""
    for entry in answer.service_entries:
        if entry.name == "robot-state":
            entry.type = "bosdyn.api.RobotCommandService"


@planted(SERVICES)
def directory_without_authority(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The lease service has no authority, so that no client can address it."""
    for entry in answer.service_entries:
        if entry.name == "lease":
            entry.authority = ""


@planted(LICENCE)
def licence_of_another_robot(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The licence is valid, but for another serial number."""
    answer.license.robot_serial = "spot-BD-00000000"
    answer.license.status = license_pb2.LicenseInfo.STATUS_VALID


@planted(FEATURES)
def licence_is_silent(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Whether a feature is licensed is not answered."""
    answer.feature_enabled.clear()


@planted(ANY)
def header_without_times(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Answers do not say when they were sent."""
    if hasattr(answer, "header"):
        answer.header.ClearField("response_timestamp")


@planted(ANY)
def header_times_reversed(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """A request is received five seconds after it was answered."""
    if hasattr(answer, "header") and answer.header.HasField("request_received_timestamp"):
        _shift(answer.header.request_received_timestamp, 5.0)


# ---- time sync ----


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


# ---- the state, polled ----


@planted(STATE)
def left_and_right_exchanged(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Polled joints of left legs bear the names of right ones."""
    for joint in _joint_states(answer):
        side = {"l": "r", "r": "l"}.get(joint.name[1], joint.name[1])
        joint.name = joint.name[0] + side + joint.name[2:]


@planted(STATE)
def joint_missing(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The last joint is not in the polled state."""
    del _joint_states(answer)[11:12]


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
    x, y, z = _rotated(pose.rotation, pose.position, back=True)
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
    _shift(answer.robot_state.kinematic_state.acquisition_timestamp, CLOCK_ERROR_S)


@planted(STATE)
def feet_reversed(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The feet come in the order hr, hl, fr, fl."""
    feet = list(answer.robot_state.foot_state)[::-1]
    copies = [robot_state_pb2.FootState.FromString(foot.SerializeToString()) for foot in feet]
    del answer.robot_state.foot_state[:]
    answer.robot_state.foot_state.extend(copies)


# ---- the state, streamed ----


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


# ---- leases ----


@planted(ACQUIRE)
def lease_for_everybody(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """A lease that another client holds is given out again."""
    if answer.status == lease_pb2.AcquireLeaseResponse.STATUS_OK:
        memory["lease"] = answer.lease.SerializeToString()
    elif answer.status == lease_pb2.AcquireLeaseResponse.STATUS_RESOURCE_ALREADY_CLAIMED and "lease" in memory:
        answer.status = lease_pb2.AcquireLeaseResponse.STATUS_OK
        answer.lease.ParseFromString(memory["lease"])


@planted(f"{ACQUIRE} {TAKE}")
def lease_sequence_stands_still(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """Every lease has the same sequence."""
    if answer.lease.sequence:
        answer.lease.sequence[:] = memory.setdefault("sequence", list(answer.lease.sequence))


@planted(ACQUIRE)
def lease_of_a_banana(request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """A resource that the robot does not have is leased."""
    if answer.status == lease_pb2.AcquireLeaseResponse.STATUS_INVALID_RESOURCE:
        answer.status = lease_pb2.AcquireLeaseResponse.STATUS_OK
        answer.lease.CopyFrom(lease_pb2.Lease(resource=request.resource, epoch="epoch", sequence=[1]))


# ---- e-stop ----


@planted(ESTOP_CHECK_IN)
def estop_of_a_stranger(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """An endpoint that is not registered may check in."""
    if answer.status == estop_pb2.EstopCheckInResponse.STATUS_ENDPOINT_UNKNOWN:
        answer.status = estop_pb2.EstopCheckInResponse.STATUS_OK


@planted(ESTOP_REGISTER)
def estop_configuration_unchecked(request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """An endpoint of another configuration may register."""
    if answer.status != estop_pb2.RegisterEstopEndpointResponse.STATUS_SUCCESS:
        answer.status = estop_pb2.RegisterEstopEndpointResponse.STATUS_SUCCESS
        answer.new_endpoint.CopyFrom(request.new_endpoint)
        answer.new_endpoint.unique_id = "endpoint"


# ---- power ----


def _grant_power(request: Any, answer: Any, memory: dict[str, Any]) -> None:
    on = request.request in (power_pb2.PowerCommandRequest.REQUEST_ON, power_pb2.PowerCommandRequest.REQUEST_ON_MOTORS)
    memory["granted"] = on and answer.status not in (power_pb2.STATUS_SUCCESS, power_pb2.STATUS_IN_PROGRESS)
    if memory["granted"]:
        answer.status, answer.power_command_id = power_pb2.STATUS_SUCCESS, 77
        answer.license_status = license_pb2.LicenseInfo.STATUS_VALID
        answer.lease_use_result.status = lease_pb2.LeaseUseResult.STATUS_OK
        answer.header.error.code = header_pb2.CommonError.CODE_OK
        memory["times"] = memory.get("times", 0) + 1


def _show_power(answer: Any, memory: dict[str, Any]) -> None:
    if memory.get("granted"):
        answer.robot_state.power_state.motor_power_state = robot_state_pb2.PowerState.MOTOR_POWER_STATE_ON


@planted(POWER, needs_motion=True)
def power_for_anybody(request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """Motors get power without a lease, and whatever the e-stop says."""
    _grant_power(request, answer, memory)


@planted(STATE, of="power_for_anybody")
def _power_for_anybody_shown(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    _show_power(answer, memory)


@planted(STATE, needs_motion=True)
def motors_stay_on(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """Motors that were on once are reported on for ever."""
    state = answer.robot_state.power_state
    memory["on"] = memory.get("on", False) or state.motor_power_state == state.MOTOR_POWER_STATE_ON
    if memory["on"]:
        state.motor_power_state = state.MOTOR_POWER_STATE_ON


# ---- commands ----


def _accept(*names: str) -> Hook:
    wrong = [robot_command_pb2.RobotCommandResponse.Status.Value(name) for name in names]

    def accept(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
        if answer.status in wrong:
            memory["id"] = memory.get("id", 900) + 1
            answer.status, answer.robot_command_id = robot_command_pb2.RobotCommandResponse.STATUS_OK, memory["id"]
            answer.message = ""
            answer.header.error.ClearField("message")
            answer.header.error.code = header_pb2.CommonError.CODE_OK

    return accept


def _accepting(name: str, what: str, *statuses: str, needs_motion: bool = False) -> None:
    hook = _accept(*statuses)
    hook.__name__, hook.__doc__ = name, what
    planted(COMMAND, needs_motion=needs_motion)(hook)


_accepting("commands_after_their_end", "A command whose end time has passed is accepted.", "STATUS_EXPIRED")
_accepting("commands_of_next_year", "A command that ends in the far future is accepted.", "STATUS_TOO_DISTANT")
_accepting("commands_without_power", "Commands are accepted while the motors are off.", "STATUS_NOT_POWERED_ON")
_accepting("commands_in_any_frame", "A frame that does not exist is accepted.", "STATUS_UNKNOWN_FRAME")
_accepting(
    "commands_of_nonsense", "Empty and malformed commands are accepted.", "STATUS_INVALID_REQUEST", "STATUS_UNSUPPORTED"
)
_accepting("commands_of_another_clock", "A wrong clock identifier is accepted.", "STATUS_NO_TIMESYNC")


@planted(COMMAND)
def commands_without_a_lease(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """A command with a wrong lease, or none, is judged as if it had a right one."""
    result = answer.lease_use_result
    if result.status != result.STATUS_OK:
        result.status, answer.status = result.STATUS_OK, robot_command_pb2.RobotCommandResponse.STATUS_OK
        answer.robot_command_id = answer.robot_command_id or 901
        answer.header.error.code = header_pb2.CommonError.CODE_OK


@planted(COMMAND, needs_motion=True)
def command_ids_alike(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """All commands get the same identifier."""
    if answer.robot_command_id:
        memory["id"] = answer.robot_command_id
        answer.robot_command_id = 7


@planted(asks=FEEDBACK, of="command_ids_alike")
def _real_id(request: Any, _answer: Any, memory: dict[str, Any]) -> None:
    if request.robot_command_id == 7:
        request.robot_command_id = memory.get("id", 0)


@planted(FEEDBACK, needs_motion=True)
def stands_at_once(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The feedback says that the robot stands when it has just been told to."""
    mobility = answer.feedback.synchronized_feedback.mobility_command_feedback
    if mobility.WhichOneof("feedback") == "stand_feedback":
        mobility.stand_feedback.status = mobility.stand_feedback.STATUS_IS_STANDING


@planted(FEEDBACK, needs_motion=True)
def never_stands(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The feedback never says that the robot stands."""
    mobility = answer.feedback.synchronized_feedback.mobility_command_feedback
    if mobility.WhichOneof("feedback") == "stand_feedback":
        mobility.stand_feedback.status = mobility.stand_feedback.STATUS_IN_PROGRESS


@planted(asks=COMMAND, needs_motion=True)
def walks_to_the_other_side(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """A velocity to the left walks to the right, and a turn goes the other way."""
    mobility = request.command.synchronized_command.mobility_command
    if mobility.WhichOneof("command") == "se2_velocity_request":
        velocity = mobility.se2_velocity_request.velocity
        velocity.linear.y, velocity.angular = -velocity.linear.y, -velocity.angular


# ---- joint control ----


@planted(asks=JOINTS, needs_motion=True)
def load_setpoint_negated(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """Load set-points act with the other sign."""
    request.joint_command.load[:] = [-load for load in request.joint_command.load]


@planted(asks=JOINTS, needs_motion=True)
def gains_halved(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """Joints are driven with half the stiffness that was asked for."""
    gains = request.joint_command.gains
    gains.k_q_p[:] = [0.5 * gain for gain in gains.k_q_p]


# ---- faults ----


@planted(STATE)
def service_faults_stay(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """A fault that was cleared stays in the state."""
    faults = answer.robot_state.service_fault_state.faults
    known = memory.setdefault("faults", {})
    for fault in faults:
        known[fault.fault_id.fault_name, fault.fault_id.service_name] = fault.SerializeToString()
    del faults[:]
    for kept in known.values():
        faults.add().ParseFromString(kept)


# ---- missed by the suite later, in the words of those who planted them ----

NAMED, SIBLING = "named", "sibling"


@planted(STREAM, source=NAMED, needs_motion=True)
def acceleration_in_odom(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The inertial unit's acceleration is expressed in odom, not in its link."""
    for packet in answer.inertial_state.packets:
        a = packet.acceleration_rt_odom_in_link_frame
        a.x, a.y, a.z = _rotated(packet.odom_rot_link, a, back=False)


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
        _shift(packet.timestamp, -0.06)


@planted(ESTOP_CHECK_IN, source=NAMED)
def estop_response_unchecked(request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """The e-stop knows its challenges, and accepts any response to them."""
    if memory.get("challenge") == request.challenge:
        answer.status = estop_pb2.EstopCheckInResponse.STATUS_OK
    memory["challenge"] = answer.challenge


@planted(COMMAND, source=NAMED, needs_motion=True)
def expired_commands_with_power(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """The server looks at power first, and then at end times not at all."""
    kinds = robot_command_pb2.RobotCommandResponse
    if answer.status in {kinds.STATUS_EXPIRED, kinds.STATUS_TOO_DISTANT, kinds.STATUS_UNKNOWN_FRAME}:
        if not memory.get("on"):
            answer.status = kinds.STATUS_NOT_POWERED_ON
        elif answer.status == kinds.STATUS_EXPIRED:
            answer.status = kinds.STATUS_OK


@planted(POWER, of="expired_commands_with_power")
def _power_is_known(request: Any, _answer: Any, memory: dict[str, Any]) -> None:
    memory["on"] = request.request == power_pb2.PowerCommandRequest.REQUEST_ON_MOTORS


@planted(COMMAND, source=NAMED)
def stops_without_power(request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """A stop is accepted while the motors are off."""
    if request.command.full_body_command.HasField("stop_request"):
        answer.status = robot_command_pb2.RobotCommandResponse.STATUS_OK


@planted(asks=JOINTS, source=NAMED, needs_motion=True)
def gains_six_tenths(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """Joints are driven with 0.6 of the stiffness and of the damping that were asked for."""
    for gains in (request.joint_command.gains.k_q_p, request.joint_command.gains.k_qd_p):
        gains[:] = [0.6 * gain for gain in gains]


@planted(asks=JOINTS, source=NAMED, needs_motion=True)
def no_damping(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """Joints are driven without damping."""
    gains = request.joint_command.gains.k_qd_p
    gains[:] = [0.0 for _ in gains]


@planted(asks=JOINTS, source=NAMED, needs_motion=True)
def joint_commands_never_end(request: Any, _answer: Any, memory: dict[str, Any]) -> None:
    """A joint command of a robot with power holds past its end time."""
    if memory.get("on"):
        _shift(request.joint_command.end_time, 9.0)


planted(POWER, of="joint_commands_never_end")(_power_is_known)


@planted(f"{STATE} {STREAM}", source=NAMED, needs_motion=True)
def contact_stuck(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The left front foot always has contact."""
    if hasattr(answer, "robot_state"):
        answer.robot_state.foot_state[0].contact = robot_state_pb2.FootState.CONTACT_MADE
    else:
        answer.contact_states[0] = robot_state_pb2.FootState.CONTACT_MADE


def _scaled(name: str, what: str, values: str, factor: float, *, source: str) -> None:
    """Enter an error of both reports: one row of the joints is scaled."""

    def scale(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
        if hasattr(answer, "robot_state"):
            for joint in _joint_states(answer):
                getattr(joint, values).value *= factor
        else:
            told = getattr(answer.joint_states, values)
            told[:] = [factor * value for value in told]

    scale.__name__, scale.__doc__ = name, what
    planted(f"{STATE} {STREAM}", source=source, needs_motion=True)(scale)


_scaled("loads_halved", "Joint loads are half of what they are.", "load", 0.5, source=NAMED)

# ---- siblings of those, of our own invention, entered before it was known which are found ----

_scaled("joint_velocities_scaled", "Joint velocities are 0.7 of what they are.", "velocity", 0.7, source=SIBLING)


@planted(f"{STATE} {STREAM}", source=SIBLING, needs_motion=True)
def body_velocities_scaled(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The body's linear velocity is 0.7 of what it is."""
    for velocity in _velocities(answer):
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
        at.x, at.y, at.z = _rotated(edges["odom"].parent_tform_child.rotation, at, back=True)


@planted(f"{STATE} {STREAM}", source=SIBLING, needs_motion=True)
def clock_two_percent_fast(_request: Any, answer: Any, memory: dict[str, Any]) -> None:
    """Stamps of states are of a clock that runs 2 % fast."""
    stamps = [_kinematics(answer).acquisition_timestamp]
    if not hasattr(answer, "robot_state"):
        stamps += [answer.joint_states.acquisition_timestamp, *(p.timestamp for p in answer.inertial_state.packets)]
    first_ns = memory.setdefault("first", stamps[0].ToNanoseconds())
    for stamp in stamps:
        _shift(stamp, 0.02e-9 * (stamp.ToNanoseconds() - first_ns))


@planted(asks=JOINTS, source=SIBLING, needs_motion=True)
def stiffness_of_one_joint(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """One knee is driven with a weak stiffness of its own."""
    if request.joint_command.gains.k_q_p:
        request.joint_command.gains.k_q_p[5] = 150.0


@planted(asks=JOINTS, source=SIBLING, needs_motion=True)
def velocity_setpoints_ignored(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """Velocity set-points count as zero."""
    request.joint_command.velocity[:] = [0.0 for _ in request.joint_command.velocity]


@planted(asks=JOINTS, source=SIBLING, needs_motion=True)
def load_setpoints_halved(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """Half of the load set-point acts."""
    request.joint_command.load[:] = [0.5 * load for load in request.joint_command.load]


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
        v.x, v.y, v.z = _rotated(packet.odom_rot_link, v, back=False)


@planted(STREAM, source=SIBLING, needs_motion=True)
def receipt_in_another_clock(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """The time at which the last command was received is 199 s off the robot's clock."""
    if answer.last_command.user_command_key:
        _shift(answer.last_command.received_timestamp, CLOCK_ERROR_S)


@planted(RETURN, source=SIBLING)
def leases_are_never_returned(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """A lease that was returned stays with its owner."""
    answer.status = lease_pb2.ReturnLeaseResponse.STATUS_OK


@planted(asks=RETURN, of="leases_are_never_returned")
def _returns_nothing(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    request.lease.epoch = "another"


# ---- one field ----


# fmt: off
_changed("motor_state_always_on", "The motors are reported on whatever they are.",
         STATE, "robot_state.power_state.motor_power_state",
         robot_state_pb2.PowerState.MOTOR_POWER_STATE_ON, source="outside")
_changed("motor_state_always_off", "The motors are reported off whatever they are.",
         STATE, "robot_state.power_state.motor_power_state",
         robot_state_pb2.PowerState.MOTOR_POWER_STATE_OFF, source="outside", needs_motion=True)
_changed("load_negated_in_poll", "Joint loads of GetRobotState have the other sign.",
         STATE, "robot_state.kinematic_state.joint_states.*.load.value",
         lambda x: -x, source="outside", needs_motion=True)
_changed("contacts_inverted_in_poll", "A foot on the ground is polled as lost, one in the air as made.",
         STATE, "robot_state.foot_state.*.contact", lambda x: 3 - x, source="outside", needs_motion=True)
_changed("robot_without_serial", "The robot has no serial number.", ROBOT_ID, "robot_id.serial_number", "")
_changed("directory_finds_anything", "A service that does not exist is answered with OK and an empty entry.",
         SERVICE, "status", 1)
_changed("header_without_code", "Unary answers leave the error code unspecified.",
         f"{STATE} {ESTOP_STATUS} {LEASES} {TIME_SYNC} {ROBOT_ID} {SERVICES}", "header.error.code",
         header_pb2.CommonError.CODE_UNSPECIFIED)
_changed("time_sync_never_ends", "Time synchronisation always needs more samples.", TIME_SYNC, "state.status", 2)
_changed("positions_in_degrees", "Polled joint positions are in degrees.",
         STATE, "robot_state.kinematic_state.joint_states.*.position.value", lambda x: x * 57.29578)
_changed("feet_mirrored_upwards", "The feet are above the body.",
         STATE, "robot_state.foot_state.*.foot_position_rt_body.z", lambda x: -x)
_changed("battery_as_a_fraction", "The battery's charge is a fraction, not a percentage.",
         STATE, "robot_state.battery_states.*.charge_percentage.value", lambda x: x / 100.0)
_changed("battery_in_millivolts", "The battery's voltage is in millivolts.",
         STATE, "robot_state.battery_states.*.voltage.value", lambda x: x * 1000.0)
_changed("estop_not_in_the_state", "The state has no e-stops.", STATE, "robot_state.estop_states", None)
_changed("estop_in_the_state_never_stopped", "The state's e-stops are released whatever they are.",
         STATE, "robot_state.estop_states.*.state", robot_state_pb2.EStopState.STATE_NOT_ESTOPPED)
_changed("always_standing", "The robot says that it stands, with its motors off.",
         STATE, "robot_state.behavior_state.state", robot_state_pb2.BehaviorState.STATE_STANDING)
_changed("acceleration_without_gravity", "The inertial unit measures no gravity.",
         STREAM, "inertial_state.packets.*.acceleration_rt_odom_in_link_frame.z", lambda x: x - 9.81)
_changed("command_key_not_echoed", "The last command's key is not in the stream.",
         STREAM, "last_command", None, needs_motion=True)
_changed("lost_lease_retained", "A lease that was taken away can still be retained.",
         RETAIN, "lease_use_result.status", lease_pb2.LeaseUseResult.STATUS_OK)
_changed("owners_not_listed", "The list of leases names no owner.", LEASES, "resources.*.lease_owner", None)
_changed("any_lease_can_be_returned", "A lease that its bearer does not hold is accepted as returned.",
         RETURN, "status", lease_pb2.ReturnLeaseResponse.STATUS_OK)
_changed("lease_result_missing", "Answers do not say what the lease was worth.",
         f"{COMMAND} {POWER} {RETAIN}", "lease_use_result", None)
_changed("estop_endpoints_not_listed", "The e-stop's status lists no endpoint.",
         ESTOP_STATUS, "status.endpoints", None)
_changed("estop_always_released", "The e-stop's status is released, whatever its endpoints ask for.",
         ESTOP_STATUS, "status.stop_level", estop_pb2.ESTOP_LEVEL_NONE)
_changed("power_feedback_of_nothing_succeeds", "A power command that was never given has succeeded.",
         POWER_FEEDBACK, "status", power_pb2.STATUS_SUCCESS)
_changed("clears_faults_that_are_not", "A behaviour fault that does not exist is cleared.",
         CLEAR_FAULT, "status", robot_command_pb2.ClearBehaviorFaultResponse.STATUS_CLEARED)
_changed("joint_stream_always_ok",
         "A stream of joint commands ends with OK whatever was sent, and whatever the robot's mode.",
         JOINTS, "status", robot_command_pb2.JointControlStreamResponse.STATUS_OK)
_changed("joint_stream_without_words", "A stream of joint commands that is refused gets no reason.",
         JOINTS, "message", "")
_changed("service_faults_not_shown", "A fault that a service raised is not in the state.",
         STATE, "robot_state.service_fault_state.faults", None)
_changed("service_faults_without_a_time", "A service's fault does not say since when.",
         STATE, "robot_state.service_fault_state.faults.*.onset_timestamp", None)
_changed("battery_current_negated", "The battery's current is positive while it discharges.",
         STATE, "robot_state.battery_states.*.current.value", lambda x: -x, source=NAMED)
_changed("battery_in_kelvin", "The motors' temperatures are in kelvins.",
         STATE, "robot_state.system_state.motor_temperatures.*.temperature", lambda x: x + 273.15, source=SIBLING)
_changed("power_never_comes", "The feedback never says that the motors have got power.",
         POWER_FEEDBACK, "status", power_pb2.STATUS_IN_PROGRESS, source=SIBLING, needs_motion=True)
_changed("estop_always_pressed", "The e-stop's status is a cut, whatever its endpoints ask for.",
         ESTOP_STATUS, "status.stop_level", estop_pb2.ESTOP_LEVEL_CUT, source=SIBLING)
# fmt: on
