"""What a request must look like; checked before it is passed on."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final

from spot_protos import operator_pb2
from spot_runtime.operator.refusal import bad_request
from spot_runtime.session.labels import RULE, is_label

MAX_MESSAGE_BYTES: Final = 64 * 1024
MAX_LABELS: Final = 32
_DIGEST: Final = re.compile(r"[0-9a-fA-F]{64}")
_COMPONENTS: Final = ("v_x_m_s", "v_y_m_s", "yaw_rate_rad_s")


def labels(given: Mapping[str, str], *, at_least: int = 0) -> dict[str, str]:
    """Labels of a log. Raises Refusal."""
    if len(given) < at_least:
        raise bad_request("no label is given; give at least one key and value")
    if len(given) > MAX_LABELS:
        raise bad_request(f"{len(given)} labels are given; allowed: at most {MAX_LABELS}")
    for key, value in given.items():
        if not is_label(key, value):
            raise bad_request(f"label {key[:80]!r} = {value[:80]!r} is not valid; allowed: {RULE}")
    return dict(given)


def operator_name(given: str) -> str:
    """The name of who asks. Raises Refusal."""
    if len(given) > 64 or not given.isprintable():
        raise bad_request("the operator's name is not valid; allowed: printable, at most 64 characters")
    return given


def sha256(given: str) -> str:
    """A digest, or none. Raises Refusal."""
    if given and not _DIGEST.fullmatch(given):
        raise bad_request(f"sha256 {given[:80]!r} is not valid; allowed: empty, or 64 hexadecimal digits")
    return given.lower()


def velocity(
    given: operator_pb2.SetVelocityRequest, low: Sequence[float], high: Sequence[float]
) -> tuple[float, float, float]:
    """A velocity within the running policy's range; while that is not known, any finite one. Raises Refusal."""
    values = (given.v_x_m_s, given.v_y_m_s, given.yaw_rate_rad_s)
    for i, (name, value) in enumerate(zip(_COMPONENTS, values, strict=True)):
        if not math.isfinite(value):
            raise bad_request(f"{name} = {value} is no number")
        if low and high and not low[i] - 1e-9 <= value <= high[i] + 1e-9:
            raise bad_request(f"{name} = {value:g}; this policy takes {low[i]:g} to {high[i]:g}")
    return values


def status_rate_hz(given: float) -> float:
    """How often a status is sent. Raises Refusal."""
    if given == 0.0:
        return 2.0
    if not 0.1 <= given <= 10.0:
        raise bad_request(f"rate_hz = {given}; allowed: 0.1 to 10, or 0 for 2")
    return given
