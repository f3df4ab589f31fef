"""A first-order low pass along time, each recording by itself."""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

from diagnosis.channels.channel_view import Array
from diagnosis.channels.stack import Stack


def low_pass(stack: Stack, raw: Array, time_constant_s: float) -> Array:
    """Low pass of (N, k), starting at rest at each recording's first value; 0 s changes nothing."""
    if time_constant_s <= 0.0:
        return raw
    keep = float(np.exp(-stack.period_s / time_constant_s))
    out = np.empty_like(raw)
    for number in range(len(stack.recordings)):
        rows = stack.run == number
        part = raw[rows]
        out[rows] = lfilter([1.0 - keep], [1.0, -keep], part, axis=0, zi=keep * part[:1])[0]
    return out
