"""An operator's end of the service: finds it, asks, and turns refusals into errors with words."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any, Final

import grpc
from typing_extensions import Self

from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.yaml_text import FileTooLargeError, read_at_most
from spot_model.text import plain
from spot_protos import operator_pb2
from spot_protos.stub import stub
from spot_runtime.causes import refusal, shortage
from spot_runtime.operator.listening import MAX_PEM_BYTES, SYSTEM_SOCKET, is_loopback, user_socket

ADDRESS_VARIABLE: Final = "SPOT_RL_OPERATOR"
TIMEOUT_S: Final = 30.0
ARM_TIMEOUT_S: Final = 120.0
INSISTED_ON: Final = ("Stop", "Damp", "Attend")
"""Calls that may be made twice without harm, and that a cut connection must not keep from the robot."""
INSIST_S: Final = 5.0
TRY_S: Final = 1.0
"""Of the first try that gets no answer; each one after it may take twice as long, for slow links."""
PAUSE_S: Final = 0.02
VERDICTS: Final = (
    grpc.StatusCode.FAILED_PRECONDITION,
    grpc.StatusCode.INVALID_ARGUMENT,
    grpc.StatusCode.PERMISSION_DENIED,
    grpc.StatusCode.UNAUTHENTICATED,
    grpc.StatusCode.UNIMPLEMENTED,
)
"""Answers of the service; with anything else a call may not even have reached it."""
OPTIONS: Final = (
    ("grpc.keepalive_time_ms", 10_000),
    ("grpc.enable_retries", 0),
    ("grpc.use_local_subchannel_pool", 1),
    ("grpc.initial_reconnect_backoff_ms", 50),
    ("grpc.max_reconnect_backoff_ms", 1_000),
)


class RefusedError(SpotRlError):
    """The service refused; its words say why and what to do."""

    exit_code = 95


class UnreachableError(SpotRlError):
    """No service answers."""

    exit_code = 96


def find_address(given: str | None, environment: Mapping[str, str]) -> str:
    """Where the service is: as given, as the environment says, the system's socket if it is there, or the user's."""
    if given or environment.get(ADDRESS_VARIABLE):
        return given or environment[ADDRESS_VARIABLE]
    runtime = environment.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    if runtime:
        return f"unix:{Path(runtime) / SYSTEM_SOCKET.name}"
    return f"unix:{SYSTEM_SOCKET if SYSTEM_SOCKET.exists() else user_socket(environment)}"


class OperatorClient:
    """Asks the service; use it in a ``with`` statement."""

    def __init__(
        self, address: str, *, ca: Path | None = None, certificate: Path | None = None, key: Path | None = None
    ) -> None:
        """Prepare; the first call connects.

        Raises:
            BadInputError: The address is none, the network is to be used without TLS, or a file cannot be read.
        """
        self.address = address
        if ca is not None and certificate is not None and key is not None:
            credentials = grpc.ssl_channel_credentials(_read(ca), _read(key), _read(certificate))
            self._connect = partial(grpc.secure_channel, address, credentials, OPTIONS)
        elif ca or certificate or key:
            raise BadInputError("--ca, --cert and --key go together; name all three")
        elif not is_loopback(address):
            raise BadInputError(f"{address} is reached over a network, which needs --ca, --cert and --key")
        else:
            self._connect = partial(grpc.insecure_channel, address, OPTIONS)
        self._channel = self._connect()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._channel.close()

    def call(self, name: str, request: Any, timeout_s: float | None = None) -> Any:
        """One call; stop, damp and attend are tried again until the time is over, each time on a new connection.

        Without a time, those take :data:`INSIST_S`, and the others :data:`TIMEOUT_S`.

        Raises:
            RefusedError: The service refused.
            UnreachableError: It does not answer.
        """
        if name in INSISTED_ON:
            return self._insist(name, request, timeout_s or INSIST_S)
        try:
            return plain_message(
                getattr(stub(self._channel, operator_pb2), name)(request, timeout=timeout_s or TIMEOUT_S)
            )
        except grpc.RpcError as error:
            raise self._explain(error) from None

    def stream(self, name: str, request: Any) -> Any:
        """One call that answers again and again. Raises as :meth:`call` does."""
        try:
            yield from map(plain_message, getattr(stub(self._channel, operator_pb2), name)(request))
        except grpc.RpcError as error:
            raise self._explain(error) from None

    def _insist(self, name: str, request: Any, timeout_s: float) -> Any:
        until_s, try_s, channel = time.monotonic() + timeout_s, TRY_S, self._channel
        told: SpotRlError | None = None  # the last answer but silence, which says less
        with ExitStack() as made:
            while True:
                left_s = until_s - time.monotonic()
                try:
                    return plain_message(
                        getattr(stub(channel, operator_pb2), name)(request, timeout=min(try_s, left_s))
                    )
                except grpc.RpcError as error:
                    is_silent = error.code() is grpc.StatusCode.DEADLINE_EXCEEDED
                    told = told if is_silent and told else self._explain(error)
                    if error.code() in VERDICTS or time.monotonic() + PAUSE_S >= until_s:
                        raise told from None
                    try_s *= 2.0 if is_silent else 1.0
                time.sleep(PAUSE_S)
                made.close()
                channel = made.enter_context(self._connect())

    def _explain(self, error: grpc.RpcError) -> SpotRlError:
        code, words = error.code(), plain(error.details() or "")
        is_by_service = words.partition(":")[0].replace("-", "").isalpha()
        is_busy = code is grpc.StatusCode.RESOURCE_EXHAUSTED or (code is grpc.StatusCode.UNAVAILABLE and is_by_service)
        if code not in VERDICTS and not is_busy:
            reason = words.rpartition(" error: ")[2]  # gRPC's innermost
            if lacks := shortage(words):
                return UnreachableError(f"the service at {self.address} cannot be reached: {lacks}")
            if does := refusal(words):
                return UnreachableError(f"the service at {self.address} {does} ({reason})")
            return UnreachableError(
                f"no service answers at {self.address} ({reason}); start it with 'spot-rl serve', or name its "
                f"address with --address or {ADDRESS_VARIABLE}"
            )
        return RefusedError(words or str(code))


def plain_message(message: Any) -> Any:
    """A message whose texts, which may be a robot's, hold nothing that a terminal obeys; changed in place."""
    for field, value in message.ListFields():
        if field.message_type is not None and field.message_type.GetOptions().map_entry:
            continue  # keys of labels and figures, checked where they come in
        if field.message_type is not None:
            for part in value if field.is_repeated else (value,):
                plain_message(part)
        elif field.type == field.TYPE_STRING:
            if field.is_repeated:
                value[:] = [plain(text) for text in value]
            else:
                setattr(message, field.name, plain(value))
    return message


def client_from(
    address: str | None, ca: Path | None = None, certificate: Path | None = None, key: Path | None = None
) -> OperatorClient:
    """A client as the command line describes it."""
    return OperatorClient(find_address(address, os.environ), ca=ca, certificate=certificate, key=key)


def _read(path: Path) -> bytes:
    try:
        return read_at_most(path, MAX_PEM_BYTES)
    except (OSError, FileTooLargeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise BadInputError(f"file {path} cannot be read: {reason}; give a PEM file") from error
