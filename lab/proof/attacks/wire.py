"""HTTP/2 by hand, for clients that do not keep to it."""

from __future__ import annotations

import socket
import ssl
import struct
from functools import cache
from pathlib import Path
from typing import Final

PREFACE: Final = b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n"
DATA, HEADERS, RST_STREAM, SETTINGS, PING, WINDOW_UPDATE, CONTINUATION = 0, 1, 3, 4, 6, 8, 9
END_STREAM, END_HEADERS = 1, 4


def frame(kind: int, flags: int, stream: int, payload: bytes = b"") -> bytes:
    """One frame."""
    return struct.pack(">I", len(payload))[1:] + struct.pack(">BBI", kind, flags, stream) + payload


def head_of_call(path: str) -> bytes:
    """The head of a gRPC call in HPACK, without its dynamic table."""

    def text(value: str) -> bytes:
        return bytes([len(value)]) + value.encode()

    fields = b"\x83\x86" + b"\x04" + text(path) + b"\x01" + text("localhost")
    return fields + b"\x0f\x10" + text("application/grpc") + b"\x00" + text("te") + text("trailers")


def connect(address: str, tls: tuple[Path, Path, Path] | None = None, timeout_s: float = 10.0) -> socket.socket:
    """A socket to the service, with or without TLS (authority, certificate, key)."""
    if address.startswith("unix:"):
        plain = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        plain.settimeout(timeout_s)
        plain.connect(address.removeprefix("unix:"))
        return plain
    host, _, port = address.rpartition(":")
    plain = socket.create_connection((host, int(port)), timeout=timeout_s)
    if tls is None:
        return plain
    return _context(*tls).wrap_socket(plain, server_hostname=host)


@cache
def _context(authority: Path, certificate: Path, key: Path) -> ssl.SSLContext:
    context = ssl.create_default_context(cafile=str(authority))
    context.load_cert_chain(certificate, key)
    context.set_alpn_protocols(["h2"])
    return context
