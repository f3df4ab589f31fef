"""The part of the configuration that the operator's service and the live view read."""

from __future__ import annotations

from pathlib import Path

from pydantic import Field, field_validator

from spot_model.io.settings import Settings, between, positive


class ServiceConfig(Settings):
    """Operator's service (``spot-rl serve``): access, rates, and reactions when no operator is present."""

    listen: str = Field(
        default="",
        description="'unix:/path', or HOST:PORT; empty: operator.sock in the service's or the user's run-time folder. "
        "A host that is not loopback needs the three tls_ files.",
    )
    tls_certificate: Path | None = Field(default=None, description="PEM file: the service's certificate.")
    tls_key: Path | None = Field(default=None, description="PEM file: its key, readable by its owner alone.")
    tls_client_ca: Path | None = Field(default=None, description="PEM file: who signs the operators' certificates.")
    policies: Path = Field(default=Path("policies"), description="Folder whose .onnx files may be armed, by name.")
    policy_sha256: tuple[str, ...] = Field(
        default=(), max_length=1000, description="If given, only policies with one of these digests may be armed."
    )
    policy_public_key: Path | None = Field(
        default=None,
        description="PEM file of Ed25519 public keys: if given, only policies that one of them has signed may run.",
    )
    deadman_s: float = positive(0.25, 2.0, "Silence of the steering operator after which the velocity fades to zero.")
    attendance_s: float = between(
        10.0, 1.0, 600.0, "Silence of all operators after which the robot stops, sits and powers off."
    )
    arm_timeout_s: float = between(90.0, 5.0, 600.0, "Longest time from arming to standing, and from the end to rest.")
    requests_per_s: float = between(50.0, 1.0, 1000.0, "Calls that each client may make, steering apart.")
    steering_per_s: float = between(100.0, 10.0, 1000.0, "SetVelocity calls of each client.")
    live_port: int = between(0, 0, 65535, "TCP port of the live view for Foxglove, on loopback; 0: none.")

    @field_validator("policy_sha256")
    @classmethod
    def _are_digests(cls, digests: tuple[str, ...]) -> tuple[str, ...]:
        for digest in digests:
            if len(digest) != 64 or set(digest) - set("0123456789abcdef"):
                raise ValueError(f"{digest!r} is no SHA-256 in 64 small hexadecimal digits")
        return digests
