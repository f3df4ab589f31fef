"""Velocity commands of a case: three kinds of motion within a policy's range, drawn anew for every case."""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_model.io.velocity_sequence import VelocitySequence, sequence_of
from spot_model.policy.contract import PolicyContract

COMFORT: Final = 0.75
"""Share of a policy's range that ordinary cases use; the rest belongs to :func:`fast_sequences`."""
TOP_M_S: Final = 3.0
FAST_M_S: Final = (4.0, 6.0)
"""Speeds at which a power-distribution limit shows; source: the paper."""


def ordinary_sequences(
    contract: PolicyContract, rng: np.random.Generator, duration_s: float
) -> tuple[VelocitySequence, ...]:
    """``ahead`` (a ramp up and down), ``around`` (one axis at a time) and ``mixed`` (all at once)."""
    low, high = _range(contract)
    v, w, t = low, high, duration_s
    top = float(rng.uniform(0.7, 1.0)) * w[0]
    a, b = (float(rng.uniform(0.5, 1.0)) for _ in range(2))
    ahead = _sequence(
        "ahead",
        t,
        (0, 0, 0, 0, False),
        (0.08, 0.25 * top, 0, 0, False),
        (0.5, top, 0, 0, True),
        (0.8, top, 0, 0, True),
        (0.95, 0, 0, 0, True),
    )
    around = _sequence(
        "around",
        t,
        (0, 0, 0, 0, False),
        (0.08, a * 0.5 * w[0], 0, 0, False),
        (0.26, b * v[0], 0, 0, False),
        (0.44, 0, a * w[1], 0, False),
        (0.6, 0, b * v[1], 0, False),
        (0.75, 0, 0, a * w[2], False),
        (0.93, 0, 0, 0, False),
    )
    points: list[tuple[float, float, float, float, bool]] = [(0.0, 0.0, 0.0, 0.0, False)]
    for share in (0.08, 0.3, 0.52, 0.74):
        x, y, yaw = rng.uniform(0.8 * low, 0.8 * high)
        points.append((share, float(x), float(y), float(yaw), False))
    points.append((0.95, 0.0, 0.0, 0.0, False))
    return ahead, around, _sequence("mixed", t, *points)


def fast_sequences(
    contract: PolicyContract, rng: np.random.Generator, duration_s: float
) -> tuple[VelocitySequence, ...]:
    """Straight on at 4 to 6 m/s: hold, two steps, and a ramp with a gentle turn."""
    top_m_s = min(FAST_M_S[1], contract.velocity_command_high[0])
    a, b, c = np.sort(rng.uniform(FAST_M_S[0], top_m_s, 3))
    t = duration_s
    hold = _sequence(
        "ahead",
        t,
        (0, 0, 0, 0, False),
        (0.05, 1, 0, 0, False),
        (0.4, b, 0, 0, True),
        (0.8, b, 0, 0, True),
        (0.97, 0, 0, 0, True),
    )
    steps = _sequence(
        "around",
        t,
        (0, 0, 0, 0, False),
        (0.05, 2, 0, 0, False),
        (0.3, a, 0, 0, True),
        (0.6, c, 0, 0, True),
        (0.85, c, 0, 0, True),
        (0.98, 0, 0, 0, True),
    )
    turn = _sequence(
        "mixed",
        t,
        (0, 0, 0, 0, False),
        (0.05, 1.5, 0, 0, False),
        (0.45, c, 0, 0, True),
        (0.65, a, 0, 0.3, True),
        (0.8, a, 0, -0.3, True),
        (0.97, 0, 0, 0, True),
    )
    return hold, steps, turn


def _range(contract: PolicyContract) -> tuple[np.ndarray, np.ndarray]:
    low = COMFORT * np.array(contract.velocity_command_low)
    high = COMFORT * np.array(contract.velocity_command_high)
    return low, np.minimum(high, [TOP_M_S, 1.0, 1.5])


def _sequence(name: str, duration_s: float, *points: tuple[float, float, float, float, bool]) -> VelocitySequence:
    """Of points with their time as a share of the duration."""
    told = [(round(share * duration_s, 3), float(x), float(y), float(w), r) for share, x, y, w, r in points]
    return sequence_of(name, duration_s, *told)
