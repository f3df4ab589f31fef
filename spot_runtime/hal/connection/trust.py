"""Whom we trust to be a robot: the vendor's certificate, and those of one file."""

from __future__ import annotations

import re
import ssl
from importlib.resources import files
from pathlib import Path
from typing import Final

from spot_model.io.bounded_file import FileTooLargeError, read_at_most
from spot_runtime.hal.errors import CertificateError

MAX_PEM_BYTES: Final = 1024 * 1024
_CERTIFICATE: Final = re.compile(rb"-----BEGIN CERTIFICATE-----[\x00-\x7f]*?-----END CERTIFICATE-----")


def trusted_certificates(ca_file: Path | None) -> bytes:
    """The vendor's certificate and those of ``ca_file``, in PEM.

    Raises:
        CertificateError: The file cannot be read, or holds no certificate.
    """
    vendor = files("bosdyn.client.resources").joinpath("robot.pem").read_bytes()
    return vendor if ca_file is None else vendor + b"\n" + read_certificates(ca_file)


def read_certificates(path: Path) -> bytes:
    """The certificates of a PEM file, without what stands between them. Raises CertificateError."""
    try:
        data = read_at_most(path, MAX_PEM_BYTES)
    except (OSError, FileTooLargeError) as error:
        reason = getattr(error, "strerror", None) or error
        raise CertificateError(f"certificate file {path} cannot be read: {reason}; give a PEM file") from error
    certificates = b"\n".join(_CERTIFICATE.findall(data)) + b"\n"
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT).load_verify_locations(cadata=certificates.decode("ascii"))
    except (ssl.SSLError, ValueError) as error:
        raise CertificateError(
            f"certificate file {path} holds no PEM certificate that can be read; give the one that signed the robot's"
        ) from error
    return certificates
