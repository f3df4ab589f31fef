"""What a failure is truly about: this computer's limits, or certificates, by the words of Python, gRPC and TLS.

Their codes cannot tell: gRPC reports a limit, a refused certificate and a service that is not there as the same one.
"""

from __future__ import annotations

from typing import Final

_FILES: Final = "this program may open no more files; raise its limit (ulimit -n, LimitNOFILE)"
_MEMORY: Final = (
    "this program gets no more memory or threads; raise its limits (ulimit -v, ulimit -u, MemoryMax, TasksMax), or end "
    "other programs"
)
SHORTAGES: Final = {
    "too many open files": _FILES,
    "cannot allocate memory": _MEMORY,
    "malloc failure": _MEMORY,
    "memoryerror": _MEMORY,
    "can't start new thread": _MEMORY,
}
"""What a failed call, of whatever kind, says where this computer is the cause."""

_REFUSED: Final = (
    "refuses this certificate (--cert): it has expired, is not valid yet, or service.tls_client_ca has not signed it; "
    "look with 'openssl x509 -noout -dates -issuer -in FILE'"
)
REFUSALS: Final = {
    "unwrap failed": _REFUSED,
    "_alert_": _REFUSED,
    "certificate has expired": "presents a certificate that has expired; renew service.tls_certificate",
    "certificate_verify_failed": (
        "presents a certificate that --ca has not signed; name the authority's file, or check that this is the service"
    ),
    "hostname verification": (
        "presents a certificate for another name; use the name that it bears, or issue it for this address"
    ),
    "wrong_version_number": "answers without TLS; leave out --ca, --cert and --key",
    "reset by peer": "ended the connection: where it wants TLS, name --ca, --cert and --key; else see its journal",
}
"""What TLS and gRPC say of a service that answers, but not to this client; the first that fits counts."""


def shortage(words: str) -> str:
    """What this computer lacks, and what to do, given a failure's words; empty where that is not why."""
    return _said(SHORTAGES, words)


def refusal(words: str) -> str:
    """What a service that answers does to this client, given gRPC's words; empty where nothing shows that it does."""
    return _said(REFUSALS, words)


def _said(table: dict[str, str], words: str) -> str:
    lower = words.lower()
    return next((told for sign, told in table.items() if sign in lower), "")
