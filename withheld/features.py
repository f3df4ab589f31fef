"""Runs as the headline measure sees them: 36 features a policy tick, until the robot falls."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spot_log import Run
from spot_model.policy.observation import is_fallen
from spot_model.policy.policy import Policy
from trainer.sysid.distance.features import features_of_observations

Features = NDArray[np.float32]
"""Shape (n_ticks, 36), N·m."""
ACTIVE = "active"


def features_of_ticks(
    observation: NDArray[np.float32], action: NDArray[np.float32], is_active: NDArray[np.bool_], policy: Policy
) -> Features:
    """Features of the ticks in which the policy followed its command, before any fall.

    Args:
        observation: Shape (n, 48), policy order.
        action: Shape (n, 12), policy order.
        is_active: Whether the policy was in command, shape (n,).
        policy: The policy that ran.
    """
    rows = np.flatnonzero(is_active & np.isfinite(observation).all(axis=1) & np.isfinite(action).all(axis=1))
    fallen = np.flatnonzero(is_fallen(observation[rows]))
    rows = rows[: fallen[0]] if len(fallen) else rows
    return features_of_observations(observation[rows], action[rows], policy)


def features_of_run(run: Run, policy: Policy) -> Features:
    """The same of a log."""
    t = run.ticks
    return features_of_ticks(t.observation, t.action, np.asarray(t.mode) == ACTIVE, policy)
