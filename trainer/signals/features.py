"""The feature space of the paper's measures: joint position, joint velocity and action, in N·m of the control law."""

from __future__ import annotations

from typing import Any

import numpy as np

from spot_log.read.run import Run
from spot_model.policy.observation import observed
from spot_model.policy.policy import Policy
from spot_model.robot.arrays import like, namespace_of
from spot_model.robot.rotation import AnyArray
from trainer.signals.policy_ticks import policy_ticks


def features_of_observations(observation: AnyArray, action: AnyArray, policy: Policy) -> Any:
    """Joint position scaled by kp, velocity by kd, and action by σ_a·kp.

    Args:
        observation: Shape (..., 48), as :mod:`spot_model.policy.observation` lays it out, policy order.
        action: The network's output. Shape (..., 12), policy order.
        policy: The policy that ran: gains, action scale, joint order, default pose.

    Returns:
        Shape (..., 36), canonical order, float32, N·m; of the array library of ``observation``.

    Source: the paper, footnote on the feature space of the evaluation metrics.
    """
    contract, order = policy.contract, policy.canonical_from_policy.tolist()
    exact = np.asarray(observation, dtype=np.float64) if isinstance(observation, np.ndarray) else observation
    position = observed(exact, "joint_position_offset_rad") + like(exact, policy.default_position_rad)
    velocity = observed(exact, "joint_velocity_rad_s")
    kp = like(exact, np.array(contract.kp_nm_per_rad)[order])
    kd = like(exact, np.array(contract.kd_nm_s_per_rad)[order])
    scaled = (kp * position[..., order], kd * velocity[..., order], contract.action_scale_rad * kp * action[..., order])
    xp = namespace_of(exact)
    return xp.astype(xp.concat(scaled, axis=-1), xp.float32)


def features_of_run(run: Run, policy: Policy, at_least: int = 0) -> Any:
    """Those of a log's :func:`~trainer.signals.policy_ticks.policy_ticks`, shape (n, 36)."""
    rows = policy_ticks(run, at_least)
    return features_of_observations(run.ticks.observation[rows], run.ticks.action[rows], policy)
