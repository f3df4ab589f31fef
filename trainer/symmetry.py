"""Left and right exchanged: the mirror image of an observation and of an action."""

from __future__ import annotations

from typing import Any

import torch
from tensordict import TensorDict

from spot_model import facts
from spot_model.observation import OBSERVATION_LAYOUT

Tensor = torch.Tensor

_MIRROR_LEG = {"fl": "fr", "fr": "fl", "hl": "hr", "hr": "hl"}
JOINT_SOURCE = [facts.JOINT_NAMES.index(f"{_MIRROR_LEG[name[:2]]}_{name[3:]}") for name in facts.JOINT_NAMES]
JOINT_SIGN = [-1.0 if name.endswith("hx") else 1.0 for name in facts.JOINT_NAMES]
_VECTOR_SIGN = {
    "linear_vel_of_body_in_body_m_s": (1.0, -1.0, 1.0),
    "angular_vel_of_body_in_body_rad_s": (-1.0, 1.0, -1.0),
    "projected_gravity_in_body": (1.0, -1.0, 1.0),
    "velocity_command": (1.0, -1.0, -1.0),
}


def mirror_action(action: Tensor) -> Tensor:
    """The mirror image of joint values (actions, offsets, velocities), shape (..., 12), canonical order."""
    return action[..., JOINT_SOURCE] * torch.tensor(JOINT_SIGN, device=action.device, dtype=action.dtype)


def mirror_observation(observation: Tensor) -> Tensor:
    """The mirror image of an observation, shape (..., 48)."""
    parts = []
    for (name, _), block in zip(
        OBSERVATION_LAYOUT, observation.split([size for _, size in OBSERVATION_LAYOUT], dim=-1), strict=True
    ):
        sign = _VECTOR_SIGN.get(name)
        parts.append(
            mirror_action(block) if sign is None else block * torch.tensor(sign, device=block.device, dtype=block.dtype)
        )
    return torch.cat(parts, dim=-1)


def with_mirror_images(
    env: Any, obs: TensorDict | None, actions: Tensor | None
) -> tuple[TensorDict | None, Tensor | None]:
    """Originals followed by their mirror images, as rsl-rl's symmetry extension wants them."""
    both_obs = None
    if obs is not None:
        groups = {key: torch.cat([value, mirror_observation(value)]) for key, value in obs.items()}
        both_obs = TensorDict(groups, batch_size=[2 * obs.batch_size[0]], device=obs.device)
    both_actions = None if actions is None else torch.cat([actions, mirror_action(actions)])
    return both_obs, both_actions
