"""Addresses: what the server listens on, what an SDK program is told, and errors in words where neither works."""

from __future__ import annotations

import socket
from collections.abc import Callable
from pathlib import Path

from spot_model.errors import SpotRlError

UNIX_PREFIX = "unix:"
SDK_PORT = 443
"""The port that the SDK appends to every host argument; a Unix socket's path ends in it too."""


class BindError(SpotRlError):
    """The server cannot listen where it was told to."""


def listen_target(address: str, port: int) -> str:
    """The gRPC target of the robot's server for an IP address, or for ``unix:/path``."""
    if address.startswith(UNIX_PREFIX):
        return f"{address}:{SDK_PORT}"
    return f"[{address}]:{port}" if ":" in address else f"{address}:{port}"


def sdk_host(address: str, port: int) -> str:
    """What an SDK program must be given as host name. The SDK appends ``:443`` to it, whatever it is.

    For TCP this makes a list of two addresses, of which the first is ours; on port 443 the plain address will do. [sdk]
    """
    if address.startswith(UNIX_PREFIX):
        return address
    family = "ipv6" if ":" in address else "ipv4"
    reachable = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(address, address)  # noqa: S104 - compared, not bound
    bracketed = f"[{reachable}]" if family == "ipv6" else reachable
    if port == SDK_PORT:
        return bracketed
    return f"{family}:{bracketed}:{port},{bracketed}"


def bind(target: str, add_port: Callable[[], int]) -> int:
    """Add a port to a server; returns its number.

    Raises:
        BindError: ``target`` cannot be listened on.
    """
    if target.startswith(UNIX_PREFIX):
        _prepare_socket(Path(target.removeprefix(UNIX_PREFIX)))
    try:
        port = add_port()
    except RuntimeError:
        port = 0
    if not port:
        raise BindError(
            f"cannot listen on {target}: it is in use, or not an address of this machine; "
            "choose another (port 0 picks a free one)"
        )
    return port


def _prepare_socket(path: Path) -> None:
    """Refuse a socket that somebody listens on or whose path is too long; remove one that a dead server left."""
    if len(str(path).encode()) > 100:
        raise BindError(f"the path of the Unix socket {path} is longer than 100 bytes; choose a shorter one")
    if not path.parent.is_dir():
        raise BindError(f"there is no folder {path.parent} for the Unix socket {path.name}; make it first")
    if not path.is_socket():
        if path.exists():
            raise BindError(f"{path} exists and is no socket; choose another path")
        return
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            path.unlink()
            return
    raise BindError(f"another server listens on {path}; stop it, or choose another path")
