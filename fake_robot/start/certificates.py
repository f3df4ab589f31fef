"""The fake robot's own certificate authority and the one leaf certificate that serves all its services.

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

from cryptography import x509
from cryptography.exceptions import InvalidSignature
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from spot_model.errors import SpotRlError
from spot_model.process.private_folder import new_private_file

VALIDITY = dt.timedelta(days=365)
_PEM = serialization.Encoding.PEM
CA_FILE, CERTIFICATE_FILE, KEY_FILE = "ca.pem", "server.pem", "server.key"


class CertificateError(SpotRlError):
    """The certificates cannot be made, stored or read."""


@dataclass(frozen=True)
class ServerCertificates:
    """PEM bytes for a TLS server, and the file that its clients must trust."""

    ca_path: Path
    ca_pem: bytes
    certificate_pem: bytes
    key_pem: bytes = field(repr=False)


def ensure_certificates(folder: Path, *, addresses: tuple[str, ...] = ()) -> ServerCertificates:
    """Load the certificates in ``folder``, or make them where there are none or they no longer serve.

    A robot that runs keeps those that it began with. So new ones name what the old ones named, and the file that
    clients trust keeps the authority before. The folder is made with mode 0700, keys with 0600; the authority's own key
    is never stored. ``addresses`` are what the leaf must name beside ``*.spot.robot``, ``localhost`` and ``127.0.0.1``.

    Raises:
        CertificateError: The folder or a file cannot be written or read; the message names it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        with locked_folder(folder):
            stored = _load(folder)
            if stored is not None and _serves(stored, addresses):
                return stored
            _write(folder, addresses, stored)
            made = _load(folder)
    except OSError as error:
        raise CertificateError(
            f"the certificates in {folder} cannot be used: {error}; choose another folder with --state-dir"
        ) from error
    if made is None:
        raise CertificateError(f"the certificates in {folder} vanished while they were written; choose another folder")
    return made


@contextmanager
def locked_folder(folder: Path) -> Iterator[None]:
    """Keep other processes of ours out of ``folder`` while files in it are looked at and made."""
    descriptor = os.open(folder / ".lock", os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def _load(folder: Path) -> ServerCertificates | None:
    paths = [folder / name for name in (CA_FILE, CERTIFICATE_FILE, KEY_FILE)]
    if not all(path.is_file() for path in paths):
        return None
    ca, certificate, key = (path.read_bytes() for path in paths)
    return ServerCertificates(paths[0], ca, certificate, key)


def _serves(stored: ServerCertificates, addresses: tuple[str, ...]) -> bool:
    """Whether the stored chain is whole, belongs together, names ``addresses`` and stays valid for a while."""
    try:
        ca = x509.load_pem_x509_certificate(stored.ca_pem)
        leaf = x509.load_pem_x509_certificate(stored.certificate_pem)
        key = serialization.load_pem_private_key(stored.key_pem, password=None)
        leaf.verify_directly_issued_by(ca)
    except (ValueError, TypeError, InvalidSignature):
        return False
    now = dt.datetime.now(dt.UTC)
    return (
        key.public_key() == leaf.public_key()
        and all(c.not_valid_before_utc <= now <= c.not_valid_after_utc - dt.timedelta(days=7) for c in (ca, leaf))
        and all(_general_name(address) in _names(leaf) for address in addresses)
    )


def _names(leaf: x509.Certificate) -> list[x509.GeneralName]:
    return list(leaf.extensions.get_extension_for_class(x509.SubjectAlternativeName).value)


def _before(stored: ServerCertificates | None) -> tuple[list[x509.GeneralName], bytes]:
    """Names of a stored leaf and the newest authority, PEM; nothing where they cannot be read."""
    if stored is None:
        return [], b""
    try:
        ca = x509.load_pem_x509_certificate(stored.ca_pem)
        return _names(x509.load_pem_x509_certificate(stored.certificate_pem)), ca.public_bytes(_PEM)
    except ValueError:
        return [], b""


def _write(folder: Path, addresses: tuple[str, ...], stored: ServerCertificates | None) -> None:
    """Make an authority and a leaf, and replace the files one by one, the key first."""
    now = dt.datetime.now(dt.UTC)
    names_before, ca_before = _before(stored)
    ca_key, leaf_key = ec.generate_private_key(ec.SECP256R1()), ec.generate_private_key(ec.SECP256R1())
    # A name of its own: OpenSSL looks for the authority by name, and takes the first of two.
    ca_name = _name(f"spot-rl fake robot CA {secrets.token_hex(4)}")
    own = [x509.DNSName("*.spot.robot"), *map(_general_name, ("localhost", "127.0.0.1", *addresses))]
    names = list(dict.fromkeys([*own, *names_before]))
    ca = (
        _builder(ca_name, ca_name, ca_key.public_key(), now)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_key_usage(signs_certificates=True), critical=True)
        .sign(ca_key, hashes.SHA256())
    )
    leaf = (
        _builder(_name("spot-rl fake robot"), ca_name, leaf_key.public_key(), now)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_key_usage(signs_certificates=False), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .sign(ca_key, hashes.SHA256())
    )
    key_pem = leaf_key.private_bytes(_PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    write_private(folder / KEY_FILE, key_pem)
    write_private(folder / CERTIFICATE_FILE, leaf.public_bytes(_PEM))
    write_private(folder / CA_FILE, ca.public_bytes(_PEM) + ca_before)


def write_private(path: Path, content: bytes) -> None:
    """Replace ``path`` in one step by a file that only its owner can read (mode 0600)."""
    temporary, descriptor = new_private_file(path)
    with os.fdopen(descriptor, "wb") as file:
        file.write(content)
    temporary.replace(path)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, now: dt.datetime
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + VALIDITY)
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
