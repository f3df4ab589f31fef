"""PayloadService and PayloadRegistrationService: payloads that clients describe. They weigh nothing here.

The payload that the simulated body carries is a matter of the scenario.
"""

from __future__ import annotations

import hmac
import threading
from dataclasses import dataclass, field
from typing import Any

from bosdyn.api import (
    payload_pb2,
    payload_registration_pb2,
)

from fake_robot.services.calls.access import refuse_request
from fake_robot.services.identity.tokens import TokenMint

MAX_PAYLOADS = 64


@dataclass
class RegisteredPayloads:
    """Registered payloads and their secrets. Thread-safe. Every payload is authorised at once."""

    _payloads: dict[str, payload_pb2.Payload] = field(default_factory=dict)
    _secrets: dict[str, str] = field(default_factory=dict, repr=False)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def payloads(self) -> list[payload_pb2.Payload]:
        """Every payload, in order of registration."""
        with self._lock:
            return list(self._payloads.values())

    def register(self, payload: payload_pb2.Payload, secret: str) -> bool:
        """Add a payload; False if its GUID is taken."""
        with self._lock:
            if payload.GUID in self._payloads or len(self._payloads) >= MAX_PAYLOADS:
                return False
            kept = payload_pb2.Payload()
            kept.CopyFrom(payload)
            kept.is_authorized = kept.is_enabled = True
            self._payloads[kept.GUID], self._secrets[kept.GUID] = kept, secret
            return True

    def find(self, guid: str, secret: str) -> tuple[payload_pb2.Payload | None, bool]:
        """The payload, and whether the secret is right."""
        with self._lock:
            known = self._secrets.get(guid)
            is_right = known is not None and hmac.compare_digest(known.encode(), secret.encode())
            return self._payloads.get(guid), is_right


class PayloadService:
    """Lists payloads."""

    def __init__(self, records: RegisteredPayloads) -> None:
        self._records = records

    def ListPayloads(self, request: Any) -> Any:  # noqa: N802
        """Every registered payload; none at start."""
        return payload_pb2.ListPayloadsResponse(payloads=self._records.payloads())


class PayloadRegistrationService:
    """Registers payloads and gives them tokens. Needs no user token: a payload has its own secret."""

    def __init__(self, records: RegisteredPayloads, tokens: TokenMint) -> None:
        self._records = records
        self._tokens = tokens

    def RegisterPayload(self, request: Any) -> Any:  # noqa: N802
        """Add a payload; GUID and secret are required."""
        response = payload_registration_pb2.RegisterPayloadResponse()
        if not request.payload.GUID or not request.payload_secret:
            return refuse_request(response, "a payload needs a GUID and a secret")
        is_new = self._records.register(request.payload, request.payload_secret)
        response.status = response.STATUS_OK if is_new else response.STATUS_ALREADY_EXISTS
        return response

    def UpdatePayloadVersion(self, request: Any) -> Any:  # noqa: N802
        """Change a payload's software version."""
        response = payload_registration_pb2.UpdatePayloadVersionResponse()
        payload = self._known(response, *_credentials(request))
        if payload is not None:
            payload.version.CopyFrom(request.updated_version)
        return response

    def GetPayloadAuthToken(self, request: Any) -> Any:  # noqa: N802
        """A token for a payload that shows its secret."""
        response = payload_registration_pb2.GetPayloadAuthTokenResponse()
        payload, is_right = self._records.find(*_credentials(request))
        if payload is None or not is_right:
            response.status = response.STATUS_INVALID_CREDENTIALS
        else:
            response.status, response.token = response.STATUS_OK, self._tokens.mint(f"payload:{payload.GUID}")
        return response

    def UpdatePayloadAttached(self, request: Any) -> Any:  # noqa: N802
        """Attach or detach a payload."""
        response = payload_registration_pb2.UpdatePayloadAttachedResponse()
        payload = self._known(response, request.payload_credentials.guid, request.payload_credentials.secret)
        if payload is not None:
            payload.is_enabled = request.request == request.REQUEST_ATTACH
        return response

    def _known(self, response: Any, guid: str, secret: str) -> payload_pb2.Payload | None:
        """The payload that shows its secret; else None. The answer's status says which."""
        payload, is_right = self._records.find(guid, secret)
        if payload is None:
            response.status = response.STATUS_DOES_NOT_EXIST
        elif not is_right:
            response.status = response.STATUS_INVALID_CREDENTIALS
        else:
            response.status = response.STATUS_OK
        return payload if is_right else None


def _credentials(
    request: payload_registration_pb2.UpdatePayloadVersionRequest | payload_registration_pb2.GetPayloadAuthTokenRequest,
) -> tuple[str, str]:
    """GUID and secret, from the newer message or the older two fields."""
    if request.HasField("payload_credentials"):
        return request.payload_credentials.guid, request.payload_credentials.secret
    return request.payload_guid, request.payload_secret
