"""A first-order low pass of a reported quantity."""

from __future__ import annotations

import math
from typing import Any

from spot_model.effects.base import Effect
from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


def low_pass(
    now: AnyArray, before: AnyArray, time_constant_s: Any, dt_s: float, effect: Effect | None = None
) -> AnyArray:
    """The filtered value; ``now`` itself, bit for bit, where the time constant is 0.

    Args:
        now: The quantity at this instant, shape (n, k).
        before: The filtered one of the previous instant, same shape.
        time_constant_s: Of the filter, broadcasts to ``now``.
        dt_s: Time between the two.
        effect: Filters only its joints, if given.
    """
    xp = namespace_of(now)
    tau = time_constant_s if effect is None else xp.where(effect.mask_like(now), time_constant_s, 0.0)
    keep = xp.where(tau > 0.0, xp.exp(-dt_s / xp.where(tau > 0.0, tau, math.inf)), 0.0)
    return xp.where(keep > 0.0, now + keep * (before - now), now)
