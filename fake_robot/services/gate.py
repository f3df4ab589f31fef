"""What every call passes on its way in: the link and the user token."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import grpc

from fake_robot.services.auth import AuthService
from fake_robot.services.calls import refusing
from fake_robot.services.directory import TOKENLESS_TYPES

_BEARER = "Bearer "


@dataclass
class Link:
    """The network between the clients and the robot. Thread-safe.

    Cuts are measured on the host's clock: in lock-step a cut-off client could not let robot time pass.
    """

    host_now_ns: Callable[[], int] = time.monotonic_ns
    _down_until_ns: int = 0
    _reason: str = ""
    _streams: list[tuple[str, Callable[[], None]]] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def cut(self, duration_s: float, reason: str) -> None:
        """Refuse every call for ``duration_s`` host seconds, and end the open streams."""
        with self._lock:
            self._down_until_ns = self.host_now_ns() + round(duration_s * 1e9)
            self._reason = reason
        self.end_streams()

    def restore(self) -> None:
        """End a cut."""
        with self._lock:
            self._down_until_ns = 0

    def why_down(self) -> str | None:
        """The reason for which calls are refused now; None while the link is up."""
        with self._lock:
            return self._reason if self.host_now_ns() < self._down_until_ns else None

    def end_streams(self, kind: str = "") -> int:
        """End the open streams of one kind (``state`` or ``command``), or all; returns how many."""
        with self._lock:
            chosen = [end for name, end in self._streams if kind in {"", name}]
        for end_stream in chosen:
            end_stream()
        return len(chosen)

    def open_streams(self, kind: str) -> int:
        """How many streams of one kind are open."""
        with self._lock:
            return sum(name == kind for name, _ in self._streams)

    def listen(self, kind: str, end_stream: Callable[[], None]) -> Callable[[], None]:
        """Have ``end_stream`` called when the stream has to end; returns what takes it off the list again."""
        entry = (kind, end_stream)
        with self._lock:
            self._streams.append(entry)

        def forget() -> None:
            with self._lock:
                if entry in self._streams:
                    self._streams.remove(entry)

        return forget


class GatekeeperInterceptor(grpc.ServerInterceptor):
    """Stands before every service of the robot.

    A call is refused while the link is down, and without a valid token, with UNAUTHENTICATED, but for the services that
    need none (auth, robot-id, payload-registration).
    """

    def __init__(self, auth: AuthService, link: Link) -> None:
        self._auth = auth
        self._link = link

    def intercept_service(
        self,
        continuation: Callable[[grpc.HandlerCallDetails], grpc.RpcMethodHandler[Any, Any] | None],
        handler_call_details: grpc.HandlerCallDetails,
    ) -> grpc.RpcMethodHandler[Any, Any] | None:
        """Let the call through, or answer in the service's place."""
        down = self._link.why_down()
        if down is not None:
            return refusing(grpc.StatusCode.UNAVAILABLE, down)
        service = handler_call_details.method.rpartition("/")[0].lstrip("/")
        if service not in TOKENLESS_TYPES and self._auth.user_of(_token_of(handler_call_details)) is None:
            told = f"{service} needs a valid user token: authenticate first, or again (401)"
            return refusing(grpc.StatusCode.UNAUTHENTICATED, told)
        return continuation(handler_call_details)


def _token_of(details: grpc.HandlerCallDetails) -> str:
    for key, value in details.invocation_metadata or ():
        if key == "authorization" and isinstance(value, str) and value.startswith(_BEARER):
            return value[len(_BEARER) :]
    return ""
