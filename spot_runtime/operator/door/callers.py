"""Who calls, and in which role: by the certificate's own fields, or by the user at the other end of a local socket.

On a Unix socket, any user who may open the file operates; on loopback, any user of this computer. Over a network only
clients with a certificate are served, and the certificate states the role as a URI among its alternative names,
``urn:spot-rl:role:observe`` or ``urn:spot-rl:role:operate``. Alternative names of other kinds are ignored.
"""

from __future__ import annotations

from enum import Enum
from functools import lru_cache
from typing import Final, NamedTuple

from cryptography import x509
from cryptography.hazmat.primitives import hashes
from cryptography.x509.oid import NameOID

from spot_model.text import plain
from spot_runtime.operator.door.peers import Peer

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
    """Who calls.

    Args:
        certificate: The client's, in DER; None where it has none.
        peer: The other end, as the kernel names it.
        is_tls: Whether certificates are required; without them, every client that reaches the service operates.
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
