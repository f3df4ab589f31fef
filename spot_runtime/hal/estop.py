"""The software e-stop: rely on the endpoint that is there, or hold one of our own."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

from bosdyn.api import estop_pb2
from bosdyn.client.estop import EstopClient, EstopEndpoint

from spot_runtime.hal.errors import EstopError

Policy = Literal["auto", "own", "external"]


def needs_own_endpoint(status: Any, policy: Policy) -> bool:
    """Whether an endpoint of our own is to be set up, given the vendor's EstopSystemStatus.

    Raises:
        EstopError: An endpoint that answers holds the robot stopped, or there is none and ``policy`` forbids our own.
    """
    if status.stop_level == estop_pb2.ESTOP_LEVEL_NONE:
        return bool(policy == "own")
    pressed = [e for e in status.endpoints if is_alive(e) and e.stop_level != estop_pb2.ESTOP_LEVEL_NONE]
    if pressed:
        raise EstopError(f"an e-stop is pressed: {_names(pressed)}; release it, then start again")
    if policy == "external":
        raise EstopError(
            "no e-stop endpoint answers, so the motors stay off; start one, or set robot.estop: own (or auto)"
        )
    return True


def is_alive(endpoint: Any) -> bool:
    """Whether an endpoint (vendor's EstopEndpointWithStatus) has answered within its own time-out."""
    timeout = endpoint.endpoint.timeout
    silent = endpoint.time_since_valid_response
    has_answered = bool(endpoint.HasField("time_since_valid_response"))
    return has_answered and silent.seconds + silent.nanos * 1e-9 <= timeout.seconds + timeout.nanos * 1e-9


class OwnEstop:
    """Our own endpoint: checks in while we live, and can cut power."""

    def __init__(self, client: EstopClient, name: str, timeout_s: float, rpc_timeout_s: float) -> None:
        """Replace the robot's e-stop configuration by this one endpoint. Raises the SDK's errors."""
        self._endpoint = EstopEndpoint(client, name, timeout_s)
        self._rpc_timeout_s = rpc_timeout_s
        self._endpoint.force_simple_setup()
        self.check_in()

    def check_in(self) -> None:
        """Say that the motors may have power. Raises the SDK's errors."""
        self._endpoint.allow(timeout=self._rpc_timeout_s)

    def press(self) -> None:
        """Have the robot settle on the ground and cut its motors' power. Raises the SDK's errors."""
        self._endpoint.settle_then_cut(timeout=self._rpc_timeout_s)


def _names(endpoints: Sequence[Any]) -> str:
    def level(endpoint: Any) -> str:
        return str(estop_pb2.EstopStopLevel.Name(endpoint.stop_level)).removeprefix("ESTOP_LEVEL_").lower()

    return ", ".join(f"{e.endpoint.name or 'unnamed'} ({level(e)})" for e in endpoints)
