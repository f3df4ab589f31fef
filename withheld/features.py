"""Runs as the judge sees them: what the headline measure and the three gaps compare, until the robot falls."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_log import Run
from spot_log.format.events import FOLLOWING_MODE
from spot_model.policy.observation import is_fallen, observed
from spot_model.policy.policy import Policy
from spot_model.robot.facts import Array
from trainer.signals.features import features_of_observations

Features = NDArray[np.float32]
"""Shape (n_ticks, 36), N·m."""
Gap = Literal["torque", "joint motion", "body motion"]
GAPS: Final[tuple[Gap, ...]] = ("torque", "joint motion", "body motion")


class Walk(NamedTuple):
    """One run at the policy's ticks, from when it was in command until any fall."""

    sequence: str
    features: Features
    """Of the headline measure."""
    signals: Mapping[Gap, Array]
    """Loads, N·m, and velocities of the joints, rad/s, each of shape (n_ticks, 12), and the body's in its own frame,
    m/s, shape (n_ticks, 3)."""
    is_fallen: bool
    """Whether the robot fell."""


def walk_of(
    sequence: str,
    observation: NDArray[np.float32],
    action: NDArray[np.float32],
    is_active: NDArray[np.bool_],
    load_nm: Array,
    policy: Policy,
) -> Walk:
    """A run from its ticks.

    Args:
        sequence: Name of its command sequence.
        observation: Shape (n, 48), policy order.
        action: Shape (n, 12), policy order.
        is_active: Whether the policy was in command, shape (n,).
        load_nm: Of the state that each tick saw, canonical order, shape (n, 12).
        policy: The policy that ran.
    """
    rows = np.flatnonzero(is_active & np.isfinite(observation).all(axis=1) & np.isfinite(action).all(axis=1))
    fallen = np.flatnonzero(is_fallen(observation[rows]))
    rows = rows[: fallen[0]] if len(fallen) else rows
    seen = observation[rows].astype(np.float64)
    signals: dict[Gap, Array] = {
        "torque": load_nm[rows],
        "joint motion": np.asarray(observed(seen, "joint_velocity_rad_s"))[:, policy.canonical_from_policy],
        "body motion": np.asarray(observed(seen, "linear_vel_of_body_in_body_m_s")),
    }
    features = features_of_observations(observation[rows], action[rows], policy)
    return Walk(sequence, features, signals, len(fallen) > 0)


def walk_of_run(run: Run, policy: Policy) -> Walk:
    """The same of a log."""
    t = run.ticks
    at = np.clip(np.searchsorted(run.states.robot_stamp_ns, t.robot_stamp_ns), 0, len(run.states) - 1)
    name = run.header.command_sequence or "unnamed"
    return walk_of(name, t.observation, t.action, np.asarray(t.mode) == FOLLOWING_MODE, run.states.load_nm[at], policy)
