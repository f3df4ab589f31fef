"""RobotCommandService: stand, sit, stop, freeze, walk, joint control, safe power-off, and how they go."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from bosdyn.api import lease_pb2, robot_command_pb2, robot_command_service_pb2

from fake_robot.network.status import EstopLevel, MotorPower
from fake_robot.services.calls import Service, refuse
from fake_robot.services.motion.commands import TIMED, WALKS, Command, Verb, feedback, parse
from fake_robot.services.motion.parameters import RefusedCommandError
from fake_robot.services.reports.state_message import behavior_fault_message
from fake_robot.services.world import World

MAX_COMMANDS = 1024


class RobotCommandService(Service):
    """Starts motions and tells how they go. The newest command replaces the one before."""

    modules = (robot_command_service_pb2,)

    def __init__(self, world: World) -> None:
        super().__init__()
        self._world = world
        self._commands: OrderedDict[int, tuple[Command, lease_pb2.LeaseUseResult]] = OrderedDict()
        self._last_id = 0

    def RobotCommand(self, request: Any, response: Any) -> None:  # noqa: N802
        """Begin a motion; needs the lease, the motors' power and no uncleared behaviour fault."""
        try:
            if not self._world.leases.admits(request, response):
                raise RefusedCommandError("INVALID_REQUEST", "the lease is not good: see lease_use_result")
            self._check_time_sync(request)
            command = parse(request.command, self._world.config)
            self._check_end_time(command)
            self._check_state(command)
            command.begin(self._world.robot)
        except RefusedCommandError as error:
            response.status, response.message = error.status, str(error)
            return
        self._last_id += 1
        self._commands[self._last_id] = command, response.lease_use_result
        if len(self._commands) > MAX_COMMANDS:
            self._commands.popitem(last=False)
        response.status, response.robot_command_id = response.STATUS_OK, self._last_id

    def RobotCommandFeedback(self, request: Any, response: Any) -> None:  # noqa: N802
        """How a motion goes, and how its lease was used; without a number, the newest one."""
        wanted = request.robot_command_id or self._last_id
        if wanted not in self._commands:
            refuse(response, f"there is no robot command {wanted}" if wanted else "no robot command was given yet")
            return
        command, lease_use = self._commands[wanted]
        response.lease_use_result.CopyFrom(lease_use)
        snapshot, is_current = self._world.robot.snapshot(), wanted == self._last_id
        response.feedback.CopyFrom(feedback(command, snapshot, is_current=is_current))

    def ClearBehaviorFault(self, request: Any, response: Any) -> None:  # noqa: N802
        """Clear a behaviour fault; needs the lease."""
        response.status = response.STATUS_NOT_CLEARED
        if not self._world.leases.admits(request, response):
            return
        for fault in self._world.robot.snapshot().behavior_faults:
            if fault.fault_id == request.behavior_fault_id:
                response.behavior_fault.CopyFrom(behavior_fault_message(fault))
        if self._world.robot.clear_behavior_fault(request.behavior_fault_id):
            response.status = response.STATUS_CLEARED

    def _check_time_sync(self, request: robot_command_pb2.RobotCommandRequest) -> None:
        """The client is synchronised, or need not be for this command."""
        check = self._world.config.clock_identifier_check
        field = request.command.synchronized_command.mobility_command.WhichOneof("command") or ""
        is_timed = field.removesuffix("_request") in {verb.value for verb in TIMED}
        is_needed = check == "every_command" or (check == "timed_commands" and is_timed)
        if is_needed and not self._world.time_sync.is_established(request.clock_identifier):
            raise RefusedCommandError(
                "NO_TIMESYNC",
                f"clock_identifier {request.clock_identifier!r} is not that of a client that has finished its time "
                "sync with this robot; wait for time sync before the first command",
            )

    def _check_end_time(self, command: Command) -> None:
        """A timed command ends after now, and not in the far future."""
        if command.end_stamp_ns is None:
            return
        config, name = self._world.config, f"{command.verb.value}_request"
        if command.end_stamp_ns == 0 and config.missing_end_time_refusal == "invalid_request":
            raise RefusedCommandError("INVALID_REQUEST", f"{name} has no end_time; it is required")
        ahead_s = (command.end_stamp_ns - self._world.now_ns()) * 1e-9
        if ahead_s < 0.0:
            told = "has no end_time" if command.end_stamp_ns == 0 else f"ended {-ahead_s:.3f} s ago"
            raise RefusedCommandError("EXPIRED", f"{name} {told}; give an end_time of the robot's clock")
        if ahead_s > config.max_command_duration_s:
            told = f"end_time lies {ahead_s:.3g} s ahead; allowed: {config.max_command_duration_s:g} s"
            raise RefusedCommandError("TOO_DISTANT", told)

    def _check_state(self, command: Command) -> None:
        """Motors on, e-stop released, no behaviour fault, and what the command needs beside."""
        world, verb = self._world, command.verb
        snapshot = world.robot.snapshot()
        if verb is Verb.SAFE_POWER_OFF:
            return
        if snapshot.motor_power is not MotorPower.ON:
            told = f"the motors are {snapshot.motor_power.value}; power them on first"
            raise RefusedCommandError("NOT_POWERED_ON", told)
        is_stopped = snapshot.estop_level is not EstopLevel.NONE
        if is_stopped and verb not in {Verb.SIT, Verb.STOP, Verb.FREEZE, Verb.SELFRIGHT}:
            told = f"the e-stop is pressed ({snapshot.estop_level.value}), so the motors are about to lose power"
            raise RefusedCommandError("NOT_POWERED_ON", told)
        if snapshot.behavior_faults:
            causes = ", ".join(f"{fault.fault_id} ({fault.cause})" for fault in snapshot.behavior_faults)
            raise RefusedCommandError("BEHAVIOR_FAULT", f"behaviour faults must be cleared first: {causes}")
        if verb is Verb.JOINT and world.license.state != "valid":
            told = f"joint control needs a licence, and the robot's is {world.license.state}"
            raise RefusedCommandError(world.config.missing_license_refusal.upper(), told)
        if verb in WALKS:
            reason = world.robot.why_no_walk()
            if reason is not None:
                raise RefusedCommandError("UNSUPPORTED", f"this fake robot cannot walk by itself: {reason}")
