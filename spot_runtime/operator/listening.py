"""Where the service listens: a Unix socket or loopback, and anything else only with mutual TLS."""

from __future__ import annotations

import contextlib
import ipaddress
import os
import socket
import ssl
import stat
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.yaml_text import open_to_read
from spot_runtime.host.instance_lock import open_locked

if TYPE_CHECKING:  # a client has no configuration, and starts without pydantic
    from spot_runtime.config import ServiceConfig

SOCKET_NAME: Final = "operator.sock"
SYSTEM_SOCKET: Final = Path("/run/spot-rl") / SOCKET_NAME
MAX_PORT: Final = 65_535
MAX_PATH: Final = 100
MAX_PEM_BYTES: Final = 1 << 20


class ListenError(SpotRlError):
    """The service cannot listen where it should."""

    exit_code = 97


def default_address(environment: Mapping[str, str]) -> str:
    """Where the service listens by default: in the folder that systemd made for it, or in the user's own."""
    folder = environment.get("RUNTIME_DIRECTORY", "").partition(":")[0]
    return f"unix:{Path(folder) / SOCKET_NAME}" if folder else f"unix:{user_socket(environment)}"


def user_socket(environment: Mapping[str, str]) -> Path:
    """The socket of a service that a user started by hand."""
    runtime = environment.get("XDG_RUNTIME_DIR", "")
    folder = Path(runtime) / "spot-rl" if runtime else Path(tempfile.gettempdir()) / f"spot-rl-{os.getuid()}"
    return folder / SOCKET_NAME


def is_unix(address: str) -> bool:
    """Whether an address is that of a Unix socket."""
    return address.startswith("unix:")


def is_loopback(address: str) -> bool:
    """Whether an address reaches this computer alone. Raises BadInputError: it is not an address."""
    host, colon, port = address.rpartition(":")
    # gRPC would take a larger number as another port; what is not printable may be no UTF-8.
    is_port = bool(colon and host) and port.isdecimal() and int(port[:6]) <= MAX_PORT
    if not address.isprintable() or not (is_unix(address) or is_port):
        raise BadInputError(
            f"address {address!r} is not valid; allowed: 'unix:/path' or HOST:PORT, up to {MAX_PORT}, in UTF-8"
        )
    if is_unix(address):
        return True
    with contextlib.suppress(ValueError):
        return ipaddress.ip_address(host.strip("[]")).is_loopback
    return host == "localhost"


def server_tls(config: ServiceConfig, address: str) -> ssl.SSLContext | None:
    """The server's side of mutual TLS, if the three files are named; None on a socket of this computer.

    Raises:
        BadInputError: Only some are named, or none where the network is served; or one cannot be read safely.
    """
    files = (config.tls_certificate, config.tls_key, config.tls_client_ca)
    certificate, key, client_ca = files
    if certificate is None or key is None or client_ca is None:
        if any(files):
            raise BadInputError("service: tls_certificate, tls_key and tls_client_ca go together; name all three")
        if not is_loopback(address):
            raise BadInputError(
                f"service.listen = {address!r} can be reached from the network, which needs mutual TLS: name "
                "tls_certificate, tls_key and tls_client_ca, or listen on loopback"
            )
        return None
    if is_unix(address):
        raise BadInputError("service: TLS is for HOST:PORT, and a Unix socket is listened on; name one of the two")
    _read(key, is_secret=True)
    _read(certificate, is_secret=False)
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    context.verify_mode = ssl.CERT_REQUIRED
    context.set_alpn_protocols(["h2"])
    context.options |= ssl.OP_NO_TICKET | ssl.OP_NO_RENEGOTIATION
    context.num_tickets = 0  # every connection shows its certificate
    try:
        context.load_cert_chain(certificate, key, password=lambda: b"")  # nobody is there to be asked for one
        context.load_verify_locations(cadata=_read(client_ca, is_secret=False).decode("ascii"))
    except (ssl.SSLError, ValueError) as error:
        raise BadInputError(
            f"tls_certificate {certificate}, tls_key {key} and tls_client_ca {client_ca} cannot be used: {error}; give "
            "PEM files, a key without a password, and the certificate that belongs to it"
        ) from error
    return context


class SocketFile:
    """The file of a Unix socket: in a folder of ours, for this user and group alone, and one service each."""

    def __init__(self, path: Path) -> None:
        """Take the lock beside the socket.

        Raises:
            BadInputError: The path is too long for a socket.
            ListenError: Another service listens there, or the folder cannot be used.
        """
        if len(str(path)) > MAX_PATH:
            raise BadInputError(f"socket {path} has a name of {len(str(path))} characters; allowed: {MAX_PATH}")
        self.path, self._lock_path = path, path.with_name(path.name + ".lock")
        self._has_made_folder = not path.parent.exists()
        try:
            path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
            owner = path.parent.stat()
            if owner.st_uid != os.getuid() or owner.st_mode & 0o002:
                raise ListenError(f"folder {path.parent} belongs to somebody else or is writable by all; use another")
            self._descriptor = open_locked(self._lock_path)
        except BlockingIOError:
            raise ListenError(f"another service listens on {path}; end it, or name another socket") from None
        except OSError as error:
            raise ListenError(f"socket {path} cannot be made: {error.strerror}; name another") from error

    def bind(self) -> socket.socket:
        """The socket, so that only this user and group may connect. Raises OSError."""
        made = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        before = os.umask(0o117)
        try:
            self.path.unlink(missing_ok=True)  # of a service that was killed: the lock is ours
            made.bind(str(self.path))
        except OSError:
            made.close()
            raise
        finally:
            os.umask(before)
        return made

    def close(self) -> None:
        """Remove the socket, the lock, and the folder if it was made for them."""
        self.path.unlink(missing_ok=True)
        self._lock_path.unlink(missing_ok=True)
        os.close(self._descriptor)
        if self._has_made_folder:
            with contextlib.suppress(OSError):  # somebody else uses it
                self.path.parent.rmdir()


class Listener:
    """The socket that operators reach: made, but not listening yet."""

    def __init__(self, wanted: str) -> None:
        """Take an address of the form that :func:`is_loopback` allows; port 0 is any free one.

        Raises:
            BadInputError: The path is too long for a socket.
            ListenError: The address is taken or cannot be used.
        """
        self._file = SocketFile(Path(wanted.removeprefix("unix:"))) if is_unix(wanted) else None
        try:
            self.socket = _bound(wanted) if self._file is None else self._file.bind()
        except OSError as error:
            self.close()
            raise ListenError(f"the service cannot listen on {wanted}: {error}; name another address") from error
        self.address = wanted
        if self._file is None:
            self.address = f"{wanted.rpartition(':')[0]}:{self.socket.getsockname()[1]}"

    def close(self) -> None:
        """Give the address back."""
        if self._file is not None:
            self._file.close()


def _bound(address: str) -> socket.socket:
    host, _, port = address.rpartition(":")
    found = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    family, kind, protocol, _, where = found[0]
    made = socket.socket(family, kind, protocol)
    try:
        made.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        made.bind(where)
    except OSError:
        made.close()
        raise
    return made


def _read(path: Path, *, is_secret: bool) -> bytes:
    try:
        with open_to_read(path) as stream:
            status = os.fstat(stream.fileno())
            data = stream.read(MAX_PEM_BYTES + 1) or b""
    except OSError as error:
        raise BadInputError(f"file {path} cannot be read: {error.strerror}") from error
    # A credential of systemd's may show its access list's mask as the group's bits; its folder is closed to others.
    credentials = os.environ.get("CREDENTIALS_DIRECTORY", "")
    forbidden = 0o007 if credentials and path.parent == Path(credentials) else 0o077
    if is_secret and (not stat.S_ISREG(status.st_mode) or status.st_mode & forbidden):
        raise BadInputError(f"key {path} can be read by others; run: chmod 600 {path}")
    if len(data) > MAX_PEM_BYTES or b"-----BEGIN" not in data:
        raise BadInputError(f"file {path} holds no PEM; give a PEM file")
    return data
