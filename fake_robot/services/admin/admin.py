"""FakeAdmin: lock-step, faults and truth; the fake's own service, apart from the robot's."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NoReturn

import grpc

from fake_robot.services.admin.injection import FaultInjector
from fake_robot.services.admin.stepping import Stepping, StepRefusedError
from fake_robot.services.sensors.world import World
from spot_model.errors import BadInputError
from spot_protos import fake_admin_pb2, fake_admin_pb2_grpc


class AdminService(fake_admin_pb2_grpc.FakeAdminServicer):
    """Answers whoever runs the fake."""

    def __init__(
        self,
        world: World,
        faults: FaultInjector,
        stepping: Stepping,
        request_stop: Callable[[], None],
        *,
        step_socket: str = "",
    ) -> None:
        self._world = world
        self._faults = faults
        self._request_stop = request_stop
        self._stepping, self._step_socket = stepping, step_socket

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
            step_socket=self._step_socket,
        )

    def Step(  # noqa: N802
        self, request: fake_admin_pb2.StepRequest, context: grpc.ServicerContext
    ) -> fake_admin_pb2.StepResponse:
        """Wait for a command if asked to, then let robot time pass."""
        try:
            return self._stepping.step(request)
        except StepRefusedError as error:
            context.abort(error.code, str(error))
            raise

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
