"""EstopService: the software e-stop, its configuration, endpoints, challenges and time-outs.

The robot may move only while every endpoint of the active configuration is registered, in time, and asks for level
NONE. A check-in proves that its sender is alive: it answers the last challenge with its bitwise complement. [sdk]
"""

from __future__ import annotations

import secrets
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bosdyn.api import estop_pb2, estop_service_pb2

from fake_robot.network.status import EstopLevel
from fake_robot.services.authority.liveness import Heartbeat, LivenessClock
from fake_robot.services.calls import Service, duration_from_ns, ns_of

REQUIRED_ROLE = "PDB_rooted"

CUT = estop_pb2.ESTOP_LEVEL_CUT
SETTLE_THEN_CUT = estop_pb2.ESTOP_LEVEL_SETTLE_THEN_CUT
NONE = estop_pb2.ESTOP_LEVEL_NONE
LEVELS = {NONE: EstopLevel.NONE, SETTLE_THEN_CUT: EstopLevel.SETTLE_THEN_CUT, CUT: EstopLevel.CUT}
"""The vendor's levels and the robot's; a smaller one of the vendor's is more restrictive."""


@dataclass
class Endpoint:
    """One endpoint of the active configuration and what it last asked for."""

    proto: estop_pb2.EstopEndpoint
    heartbeat: Heartbeat
    level: int = CUT
    challenge: int = 0
    is_registered: bool = False
    is_operator: bool = False


class EstopService(Service):
    """Registers endpoints and hears their check-ins; every change reaches the robot at once.

    A silent endpoint settles the robot, and cuts its power ``cut_after_settle_s`` later unless it says otherwise. With
    ``has_operator``, an operator holds a released endpoint at start.
    """

    modules = (estop_service_pb2,)

    def __init__(
        self,
        clock: LivenessClock,
        *,
        cut_after_settle_s: float,
        are_motors_on: Callable[[], bool],
        apply_level: Callable[[EstopLevel], None],
        has_operator: bool,
    ) -> None:
        super().__init__()
        self._clock, self._cut_after_settle_s, self._has_operator = clock, cut_after_settle_s, has_operator
        self._are_motors_on, self._apply_level = are_motors_on, apply_level
        self.reset()

    def reset(self) -> None:
        """Go back to the state at power-up: the operator's released endpoint, or none at all."""
        with self.lock:
            self._config_id, self._is_pressed_elsewhere = secrets.token_hex(8), False
            self._endpoints: list[Endpoint] = []
            if self._has_operator:
                proto = _with_new_id(estop_pb2.EstopEndpoint(role=REQUIRED_ROLE, name="operator's tablet (fake)"))
                proto.timeout.CopyFrom(duration_from_ns(9_000_000_000))
                operator = Endpoint(proto, self._clock.beat(), level=NONE, is_registered=True, is_operator=True)
                self._endpoints.append(operator)

    def GetEstopConfig(self, request: Any, response: Any) -> None:  # noqa: N802
        """The active configuration."""
        response.request.CopyFrom(request)
        self._tell_config(response)

    def SetEstopConfig(self, request: Any, response: Any) -> None:  # noqa: N802
        """Replace the configuration; not while the motors are on.

        Every endpoint of the new one asks for CUT until it has been registered and has checked in.
        """
        response.request.CopyFrom(request)
        if request.target_config_id != self._config_id:
            response.status = response.STATUS_INVALID_ID
        elif self._are_motors_on():
            response.status = response.STATUS_MOTORS_ON
        else:
            self._config_id, response.status = secrets.token_hex(8), response.STATUS_SUCCESS
            self._endpoints = [Endpoint(_with_new_id(e), self._clock.beat()) for e in request.config.endpoints]
        self._tell_config(response)
        self.apply()

    def RegisterEstopEndpoint(self, request: Any, response: Any) -> None:  # noqa: N802
        """Take over an endpoint of the configuration."""
        response.request.CopyFrom(request)
        new, found = request.new_endpoint, self._find(request.target_endpoint, request.new_endpoint.name)
        if request.target_config_id != self._config_id:
            response.status = response.STATUS_CONFIG_MISMATCH
        elif found is None:
            response.status = response.STATUS_ENDPOINT_MISMATCH
        elif new.role != found.proto.role or not new.name or ns_of(new.timeout) <= 0:
            response.status = response.STATUS_INVALID_ENDPOINT
        else:
            response.status, new = response.STATUS_SUCCESS, _with_new_id(new)
            place = self._endpoints.index(found)
            self._endpoints[place] = Endpoint(new, self._clock.beat(), is_registered=True)
        response.new_endpoint.CopyFrom(new)
        self.apply()

    def DeregisterEstopEndpoint(self, request: Any, response: Any) -> None:  # noqa: N802
        """Let an endpoint go: it asks for CUT from now on."""
        response.request.CopyFrom(request)
        found = self._find(request.target_endpoint)
        if request.target_config_id != self._config_id:
            response.status = response.STATUS_CONFIG_MISMATCH
        elif found is None or not found.is_registered:
            response.status = response.STATUS_ENDPOINT_MISMATCH
        elif self._are_motors_on():
            response.status = response.STATUS_MOTORS_ON
        else:
            found.is_registered, found.level, response.status = False, CUT, response.STATUS_SUCCESS
        self.apply()

    def EstopCheckIn(self, request: Any, response: Any) -> None:  # noqa: N802
        """Hear an endpoint and give it the next challenge. A wrong answer may stop the robot but never release it."""
        response.request.CopyFrom(request)
        known = [e for e in self._endpoints if e.is_registered and e.proto.unique_id == request.endpoint.unique_id]
        if not known or request.stop_level not in LEVELS:
            response.status = response.STATUS_ENDPOINT_UNKNOWN
        else:
            found, challenge = known[0], request.challenge
            is_answer = request.response == challenge ^ (1 << 64) - 1
            if found.challenge and challenge == found.challenge and is_answer:
                found.heartbeat, found.level = self._clock.beat(), request.stop_level
                response.status = response.STATUS_OK
            else:
                found.level = min(found.level, request.stop_level)
                response.status = response.STATUS_INCORRECT_CHALLENGE_RESPONSE
            found.challenge = response.challenge = secrets.randbits(63) + 1
        self.apply()

    def GetEstopSystemStatus(self, request: Any, response: Any) -> None:  # noqa: N802
        """The level, the endpoints, and why the robot is stopped, in words."""
        status = response.status
        status.stop_level, status.stop_level_details = self.level(), self._details()
        for endpoint in self._endpoints:
            entry = status.endpoints.add(endpoint=endpoint.proto, stop_level=self._level_of(endpoint))
            silence_s = 0.0 if endpoint.is_operator else self._clock.elapsed_s(endpoint.heartbeat)
            entry.time_since_valid_response.CopyFrom(duration_from_ns(round(silence_s * 1e9)))

    def press_elsewhere(self, *, is_pressed: bool) -> None:
        """Press or release a button that no client of the service holds."""
        with self.lock:
            self._is_pressed_elsewhere = is_pressed

    def level(self) -> int:
        """What the robot must do now: the most restrictive level of all endpoints."""
        with self.lock:
            levels = [self._level_of(endpoint) for endpoint in self._endpoints]
            return int(CUT if self._is_pressed_elsewhere or not levels else min(levels))

    def apply(self) -> None:
        """Bring the level to the robot; no older one comes after it."""
        with self.lock:
            self._apply_level(LEVELS[self.level()])

    def _find(self, target: estop_pb2.EstopEndpoint, new_name: str = "") -> Endpoint | None:
        """The endpoint that is meant; of several with one role, which the SDK names alone, the new one's own place."""
        meant = [
            endpoint
            for endpoint in self._endpoints
            if endpoint.proto.role == target.role and target.unique_id in {"", endpoint.proto.unique_id}
        ]
        return min(meant, key=lambda e: (e.proto.name != new_name, bool(new_name) and e.is_registered), default=None)

    def _level_of(self, endpoint: Endpoint) -> int:
        if endpoint.is_operator:
            return endpoint.level
        if not endpoint.is_registered:
            return int(CUT)
        silence_s = self._clock.elapsed_s(endpoint.heartbeat)
        timeout_s = ns_of(endpoint.proto.timeout) * 1e-9
        cut_s = ns_of(endpoint.proto.cut_power_timeout) * 1e-9 or timeout_s + self._cut_after_settle_s
        if silence_s > max(cut_s, timeout_s):
            return int(CUT)
        return min(endpoint.level, SETTLE_THEN_CUT) if silence_s > timeout_s else endpoint.level

    def _tell_config(self, response: Any) -> None:
        response.active_config.unique_id = self._config_id
        response.active_config.endpoints.extend(endpoint.proto for endpoint in self._endpoints)

    def _details(self) -> str:
        if self._is_pressed_elsewhere:
            return "a stop button was pressed elsewhere"
        if not self._endpoints:
            return "no e-stop endpoint is configured; set a configuration and register an endpoint"
        reasons = []
        for endpoint in self._endpoints:
            name, silence_s = endpoint.proto.name or endpoint.proto.role, self._clock.elapsed_s(endpoint.heartbeat)
            if not endpoint.is_registered:
                reasons.append(f"endpoint {name!r} is not registered")
            elif self._level_of(endpoint) != endpoint.level:
                reasons.append(f"endpoint {name!r} has been silent for {silence_s:.1f} s")
            elif endpoint.level != NONE:
                reasons.append(f"endpoint {name!r} asks for {estop_pb2.EstopStopLevel.Name(endpoint.level)}")
        return "; ".join(reasons)


def _with_new_id(proto: estop_pb2.EstopEndpoint) -> estop_pb2.EstopEndpoint:
    """A copy under an identifier of its own."""
    copied = estop_pb2.EstopEndpoint()
    copied.CopyFrom(proto)
    copied.unique_id = secrets.token_hex(8)
    return copied
