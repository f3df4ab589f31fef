"""The feature space of the paper's measures: joint position, joint velocity and action, in N·m of the control law."""

from __future__ import annotations

from typing import Any

import numpy as np

from spot_log.read.run import Run
from spot_model.policy.contract import PolicyContract
from spot_model.policy.observation import observed
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.arrays import like, namespace_of
from spot_model.robot.rotation import AnyArray
from trainer.signals.policy_ticks import policy_ticks


def control_law_features(
    *,
    position_rad: AnyArray,
    velocity_rad_s: AnyArray,
    action: AnyArray,
    contract: PolicyContract,
) -> Any:
    """Scale position by kp, velocity by kd, and action by σ_a·kp.

    Args:
        position_rad: Shape (..., 12), canonical order, rad.
        velocity_rad_s: Shape (..., 12), canonical order, rad/s.
        action: The network's output. Shape (..., 12), in the policy's joint order.
        contract: The policy's contract: gains, action scale, joint order.

    Returns:
        Shape (..., 36), canonical order, float32, N·m; of the array library of ``position_rad``.

    Source: the paper, footnote on the feature space of the evaluation metrics.
    """
    index = {name: i for i, name in enumerate(contract.joint_names)}
    order = [index[name] for name in facts.JOINT_NAMES]
    kp = like(position_rad, np.array(contract.kp_nm_per_rad)[order])
    kd = like(position_rad, np.array(contract.kd_nm_s_per_rad)[order])
    scaled = (kp * position_rad, kd * velocity_rad_s, contract.action_scale_rad * kp * action[..., order])
    xp = namespace_of(position_rad)
    return xp.astype(xp.concat(scaled, axis=-1), xp.float32)


def features_of_observations(observation: AnyArray, action: AnyArray, policy: Policy) -> Any:
    """The same features from ticks.

    Args:
        observation: Shape (..., 48), as :mod:`spot_model.policy.observation` lays it out, policy order.
        action: Shape (..., 12), policy order.
        policy: The policy that ran.

    Returns:
        Shape (..., 36), canonical order, N·m.
    """
    order = policy.canonical_from_policy.tolist()
    exact = np.asarray(observation, dtype=np.float64) if isinstance(observation, np.ndarray) else observation
    offset = observed(exact, "joint_position_offset_rad")
    position = offset + like(exact, policy.default_position_rad)
    return control_law_features(
        position_rad=position[..., order],
        velocity_rad_s=observed(exact, "joint_velocity_rad_s")[..., order],
        action=action,
        contract=policy.contract,
    )


def features_of_run(run: Run, policy: Policy, at_least: int = 0) -> Any:
    """Those of a log's :func:`~trainer.signals.policy_ticks.policy_ticks`, shape (n, 36)."""
    rows = policy_ticks(run, at_least)
    return features_of_observations(run.ticks.observation[rows], run.ticks.action[rows], policy)
