"""Login and trust: user name, password and the certificates by which the robot is believed.

The login comes from a file, a systemd credential or the environment, never from the command line.
"""

from __future__ import annotations

import os
import re
import ssl
import stat
from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Final

from spot_model.io.yaml_text import FileTooLargeError, YamlError, open_to_read, parse_yaml, read_at_most
from spot_runtime.hal.errors import CertificateError, CredentialsError

USERNAME_VARIABLE: Final = "BOSDYN_CLIENT_USERNAME"
PASSWORD_VARIABLE: Final = "BOSDYN_CLIENT_PASSWORD"  # noqa: S105 - a variable's name; the vendor's SDK reads it too
FOLDER_VARIABLE: Final = "CREDENTIALS_DIRECTORY"
SYSTEMD_NAME: Final = "spot-credentials"
MAX_BYTES: Final = 4096


@dataclass(frozen=True)
class Credentials:
    """What the robot's user logs in with; its text form hides the password."""

    username: str
    password: str = field(repr=False)


def find_credentials(file: Path | None, environment: Mapping[str, str]) -> Credentials:
    """Read the credentials.

    The first of these counts: ``file``; the systemd credential ``spot-credentials``; the two variables
    ``BOSDYN_CLIENT_USERNAME`` and ``BOSDYN_CLIENT_PASSWORD``.

    Raises:
        CredentialsError: None is there, or the file is unreadable, readable by others, or holds something else. The
            message never holds the content.
    """
    if file is None and FOLDER_VARIABLE in environment:
        candidate = Path(environment[FOLDER_VARIABLE]) / SYSTEMD_NAME
        if _is_file(candidate):
            # systemd may grant the service's user its reading by an access list, whose mask shows as the group's bits;
            # the folder lets nobody else in.
            return _read(candidate, forbidden_mode=0o007)
    if file is not None:
        return _read(file, forbidden_mode=0o077)
    username, password = environment.get(USERNAME_VARIABLE, ""), environment.get(PASSWORD_VARIABLE, "")
    if username and password:
        try:
            (username + password).encode()
        except UnicodeEncodeError:
            words = f"{USERNAME_VARIABLE} or {PASSWORD_VARIABLE} is no UTF-8; set it in a terminal that writes UTF-8"
            raise CredentialsError(words) from None
        return Credentials(username, password)
    raise CredentialsError(
        f"no user name and password for the robot: set {USERNAME_VARIABLE} and {PASSWORD_VARIABLE}, or name a file "
        f"with --credentials-file"
    )


def told_credentials(environment: Mapping[str, str]) -> dict[str, str]:
    """The variables that :func:`find_credentials` reads, for a process that is told them instead of inheriting them."""
    names = (USERNAME_VARIABLE, PASSWORD_VARIABLE, FOLDER_VARIABLE)
    return {name: environment[name] for name in names if name in environment}


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # systemd hides the folder from what it runs after a stop
        return False


def _read(file: Path, *, forbidden_mode: int) -> Credentials:
    try:
        with open_to_read(file) as stream:
            status = os.fstat(stream.fileno())
            data = stream.read(MAX_BYTES + 1)
    except OSError as error:
        raise CredentialsError(f"credentials file {file} cannot be read: {error.strerror}") from error
    if not stat.S_ISREG(status.st_mode) or status.st_mode & forbidden_mode:
        raise CredentialsError(f"credentials file {file} can be read by others; run: chmod 600 {file}")
    try:
        content = parse_yaml(data) if len(data) <= MAX_BYTES else None
    except YamlError:
        content = None
    fields = content if isinstance(content, dict) else {}
    if set(fields) != {"username", "password"} or not all(isinstance(v, str) and v for v in fields.values()):
        # The content is a secret, so neither it nor a parser's quotation of it may show.
        raise CredentialsError(f"credentials file {file} must hold 'username: …' and 'password: …', both text")
    return Credentials(fields["username"], fields["password"])


MAX_PEM_BYTES: Final = 1024 * 1024
_CERTIFICATE: Final = re.compile(rb"-----BEGIN CERTIFICATE-----[\x00-\x7f]*?-----END CERTIFICATE-----")


def trusted_certificates(ca_file: Path | None) -> bytes:
    """The vendor's certificate and those of ``ca_file``, in PEM. Raises CertificateError."""
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
