"""The feature space of the paper's measures: joint position, joint velocity and action, in N·m of the control law."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from spot_log.read.run import Run
from spot_model.policy.contract import PolicyContract
from spot_model.policy.observation import observed
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from trainer.signals.policy_ticks import policy_ticks


def control_law_features(
    *,
    position_rad: NDArray[np.float64],
    velocity_rad_s: NDArray[np.float64],
    action: NDArray[np.floating],
    contract: PolicyContract,
) -> NDArray[np.float32]:
    """Scale position by kp, velocity by kd, and action by σ_a·kp.

    Args:
        position_rad: Shape (..., 12), canonical order, rad.
        velocity_rad_s: Shape (..., 12), canonical order, rad/s.
        action: The network's output. Shape (..., 12), in the policy's joint order.
        contract: The policy's contract: gains, action scale, joint order.

    Returns:
        Shape (..., 36), canonical order, N·m.

    Source: the paper, footnote on the feature space of the evaluation metrics.
    """
    index = {name: i for i, name in enumerate(contract.joint_names)}
    order = np.array([index[name] for name in facts.JOINT_NAMES], dtype=np.intp)
    kp = np.array(contract.kp_nm_per_rad)[order]
    kd = np.array(contract.kd_nm_s_per_rad)[order]
    scaled = (kp * position_rad, kd * velocity_rad_s, contract.action_scale_rad * kp * action[..., order])
    return np.concatenate(scaled, axis=-1).astype(np.float32)


def features_of_observations(
    observation: NDArray[np.floating], action: NDArray[np.floating], policy: Policy
) -> NDArray[np.float32]:
    """The same features from ticks.

    Args:
        observation: Shape (n, 48), as :mod:`spot_model.policy.observation` lays it out, policy order.
        action: Shape (n, 12), policy order.
        policy: The policy that ran.

    Returns:
        Shape (n, 36), canonical order, N·m.
    """
    order = policy.canonical_from_policy
    velocity = observed(observation, "joint_velocity_rad_s")
    offset = observed(observation, "joint_position_offset_rad")
    position = np.asarray(offset, dtype=np.float64) + policy.default_position_rad
    return control_law_features(
        position_rad=position[:, order],
        velocity_rad_s=np.asarray(velocity, dtype=np.float64)[:, order],
        action=action,
        contract=policy.contract,
    )


def features_of_run(run: Run, policy: Policy, at_least: int = 0) -> NDArray[np.float32]:
    """Those of a log's :func:`~trainer.signals.policy_ticks.policy_ticks`, shape (n, 36)."""
    rows = policy_ticks(run, at_least)
    return features_of_observations(run.ticks.observation[rows], run.ticks.action[rows], policy)
