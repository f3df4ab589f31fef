"""Effects on set-points: what the program sends, and when it arrives at the servos."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from array_api_compat import device

from spot_model.effects.base import CommandEffect, Draws, SoftwareEffect, parameter, per_sim
from spot_model.robot.arrays import namespace_of
from spot_model.robot.facts import DEFAULT_POSITION_RAD
from spot_model.robot.rotation import AnyArray


@dataclass(frozen=True, kw_only=True)
class ActionScale(SoftwareEffect):
    """The set-point's distance from the default pose is scaled.

    Source: exported policies run with another action scale, a fault often reported by users.
    """

    name: ClassVar[str] = "action_scale"

    scale: Any = parameter(null=1.0, low=0.1, high=10.0, unit="1", source="0.25 in place of 0.2, say")

    def setpoint_rad(self, position_rad: AnyArray) -> AnyArray:
        """Scale about the default pose."""
        xp = namespace_of(position_rad)
        rest = xp.asarray(DEFAULT_POSITION_RAD, dtype=position_rad.dtype, device=device(position_rad))
        scaled = position_rad + (self.scale - 1.0) * (position_rad - rest)
        return xp.where(self.mask_like(position_rad), scaled, position_rad)


@dataclass(frozen=True, kw_only=True)
class DefaultPose(SoftwareEffect):
    """A constant added to the set-points.

    Source: exported policies run with another default pose, a fault often reported by users.
    """

    name: ClassVar[str] = "default_pose"

    offset_rad: Any = parameter(null=0.0, low=-1.0, high=1.0, unit="rad", source="hind hips 1.1 in place of 0.9, say")

    def setpoint_rad(self, position_rad: AnyArray) -> AnyArray:
        """Add the offset."""
        return position_rad + self.offset_rad * self.mask_like(position_rad)


LEFT_RIGHT = np.array([3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8])
"""The joint on the other side, for each joint in canonical order."""


@dataclass(frozen=True, kw_only=True)
class JointSwap(SoftwareEffect):
    """The set-points of the chosen joints are blended with those of the other side.

    A full swap has share 1; choose both sides of a joint (``hx``) for a true exchange.

    Source: exported policies run in another joint order, a fault often reported by users.
    """

    name: ClassVar[str] = "joint_swap"

    share: Any = parameter(null=0.0, low=0.0, high=1.0, unit="1", source="1 for a swap")

    def setpoint_rad(self, position_rad: AnyArray) -> AnyArray:
        """Blend with the other side."""
        other = position_rad[:, LEFT_RIGHT]
        return position_rad + self.share * self.mask_like(position_rad) * (other - position_rad)


@dataclass(frozen=True, kw_only=True)
class CommandDelay(CommandEffect):
    """A constant delay from policy to servo.

    Source: the paper models the whole path as 5 ms.
    """

    name: ClassVar[str] = "command_delay"

    delay_s: Any = parameter(null=0.0, low=0.0, high=0.2, unit="s", source="the paper: 5 ms")

    def arrival_s(self, issued_s: AnyArray, rng: Draws) -> AnyArray:
        """Issue time plus delay."""
        return issued_s + per_sim(self.delay_s)


@dataclass(frozen=True, kw_only=True)
class CommandJitter(CommandEffect):
    """An added delay, exponentially distributed.

    Source: send intervals of a published recording vary by 0.5 ms (median) to 3 ms.
    """

    name: ClassVar[str] = "command_jitter"

    mean_s: Any = parameter(null=0.0, low=0.0, high=0.05, unit="s", source="recorded intervals, 0.0005 to 0.003 s")

    def arrival_s(self, issued_s: AnyArray, rng: Draws) -> AnyArray:
        """Issue time plus a drawn delay."""
        return issued_s + per_sim(self.mean_s) * rng.standard_exponential(tuple(issued_s.shape))


@dataclass(frozen=True, kw_only=True)
class CommandDrop(CommandEffect):
    """Each command is lost with the same probability.

    Source: weak wireless links, 0 to 2 %.
    """

    name: ClassVar[str] = "command_drop"

    probability: Any = parameter(null=0.0, low=0.0, high=0.9, unit="1", source="0 to 0.02")

    def arrival_s(self, issued_s: AnyArray, rng: Draws) -> AnyArray:
        """Issue time, or never."""
        is_lost = rng.random(tuple(issued_s.shape)) < per_sim(self.probability)
        return namespace_of(issued_s).where(is_lost, math.inf, issued_s)
