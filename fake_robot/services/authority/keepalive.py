"""KeepaliveService: policies that say what the robot does when a client falls silent."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bosdyn.api.keepalive import keepalive_pb2

from fake_robot.services.authority.liveness import Heartbeat, LivenessClock
from fake_robot.services.calls.stamps import ns_from_duration, timestamp_from_ns

MAX_POLICIES = 64
Control = keepalive_pb2.GetStatusResponse
_CONTROLS = {
    "auto_return": Control.POLICY_CONTROL_ACTION_AUTO_RETURN,
    "controlled_motors_off": Control.POLICY_CONTROL_ACTION_MOTORS_OFF,
    "immediate_motors_off": Control.POLICY_CONTROL_ACTION_MOTORS_OFF,
    "immediate_robot_off": Control.POLICY_CONTROL_ACTION_ROBOT_OFF,
}
"""What actions do for as long as their client stays silent."""

Act = Callable[[keepalive_pb2.ActionAfter], None]


@dataclass
class LivePolicy:
    """A policy, its client's last sign of life, and which of its actions have been taken since."""

    policy_id: int
    proto: keepalive_pb2.Policy
    client_name: str
    heartbeat: Heartbeat
    taken: set[int] = field(default_factory=set)


@dataclass
class KeepalivePolicies:
    """Active policies. Thread-safe."""

    clock: LivenessClock
    _policies: dict[int, LivePolicy] = field(default_factory=dict)
    _last_id: int = 0
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def add(self, policy: keepalive_pb2.Policy, client_name: str) -> LivePolicy:
        """Start a policy; its time runs from now."""
        with self._lock:
            self._last_id += 1
            kept = keepalive_pb2.Policy()
            kept.CopyFrom(policy)
            while len(self._policies) >= MAX_POLICIES:
                del self._policies[next(iter(self._policies))]
            self._policies[self._last_id] = LivePolicy(self._last_id, kept, client_name, self.clock.beat())
            return self._policies[self._last_id]

    def remove(self, policy_id: int) -> LivePolicy | None:
        """End a policy; None if there is none of that number."""
        with self._lock:
            return self._policies.pop(policy_id, None)

    def check_in(self, policy_id: int) -> LivePolicy | None:
        """Hear a client; its policy's time starts again. None if there is none of that number."""
        with self._lock:
            policy = self._policies.get(policy_id)
            if policy is not None:
                policy.heartbeat = self.clock.beat()
                policy.taken.clear()
            return policy

    def policies(self) -> list[LivePolicy]:
        """Every active policy."""
        with self._lock:
            return list(self._policies.values())

    def due(self) -> list[keepalive_pb2.ActionAfter]:
        """The actions whose time has come since the last call; each comes once a silence."""
        actions = []
        with self._lock:
            for policy in self._policies.values():
                silence_s = self.clock.elapsed_s(policy.heartbeat)
                for index, action in enumerate(policy.proto.actions):
                    if index not in policy.taken and silence_s > ns_from_duration(action.after) * 1e-9:
                        policy.taken.add(index)
                        actions.append(action)
        return actions

    def controls(self) -> set[Any]:
        """What the policies of silent clients do with the robot now, as values of ``PolicyControlAction``."""
        with self._lock:
            kinds = [p.proto.actions[index].WhichOneof("action") for p in self._policies.values() for index in p.taken]
        return {_CONTROLS[kind] for kind in kinds if kind in _CONTROLS}

    def holds_motors_off(self) -> bool:
        """Whether a silent client's policy keeps the motors without power."""
        return Control.POLICY_CONTROL_ACTION_MOTORS_OFF in self.controls()

    def reset(self) -> None:
        """Drop every policy, as a reboot does."""
        with self._lock:
            self._policies.clear()


class KeepaliveService:
    """Adds, removes and lists policies."""

    def __init__(self, records: KeepalivePolicies) -> None:
        self._records = records

    def ModifyPolicy(self, request: Any) -> Any:  # noqa: N802
        """Remove policies, then add one. Nothing happens when one to remove is unknown."""
        response = keepalive_pb2.ModifyPolicyResponse()
        known = {policy.policy_id for policy in self._records.policies()}
        if not known.issuperset(request.policy_ids_to_remove):
            response.status = response.STATUS_INVALID_POLICY_ID
            return response
        for policy_id in request.policy_ids_to_remove:
            removed = self._records.remove(policy_id)
            if removed is not None:
                response.removed_policies.append(_to_proto(removed))
        if request.HasField("to_add"):
            response.added_policy.CopyFrom(_to_proto(self._records.add(request.to_add, request.header.client_name)))
        response.status = response.STATUS_OK
        return response

    def CheckIn(self, request: Any) -> Any:  # noqa: N802
        """Hear a client."""
        response = keepalive_pb2.CheckInResponse()
        policy = self._records.check_in(request.policy_id)
        if policy is None:
            response.status = response.STATUS_INVALID_POLICY_ID
            return response
        response.status = response.STATUS_OK
        response.last_checkin.CopyFrom(timestamp_from_ns(policy.heartbeat.robot_stamp_ns))
        return response

    def GetStatus(self, request: Any) -> Any:  # noqa: N802
        """List the active policies, and what they do with the robot."""
        status = [_to_proto(policy) for policy in self._records.policies()]
        controls = sorted(self._records.controls())
        return keepalive_pb2.GetStatusResponse(status=status, active_control_actions=controls)


def _to_proto(policy: LivePolicy) -> keepalive_pb2.LivePolicy:
    proto = keepalive_pb2.LivePolicy(policy_id=policy.policy_id, policy=policy.proto, client_name=policy.client_name)
    proto.last_checkin.CopyFrom(timestamp_from_ns(policy.heartbeat.robot_stamp_ns))
    return proto
