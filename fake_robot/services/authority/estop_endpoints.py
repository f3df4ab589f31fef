"""The software e-stop: configuration, endpoints, challenges, time-outs. Pure bookkeeping, no gRPC.

The robot may move only while every endpoint of the active configuration is registered, in time, and asks for level
NONE. A check-in proves that its sender is alive: it answers the last challenge with its bitwise complement. [sdk]
"""

from __future__ import annotations

import secrets
import threading
from collections.abc import Callable
from dataclasses import dataclass, field

from bosdyn.api import estop_pb2

from fake_robot.services.authority.liveness import Heartbeat, LivenessClock
from fake_robot.services.calls.stamps import StatusValue, duration_from_ns, ns_from_duration

REQUIRED_ROLE = "PDB_rooted"
OPERATOR_NAME = "operator's tablet (fake)"
OPERATOR_TIMEOUT_NS = 9_000_000_000
ALL_64_BITS = (1 << 64) - 1

CUT = estop_pb2.ESTOP_LEVEL_CUT
SETTLE_THEN_CUT = estop_pb2.ESTOP_LEVEL_SETTLE_THEN_CUT
NONE = estop_pb2.ESTOP_LEVEL_NONE
LEVELS = (CUT, SETTLE_THEN_CUT, NONE)

CheckIn = estop_pb2.EstopCheckInResponse
Register = estop_pb2.RegisterEstopEndpointResponse
Deregister = estop_pb2.DeregisterEstopEndpointResponse
SetConfig = estop_pb2.SetEstopConfigResponse


@dataclass
class Endpoint:
    """One endpoint of the active configuration and what it last asked for."""

    proto: estop_pb2.EstopEndpoint
    heartbeat: Heartbeat
    level: int = CUT
    challenge: int = 0
    is_registered: bool = False
    is_operator: bool = False


@dataclass
class EstopEndpoints:
    """The e-stop service's memory. Thread-safe."""

    clock: LivenessClock
    cut_after_settle_s: float
    are_motors_on: Callable[[], bool]
    has_operator: bool
    _endpoints: list[Endpoint] = field(default_factory=list)
    _config_id: str = ""
    _is_pressed_elsewhere: bool = False
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def __post_init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Go back to the state at power-up: the operator's released endpoint, or none at all."""
        with self._lock:
            self._config_id = _new_id()
            self._endpoints = []
            self._is_pressed_elsewhere = False
            if self.has_operator:
                proto = estop_pb2.EstopEndpoint(role=REQUIRED_ROLE, name=OPERATOR_NAME, unique_id=_new_id())
                proto.timeout.CopyFrom(duration_from_ns(OPERATOR_TIMEOUT_NS))
                operator = Endpoint(proto, self.clock.beat(), level=NONE, is_registered=True, is_operator=True)
                self._endpoints.append(operator)

    def config(self) -> estop_pb2.EstopConfig:
        """The active configuration."""
        with self._lock:
            return estop_pb2.EstopConfig(unique_id=self._config_id, endpoints=[e.proto for e in self._endpoints])

    def set_config(self, config: estop_pb2.EstopConfig, target_config_id: str) -> StatusValue:
        """Replace the configuration; returns ``SetEstopConfigResponse`` status.

        Every endpoint of the new one asks for CUT until it has been registered and has checked in.
        """
        with self._lock:
            if target_config_id != self._config_id:
                return SetConfig.STATUS_INVALID_ID
            if self.are_motors_on():
                return SetConfig.STATUS_MOTORS_ON
            self._config_id = _new_id()
            self._endpoints = []
            for endpoint in config.endpoints:
                proto = estop_pb2.EstopEndpoint()
                proto.CopyFrom(endpoint)
                proto.unique_id = _new_id()
                self._endpoints.append(Endpoint(proto, self.clock.beat()))
            return SetConfig.STATUS_SUCCESS

    def register(
        self, target_config_id: str, target: estop_pb2.EstopEndpoint, new: estop_pb2.EstopEndpoint
    ) -> tuple[StatusValue, estop_pb2.EstopEndpoint]:
        """Take over an endpoint of the configuration; returns ``RegisterEstopEndpointResponse`` status and endpoint."""
        with self._lock:
            if target_config_id != self._config_id:
                return Register.STATUS_CONFIG_MISMATCH, new
            found = self._find(target, new.name)
            if found is None:
                return Register.STATUS_ENDPOINT_MISMATCH, new
            if new.role != found.proto.role or not new.name or ns_from_duration(new.timeout) <= 0:
                return Register.STATUS_INVALID_ENDPOINT, new
            proto = estop_pb2.EstopEndpoint()
            proto.CopyFrom(new)
            proto.unique_id = _new_id()
            index = self._endpoints.index(found)
            self._endpoints[index] = Endpoint(proto, self.clock.beat(), is_registered=True)
            return Register.STATUS_SUCCESS, proto

    def deregister(self, target_config_id: str, target: estop_pb2.EstopEndpoint) -> StatusValue:
        """Let an endpoint go: it asks for CUT from now on. Returns ``DeregisterEstopEndpointResponse`` status."""
        with self._lock:
            if target_config_id != self._config_id:
                return Deregister.STATUS_CONFIG_MISMATCH
            found = self._find(target)
            if found is None or not found.is_registered:
                return Deregister.STATUS_ENDPOINT_MISMATCH
            if self.are_motors_on():
                return Deregister.STATUS_MOTORS_ON
            found.is_registered, found.level = False, CUT
            return Deregister.STATUS_SUCCESS

    def check_in(
        self, endpoint: estop_pb2.EstopEndpoint, challenge: int, response: int, level: int
    ) -> tuple[StatusValue, int]:
        """Hear an endpoint; returns ``EstopCheckInResponse`` status and the next challenge.

        A wrong answer may stop the robot but never release it.
        """
        with self._lock:
            known = [e for e in self._endpoints if e.is_registered]
            found = next((e for e in known if e.proto.unique_id == endpoint.unique_id), None)
            if found is None or level not in LEVELS:
                return CheckIn.STATUS_ENDPOINT_UNKNOWN, 0
            is_right = bool(found.challenge) and challenge == found.challenge and response == challenge ^ ALL_64_BITS
            found.challenge = secrets.randbits(63) + 1
            if is_right:
                found.heartbeat, found.level = self.clock.beat(), level
            else:
                found.level = min(found.level, level)
            return (CheckIn.STATUS_OK if is_right else CheckIn.STATUS_INCORRECT_CHALLENGE_RESPONSE), found.challenge

    def press_elsewhere(self, *, is_pressed: bool) -> None:
        """Press or release a button that no client of the service holds."""
        with self._lock:
            self._is_pressed_elsewhere = is_pressed

    def level(self) -> StatusValue:
        """What the robot must do now: the most restrictive level of all endpoints."""
        with self._lock:
            levels = [self._level_of(endpoint) for endpoint in self._endpoints]
            return CUT if self._is_pressed_elsewhere or not levels else min(levels)

    def status(self) -> estop_pb2.EstopSystemStatus:
        """The level, the endpoints, and why the robot is stopped, in words."""
        with self._lock:
            status = estop_pb2.EstopSystemStatus(stop_level=self.level(), stop_level_details=self._details())
            for endpoint in self._endpoints:
                entry = status.endpoints.add(endpoint=endpoint.proto, stop_level=self._level_of(endpoint))
                silence_s = 0.0 if endpoint.is_operator else self.clock.elapsed_s(endpoint.heartbeat)
                entry.time_since_valid_response.CopyFrom(duration_from_ns(round(silence_s * 1e9)))
            return status

    def _find(self, target: estop_pb2.EstopEndpoint, new_name: str = "") -> Endpoint | None:
        """The endpoint that is meant; of several with one role, which the SDK names alone, the new one's own place."""
        meant = [
            endpoint
            for endpoint in self._endpoints
            if endpoint.proto.role == target.role and target.unique_id in {"", endpoint.proto.unique_id}
        ]
        return min(meant, key=lambda e: (e.proto.name != new_name, bool(new_name) and e.is_registered), default=None)

    def _level_of(self, endpoint: Endpoint) -> StatusValue:
        if endpoint.is_operator:
            return endpoint.level
        if not endpoint.is_registered:
            return CUT
        silence_s = self.clock.elapsed_s(endpoint.heartbeat)
        timeout_s = ns_from_duration(endpoint.proto.timeout) * 1e-9
        cut_s = ns_from_duration(endpoint.proto.cut_power_timeout) * 1e-9 or timeout_s + self.cut_after_settle_s
        if silence_s > max(cut_s, timeout_s):
            return CUT
        return min(endpoint.level, SETTLE_THEN_CUT) if silence_s > timeout_s else endpoint.level

    def _details(self) -> str:
        if self._is_pressed_elsewhere:
            return "a stop button was pressed elsewhere"
        if not self._endpoints:
            return "no e-stop endpoint is configured; set a configuration and register an endpoint"
        reasons = []
        for endpoint in self._endpoints:
            name = endpoint.proto.name or endpoint.proto.role
            if not endpoint.is_registered:
                reasons.append(f"endpoint {name!r} is not registered")
            elif self._level_of(endpoint) != endpoint.level:
                reasons.append(
                    f"endpoint {name!r} has been silent for {self.clock.elapsed_s(endpoint.heartbeat):.1f} s"
                )
            elif endpoint.level != NONE:
                reasons.append(f"endpoint {name!r} asks for {estop_pb2.EstopStopLevel.Name(endpoint.level)}")
        return "; ".join(reasons)


def _new_id() -> str:
    return secrets.token_hex(8)
