"""Mirror images of observations and actions: left and right exchanged."""

from __future__ import annotations

import functools
from typing import Any

import torch
from tensordict import TensorDict

from spot_model.policy.observation import OBSERVATION
from spot_model.robot import facts

Tensor = torch.Tensor

_MIRROR_LEG = {"fl": "fr", "fr": "fl", "hl": "hr", "hr": "hl"}
JOINT_SOURCE = [facts.JOINT_NAMES.index(f"{_MIRROR_LEG[name[:2]]}_{name[3:]}") for name in facts.JOINT_NAMES]
JOINT_SIGN = [-1.0 if name.endswith("hx") else 1.0 for name in facts.JOINT_NAMES]


def mirror_action(action: Tensor) -> Tensor:
    """The mirror image of joint values (actions, offsets, velocities), shape (..., 12), canonical order."""
    source, sign = _joint_mirror(action.device)
    return action[..., source] * sign


def mirror_observation(observation: Tensor) -> Tensor:
    """The mirror image of an observation, shape (..., 48)."""
    source, sign = _observation_mirror(observation.device)
    return observation[..., source] * sign


def with_mirror_images(
    env: Any,  # noqa: ARG001 - rsl-rl's signature
    obs: TensorDict | None,
    actions: Tensor | None,
) -> tuple[TensorDict | None, Tensor | None]:
    """Originals followed by their mirror images, as rsl-rl's symmetry extension wants them."""
    both_obs = None
    if obs is not None:
        tensors: dict[str, Any] = dict(obs.items())
        groups = {key: torch.cat([value, mirror_observation(value)]) for key, value in tensors.items()}
        both_obs = TensorDict(groups, batch_size=[2 * obs.batch_size[0]], device=obs.device)
    both_actions = None if actions is None else torch.cat([actions, mirror_action(actions)])
    return both_obs, both_actions


@functools.lru_cache(maxsize=8)
def _joint_mirror(device: torch.device) -> tuple[Tensor, Tensor]:
    with torch.inference_mode(mode=False):
        return torch.tensor(JOINT_SOURCE, device=device), torch.tensor(JOINT_SIGN, device=device)


@functools.lru_cache(maxsize=8)
def _observation_mirror(device: torch.device) -> tuple[Tensor, Tensor]:
    """Source column and sign of each of the 48 columns of a mirrored observation."""
    source: list[int] = []
    sign: list[float] = []
    for field in OBSERVATION:
        first = len(source)
        source += [first + i for i in (JOINT_SOURCE if field.mirror is None else range(field.width))]
        sign += JOINT_SIGN if field.mirror is None else field.mirror
    with torch.inference_mode(mode=False):
        return torch.tensor(source, device=device), torch.tensor(sign, device=device)
