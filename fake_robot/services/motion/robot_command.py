"""RobotCommandService: stand, sit, stop, freeze, joint control, safe power-off, and how they go."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Any

from bosdyn.api import lease_pb2, robot_command_pb2

from fake_robot.network.status import EstopLevel, MotorPower
from fake_robot.services.calls.access import refuse_request
from fake_robot.services.motion import commands
from fake_robot.services.motion.commands import WALKS, Command, Verb
from fake_robot.services.motion.feedback import feedback
from fake_robot.services.motion.refusals import (
    BehaviorFaultError,
    ExpiredCommandError,
    InvalidCommandError,
    NotPoweredOnError,
    RefusedCommandError,
    TooDistantCommandError,
    UnsupportedCommandError,
)
from fake_robot.services.motion.walk_params import WalkBounds
from fake_robot.services.reports.robot_state_message import behavior_fault_message
from fake_robot.services.sensors.world import World

MAX_COMMANDS = 1024
Response = robot_command_pb2.RobotCommandResponse


class RobotCommandService:
    """Starts motions and tells how they go. The newest command replaces the one before."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._bounds = WalkBounds(world.config.max_walking_speed_m_s, world.config.max_turn_rate_rad_s)
        self._lock = threading.Lock()
        self._commands: OrderedDict[int, tuple[Command, lease_pb2.LeaseUseResult]] = OrderedDict()
        self._last_id = 0

    def RobotCommand(self, request: Any) -> Any:  # noqa: N802
        """Begin a motion; needs the lease, the motors' power and no uncleared behaviour fault."""
        response = Response(lease_use_result=self._world.leases.use(request.lease))
        if response.lease_use_result.status != lease_pb2.LeaseUseResult.STATUS_OK:
            response.status = Response.STATUS_INVALID_REQUEST
            response.message = "the lease is not good: see lease_use_result"
            return response
        if not self._has_time_sync(request):
            response.status = Response.STATUS_NO_TIMESYNC
            response.message = (
                f"clock_identifier {request.clock_identifier!r} is not that of a client that has finished its time "
                "sync with this robot; wait for time sync before the first command"
            )
            return response
        try:
            command = commands.parse(request.command, self._bounds)
            self._check_end_time(command)
            self._check_state(command)
            with self._lock:
                commands.start(command, self._world.robot)
                self._last_id += 1
                self._commands[self._last_id] = command, response.lease_use_result
                response.robot_command_id = self._last_id
                while len(self._commands) > MAX_COMMANDS:
                    self._commands.popitem(last=False)
        except RefusedCommandError as error:
            response.status, response.message = error.status, str(error)
            return response
        response.status = Response.STATUS_OK
        return response

    def RobotCommandFeedback(self, request: Any) -> Any:  # noqa: N802
        """How a motion goes, and how its lease was used; without a number, the newest one."""
        response = robot_command_pb2.RobotCommandFeedbackResponse()
        with self._lock:
            wanted = request.robot_command_id or self._last_id
            given, is_current = self._commands.get(wanted), wanted == self._last_id
        if given is None:
            told = f"there is no robot command {wanted}" if wanted else "no robot command was given yet"
            return refuse_request(response, told)
        command, lease_use = given
        response.lease_use_result.CopyFrom(lease_use)
        response.feedback.CopyFrom(feedback(command, self._world.robot.snapshot(), is_current=is_current))
        return response

    def ClearBehaviorFault(self, request: Any) -> Any:  # noqa: N802
        """Clear a behaviour fault; needs the lease."""
        response = robot_command_pb2.ClearBehaviorFaultResponse(
            lease_use_result=self._world.leases.use(request.lease), status=0
        )
        if response.lease_use_result.status != lease_pb2.LeaseUseResult.STATUS_OK:
            response.status = response.STATUS_NOT_CLEARED
            return response
        faults = {fault.fault_id: fault for fault in self._world.robot.snapshot().behavior_faults}
        if request.behavior_fault_id in faults:
            response.behavior_fault.CopyFrom(behavior_fault_message(faults[request.behavior_fault_id]))
        is_cleared = self._world.robot.clear_behavior_fault(request.behavior_fault_id)
        response.status = response.STATUS_CLEARED if is_cleared else response.STATUS_NOT_CLEARED
        return response

    def _has_time_sync(self, request: robot_command_pb2.RobotCommandRequest) -> bool:
        """Whether the client is synchronised, or need not be for this command."""
        check = self._world.config.clock_identifier_check
        field = request.command.synchronized_command.mobility_command.WhichOneof("command") or ""
        is_timed = field.removesuffix("_request") in {verb.value for verb in commands.TIMED}
        if check == "none" or (check == "timed_commands" and not is_timed):
            return True
        return self._world.time_sync.is_established(request.clock_identifier)

    def _check_end_time(self, command: Command) -> None:
        """A timed command ends after now, and not in the far future."""
        if command.end_stamp_ns is None:
            return
        config = self._world.config
        if command.end_stamp_ns == 0 and config.missing_end_time_refusal == "invalid_request":
            raise InvalidCommandError(f"{command.verb.value}_request has no end_time; it is required")
        ahead_s = (command.end_stamp_ns - self._world.now_ns()) * 1e-9
        if ahead_s < 0.0:
            told = "has no end_time" if command.end_stamp_ns == 0 else f"ended {-ahead_s:.3f} s ago"
            raise ExpiredCommandError(f"{command.verb.value}_request {told}; give an end_time of the robot's clock")
        if ahead_s > config.max_command_duration_s:
            raise TooDistantCommandError(
                f"end_time lies {ahead_s:.3g} s ahead; allowed: {config.max_command_duration_s:g} s"
            )

    def _check_state(self, command: Command) -> None:
        """Motors on, e-stop released, no behaviour fault, and what the command needs beside."""
        world, verb = self._world, command.verb
        snapshot = world.robot.snapshot()
        if verb is Verb.SAFE_POWER_OFF:
            return
        if snapshot.motor_power is not MotorPower.ON:
            raise NotPoweredOnError(f"the motors are {snapshot.motor_power.value}; power them on first")
        if (
            verb not in {Verb.SIT, Verb.STOP, Verb.FREEZE, Verb.SELFRIGHT}
            and snapshot.estop_level is not EstopLevel.NONE
        ):
            told = f"the e-stop is pressed ({snapshot.estop_level.value}), so the motors are about to lose power"
            raise NotPoweredOnError(told)
        if snapshot.behavior_faults:
            causes = ", ".join(f"{fault.fault_id} ({fault.cause})" for fault in snapshot.behavior_faults)
            raise BehaviorFaultError(f"behaviour faults must be cleared first: {causes}")
        if verb is Verb.JOINT and world.license_state != "valid":
            refusal = InvalidCommandError if world.config.missing_license_refusal == "invalid_request" else None
            raise (refusal or UnsupportedCommandError)(
                f"joint control needs a licence, and the robot's is {world.license_state}"
            )
        if verb in WALKS:
            reason = world.robot.why_no_walk()
            if reason is not None:
                raise UnsupportedCommandError(f"this fake robot cannot walk by itself: {reason}")
