"""FakeAdmin: lock-step, faults and truth; the fake's own service, apart from the robot's."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from typing import Any

from fake_robot.faults.registry import FAULTS, FaultInjector
from fake_robot.services.calls import Service
from fake_robot.services.stepping import Stepping
from fake_robot.services.world import World
from spot_protos import fake_admin_pb2


class AdminService(Service):
    """Answers whoever runs the fake."""

    modules = (fake_admin_pb2,)

    def __init__(
        self,
        world: World,
        faults: FaultInjector,
        stepping: Stepping,
        request_stop: Callable[[], None],
        *,
        step_socket: str = "",
    ) -> None:
        super().__init__()
        self.lock = nullcontext()  # a step may wait; faults and steps have locks of their own
        self._world, self._faults, self._request_stop = world, faults, request_stop
        self._stepping, self._step_socket = stepping, step_socket

    def GetStatus(self, request: Any, response: Any) -> None:  # noqa: N802
        """Robot time, mode, lease, e-stop, faults, counters."""
        robot, link = self._world.robot, self._world.link
        snapshot = robot.snapshot()
        response.robot_stamp_ns, response.elapsed_ns = self._world.now_ns(), robot.clock.elapsed_ns()
        response.lock_step, response.step_socket = robot.is_lock_step, self._step_socket
        response.mode, response.motor_power = snapshot.mode.value, snapshot.motor_power.value
        response.estop_level = snapshot.estop_level.value
        response.lease_owner = self._world.leases.owner().client_name
        for fault_id, name in self._faults.active().items():
            response.active_faults.add(fault_id=fault_id, name=name)
        response.last_command_key, response.commands_submitted = robot.last_command_key, robot.commands_submitted
        response.commands_received = snapshot.joint_commands_received
        response.last_state_robot_stamp_ns, response.states_sent = robot.last_state_stamp_ns, robot.states_sent
        response.state_streams, response.command_streams = map(link.open_streams, ("state", "command"))

    def Step(self, request: Any, response: Any) -> None:  # noqa: N802
        """Wait for a command if asked to, then let robot time pass."""
        self._stepping.step(request, response)

    def ListFaults(self, request: Any, response: Any) -> None:  # noqa: N802
        """What can be injected."""
        for name, fault in sorted(FAULTS.items()):
            meanings = {key: field.description or "" for key, field in fault.model_fields.items()}
            response.faults.add(name=name, help=(fault.__doc__ or "").strip(), parameters=meanings)

    def InjectFault(self, request: Any, response: Any) -> None:  # noqa: N802
        """Make a fault happen."""
        parameters: dict[str, float | str] = {**request.numbers, **request.texts}
        response.fault_id = self._faults.inject(request.name, parameters, request.duration_s or None)
        response.robot_stamp_ns = self._world.now_ns()

    def ClearFaults(self, request: Any, response: Any) -> None:  # noqa: N802
        """End faults."""
        response.cleared_fault_ids.extend(self._faults.clear(tuple(request.fault_ids)))

    def GetTruth(self, request: Any, response: Any) -> None:  # noqa: N802
        """The simulated body as it is; fields of one name on both sides."""
        truth = self._world.robot.truth(reset_extremes=request.reset_extremes)
        for field in response.DESCRIPTOR.fields:
            value = getattr(truth, field.name)
            if field.is_repeated:
                getattr(response, field.name).extend(value.tolist() if hasattr(value, "tolist") else value)
            else:
                setattr(response, field.name, value)

    def Shutdown(self, request: Any, response: Any) -> None:  # noqa: N802
        """End the fake."""
        self._request_stop()
