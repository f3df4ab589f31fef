"""An operator's end of the service: finds it, asks, and turns refusals into errors with words."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping
from itertools import cycle
from pathlib import Path
from typing import Any, Final

import grpc
from typing_extensions import Self

from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.bounded_file import FileTooLargeError, read_at_most
from spot_model.text import plain
from spot_protos import operator_pb2_grpc
from spot_runtime.operator.listening import MAX_PEM_BYTES, SYSTEM_SOCKET, is_loopback, is_unix, stop_path, user_socket

ADDRESS_VARIABLE: Final = "SPOT_RL_OPERATOR"
TIMEOUT_S: Final = 30.0
ARM_TIMEOUT_S: Final = 120.0
STOP_TRIED_S: Final = 2.0
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
            self._channels = [grpc.secure_channel(address, credentials, OPTIONS)]
        elif ca or certificate or key:
            raise BadInputError("--ca, --cert and --key go together; name all three")
        elif not is_loopback(address):
            raise BadInputError(f"{address} is reached over a network, which needs --ca, --cert and --key")
        else:
            self._channels = [grpc.insecure_channel(address, OPTIONS)]
        if is_unix(address) and stop_path(Path(address.removeprefix("unix:"))).exists():
            beside = stop_path(Path(address.removeprefix("unix:")))
            self._channels.append(grpc.insecure_channel(f"unix:{beside}", OPTIONS))
        self._stubs: list[Any] = [operator_pb2_grpc.OperatorStub(c) for c in self._channels]  # type: ignore[no-untyped-call]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        for channel in self._channels:
            channel.close()

    def call(self, name: str, request: Any, timeout_s: float = TIMEOUT_S) -> Any:
        """One call; a stop goes by a socket of its own where there is one, and is tried again where that was cut.

        Raises:
            RefusedError: The service refused.
            UnreachableError: It does not answer.
        """
        is_stop = name in ("Stop", "Damp")
        until_s = time.monotonic() + (STOP_TRIED_S if is_stop else 0.0)
        for stub in cycle(reversed(self._stubs) if is_stop else self._stubs[:1]):
            try:
                return plain_message(getattr(stub, name)(request, timeout=timeout_s))
            except grpc.RpcError as error:
                explained = self._explain(error)
                was_cut = error.code() is grpc.StatusCode.UNAVAILABLE and isinstance(explained, UnreachableError)
                if not was_cut or time.monotonic() >= until_s:
                    raise explained from None
            time.sleep(0.02)
        raise AssertionError("unreachable")

    def stream(self, name: str, request: Any) -> Any:
        """One call that answers again and again. Raises as :meth:`call` does."""
        try:
            yield from map(plain_message, getattr(self._stubs[0], name)(request))
        except grpc.RpcError as error:
            raise self._explain(error) from None

    def _explain(self, error: grpc.RpcError) -> SpotRlError:
        code, words = error.code(), plain(error.details() or "")
        nobody = code is grpc.StatusCode.UNAVAILABLE and not words.partition(":")[0].replace("-", "").isalpha()
        if nobody or code is grpc.StatusCode.DEADLINE_EXCEEDED:
            reason = words.rpartition(" error: ")[2]  # gRPC's innermost
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
