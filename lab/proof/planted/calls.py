"""Errors of what a server accepts: logins, leases, e-stops, power, commands and joint control."""

from __future__ import annotations

from typing import Any

from bosdyn.api import estop_pb2, header_pb2, lease_pb2, license_pb2, power_pb2, robot_command_pb2, robot_state_pb2

from proof.planted.planting import (
    ACQUIRE,
    ANY,
    AUTH,
    COMMAND,
    ESTOP_CHECK_IN,
    ESTOP_REGISTER,
    FEATURES,
    FEEDBACK,
    JOINTS,
    LICENCE,
    NAMED,
    POWER,
    RETURN,
    SERVICES,
    SIBLING,
    STATE,
    TAKE,
    Hook,
    planted,
    shift,
)


@planted(ESTOP_CHECK_IN, source="outside")
def estop_challenge_unchecked(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
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
        shift(mobility.se2_velocity_request.end_time, 5.0)


@planted(ANY, source="outside")
def headers_not_echoed(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """Answers do not echo the request's header."""
    if hasattr(answer, "header"):
        answer.header.ClearField("request_header")


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
        shift(answer.header.request_received_timestamp, 5.0)


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


@planted(asks=JOINTS, needs_motion=True)
def load_setpoint_negated(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """Load set-points act with the other sign."""
    request.joint_command.load[:] = [-load for load in request.joint_command.load]


@planted(asks=JOINTS, needs_motion=True)
def gains_halved(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    """Joints are driven with half the stiffness that was asked for."""
    gains = request.joint_command.gains
    gains.k_q_p[:] = [0.5 * gain for gain in gains.k_q_p]


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
        shift(request.joint_command.end_time, 9.0)


planted(POWER, of="joint_commands_never_end")(_power_is_known)


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


@planted(RETURN, source=SIBLING)
def leases_are_never_returned(_request: Any, answer: Any, _memory: dict[str, Any]) -> None:
    """A lease that was returned stays with its owner."""
    answer.status = lease_pb2.ReturnLeaseResponse.STATUS_OK


@planted(asks=RETURN, of="leases_are_never_returned")
def _returns_nothing(request: Any, _answer: Any, _memory: dict[str, Any]) -> None:
    request.lease.epoch = "another"
