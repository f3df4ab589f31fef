"""A stance command: where the four feet shall stand. No gRPC."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from fake_robot.network.status import Array, Snapshot
from fake_robot.services.motion.refusals import InvalidCommandError, UnknownFrameError
from fake_robot.services.motion.walk_params import BODY_FRAMES, WORLD_FRAMES, odom_point
from spot_model.robot.facts import LEG_NAMES

ACCURACY_M: Final = (0.02, 0.10)
"""Least and largest accuracy that can be asked for. Source: the proto."""
DEFAULT_ACCURACY_M: Final = 0.05


@dataclass(frozen=True)
class FootTargets:
    """Where the feet shall stand in a frame, and how exactly."""

    frame: str
    position_m: tuple[tuple[float, float], ...]
    """Legs fl, fr, hl, hr."""
    accuracy_m: float

    def in_odom_m(self, snapshot: Snapshot) -> Array:
        """Places of the feet in odom, shape (4, 2)."""
        return np.array([odom_point(self.frame, x, y, snapshot) for x, y in self.position_m])


def read_stance(request: Any) -> FootTargets:
    """Read a ``StanceCommand.Request``.

    Raises:
        InvalidCommandError: A foot is missing, or a number is none or out of its bounds.
        UnknownFrameError: The robot takes no stance in this frame.
    """
    stance = request.stance
    allowed = (*WORLD_FRAMES, *BODY_FRAMES)
    if stance.se2_frame_name not in allowed:
        raise UnknownFrameError(f"se2_frame_name = {stance.se2_frame_name!r}; allowed: {', '.join(allowed)}")
    if set(stance.foot_positions) != set(LEG_NAMES):
        given = ", ".join(sorted(stance.foot_positions)) or "none"
        raise InvalidCommandError(f"foot_positions has {given}; it needs each of {', '.join(LEG_NAMES)}")
    feet = tuple((stance.foot_positions[leg].x, stance.foot_positions[leg].y) for leg in LEG_NAMES)
    accuracy_m = stance.accuracy or DEFAULT_ACCURACY_M
    if not all(math.isfinite(v) for foot in feet for v in foot):
        raise InvalidCommandError("foot_positions holds a value that is no finite number")
    if not ACCURACY_M[0] - 1e-6 <= accuracy_m <= ACCURACY_M[1] + 1e-6:
        raise InvalidCommandError(f"accuracy = {accuracy_m:g} m; allowed: {ACCURACY_M[0]:g} to {ACCURACY_M[1]:g} m")
    return FootTargets(stance.se2_frame_name, feet, accuracy_m)
