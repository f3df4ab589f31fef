"""Where a robot is: host, port, and the form that the SDK takes."""

from __future__ import annotations

import ipaddress
import socket
from dataclasses import dataclass
from typing import Final

from spot_model.errors import BadInputError
from spot_runtime.causes import shortage
from spot_runtime.hal.errors import CertificateError, HalError, NoRobotError

DEFAULT_PORT: Final = 443
MAX_HOST: Final = 253
"""Characters of a name, as the domain name system has it."""

TLS_NAME: Final = "auth.spot.robot"
"""The first name that a Spot's certificate is asked for."""


@dataclass(frozen=True)
class Address:
    """A robot's address, taken apart."""

    host: str
    """A name or IP address, or ``unix:/path`` for a socket."""
    port: int

    @property
    def is_unix(self) -> bool:
        """Whether it is a socket of this machine."""
        return self.host.startswith("unix:")

    @property
    def sdk_host(self) -> str:
        """The host as the SDK puts it before ``:port``."""
        return f"[{self.host}]" if ":" in self.host and not self.is_unix else self.host

    def __str__(self) -> str:
        return self.host if self.is_unix else f"{self.sdk_host}:{self.port}"


def as_people_write_it(address: str) -> str:
    """``ipv4:IP:PORT,IP``, by which an unmodified SDK program reaches another port than its own, as ``IP:PORT``."""
    is_for_sdk = address.startswith("ipv4:") and "," in address
    return address[len("ipv4:") :].partition(",")[0] if is_for_sdk else address


def parse_address(text: str) -> Address:
    """Take apart ``HOST``, ``HOST:PORT``, ``[IPv6]:PORT``, ``unix:/path/socket`` or ``ipv4:IP:PORT,IP``.

    Raises:
        BadInputError: It is none of these.
    """
    text = as_people_write_it(text)
    if text.startswith("unix:"):
        if len(text) > len("unix:"):
            return Address(text, DEFAULT_PORT)
        raise BadInputError("robot address 'unix:' names no socket; allowed: unix:/path/to/socket")
    host, port_text = text, str(DEFAULT_PORT)
    if text.startswith("["):
        host, bracket, rest = text[1:].partition("]")
        port_text = rest[1:] if rest.startswith(":") else (port_text if bracket and not rest else "")
    elif text.count(":") == 1:
        host, _, port_text = text.partition(":")
    is_port = port_text.isdecimal() and 0 < int(port_text) < 65536
    if not host or not is_port or any(c.isspace() or c in "/,@" for c in host) or not _is_host(host):
        raise BadInputError(
            f"robot address {text!r} is not valid; allowed: HOST, HOST:PORT (1 to 65535), [IPv6]:PORT, unix:/path"
        )
    return Address(host, int(port_text))


def _is_host(text: str) -> bool:
    """Whether this may be a host at all: an address, or a name as the domain name system can carry it."""
    try:
        if ":" in text:
            return bool(ipaddress.ip_address(text.partition("%")[0]))
        return len(text.encode("idna")) <= MAX_HOST
    except ValueError:  # UnicodeError is one
        return False


def explain_no_connection(address: Address, trusted_pem: bytes, reason: str, timeout_s: float) -> HalError:
    """Find out why no secure connection came about, by trying its steps one by one, each for ``timeout_s``.

    If every step succeeds here, the failed call's own ``reason`` is told.
    """
    try:
        connection = connect(address, timeout_s)
    except TimeoutError:
        return NoRobotError(
            f"no robot at {address}: no answer within {timeout_s:g} s; check address, network and power"
        )
    except socket.gaierror as error:
        return NoRobotError(f"no robot at {address}: the name is not known ({error.strerror}); check the address")
    except OSError as error:
        if lacks := shortage(str(error)):
            return HalError(f"{address} cannot be reached: {lacks}")
        return NoRobotError(f"no robot at {address}: {error.strerror}; check address, port and that the robot is on")
    import ssl  # as slow to load as all else that a command's help needs

    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    try:
        with connection:
            context.load_verify_locations(cadata=trusted_pem.decode("ascii"))
            context.wrap_socket(connection, server_hostname=TLS_NAME).close()
    except ssl.SSLCertVerificationError as error:
        return CertificateError(
            f"{address} presents a certificate that is not trusted: {error.verify_message.rstrip('.')}; "
            f"give the certificate that signed it with --ca-file, or check that this is the robot"
        )
    except (OSError, ValueError) as error:
        return CertificateError(f"{address} answers, but not with Spot's TLS ({error}); check address and port")
    return HalError(f"{address} answers, but the call failed: {reason}; try again")


def connect(address: Address, timeout_s: float) -> socket.socket:
    """A TCP or Unix connection to the robot, before any TLS. Raises OSError."""
    if not address.is_unix:
        return socket.create_connection((address.host, address.port), timeout=timeout_s)
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(timeout_s)
    try:
        # The SDK appends the port to whatever host it is given, and so does a server that it can reach.
        connection.connect(f"{address.host[len('unix:') :]}:{address.port}")
    except OSError:
        connection.close()
        raise
    return connection
