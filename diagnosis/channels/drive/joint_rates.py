"""Channel *joint rates*: reported joint velocities against the derivative of reported positions, joint by joint.

Time convention: position and velocity of one state belong to one instant, but for a given offset of the velocity, half
of the load's lag: over the step that ends at a state, a discrete servo and its motion have one mean velocity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView
from diagnosis.channels.stack import Stack

STRIDE: Final = 2
FLOOR_RAD_S: Final = 0.02


@dataclass(frozen=True)
class RateSignals:
    """Signals of channel *joint rates*."""

    stack: Stack
    velocity_rad_s: Array
    """Shape (N, J)."""

    stride: int = STRIDE
    """Every so many rows one is kept."""

    def thinned(self, every: int) -> tuple[RateSignals, slice]:
        """Signals of one of ``every`` rows, and these rows."""
        return replace(self, stride=self.stride * every), slice(None, None, every)

    def finish_rate(self, raw: Array) -> Array:
        """The derivative of (N, J) as the channel's rows have it."""
        return self.stack.rate(raw, slice(None, None, self.stride))


def rate_view(stack: Stack, velocity_age_s: float = 0.0) -> ChannelView | ChannelOff:
    """Build the channel *joint rates*; by convention a reported velocity is so much older than its stamp."""
    if missing := stack.missing({"position_rad": "positions", "velocity_rad_s": "velocities"}):
        return ChannelOff(Channel.JOINT_RATES, f"no measured joint {missing}")
    velocity = stack.filled(lambda r: r.velocity_rad_s)
    position = stack.filled(lambda r: r.position_rad)
    kept, n_joints = slice(None, None, STRIDE), velocity.shape[1]
    response = (stack.smooth(velocity) + velocity_age_s * stack.rate(velocity) - stack.rate(position))[kept]
    return stack.joint_view(
        Channel.JOINT_RATES,
        kept,
        response,
        stack.legs,
        unit="rad/s",
        usable=np.repeat(stack.inner(stack.used)[kept, None], n_joints, axis=1),
        noise=np.full(n_joints, FLOOR_RAD_S),
        signals=RateSignals(stack, velocity),
    )
