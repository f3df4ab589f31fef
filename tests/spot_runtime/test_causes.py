"""What stands behind a failure's words, for a robot, a service and a defect alike: one row for each true cause."""

from __future__ import annotations

import datetime as dt
import errno
import os
import subprocess
import sys
from pathlib import Path

import grpc
import pytest
from bosdyn.client import exceptions as sdk
from cryptography import x509

from proof.attacks.certificates import LOOPBACK, Authority, role
from spot_protos import operator_pb2
from spot_runtime.causes import refusal, shortage
from spot_runtime.hal.address import Address, explain_no_connection
from spot_runtime.hal.errors import CredentialsError, HalError
from spot_runtime.hal.spot.vendor_errors import translate
from spot_runtime.stops import StopReason, unforeseen
from spot_tools.client import OperatorClient, UnreachableError
from tests.spot_runtime.operator.test_service import serving

FILES, MEMORY = "may open no more files", "gets no more memory or threads"
REFUSED = "refuses this certificate"
TLS = "Tls handshake failed (TSI_PROTOCOL_FAILURE): SSL_ERROR_SSL: error:1000007d:SSL routines:OPENSSL_internal:"


@pytest.mark.parametrize(
    ("words", "lacks", "does"),
    [
        ("OSError: [Errno 24] Too many open files: '/proc/self/statm'", FILES, ""),
        ("INTERNAL: ipv4:127.0.0.1:1: socket: Too many open files", FILES, ""),
        ("MemoryError: ", MEMORY, ""),
        ("OSError: [Errno 12] Cannot allocate memory", MEMORY, ""),
        ("RuntimeError: can't start new thread", MEMORY, ""),
        ("error:0e000041:common libcrypto routines:OPENSSL_internal:malloc failure: Invalid", MEMORY, ""),
        ("UNAVAILABLE: ipv4:127.0.0.1:1: Unwrap failed (TSI_DATA_CORRUPTED)", "", REFUSED),
        ("SSL routines:OPENSSL_internal:SSLV3_ALERT_CERTIFICATE_EXPIRED", "", REFUSED),
        ("SSL routines:OPENSSL_internal:TLSV1_ALERT_UNKNOWN_CA", "", REFUSED),
        (f"{TLS}CERTIFICATE_VERIFY_FAILED: certificate has expired: OK", "", "renew service.tls_certificate"),
        (f"{TLS}CERTIFICATE_VERIFY_FAILED: self signed certificate in certificate chain", "", "--ca has not signed"),
        ("UNAUTHENTICATED: Hostname Verification Check failed.", "", "for another name"),
        (f"{TLS}WRONG_VERSION_NUMBER: Invalid certificate verification context: OK", "", "without TLS"),
        ("UNAVAILABLE: recvmsg:Connection reset by peer (104)", "", "where it wants TLS"),
        ("UNKNOWN: ipv4:127.0.0.1:9: Failed to connect to remote host: Connection refused", "", ""),
        ("Deadline Exceeded", "", ""),
    ],
)
def test_a_cause_is_told_by_the_words_of_the_failure(words: str, lacks: str, does: str) -> None:
    for told, expected in ((shortage(words), lacks), (refusal(words), does)):
        assert expected in told
        assert bool(told) == bool(expected)


class Failed(grpc.RpcError):
    def __init__(self, code: grpc.StatusCode, details: str) -> None:
        self._code, self._details = code, details

    def code(self) -> grpc.StatusCode:
        return self._code

    def details(self) -> str:
        return self._details


def test_a_robot_denies_access_only_where_it_says_so() -> None:
    """The SDK chooses its classes by numbers in gRPC's text: 401 of a port makes a call unauthenticated."""
    unavailable = Failed(grpc.StatusCode.UNAVAILABLE, "ipv4:127.0.0.1:40123: no answer")
    told = translate(sdk.UnauthenticatedError(unavailable), "logging in")
    assert not isinstance(told, CredentialsError)
    assert "did not answer" in str(told)
    denied = Failed(grpc.StatusCode.UNAUTHENTICATED, "token")
    assert isinstance(translate(sdk.UnauthenticatedError(denied), "logging in"), CredentialsError)
    short = Failed(grpc.StatusCode.UNAVAILABLE, "socket: Too many open files")
    told = translate(sdk.UnauthenticatedError(short), "logging in")
    assert str(told).startswith("logging in: this program may open no more files; raise its limit")


def test_a_robot_that_this_computer_cannot_reach_is_not_missing(monkeypatch: pytest.MonkeyPatch) -> None:
    def connect(*_: object) -> None:
        raise OSError(errno.EMFILE, os.strerror(errno.EMFILE))

    monkeypatch.setattr("spot_runtime.hal.address.connect", connect)
    told = explain_no_connection(Address("127.0.0.1", 1), b"", "", 1.0)
    assert type(told) is HalError
    assert str(told).startswith("127.0.0.1:1 cannot be reached: this program may open no more files")


@pytest.mark.parametrize(
    ("error", "reason", "words"),
    [
        (OSError(errno.EMFILE, "Too many open files", "/proc/self/statm"), StopReason.COMPUTER_SHORT, "statm"),
        (RuntimeError("can't start new thread"), StopReason.COMPUTER_SHORT, "raise its limits"),
        (MemoryError(), StopReason.COMPUTER_SHORT, "too few files, threads or memory"),
        (ValueError("shape (3,)"), StopReason.INTERNAL_ERROR, "a defect of this program: poll: ValueError: shape (3,)"),
    ],
)
def test_a_limit_of_this_computer_is_no_defect_of_the_program(error: Exception, reason: StopReason, words: str) -> None:
    stop = unforeseen(error, "poll")
    assert stop.reason is reason
    assert words in stop.sentence()
    assert unforeseen(error).detail == stop.detail.removeprefix("poll: ")


# Over mutual TLS ------------------------------------------------------------------------------------------------------


def expired(authority: Authority, name: str, *alternatives: x509.GeneralName) -> tuple[Path, Path]:
    """A certificate of this authority whose time is over."""
    builder, over = authority._builder, dt.datetime.now(dt.timezone.utc) - dt.timedelta(hours=1)

    def older(*names: object) -> x509.CertificateBuilder:
        made = builder(*names)  # type: ignore[arg-type]
        made._not_valid_after = over.replace(tzinfo=None)
        return made

    authority._builder = older  # type: ignore[method-assign]
    try:
        return authority.sign(name, *alternatives)
    finally:
        authority._builder = builder  # type: ignore[method-assign]


def test_why_a_service_over_tls_is_not_reached(tmp_path: Path) -> None:
    authority, stranger = Authority(tmp_path, "authority"), Authority(tmp_path, "stranger")
    pair = authority.sign("anna", role("operate"))
    certificate, key = authority.sign("robot", LOOPBACK)

    def told(address: str, ca: Path = authority.file, own: tuple[Path, Path] = pair, call: str = "GetStatus") -> str:
        request = operator_pb2.StopRequest() if call == "Stop" else operator_pb2.GetStatusRequest()
        with (
            OperatorClient(address, ca=ca, certificate=own[0], key=own[1]) as client,
            pytest.raises(UnreachableError) as failed,
        ):
            client.call(call, request, 1.2 if call == "Stop" else 10.0)
        assert "spot-rl serve" not in str(failed.value)
        return str(failed.value)

    files = {"tls_certificate": certificate, "tls_key": key, "tls_client_ca": authority.file}
    with serving(listen="127.0.0.1:0", **files) as (server, _):
        for own in (stranger.sign("eve", role("operate")), expired(authority, "olga", role("operate"))):
            assert REFUSED in told(server.address, own=own)
            assert REFUSED in told(server.address, own=own, call="Stop")
        assert "--ca has not signed" in told(server.address, ca=stranger.file)
    certificate, key = expired(authority, "old robot", LOOPBACK)
    with serving(listen="127.0.0.1:0", **{**files, "tls_certificate": certificate, "tls_key": key}) as (server, _):
        assert "renew service.tls_certificate" in told(server.address)
    with serving(listen="127.0.0.1:0") as (server, _):
        assert "without TLS" in told(server.address)


def test_grpc_is_silent_where_our_errors_speak() -> None:
    program = "import spot_tools.client, os; print(os.environ['GRPC_VERBOSITY'])"
    environment = {name: value for name, value in os.environ.items() if name != "GRPC_VERBOSITY"}
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True, timeout=60
    )
    assert done.stdout == "NONE\n"
