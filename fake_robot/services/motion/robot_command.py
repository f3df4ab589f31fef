"""RobotCommandService: stand, sit, stop, freeze, joint control, safe power-off, and how they go."""

from __future__ import annotations

import threading
from collections import OrderedDict

import grpc
from bosdyn.api import lease_pb2, robot_command_pb2, robot_command_service_pb2_grpc

from fake_robot.network.robot_port import EstopLevel, MotorPower
from fake_robot.services.calls.access import refuse_request
from fake_robot.services.motion import commands
from fake_robot.services.motion.commands import Command, UnsupportedCommandError, Verb
from fake_robot.services.motion.stand_params import InvalidCommandError, UnknownFrameError
from fake_robot.services.reports.robot_state_message import behavior_fault_message
from fake_robot.services.sensors.world import World

MAX_COMMANDS = 1024
Response = robot_command_pb2.RobotCommandResponse


class RobotCommandService(robot_command_service_pb2_grpc.RobotCommandServiceServicer):  # type: ignore[misc]
    """Starts motions and tells how they go. The newest command replaces the one before."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._lock = threading.Lock()
        self._commands: OrderedDict[int, Command] = OrderedDict()
        self._last_id = 0

    def RobotCommand(  # noqa: N802
        self, request: robot_command_pb2.RobotCommandRequest, context: grpc.ServicerContext
    ) -> robot_command_pb2.RobotCommandResponse:
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
            command = commands.parse(request.command)
        except InvalidCommandError as error:
            response.status, response.message = Response.STATUS_INVALID_REQUEST, str(error)
            return response
        except UnsupportedCommandError as error:
            response.status, response.message = Response.STATUS_UNSUPPORTED, str(error)
            return response
        refusal = self._why_not(command)
        if refusal is not None:
            response.status, response.message = refusal
            return response
        with self._lock:
            try:
                commands.start(command, self._world.robot)
            except UnknownFrameError as error:
                response.status, response.message = Response.STATUS_UNKNOWN_FRAME, str(error)
                return response
            self._last_id += 1
            self._commands[self._last_id] = command
            response.robot_command_id = self._last_id
            while len(self._commands) > MAX_COMMANDS:
                self._commands.popitem(last=False)
        response.status = Response.STATUS_OK
        return response

    def RobotCommandFeedback(  # noqa: N802
        self, request: robot_command_pb2.RobotCommandFeedbackRequest, context: grpc.ServicerContext
    ) -> robot_command_pb2.RobotCommandFeedbackResponse:
        """How a motion goes; without a number, the newest one."""
        response = robot_command_pb2.RobotCommandFeedbackResponse()
        with self._lock:
            wanted = request.robot_command_id or self._last_id
            command, is_current = self._commands.get(wanted), wanted == self._last_id
        if command is None:
            told = f"there is no robot command {wanted}" if wanted else "no robot command was given yet"
            refused: robot_command_pb2.RobotCommandFeedbackResponse = refuse_request(response, told)
            return refused
        snapshot = self._world.robot.snapshot()
        response.feedback.CopyFrom(commands.feedback(command, snapshot, is_current=is_current))
        return response

    def ClearBehaviorFault(  # noqa: N802
        self, request: robot_command_pb2.ClearBehaviorFaultRequest, context: grpc.ServicerContext
    ) -> robot_command_pb2.ClearBehaviorFaultResponse:
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
        if check == "none" or (check == "timed_commands" and not commands.is_timed(request.command)):
            return True
        return self._world.time_sync.is_established(request.clock_identifier)

    def _why_not(self, command: Command) -> tuple[int, str] | None:
        """The status and words with which the robot refuses a command now; None if it takes it."""
        world = self._world
        snapshot = world.robot.snapshot()
        if command.verb is Verb.SAFE_POWER_OFF:
            return None
        if snapshot.motor_power is not MotorPower.ON:
            return Response.STATUS_NOT_POWERED_ON, f"the motors are {snapshot.motor_power.value}; power them on first"
        if command.verb in {Verb.STAND, Verb.JOINT} and snapshot.estop_level is not EstopLevel.NONE:
            told = f"the e-stop is pressed ({snapshot.estop_level.value}), so the motors are about to lose power"
            return Response.STATUS_NOT_POWERED_ON, told
        if snapshot.behavior_faults:
            causes = ", ".join(f"{fault.fault_id} ({fault.cause})" for fault in snapshot.behavior_faults)
            return Response.STATUS_BEHAVIOR_FAULT, f"behaviour faults must be cleared first: {causes}"
        if command.verb is Verb.JOINT and world.license_state != "valid":
            is_invalid = world.config.missing_license_refusal == "invalid_request"
            status = Response.STATUS_INVALID_REQUEST if is_invalid else Response.STATUS_UNSUPPORTED
            return status, f"joint control needs a licence, and the robot's is {world.license_state}"
        return None
