"""The gRPC service: each call is admitted, checked, carried out or refused in words."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import TypeVar

import grpc
from typing_extensions import Self

from spot_protos import operator_pb2, operator_pb2_grpc, run_link_pb2
from spot_runtime.control.modes import Mode
from spot_runtime.operator.refusal import Refusal, bad_request
from spot_runtime.operator.server import request_checks
from spot_runtime.operator.server.access import Gate, Role
from spot_runtime.operator.server.event_history import KEPT
from spot_runtime.operator.server.mode_texts import MODE_TEXTS
from spot_runtime.operator.server.states import State
from spot_runtime.operator.server.supervisor import Supervisor

Answer = TypeVar("Answer")
EVENT_WAIT_S = 0.5


class OperatorService(operator_pb2_grpc.OperatorServicer):  # type: ignore[misc,unused-ignore]
    """Answers for the supervisor."""

    def __init__(self, supervisor: Supervisor, gate: Gate) -> None:
        """Ask ``supervisor`` what ``gate`` lets in."""
        self._supervisor, self._gate = supervisor, gate
        self.is_closing = False
        """Set it, and streams end."""

    # To observe -------------------------------------------------------------------------------------------------------

    def GetStatus(  # noqa: N802
        self, request: operator_pb2.GetStatusRequest, context: grpc.ServicerContext
    ) -> operator_pb2.Status:
        """See the proto."""
        return self._carry_out("GetStatus", context, Role.OBSERVE, lambda _: self._status())

    def WatchStatus(  # noqa: N802
        self, request: operator_pb2.WatchStatusRequest, context: grpc.ServicerContext
    ) -> Iterator[operator_pb2.Status]:
        """See the proto."""
        rate_hz = self._carry_out(
            "WatchStatus", context, Role.OBSERVE, lambda _: request_checks.status_rate_hz(request.rate_hz)
        )
        with _Stream(self, "WatchStatus", context) as stream:
            while stream.is_open:
                yield self._status()
                stream.pause(1.0 / rate_hz)

    def ListModes(  # noqa: N802
        self, request: operator_pb2.ListModesRequest, context: grpc.ServicerContext
    ) -> operator_pb2.ListModesResponse:
        """See the proto."""
        kind = operator_pb2.ListModesResponse.Mode

        def work(_: str) -> operator_pb2.ListModesResponse:
            states = [kind(name=s.value, meaning=s.meaning, allows=s.allows) for s in State]
            modes = [kind(name=m.value, meaning=MODE_TEXTS[m]) for m in Mode]
            return operator_pb2.ListModesResponse(states=states, modes=modes)

        return self._carry_out("ListModes", context, Role.OBSERVE, work)

    def ListPolicies(  # noqa: N802
        self, request: operator_pb2.ListPoliciesRequest, context: grpc.ServicerContext
    ) -> operator_pb2.ListPoliciesResponse:
        """See the proto."""
        kind = operator_pb2.ListPoliciesResponse.Policy

        def work(_: str) -> operator_pb2.ListPoliciesResponse:
            found = self._supervisor.shelf.list()
            return operator_pb2.ListPoliciesResponse(
                policies=[
                    kind(name=p.name, sha256=p.sha256, size_bytes=p.size_bytes, is_allowed=p.is_allowed) for p in found
                ]
            )

        return self._carry_out("ListPolicies", context, Role.OBSERVE, work)

    def StreamEvents(  # noqa: N802
        self, request: operator_pb2.StreamEventsRequest, context: grpc.ServicerContext
    ) -> Iterator[operator_pb2.Event]:
        """See the proto."""

        def check(_: str) -> int:
            if request.past > KEPT:
                raise bad_request(f"past = {request.past}; allowed: at most {KEPT}")
            return max(0, self._supervisor.events.count - request.past)

        number = self._carry_out("StreamEvents", context, Role.OBSERVE, check)
        with _Stream(self, "StreamEvents", context) as stream:
            while stream.is_open:
                for event in self._supervisor.events.after(number, EVENT_WAIT_S):
                    number = event.number
                    yield event

    # To operate -------------------------------------------------------------------------------------------------------

    def Arm(self, request: operator_pb2.ArmRequest, context: grpc.ServicerContext) -> operator_pb2.Done:  # noqa: N802
        """See the proto."""

        def work(client: str) -> str:
            labels = request_checks.labels(request.labels)
            operator = request_checks.operator_name(request.operator) or client
            policy = self._supervisor.shelf.find(request.policy, request_checks.sha256(request.sha256))
            return self._supervisor.arm(policy, labels, operator)

        return self._do("Arm", context, work)

    def Start(self, request: operator_pb2.StartRequest, context: grpc.ServicerContext) -> operator_pb2.Done:  # noqa: N802
        """See the proto."""
        message = run_link_pb2.ToRun(start=request)
        return self._do("Start", context, lambda _: self._supervisor.ask("Start", message, State.ARMED))

    def Stop(self, request: operator_pb2.StopRequest, context: grpc.ServicerContext) -> operator_pb2.Done:  # noqa: N802
        """See the proto."""
        message = run_link_pb2.ToRun(stop=request)
        # To leave it standing with the lease in hand is no mere stop.
        role = Role.OPERATE if request.keep_standing else Role.OBSERVE

        def work(client: str) -> str:
            return self._supervisor.end("Stop", message, client, is_damping=False)

        return self._do("Stop", context, work, role=role, is_stopping=True)

    def Damp(self, request: operator_pb2.DampRequest, context: grpc.ServicerContext) -> operator_pb2.Done:  # noqa: N802
        """See the proto."""
        message = run_link_pb2.ToRun(damp=request)

        def work(client: str) -> str:
            return self._supervisor.end("Damp", message, client, is_damping=True)

        return self._do("Damp", context, work, role=Role.OBSERVE, is_stopping=True)

    def SetVelocity(  # noqa: N802
        self, request: operator_pb2.SetVelocityRequest, context: grpc.ServicerContext
    ) -> operator_pb2.Done:
        """See the proto."""

        def work(client: str) -> str:
            run = self._supervisor.status().run
            v_x, v_y, yaw = request_checks.velocity(request, run.velocity_command_low, run.velocity_command_high)
            velocity = run_link_pb2.Velocity(v_x_m_s=v_x, v_y_m_s=v_y, yaw_rate_rad_s=yaw)
            operator = request_checks.operator_name(request.operator) or client
            self._supervisor.steer(run_link_pb2.ToRun(velocity=velocity), operator)
            return "steering"

        return self._do("SetVelocity", context, work, is_steering=True)

    def SwitchPolicy(  # noqa: N802
        self, request: operator_pb2.SwitchPolicyRequest, context: grpc.ServicerContext
    ) -> operator_pb2.Done:
        """See the proto."""

        def work(_: str) -> str:
            policy = self._supervisor.shelf.find(request.policy, request_checks.sha256(request.sha256))
            message = run_link_pb2.ToRun(
                switch_policy=run_link_pb2.SwitchPolicy(path=str(policy.path.absolute()), sha256=policy.sha256)
            )
            return self._supervisor.ask("SwitchPolicy", message, State.ARMED)

        return self._do("SwitchPolicy", context, work)

    def StartLog(  # noqa: N802
        self, request: operator_pb2.StartLogRequest, context: grpc.ServicerContext
    ) -> operator_pb2.StartLogResponse:
        """See the proto."""

        def work(_: str) -> operator_pb2.StartLogResponse:
            request_checks.labels(request.labels)
            message = run_link_pb2.ToRun(start_log=request)
            return operator_pb2.StartLogResponse(path=self._supervisor.ask("StartLog", message, State.ARMED))

        return self._carry_out("StartLog", context, Role.OPERATE, work)

    def LabelLog(self, request: operator_pb2.LabelLogRequest, context: grpc.ServicerContext) -> operator_pb2.Done:  # noqa: N802
        """See the proto."""

        def work(_: str) -> str:
            request_checks.some_labels(request.labels)
            message = run_link_pb2.ToRun(label_log=request)
            return self._supervisor.ask("LabelLog", message, State.ARMED, State.RUNNING)

        return self._do("LabelLog", context, work)

    def Attend(self, request: operator_pb2.AttendRequest, context: grpc.ServicerContext) -> operator_pb2.Done:  # noqa: N802
        """See the proto."""

        def work(_: str) -> str:
            self._supervisor.attend()
            return "seen"

        return self._do("Attend", context, work)

    # Details ----------------------------------------------------------------------------------------------------------

    @property
    def gate(self) -> Gate:
        """Who may ask."""
        return self._gate

    def _status(self) -> operator_pb2.Status:
        status = self._supervisor.status()
        status.software_version = _VERSION
        return status

    def _do(
        self,
        name: str,
        context: grpc.ServicerContext,
        work: Callable[[str], str],
        *,
        role: Role = Role.OPERATE,
        is_steering: bool = False,
        is_stopping: bool = False,
    ) -> operator_pb2.Done:
        text = self._carry_out(name, context, role, work, is_steering=is_steering, is_stopping=is_stopping)
        return operator_pb2.Done(state=self._supervisor.state.value, text=text)

    def _carry_out(
        self,
        name: str,
        context: grpc.ServicerContext,
        role: Role,
        work: Callable[[str], Answer],
        *,
        is_steering: bool = False,
        is_stopping: bool = False,
    ) -> Answer:
        try:
            return work(self._gate.admit(name, context, role, is_steering=is_steering, is_stopping=is_stopping))
        except Refusal as refusal:
            context.abort(refusal.code, refusal.text)
            raise  # not reached: abort raises


class _Stream:
    """One open stream: counted, and closed with the service."""

    def __init__(self, service: OperatorService, name: str, context: grpc.ServicerContext) -> None:
        self._service, self._name, self._context = service, name, context

    def __enter__(self) -> Self:
        try:
            self._service.gate.open_stream(self._name)
        except Refusal as refusal:
            self._context.abort(refusal.code, refusal.text)
        return self

    def __exit__(self, *problem: object) -> None:
        self._service.gate.close_stream()

    @property
    def is_open(self) -> bool:
        return bool(self._context.is_active()) and not self._service.is_closing

    def pause(self, duration_s: float) -> None:
        until_s = time.monotonic() + duration_s
        while self.is_open and time.monotonic() < until_s:
            time.sleep(min(0.1, max(0.0, until_s - time.monotonic())))


def _software_version() -> str:
    try:
        return version("spot-rl")
    except PackageNotFoundError:
        return ""


_VERSION = _software_version()
