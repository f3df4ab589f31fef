"""The service's methods: each request is checked, carried out by the supervisor, or refused in words."""

from __future__ import annotations

import asyncio
import math
import re
from collections.abc import AsyncIterator, Mapping, Sequence
from typing import Final

from spot_model.version import software_version
from spot_protos import operator_pb2, run_link_pb2
from spot_runtime.control.modes import Mode
from spot_runtime.operator.door.access import Gate, bad_request
from spot_runtime.operator.door.callers import Caller, Role
from spot_runtime.operator.server.service_state import KEPT, State
from spot_runtime.operator.server.supervisor import Supervisor
from spot_runtime.session.labels import RULE, is_label

MAX_MESSAGE_BYTES: Final = 64 * 1024
MAX_LABELS: Final = 32
_DIGEST: Final = re.compile(r"[0-9a-fA-F]{64}")


def checked_labels(given: Mapping[str, str], *, at_least: int = 0) -> dict[str, str]:
    """Labels of a log. Raises Refusal."""
    if len(given) < at_least:
        raise bad_request("no label is given; give at least one key and value")
    if len(given) > MAX_LABELS:
        raise bad_request(f"{len(given)} labels are given; allowed: at most {MAX_LABELS}")
    for key, value in given.items():
        if not is_label(key, value):
            raise bad_request(f"label {key[:80]!r} = {value[:80]!r} is not valid; allowed: {RULE}")
    return dict(given)


def checked_operator(given: str) -> str:
    """The name of who asks. Raises Refusal."""
    if len(given) > 64 or not given.isprintable():
        raise bad_request("the operator's name is not valid; allowed: printable, at most 64 characters")
    return given


def checked_sha256(given: str) -> str:
    """A digest, or none. Raises Refusal."""
    if given and not _DIGEST.fullmatch(given):
        raise bad_request(f"sha256 {given[:80]!r} is not valid; allowed: empty, or 64 hexadecimal digits")
    return given.lower()


def checked_velocity(
    given: operator_pb2.SetVelocityRequest, low: Sequence[float], high: Sequence[float]
) -> tuple[float, float, float]:
    """A velocity within the running policy's range; while that is not known, any finite one. Raises Refusal."""
    values = (given.v_x_m_s, given.v_y_m_s, given.yaw_rate_rad_s)
    for i, (name, value) in enumerate(zip(("v_x_m_s", "v_y_m_s", "yaw_rate_rad_s"), values, strict=True)):
        if not math.isfinite(value):
            raise bad_request(f"{name} = {value} is no number")
        if low and high and not low[i] - 1e-9 <= value <= high[i] + 1e-9:
            raise bad_request(f"{name} = {value:g}; this policy takes {low[i]:g} to {high[i]:g}")
    return values


def checked_rate_hz(given: float) -> float:
    """How often a status is sent. Raises Refusal."""
    if given == 0.0:
        return 2.0
    if not 0.1 <= given <= 10.0:
        raise bad_request(f"rate_hz = {given}; allowed: 0.1 to 10, or 0 for 2")
    return given


_VERSION: Final = software_version()


class OperatorService:
    """Answers for the supervisor. Methods are named as in the proto; who calls has been let in already."""

    def __init__(self, supervisor: Supervisor, gate: Gate) -> None:
        self._supervisor, self._gate = supervisor, gate

    # To observe -------------------------------------------------------------------------------------------------------

    def get_status(self, request: operator_pb2.GetStatusRequest, caller: Caller) -> operator_pb2.Status:
        """See the proto."""
        status = self._supervisor.status()
        status.software_version = _VERSION
        return status

    def list_modes(self, request: operator_pb2.ListModesRequest, caller: Caller) -> operator_pb2.ListModesResponse:
        """See the proto."""
        kind = operator_pb2.ListModesResponse.Mode
        states = [kind(name=s.value, meaning=s.meaning, allows=s.allows) for s in State]
        modes = [kind(name=m.value, meaning=m.meaning) for m in Mode]
        return operator_pb2.ListModesResponse(states=states, modes=modes)

    def list_policies(
        self, request: operator_pb2.ListPoliciesRequest, caller: Caller
    ) -> operator_pb2.ListPoliciesResponse:
        """See the proto."""
        kind = operator_pb2.ListPoliciesResponse.Policy
        found = self._supervisor.policies.list()
        return operator_pb2.ListPoliciesResponse(
            policies=[
                kind(name=p.name, sha256=p.sha256, size_bytes=p.size_bytes, is_allowed=p.is_allowed) for p in found
            ]
        )

    async def watch_status(
        self, request: operator_pb2.WatchStatusRequest, caller: Caller
    ) -> AsyncIterator[operator_pb2.Status]:
        """See the proto."""
        rate_hz = checked_rate_hz(request.rate_hz)
        while True:
            yield await asyncio.to_thread(self.get_status, operator_pb2.GetStatusRequest(), caller)
            await asyncio.sleep(1.0 / rate_hz)

    async def stream_events(
        self, request: operator_pb2.StreamEventsRequest, caller: Caller
    ) -> AsyncIterator[operator_pb2.Event]:
        """See the proto."""
        if request.past > KEPT:
            raise bad_request(f"past = {request.past}; allowed: at most {KEPT}")
        events = self._supervisor.events
        number = max(0, events.count - request.past)
        while True:
            for event in events.after(number):
                number = event.number
                yield event
            await asyncio.sleep(0.1)

    # To operate -------------------------------------------------------------------------------------------------------

    def arm(self, request: operator_pb2.ArmRequest, caller: Caller) -> operator_pb2.Done:
        """See the proto."""
        labels = checked_labels(request.labels)
        operator = checked_operator(request.operator) or caller.name
        policy = self._supervisor.policies.find(request.policy, checked_sha256(request.sha256))
        return self._done(self._supervisor.arm(policy, labels, operator))

    def start(self, request: operator_pb2.StartRequest, caller: Caller) -> operator_pb2.Done:
        """See the proto."""
        message = run_link_pb2.ToRun(start=request)
        return self._done(self._supervisor.ask("start", message, State.ARMED))

    def stop(self, request: operator_pb2.StopRequest, caller: Caller) -> operator_pb2.Done:
        """See the proto."""
        if request.keep_standing:  # leaving it standing under our lease takes more than the right to stop
            self._gate.check_role("stop --keep-standing", caller, Role.OPERATE)
        message = run_link_pb2.ToRun(stop=request)
        return self._done(self._supervisor.end("stop", message, caller.name, is_damping=False))

    def damp(self, request: operator_pb2.DampRequest, caller: Caller) -> operator_pb2.Done:
        """See the proto."""
        message = run_link_pb2.ToRun(damp=request)
        return self._done(self._supervisor.end("damp", message, caller.name, is_damping=True))

    def set_velocity(self, request: operator_pb2.SetVelocityRequest, caller: Caller) -> operator_pb2.Done:
        """See the proto."""
        run = self._supervisor.status().run
        v_x, v_y, yaw = checked_velocity(request, run.velocity_command_low, run.velocity_command_high)
        velocity = run_link_pb2.Velocity(v_x_m_s=v_x, v_y_m_s=v_y, yaw_rate_rad_s=yaw)
        name = checked_operator(request.operator) or caller.name
        self._supervisor.steer(run_link_pb2.ToRun(velocity=velocity), caller.identity, name)
        return self._done("sent to the control process")

    def switch_policy(self, request: operator_pb2.SwitchPolicyRequest, caller: Caller) -> operator_pb2.Done:
        """See the proto."""
        policy = self._supervisor.policies.find(request.policy, checked_sha256(request.sha256))
        message = run_link_pb2.ToRun(
            switch_policy=run_link_pb2.SwitchPolicy(path=str(policy.path.absolute()), sha256=policy.sha256)
        )
        return self._done(self._supervisor.ask("switch-policy", message, State.ARMED))

    def start_log(self, request: operator_pb2.StartLogRequest, caller: Caller) -> operator_pb2.StartLogResponse:
        """See the proto."""
        checked_labels(request.labels)
        message = run_link_pb2.ToRun(start_log=request)
        return operator_pb2.StartLogResponse(path=self._supervisor.ask("start-log", message, State.ARMED))

    def label_log(self, request: operator_pb2.LabelLogRequest, caller: Caller) -> operator_pb2.Done:
        """See the proto."""
        checked_labels(request.labels, at_least=1)
        message = run_link_pb2.ToRun(label_log=request)
        return self._done(self._supervisor.ask("label-log", message, State.ARMED, State.RUNNING))

    def attend(self, request: operator_pb2.AttendRequest, caller: Caller) -> operator_pb2.Done:
        """See the proto."""
        self._supervisor.attend()
        return self._done("seen")

    def _done(self, text: str) -> operator_pb2.Done:
        return operator_pb2.Done(state=self._supervisor.state.value, text=text)
