"""Who may ask: roles from certificates, how often each client may call, and how many streams are open at once.

On a Unix socket whoever may open the file operates; on loopback whoever is logged in to this computer does. Over a
network only clients with a certificate are heard, and the certificate says the role: a URI among its alternative names,
``urn:spot-rl:role:observe`` or ``urn:spot-rl:role:operate``.
"""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Final, cast

import grpc

from spot_runtime.operator.refusal import Refusal

ROLE_URI: Final = "urn:spot-rl:role:"
MAX_CLIENTS: Final = 256
MAX_STREAMS: Final = 8


class Role(Enum):
    """What a client may do. Whoever has a role may also stop and damp the robot: a stop must not want a permission."""

    OBSERVE = "observe"
    OPERATE = "operate"


class Buckets:
    """A bucket of tokens for each client; a call takes one, time fills them up again."""

    def __init__(self, rate_hz: float, *, now_s: Callable[[], float] = time.monotonic) -> None:
        """Allow ``rate_hz`` calls a second, and a second's worth at once."""
        self._rate_hz, self._now_s = rate_hz, now_s
        self._lock = threading.Lock()
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()

    def take(self, client: str) -> bool:
        """Whether this client may call now."""
        now_s = self._now_s()
        with self._lock:
            tokens, since_s = self._buckets.pop(client, (self._rate_hz, now_s))
            tokens = min(self._rate_hz, tokens + (now_s - since_s) * self._rate_hz)
            is_allowed = tokens >= 1.0
            self._buckets[client] = (tokens - 1.0 if is_allowed else tokens, now_s)
            while len(self._buckets) > MAX_CLIENTS:
                self._buckets.popitem(last=False)
            return is_allowed


class Gate:
    """Lets calls in, or says why not."""

    def __init__(self, *, is_tls: bool, requests_per_s: float, steering_per_s: float) -> None:
        """With ``is_tls`` roles come from certificates; otherwise whoever reaches the service operates."""
        self._is_tls = is_tls
        self._requests, self._steering = Buckets(requests_per_s), Buckets(steering_per_s)
        self._rates = {False: requests_per_s, True: steering_per_s}
        self._streams = threading.BoundedSemaphore(MAX_STREAMS)

    def admit(
        self,
        name: str,
        context: grpc.ServicerContext,
        needed: Role,
        *,
        is_steering: bool = False,
        is_stopping: bool = False,
    ) -> str:
        """Check role and rate of a call; one that stops the robot is never too often.

        Returns the client's name, empty where no certificate names it.

        Raises:
            Refusal: The role does not allow it, or it comes too often.
        """
        client, role = self._who(context)
        if role is None:
            raise Refusal(
                grpc.StatusCode.PERMISSION_DENIED,
                f"{name}: the certificate of {client!r} names no role; it needs the URI {ROLE_URI}observe or "
                f"{ROLE_URI}operate among its alternative names",
            )
        if needed is Role.OPERATE and role is not Role.OPERATE:
            raise Refusal(
                grpc.StatusCode.PERMISSION_DENIED,
                f"{name} needs the role operate, and the certificate of {client!r} has observe; use an operator's",
            )
        buckets = self._steering if is_steering else self._requests
        if not is_stopping and not buckets.take(client or context.peer()):
            raise Refusal(
                grpc.StatusCode.RESOURCE_EXHAUSTED,
                f"{name}: more than {self._rates[is_steering]:g} calls a second; call less often",
            )
        return client

    def open_stream(self, name: str) -> None:
        """Take one of the streams; :meth:`close_stream` gives it back. Raises Refusal."""
        if not self._streams.acquire(blocking=False):
            raise Refusal(
                grpc.StatusCode.RESOURCE_EXHAUSTED, f"{name}: {MAX_STREAMS} streams are open already; close one"
            )

    def close_stream(self) -> None:
        """Give a stream back."""
        self._streams.release()

    def _who(self, context: grpc.ServicerContext) -> tuple[str, Role | None]:
        if not self._is_tls:
            return "", Role.OPERATE
        about = cast("Mapping[str, Sequence[bytes]]", context.auth_context())
        client = b"".join(about.get("x509_common_name", ())).decode("utf-8", errors="replace")
        uris = {name.decode("utf-8", errors="replace") for name in about.get("x509_subject_alternative_name", ())}
        for role in (Role.OPERATE, Role.OBSERVE):
            if ROLE_URI + role.value in uris:
                return client, role
        return client, None
