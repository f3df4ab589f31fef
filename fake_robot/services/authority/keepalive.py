"""KeepaliveService: policies that say what the robot does when a client falls silent."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bosdyn.api import lease_pb2
from bosdyn.api.keepalive import keepalive_pb2, keepalive_service_pb2

from fake_robot.services.authority.liveness import Heartbeat, LivenessClock
from fake_robot.services.calls import Service, ns_of, timestamp_from_ns

Control = keepalive_pb2.GetStatusResponse
_CONTROLS = {
    "auto_return": Control.POLICY_CONTROL_ACTION_AUTO_RETURN,
    "controlled_motors_off": Control.POLICY_CONTROL_ACTION_MOTORS_OFF,
    "immediate_motors_off": Control.POLICY_CONTROL_ACTION_MOTORS_OFF,
    "immediate_robot_off": Control.POLICY_CONTROL_ACTION_ROBOT_OFF,
}
"""What actions do for as long as their client stays silent."""


@dataclass
class LivePolicy:
    """A policy as clients see it, its client's last sign of life, and which of its actions have been taken since."""

    proto: keepalive_pb2.LivePolicy
    heartbeat: Heartbeat
    taken: set[int] = field(default_factory=set)

    def __post_init__(self) -> None:
        self.hear(self.heartbeat)

    def hear(self, heartbeat: Heartbeat) -> None:
        """Let its time start again."""
        self.heartbeat = heartbeat
        self.proto.last_checkin.CopyFrom(timestamp_from_ns(heartbeat.robot_stamp_ns))
        self.taken.clear()


class KeepaliveService(Service):
    """Adds, removes and lists policies, and tells which actions are due."""

    modules = (keepalive_service_pb2,)

    def __init__(self, clock: LivenessClock, is_owned: Callable[[lease_pb2.Lease], bool]) -> None:
        """Measure silence by ``clock``; a policy ends once ``is_owned`` says no of a lease that it is tied to."""
        super().__init__()
        self._clock, self._is_owned = clock, is_owned
        self._policies: dict[int, LivePolicy] = {}
        self._last_id = 0

    def ModifyPolicy(self, request: Any, response: Any) -> None:  # noqa: N802
        """Remove policies, then add one. Nothing happens when one to remove is unknown."""
        self._drop_orphans()
        if not set(request.policy_ids_to_remove) <= set(self._policies):
            response.status = response.STATUS_INVALID_POLICY_ID
            return
        if not all(map(self._is_owned, request.to_add.associated_leases)):
            response.status = response.STATUS_INVALID_LEASE
            return
        removed = (self._policies.pop(policy_id, None) for policy_id in request.policy_ids_to_remove)
        response.removed_policies.extend(policy.proto for policy in removed if policy is not None)
        if request.HasField("to_add"):
            self._last_id += 1
            while len(self._policies) >= 64:
                del self._policies[next(iter(self._policies))]
            added = keepalive_pb2.LivePolicy(policy_id=self._last_id, policy=request.to_add)
            added.client_name = request.header.client_name
            self._policies[self._last_id] = policy = LivePolicy(added, self._clock.beat())
            response.added_policy.CopyFrom(policy.proto)
        response.status = response.STATUS_OK

    def CheckIn(self, request: Any, response: Any) -> None:  # noqa: N802
        """Hear a client; its policy's time starts again."""
        self._drop_orphans()
        policy = self._policies.get(request.policy_id)
        if policy is None:
            response.status = response.STATUS_INVALID_POLICY_ID
            return
        policy.hear(self._clock.beat())
        response.status = response.STATUS_OK
        response.last_checkin.CopyFrom(policy.proto.last_checkin)

    def GetStatus(self, request: Any, response: Any) -> None:  # noqa: N802
        """List the active policies, and what they do with the robot."""
        self._drop_orphans()
        response.status.extend(policy.proto for policy in self._policies.values())
        response.active_control_actions.extend(sorted(self._controls()))

    def due(self) -> list[keepalive_pb2.ActionAfter]:
        """The actions whose time has come since the last call; each comes once a silence."""
        actions = []
        with self.lock:
            self._drop_orphans()
            for policy in self._policies.values():
                silence_s = self._clock.elapsed_s(policy.heartbeat)
                for index, action in enumerate(policy.proto.policy.actions):
                    if index not in policy.taken and silence_s > ns_of(action.after) * 1e-9:
                        policy.taken.add(index)
                        actions.append(action)
        return actions

    def holds_motors_off(self) -> bool:
        """Whether a silent client's policy keeps the motors without power."""
        with self.lock:
            self._drop_orphans()
            return Control.POLICY_CONTROL_ACTION_MOTORS_OFF in self._controls()

    def reset(self) -> None:
        """Drop every policy, as a reboot does."""
        with self.lock:
            self._policies.clear()

    def _drop_orphans(self) -> None:
        """End the policies that are tied to a lease which no longer owns the robot."""
        for policy_id, policy in list(self._policies.items()):
            if not all(map(self._is_owned, policy.proto.policy.associated_leases)):
                del self._policies[policy_id]

    def _controls(self) -> set[Any]:
        """What the policies of silent clients do with the robot now, as values of ``PolicyControlAction``."""
        taken = [p.proto.policy.actions[index] for p in self._policies.values() for index in p.taken]
        kinds = [action.WhichOneof("action") for action in taken]
        return {_CONTROLS[kind] for kind in kinds if kind in _CONTROLS}
