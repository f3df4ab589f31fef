"""Units of recordings, with their factors to SI."""

from __future__ import annotations

import math
from typing import Final

from spot_model.errors import BadInputError

UNITS: Final[dict[str, dict[str, float]]] = {
    "angle": {"rad": 1.0, "deg": math.pi / 180, "turn": 2 * math.pi},
    "angular velocity": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": 2 * math.pi / 60},
    "torque": {"N·m": 1.0, "Nm": 1.0, "mN·m": 1e-3, "mNm": 1e-3},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
    "velocity": {"m/s": 1.0, "mm/s": 1e-3},
    "acceleration": {"m/s^2": 1.0, "m/s²": 1.0, "g": 9.80665},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "stiffness": {"N·m/rad": 1.0, "Nm/rad": 1.0},
    "damping": {"N·m·s/rad": 1.0, "Nms/rad": 1.0},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "current": {"A": 1.0, "mA": 1e-3},
    "temperature": {"°C": 1.0, "C": 1.0},
    "share": {"%": 1.0, "1": 100.0},
    "none": {"1": 1.0},
}
"""Kind of quantity, then unit, then the factor that turns a value into rad, rad/s, N·m, m, m/s, s, V, A, °C or %."""


def factor_of(unit: str | None, kind: str, where: str) -> float:
    """Return the factor from ``unit`` to ours.

    Raises:
        BadInputError: The unit is missing where one is needed, or is not one of that kind of quantity.
    """
    allowed = UNITS[kind]
    if unit is None and kind == "none":
        return 1.0
    if unit not in allowed:
        given = "has no unit" if unit is None else f"unit {unit!r} is not one of {kind}"
        raise BadInputError(f"{where}: {given}; allowed: {', '.join(allowed)}")
    return allowed[unit]
