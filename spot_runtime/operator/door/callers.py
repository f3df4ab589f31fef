"""Who calls, and in which role: by the certificate's own fields, or by the user at the other end of a local socket.

On a Unix socket, any user who may open the file operates; on loopback, any user of this computer. Over a network only
clients with a certificate are served, and the certificate states the role as a URI among its alternative names,
``urn:spot-rl:role:observe`` or ``urn:spot-rl:role:operate``. Alternative names of other kinds are ignored.
"""

from __future__ import annotations

import ipaddress
import socket
import struct
import sys
from enum import Enum
from functools import lru_cache
from typing import Final, NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.x509.oid import NameOID

from spot_model.text import plain

_CREDENTIALS: Final = struct.Struct("3i")
NETLINK_SOCK_DIAG: Final = 4
SOCK_DIAG_BY_FAMILY: Final = 20
REQUEST: Final = 1
ALL_STATES: Final = 0xFFFF_FFFF
ANY_INTERFACE_AND_COOKIE: Final = bytes(4) + b"\xff" * 8
USER_OFFSET: Final = 64
"""Offset of the user in ``inet_diag_msg``, after state, addresses, timer and queues."""

Address = ipaddress.IPv4Address | ipaddress.IPv6Address
NETWORK_BITS: Final = {4: 32, 6: 64}
"""A client with one IPv6 address has 2^64 of them."""


class Peer(NamedTuple):
    """The other end of a connection."""

    group: str
    """Group whose share of the connections it takes: a process, a user, or an address."""
    user_id: int | None
    """On this computer; None over a network, or where the kernel does not tell."""

    @property
    def identity(self) -> str:
        """The client's identity if it has no certificate."""
        return self.group if self.user_id is None else f"user {self.user_id}"


def peer_of(connection: socket.socket) -> Peer:
    """The other end of an accepted connection. Never raises."""
    if connection.family == socket.AF_UNIX:
        data = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
        process_id, user_id, _ = _CREDENTIALS.unpack(data)
        return Peer(f"process {process_id}", user_id)
    try:
        client, service = _end(connection.getpeername()), _end(connection.getsockname())
    except OSError:  # it has gone already
        return Peer("nobody", None)
    address = client[0]
    if address.is_loopback:
        user_id = _user_of(client, service)
        return Peer("this computer" if user_id is None else f"user {user_id}", user_id)
    network = ipaddress.ip_network((address, NETWORK_BITS[address.version]), strict=False)
    return Peer(f"address {network.network_address}", None)


def _end(name: tuple[str, int]) -> tuple[Address, int]:
    address = ipaddress.ip_address(name[0].partition("%")[0])
    mapped = getattr(address, "ipv4_mapped", None)
    return (address if mapped is None else mapped), name[1]


def _user_of(client: tuple[Address, int], service: tuple[Address, int]) -> int | None:
    """Which user has the client's end of a connection within this computer; None where the kernel does not tell.

    Source: sock_diag(7), a request for one socket by its addresses.
    """
    family = socket.AF_INET if client[0].version == 4 else socket.AF_INET6
    ends = struct.pack(">HH16s16s", client[1], service[1], client[0].packed, service[0].packed)
    body = struct.pack("=BBBBI", family, socket.IPPROTO_TCP, 0, 0, ALL_STATES) + ends + ANY_INTERFACE_AND_COOKIE
    head = struct.pack("=IHHII", 16 + len(body), SOCK_DIAG_BY_FAMILY, REQUEST, 1, 0)
    try:
        with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, NETLINK_SOCK_DIAG) as netlink:
            netlink.settimeout(0.05)
            netlink.send(head + body)
            answer = netlink.recv(4096)
    except OSError:
        return None
    kind = int.from_bytes(answer[4:6], sys.byteorder)
    at = 16 + USER_OFFSET
    if kind != SOCK_DIAG_BY_FAMILY or len(answer) < at + 4:
        return None
    return int.from_bytes(answer[at : at + 4], sys.byteorder)


ROLE_URI: Final = "urn:spot-rl:role:"


class Role(Enum):
    """What a client may do. Any role may also stop and damp the robot: a stop must not need a permission."""

    OBSERVE = "observe"
    OPERATE = "operate"


class Caller(NamedTuple):
    """Somebody who calls."""

    identity: str
    """One certificate, or one user of this computer: what a client cannot choose freely."""
    name: str
    """For people to read; empty where no certificate gives one."""
    role: Role | None


def caller_of(certificate: bytes | None, peer: Peer, *, is_tls: bool) -> Caller:
    """Who calls, by the client's certificate in DER, if it has one, and the other end as the kernel names it.

    Without ``is_tls`` no certificate is required, and every client that reaches the service operates.
    """
    if not is_tls:
        return Caller(peer.identity, "", Role.OPERATE)
    return Caller(peer.identity, "", None) if certificate is None else _caller_of_certificate(certificate)


@lru_cache(maxsize=256)
def _caller_of_certificate(der: bytes) -> Caller:
    certificate = x509.load_der_x509_certificate(der)
    identity = f"certificate {certificate.fingerprint(hashes.SHA256()).hex()}"
    names = certificate.subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    name = plain(str(names[0].value))[:64] if names else ""
    try:
        found = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
        uris = set(found.get_values_for_type(x509.UniformResourceIdentifier))
    except (x509.ExtensionNotFound, x509.DuplicateExtension, ValueError):
        uris = set()
    for role in (Role.OPERATE, Role.OBSERVE):
        if ROLE_URI + role.value in uris:
            return Caller(identity, name, role)
    return Caller(identity, name, None)
