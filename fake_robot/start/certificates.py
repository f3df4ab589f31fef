"""The fake robot's own certificate authority, and the leaf certificate that serves all services of one start.

A client tells the services apart by TLS authority (``auth.spot.robot``, ``api.spot.robot`` ...), so one leaf with the
alternative name ``*.spot.robot`` serves them all. [sdk]
"""

from __future__ import annotations

import datetime as dt
import fcntl
import ipaddress
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from spot_model.errors import SpotRlError
from spot_model.process.private_folder import new_private_file

VALIDITY: Final = dt.timedelta(days=365)
"""Of a leaf, from the start of its robot; the authority's is ten times as long."""
_PEM = serialization.Encoding.PEM
CA_FILE, CA_KEY_FILE = "ca.pem", "ca.key"


class CertificateError(SpotRlError):
    """The certificates cannot be made, stored or read."""


@dataclass(frozen=True)
class ServerCertificates:
    """PEM bytes for a TLS server, and the file that its clients must trust."""

    ca_path: Path
    ca_pem: bytes
    certificate_pem: bytes
    key_pem: bytes = field(repr=False)


def make_certificates(folder: Path, *, addresses: tuple[str, ...] = ()) -> ServerCertificates:
    """Make a leaf, signed by the authority in ``folder``, or by a new one where that is missing, torn or at its end.

    All robots with one folder are trusted alike, whenever they were started. The folder is made with mode 0700, its
    files with 0600; the leaf is stored nowhere. ``addresses`` are what it names beside ``*.spot.robot``, ``localhost``
    and ``127.0.0.1``.

    Raises:
        CertificateError: The folder or a file cannot be written or read; the message names it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with locked_folder(folder):
            ca, ca_key = _stored_authority(folder) or _new_authority(folder)
    except OSError as error:
        raise CertificateError(
            f"the certificates in {folder} cannot be used: {error}; choose another folder with --state-dir"
        ) from error
    key = ec.generate_private_key(ec.SECP256R1())
    names = [x509.DNSName("*.spot.robot"), *map(_general_name, ("localhost", "127.0.0.1", *addresses))]
    leaf = (
        _builder(_name("spot-rl fake robot"), ca.subject, key.public_key(), VALIDITY)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .sign(ca_key, hashes.SHA256())
    )
    return ServerCertificates(folder / CA_FILE, ca.public_bytes(_PEM), leaf.public_bytes(_PEM), _private_pem(key))


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Keep other processes of ours out of ``folder`` while files in it are looked at and made."""
    descriptor = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _stored_authority(folder: Path) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey] | None:
    """The authority and its key; None where they are not there, do not belong together or end before a leaf would."""
    try:
        ca = x509.load_pem_x509_certificate((folder / CA_FILE).read_bytes())
        key = serialization.load_pem_private_key((folder / CA_KEY_FILE).read_bytes(), password=None)
    except (FileNotFoundError, ValueError, TypeError):
        return None
    if not isinstance(key, ec.EllipticCurvePrivateKey) or key.public_key() != ca.public_key():
        return None
    is_valid = ca.not_valid_before_utc <= dt.datetime.now(dt.UTC) <= ca.not_valid_after_utc - VALIDITY
    return (ca, key) if is_valid else None


def _new_authority(folder: Path) -> tuple[x509.Certificate, ec.EllipticCurvePrivateKey]:
    key = ec.generate_private_key(ec.SECP256R1())
    # A name of its own: OpenSSL looks for the authority by name, and takes the first of two.
    name = _name(f"spot-rl fake robot CA {secrets.token_hex(4)}")
    ca = (
        _builder(name, name, key.public_key(), 10 * VALIDITY)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(signs_certificates=True), critical=True)
        .sign(key, hashes.SHA256())
    )
    write_private(folder / CA_KEY_FILE, _private_pem(key))
    write_private(folder / CA_FILE, ca.public_bytes(_PEM))
    return ca, key


def write_private(path: Path, content: bytes) -> None:
    """Replace ``path`` in one step by a file that only its owner can read (mode 0600)."""
    temporary, descriptor = new_private_file(path)
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
    temporary.replace(path)


def _private_pem(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(_PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, validity: dt.timedelta
) -> x509.CertificateBuilder:
    now = dt.datetime.now(dt.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + validity)
    )


def _name(common_name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, common_name)])


def _general_name(address: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(address))
    except ValueError:
        return x509.DNSName(address)


def _key_usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )
