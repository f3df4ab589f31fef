"""FakeAdmin: lock-step, faults and truth; the fake's own service, apart from the robot's."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any, NoReturn

import grpc

from fake_robot.services.admin.injection import FaultInjector
from fake_robot.services.admin.step_states import StateTap
from fake_robot.services.sensors.world import World
from spot_model.errors import BadInputError
from spot_model.robot.stamps import NS_PER_S
from spot_protos import fake_admin_pb2, fake_admin_pb2_grpc

DEFAULT_WAIT_S = 5.0
MAX_STEP_NS = 3600 * NS_PER_S
MAX_STEP_STATES = 1_000_000
TICK_EVERY_NS = 50_000_000
TICK_EVERY_STATES = 16


class AdminService(fake_admin_pb2_grpc.FakeAdminServicer):
    """Answers whoever runs the fake.

    Args:
        world: The robot and its services.
        faults: The faults that can be injected.
        request_stop: Ends the server, soon.
    """

    def __init__(self, world: World, faults: FaultInjector, request_stop: Callable[[], None]) -> None:
        self._world = world
        self._faults = faults
        self._request_stop = request_stop
        self._step_lock = threading.Lock()
        self._tap: StateTap | None = None

    def GetStatus(  # noqa: N802
        self, request: fake_admin_pb2.GetStatusRequest, context: grpc.ServicerContext
    ) -> fake_admin_pb2.GetStatusResponse:
        """Robot time, mode, lease, e-stop, faults, counters."""
        robot = self._world.robot
        snapshot = robot.snapshot()
        faults = [fake_admin_pb2.ActiveFault(fault_id=i, name=name) for i, name in self._faults.active().items()]
        return fake_admin_pb2.GetStatusResponse(
            robot_stamp_ns=self._world.now_ns(),
            lock_step=robot.is_lock_step,
            mode=snapshot.mode.value,
            motor_power=snapshot.motor_power.value,
            estop_level=snapshot.estop_level.value,
            lease_owner=self._world.leases.owner().client_name,
            active_faults=faults,
            last_command_key=robot.last_command_key,
            commands_submitted=robot.commands_submitted,
            last_state_robot_stamp_ns=robot.last_state_stamp_ns,
            states_sent=robot.states_sent,
            commands_received=snapshot.joint_commands_received,
            state_streams=self._world.link.open_streams("state"),
            command_streams=self._world.link.open_streams("command"),
            elapsed_ns=robot.clock.elapsed_ns(),
        )

    def Step(  # noqa: N802
        self, request: fake_admin_pb2.StepRequest, context: grpc.ServicerContext
    ) -> fake_admin_pb2.StepResponse:
        """Wait for a command if asked to, then let robot time pass."""
        robot = self._world.robot
        if not robot.is_lock_step:
            _refuse(context, "the fake runs in real time; start it with --lock-step to use Step")
        durations_ns = (request.duration_ns, request.max_duration_ns)
        if not all(0 <= ns <= MAX_STEP_NS for ns in durations_ns) or request.state_messages > MAX_STEP_STATES:
            _refuse(
                context, f"a step is at most {MAX_STEP_NS} ns or {MAX_STEP_STATES} state messages, and not negative"
            )
        with self._step_lock:
            self._tap_states(request.with_states)
            self._wait_for_command(request, context)
            states_before = robot.states_sent
            if request.WhichOneof("until") == "state_messages":
                self._advance_states(request.state_messages, request.max_duration_ns or None)
            else:
                self._advance(request.duration_ns)
            response = fake_admin_pb2.StepResponse(
                robot_stamp_ns=self._world.now_ns(),
                last_state_robot_stamp_ns=robot.last_state_stamp_ns,
                states_sent=robot.states_sent - states_before,
                elapsed_ns=robot.clock.elapsed_ns(),
            )
            if self._tap is not None:
                response.states.extend(self._tap.take())
                if self._tap.is_closed:
                    response.states_ended = self._world.link.why_down() or "the robot ended the state stream"
                    self._tap = None
            return response

    def ListFaults(  # noqa: N802
        self, request: fake_admin_pb2.ListFaultsRequest, context: grpc.ServicerContext
    ) -> fake_admin_pb2.ListFaultsResponse:
        """What can be injected."""
        response = fake_admin_pb2.ListFaultsResponse()
        for kind in self._faults.kinds():
            response.faults.add(name=kind.name, help=kind.help, parameters=dict(kind.parameters))
        return response

    def InjectFault(  # noqa: N802
        self, request: fake_admin_pb2.InjectFaultRequest, context: grpc.ServicerContext
    ) -> fake_admin_pb2.InjectFaultResponse:
        """Make a fault happen."""
        parameters: dict[str, float | str] = {**request.numbers, **request.texts}
        try:
            fault_id = self._faults.inject(request.name, parameters, request.duration_s or None)
        except BadInputError as error:
            _refuse(context, str(error))
        return fake_admin_pb2.InjectFaultResponse(fault_id=fault_id, robot_stamp_ns=self._world.now_ns())

    def ClearFaults(  # noqa: N802
        self, request: fake_admin_pb2.ClearFaultsRequest, context: grpc.ServicerContext
    ) -> fake_admin_pb2.ClearFaultsResponse:
        """End faults."""
        try:
            cleared = self._faults.clear(tuple(request.fault_ids))
        except BadInputError as error:
            _refuse(context, str(error))
        return fake_admin_pb2.ClearFaultsResponse(cleared_fault_ids=cleared)

    def GetTruth(  # noqa: N802
        self, request: fake_admin_pb2.GetTruthRequest, context: grpc.ServicerContext
    ) -> fake_admin_pb2.GetTruthResponse:
        """The simulated body as it is."""
        return truth_message(self._world.robot.truth(reset_extremes=request.reset_extremes))

    def Shutdown(  # noqa: N802
        self, request: fake_admin_pb2.ShutdownRequest, context: grpc.ServicerContext
    ) -> fake_admin_pb2.ShutdownResponse:
        """End the fake."""
        self._request_stop()
        return fake_admin_pb2.ShutdownResponse()

    def _tap_states(self, is_wanted: bool) -> None:
        if is_wanted and self._tap is None:
            self._tap = StateTap(self._world)
        elif not is_wanted and self._tap is not None:
            self._tap.close()
            self._tap = None

    def _wait_for_command(self, request: fake_admin_pb2.StepRequest, context: grpc.ServicerContext) -> None:
        key, wait_s = request.wait_for_command_key, request.wait_timeout_s or DEFAULT_WAIT_S
        beyond = request.wait_beyond_commands
        if key and not self._world.robot.wait_for_command_key(key, wait_s, beyond=beyond):
            context.abort(
                grpc.StatusCode.DEADLINE_EXCEEDED,
                f"no command with key {key} or newer arrived within {wait_s:g} s; "
                f"the newest has key {self._world.robot.last_command_key}",
            )

    # Time passes in parts, so that time-outs of leases and e-stops act when they fall due.

    def _advance(self, duration_ns: int) -> None:
        while duration_ns > 0:
            part_ns = min(TICK_EVERY_NS, duration_ns)
            self._world.robot.advance(part_ns)
            duration_ns -= part_ns
            self._tick()

    def _advance_states(self, count: int, max_duration_ns: int | None) -> None:
        robot = self._world.robot
        if max_duration_ns is not None:
            end_ns, goal = robot.clock.elapsed_ns() + max_duration_ns, robot.states_sent + count
            while robot.states_sent < goal and robot.clock.elapsed_ns() < end_ns:
                left_ns = end_ns - robot.clock.elapsed_ns()
                robot.advance_states(goal - robot.states_sent, min(TICK_EVERY_NS, left_ns))
                self._tick()
            return
        while count > 0:
            part = min(TICK_EVERY_STATES, count)
            robot.advance_states(part)
            count -= part
            self._tick()

    def _tick(self) -> None:
        self._world.tick()
        self._faults.tick()


def truth_message(truth: Any) -> fake_admin_pb2.GetTruthResponse:
    """The robot's truth on the wire; fields of one name on both sides."""
    response = fake_admin_pb2.GetTruthResponse()
    for field in response.DESCRIPTOR.fields:
        value = getattr(truth, field.name)
        if field.is_repeated:
            getattr(response, field.name).extend(value.tolist() if hasattr(value, "tolist") else value)
        else:
            setattr(response, field.name, value)
    return response


def _refuse(context: grpc.ServicerContext, told: str) -> NoReturn:
    context.abort(grpc.StatusCode.INVALID_ARGUMENT, told)
    raise AssertionError
