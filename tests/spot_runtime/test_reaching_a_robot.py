"""Addresses and credentials, and the words for a connection that does not come about."""

from __future__ import annotations

import socket
from pathlib import Path

import pytest

from spot_model.errors import BadInputError
from spot_runtime.hal.address import Address, explain_no_connection, parse_address
from spot_runtime.hal.credentials import (
    Credentials,
    find_credentials,
    read_certificates,
    trusted_certificates,
)
from spot_runtime.hal.errors import CertificateError, CredentialsError, NoRobotError


@pytest.mark.parametrize(
    ("text", "host", "port", "sdk_host"),
    [
        ("192.168.80.3", "192.168.80.3", 443, "192.168.80.3"),
        ("spot.local:8443", "spot.local", 8443, "spot.local"),
        ("[fe80::1]:8443", "fe80::1", 8443, "[fe80::1]"),
        ("[::1]", "::1", 443, "[::1]"),
        ("fe80::1", "fe80::1", 443, "[fe80::1]"),
        ("ipv4:127.0.0.1:8443,127.0.0.1", "127.0.0.1", 8443, "127.0.0.1"),
        ("unix:/run/spot.sock", "unix:/run/spot.sock", 443, "unix:/run/spot.sock"),
    ],
)
def test_addresses(text: str, host: str, port: int, sdk_host: str) -> None:
    address = parse_address(text)
    assert (address.host, address.port, address.sdk_host) == (host, port, sdk_host)


@pytest.mark.parametrize(
    "text", ["", ":443", "h:", "h:0", "h:65536", "h:x", "a b", "https://h", "unix:", "[::1]x", "[::"]
)
def test_what_is_no_address_is_refused(text: str) -> None:
    with pytest.raises(BadInputError, match=r"allowed|names no socket"):
        parse_address(text)


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def test_nobody_at_the_address() -> None:
    error = explain_no_connection(Address("127.0.0.1", free_port()), b"", "UNAVAILABLE", 1.0)
    assert isinstance(error, NoRobotError)
    assert "Connection refused" in str(error)
    error = explain_no_connection(Address("unix:/nowhere/spot.sock", 443), b"", "UNAVAILABLE", 1.0)
    assert isinstance(error, NoRobotError)
    assert "No such file" in str(error)


def test_somebody_who_is_no_robot() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
        error = explain_no_connection(Address("127.0.0.1", port), b"no certificate", "UNAVAILABLE", 0.2)
    assert isinstance(error, CertificateError)
    assert "not with Spot's TLS" in str(error)


def secret(path: Path, text: str, mode: int = 0o600) -> Path:
    file = path / "credentials.yaml"
    file.write_text(text, encoding="utf-8")
    file.chmod(mode)
    return file


GOOD = "username: admin\npassword: s3cret-canary\n"


def test_credentials_from_a_file_a_systemd_credential_and_the_environment(tmp_path: Path) -> None:
    wanted = Credentials("admin", "s3cret-canary")
    file = secret(tmp_path, GOOD)
    assert find_credentials(file, {}) == wanted
    file.rename(tmp_path / "spot-credentials")
    assert find_credentials(None, {"CREDENTIALS_DIRECTORY": str(tmp_path)}) == wanted
    environment = {"BOSDYN_CLIENT_USERNAME": "admin", "BOSDYN_CLIENT_PASSWORD": "s3cret-canary"}
    assert find_credentials(None, environment) == wanted


def test_a_systemd_credential_may_show_the_mask_of_an_access_list_as_its_groups_bits(tmp_path: Path) -> None:
    file = secret(tmp_path, GOOD, mode=0o440).rename(tmp_path / "spot-credentials")
    assert find_credentials(None, {"CREDENTIALS_DIRECTORY": str(tmp_path)}).username == "admin"
    with pytest.raises(CredentialsError, match="can be read by others"):
        find_credentials(file, {})
    file.chmod(0o444)
    with pytest.raises(CredentialsError, match="can be read by others"):
        find_credentials(None, {"CREDENTIALS_DIRECTORY": str(tmp_path)})


def test_the_password_does_not_show_in_the_text_form() -> None:
    assert "s3cret" not in repr(Credentials("admin", "s3cret-canary"))


def test_no_credentials_at_all() -> None:
    with pytest.raises(CredentialsError, match="BOSDYN_CLIENT_USERNAME and BOSDYN_CLIENT_PASSWORD"):
        find_credentials(None, {"BOSDYN_CLIENT_USERNAME": "admin"})


@pytest.mark.parametrize(
    ("text", "mode", "words"),
    [
        (GOOD, 0o644, "can be read by others; run: chmod 600"),
        (GOOD + "more: x\n", 0o600, "must hold"),
        ("username: admin\npassword: 12345\n", 0o600, "must hold"),
        ("s3cret-canary", 0o600, "must hold"),
        ("password: [s3cret-canary", 0o600, "must hold"),
        ("username: admin\npassword: s3cret-canary\n#" + "x" * 5000, 0o600, "must hold"),
    ],
)
def test_a_bad_file_is_refused_without_showing_its_content(tmp_path: Path, text: str, mode: int, words: str) -> None:
    with pytest.raises(CredentialsError, match=words) as caught:
        find_credentials(secret(tmp_path, text, mode), {})
    assert "s3cret" not in str(caught.value)
    assert "12345" not in str(caught.value)


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(CredentialsError, match="No such file"):
        find_credentials(tmp_path / "none", {})


# Certificates --------------------------------------------------------------------------------------------------------

VENDOR = trusted_certificates(None)
"""The vendor's certificate, for want of another that is at hand."""


def test_what_stands_between_certificates_is_left_out(tmp_path: Path) -> None:
    file = tmp_path / "ca.pem"
    file.write_bytes("Aussteller: Müller\n".encode() + VENDOR + b"\xff\n" + VENDOR)
    assert read_certificates(file).count(b"BEGIN CERTIFICATE") == 2 * VENDOR.count(b"BEGIN CERTIFICATE")
    read_certificates(file).decode("ascii")
    assert trusted_certificates(file).startswith(VENDOR)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (None, "cannot be read: No such file or directory; give a PEM file"),
        (b"", "holds no PEM certificate that can be read; give the one that signed"),
        (VENDOR[:200], "holds no PEM certificate that can be read"),
        (
            b"-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n",
            "holds no PEM certificate that can be read",
        ),
    ],
)
def test_a_file_without_certificates_is_named(tmp_path: Path, content: bytes | None, words: str) -> None:
    file = tmp_path / "ca.pem"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(CertificateError, match=words):
        trusted_certificates(file)
