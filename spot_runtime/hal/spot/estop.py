"""The software e-stop: rely on the endpoint that is there, or hold one of our own."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Sequence
from typing import Any, Literal

from bosdyn.api import estop_pb2
from bosdyn.client.estop import EstopClient, EstopEndpoint, IncorrectChallengeResponseError
from bosdyn.client.exceptions import Error

from spot_runtime.hal.errors import EstopError
from spot_runtime.hal.spot.vendor_errors import enum_word

EstopPolicy = Literal["auto", "own", "external"]


def needs_own_endpoint(status: Any, policy: EstopPolicy, our_name: str) -> bool:
    """Whether an endpoint of our own is to be set up, given the vendor's EstopSystemStatus.

    An endpoint with our name belongs to an earlier run and no longer checks in. It does not count, because it
    would stop the robot some seconds from now.

    Raises:
        EstopError: Somebody holds the robot stopped, or no endpoint answers and ``policy`` forbids our own.
    """
    endpoints = list(status.endpoints)
    # An endpoint of ours at CUT was taken back at the end of its run: when we press, we settle first.
    alive = [endpoint for endpoint in endpoints if is_alive(endpoint) and not _is_taken_back(endpoint, our_name)]
    pressed = [endpoint for endpoint in alive if endpoint.stop_level != estop_pb2.ESTOP_LEVEL_NONE]
    left_by_us = [endpoint for endpoint in pressed if endpoint.endpoint.name == our_name]
    if left_by_us and len(left_by_us) == len(pressed):
        left_s = max(_seconds(e.endpoint.timeout) - _seconds(e.time_since_valid_response) for e in left_by_us)
        raise EstopError(
            f"an earlier run pressed the e-stop: {_names(pressed)}; check the robot, then start again in {left_s:.0f} s"
        )
    if pressed:
        raise EstopError(f"an e-stop is pressed: {_names(pressed)}; release it, then start again")
    is_released = status.stop_level == estop_pb2.ESTOP_LEVEL_NONE
    if endpoints and len(alive) == len(endpoints) and not is_released:
        # Replacing an endpoint would not help: none of them is what is pressed.
        why = status.stop_level_details or "the robot does not say which"
        raise EstopError(f"an e-stop is pressed that no endpoint holds: {why}; release it, then start again")
    if is_released and not any(endpoint.endpoint.name == our_name for endpoint in endpoints):
        return policy == "own"
    if policy == "external":
        raise EstopError(
            "no e-stop endpoint answers, so the motors stay off; start one, or set robot.estop: own (or auto)"
        )
    return True


def is_alive(endpoint: Any) -> bool:
    """Whether an endpoint (vendor's EstopEndpointWithStatus) has answered within its own time-out."""
    has_answered = bool(endpoint.HasField("time_since_valid_response"))
    return has_answered and _seconds(endpoint.time_since_valid_response) <= _seconds(endpoint.endpoint.timeout)


class OwnEstop:
    """Our own endpoint: checks in while we live, and can cut power."""

    def __init__(self, client: EstopClient, name: str, timeout_s: float, rpc_timeout_s: float) -> None:
        """Replace the robot's e-stop configuration by this one endpoint. Raises the SDK's errors."""
        self._client, self._endpoint = client, EstopEndpoint(client, name, timeout_s)
        self._rpc_timeout_s = rpc_timeout_s
        self._lock = threading.Lock()
        self._is_pressed = False
        self._endpoint.force_simple_setup()
        self.check_in()

    def check_in(self) -> None:
        """Say that the motors may have power, unless the e-stop was pressed. Raises the SDK's errors."""
        with self._lock:
            if not self._is_pressed:
                self._endpoint.allow(timeout=self._rpc_timeout_s)

    def let_go(self) -> None:
        """Take the endpoint back, so that nobody relies on it. Raises the SDK's errors, also while there is power."""
        self._client.deregister(self._endpoint._config_id, self._endpoint, timeout=self._rpc_timeout_s)

    def press(self) -> None:
        """Have the robot settle on the ground and cut its motors' power. Raises the SDK's errors.

        At once, also while a check-in is under way: both answer one challenge, so the robot refuses whichever comes
        second. Then once more when that check-in is over, lest it came after this and with the newer challenge.
        """
        self._is_pressed = True
        if self._lock.acquire(blocking=False):
            try:
                self._settle()
            finally:
                self._lock.release()
            return
        with contextlib.suppress(Error):
            self._settle()
        with self._lock:
            self._settle()

    def _settle(self) -> None:
        try:
            self._endpoint.settle_then_cut(timeout=self._rpc_timeout_s)
        except IncorrectChallengeResponseError:
            # The answer to a check-in got lost, or came first, and its challenge with it. The refusal brought another.
            self._endpoint.settle_then_cut(timeout=self._rpc_timeout_s)


def _is_taken_back(endpoint: Any, our_name: str) -> bool:
    return bool(endpoint.endpoint.name == our_name and endpoint.stop_level == estop_pb2.ESTOP_LEVEL_CUT)


def _seconds(duration: Any) -> float:
    return float(duration.seconds + duration.nanos * 1e-9)


def _names(endpoints: Sequence[Any]) -> str:
    levels = [enum_word(estop_pb2.EstopStopLevel, e.stop_level, "ESTOP_LEVEL_") for e in endpoints]
    return ", ".join(f"{e.endpoint.name or 'unnamed'} ({level})" for e, level in zip(endpoints, levels, strict=True))
