"""rsl-rl's PPO with an update that never waits for the device, and the mirror images that its symmetry loss needs."""

from __future__ import annotations

import contextlib
import functools
import itertools
from collections.abc import Iterator
from typing import Any

import torch
from rsl_rl.algorithms import PPO
from rsl_rl.modules.distribution import GaussianDistribution
from torch import Tensor
from torch.nn.functional import mse_loss
from torch.nn.utils import clip_grad_norm_

from spot_model.plant.captured import Captured
from spot_model.policy.observation import OBSERVATION
from spot_model.robot import facts
from trainer.ppo.vec_env import TaskVecEnv

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


SETTLED_KL_SHARE = 0.2
"""Share of the KL target at the end of the settling iterations."""
LEARNING_RATES = (1.0e-5, 1.0e-2)
"""Bounds of the adaptive learning rate. Source: rsl-rl."""
LEARNING_RATE_FACTOR = 1.5

LOSSES = ("value", "surrogate", "entropy", "symmetry")


class DeviceGaussian(GaussianDistribution):  # type: ignore[misc]  # rsl_rl has no types
    """rsl-rl's Gaussian, drawn without looking at its deviation on the host, as ``torch.normal`` does."""

    def sample(self) -> Tensor:
        """One draw for each robot, shape (n, 12)."""
        mean, std = self.params
        drawn: Tensor = torch.randn_like(mean) * std + mean
        return drawn


class DevicePpo(PPO):  # type: ignore[misc]  # rsl_rl has no types
    """PPO whose update stays on the device, learning rate included, so that a GPU can repeat it as a graph.

    Rollouts, storage, returns and networks are rsl-rl's. The losses are the same, too; samples are shuffled once an
    iteration, as there, but also gathered once, and all cores are used to learn alone.
    """

    env: TaskVecEnv
    learning_threads: int = 1
    mirror_weight: float = 0.0
    mirror_from_iteration: int = 0
    settle_iterations: int = 0
    critic_first_iterations: int = 0
    total_iterations: int = 0
    uses_graphs: bool = False
    entropy_coef: float
    desired_kl: float
    learning_rate: Tensor

    def __init__(self, *args: Any, **settings: Any) -> None:
        super().__init__(*args, **settings)
        self.learning_rate = torch.as_tensor(self.learning_rate, dtype=torch.float32, device=self.device)
        self.optimizer = torch.optim.Adam(
            itertools.chain(self.actor.parameters(), self.critic.parameters()),
            lr=self.learning_rate,
            fused=True,
            capturable=self._is_on_gpu,
        )
        n = self.storage.num_envs * self.storage.num_transitions_per_env
        self._order = torch.zeros(n - n % self.num_mini_batches, dtype=torch.long, device=self.device)
        self._entropy_weight = torch.zeros((), device=self.device)
        self._kl_target = torch.zeros((), device=self.device)
        self._actor_learns = torch.ones((), device=self.device)
        self._passes: dict[bool, Captured] = {}

    def act(self, obs: Any) -> Tensor:
        """Sample actions with as many torch threads as learning has: nothing else runs meanwhile."""
        with self._all_threads():
            actions: Tensor = super().act(obs)
        return actions

    def update(self) -> dict[str, float]:
        """Learn from the storage, with :attr:`learning_threads` torch threads; returns the mean losses by name."""
        entropy, desired_kl = self._settled(self.entropy_coef, self.desired_kl)
        self._entropy_weight.fill_(entropy)
        self._kl_target.fill_(desired_kl)
        self._actor_learns.fill_(float(self.env.iteration >= self.critic_first_iterations))
        self._order.copy_(torch.randperm(len(self._order), device=self.device))
        mirrors = self.mirror_weight > 0.0 and self.env.iteration >= self.mirror_from_iteration
        if mirrors not in self._passes:
            self._passes[mirrors] = Captured(lambda: self._learn(mirrors=mirrors), (), is_recorded=self.uses_graphs)
        with self._all_threads():
            losses: Tensor = self._passes[mirrors]()
            seen = self.storage.observations.flatten(0, 1)
            self.actor.update_normalization(seen)
            self.critic.update_normalization(seen)
        self.storage.clear()
        return dict(zip(LOSSES if mirrors else LOSSES[:-1], losses.tolist(), strict=False))

    def load(self, loaded_dict: dict[str, Any], load_cfg: dict[str, Any] | None, strict: bool) -> bool:
        """Take over a checkpoint's state; the optimiser's settings stay this one's, the learning rate in its place."""
        if load_cfg is None:
            groups = loaded_dict["optimizer_state_dict"]["param_groups"]
            self.learning_rate.fill_(float(groups[0]["lr"]))
            for group in groups:
                group.update(fused=True, foreach=None, capturable=self._is_on_gpu)
        rate = self.learning_rate
        has_iteration: bool = super().load(loaded_dict, load_cfg, strict)
        self.learning_rate = rate
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        return has_iteration

    @contextlib.contextmanager
    def _all_threads(self) -> Iterator[None]:
        before = torch.get_num_threads()
        torch.set_num_threads(self.learning_threads)
        try:
            yield
        finally:
            torch.set_num_threads(before)

    @property
    def _is_on_gpu(self) -> bool:
        return torch.device(self.device).type == "cuda"

    def _settled(self, entropy: float, desired_kl: float) -> tuple[float, float]:
        """Entropy weight and KL target of this iteration."""
        left = self.total_iterations - self.env.iteration
        if self.settle_iterations == 0 or left >= self.settle_iterations:
            return entropy, desired_kl
        share = max(0.0, left / self.settle_iterations)
        return entropy * share, desired_kl * (SETTLED_KL_SHARE + (1.0 - SETTLED_KL_SHARE) * share)

    def _learn(self, *, mirrors: bool) -> Tensor:
        """All passes over the storage; mean losses in the order of :data:`LOSSES`, shape (4,)."""
        storage, order = self.storage, self._order
        columns = (
            storage.observations[self.actor.obs_groups[0]],
            storage.observations[self.critic.obs_groups[0]],
            storage.actions,
            *storage.distribution_params,
            torch.cat([storage.actions_log_prob, storage.advantages, storage.returns, storage.values], dim=-1),
        )
        with torch.no_grad():
            shuffled = [column.flatten(0, 1)[order] for column in columns]
        batches = list(zip(*(column.chunk(self.num_mini_batches) for column in shuffled), strict=True))
        sums = torch.zeros(len(LOSSES), device=self.device)
        for batch in batches * self.num_learning_epochs:
            sums += self._learn_from(*batch, mirrors=mirrors)
        mean: Tensor = sums / (len(batches) * self.num_learning_epochs)
        return mean

    def _learn_from(
        self,
        seen: Tensor,
        known: Tensor,
        actions: Tensor,
        old_mean: Tensor,
        old_std: Tensor,
        numbers: Tensor,
        *,
        mirrors: bool,
    ) -> Tensor:
        """One step of the optimiser on a mini-batch; its losses, shape (4,).

        Args:
            seen: The actor's observations, shape (n, 48).
            known: The critic's.
            actions: What was done, shape (n, 12).
            old_mean: Of the policy that acted, shape (n, 12).
            old_std: Of the same policy, shape (n, 12).
            numbers: Log probability of the action then, advantage, return, value then; shape (n, 4).
            mirrors: Whether the mirror loss acts.
        """
        old_log_prob, advantage, returns, old_value = numbers.unbind(dim=-1)
        with torch.autocast(torch.device(self.device).type, torch.bfloat16, enabled=self.use_mixed_precision):
            mean = self._mean_action(seen)
            value = self.critic.mlp(self.critic.obs_normalizer(known))[:, 0]
            mirrored = self._mean_action(mirror_observation(seen)) if mirrors else mean
        mean, value = mean.float(), value.float()
        policy = self.actor.distribution
        policy.update(mean)
        entropy = policy.entropy.mean()
        self._adapt_learning_rate(policy.kl_divergence((old_mean, old_std), (mean.detach(), policy.std.detach())))

        ratio = torch.exp(policy.log_prob(actions) - old_log_prob)
        clipped = ratio.clamp(1.0 - self.clip_param, 1.0 + self.clip_param)
        surrogate = torch.max(-advantage * ratio, -advantage * clipped).mean()
        value_error = (value - returns).square()
        if self.use_clipped_value_loss:
            near = old_value + (value - old_value).clamp(-self.clip_param, self.clip_param)
            value_error = torch.max(value_error, (near - returns).square())
        value_loss = value_error.mean()
        symmetry = mse_loss(mirrored.float(), mirror_action(mean).detach()) if mirrors else torch.zeros_like(entropy)
        of_actor = surrogate - self._entropy_weight * entropy
        if mirrors:
            of_actor = of_actor + self.mirror_weight * symmetry
        loss = self._actor_learns * of_actor + self.value_loss_coef * value_loss

        self.optimizer.zero_grad()
        loss.backward()
        if self.is_multi_gpu:
            self.reduce_parameters()
        clip_grad_norm_(self.actor.parameters(), self.max_grad_norm)
        clip_grad_norm_(self.critic.parameters(), self.max_grad_norm)
        self.optimizer.step()
        return torch.stack([value_loss, surrogate, entropy, symmetry]).detach()

    def _mean_action(self, observation: Tensor) -> Tensor:
        mean: Tensor = self.actor.mlp(self.actor.obs_normalizer(observation))
        return mean

    def _adapt_learning_rate(self, kl: Tensor) -> None:
        """Lower the rate where the policy changed by more than twice the KL target, raise it below half of it."""
        if self.schedule != "adaptive":
            return
        mean = kl.mean()
        if self.is_multi_gpu:
            torch.distributed.all_reduce(mean)
            mean /= self.gpu_world_size
        low, high = LEARNING_RATES
        rate = self.learning_rate
        slower = (rate / LEARNING_RATE_FACTOR).clamp(min=low)
        faster = (rate * LEARNING_RATE_FACTOR).clamp(max=high)
        is_small = (mean < self._kl_target / 2.0) & (mean > 0.0) & (self._actor_learns > 0.0)
        rate.copy_(torch.where(mean > self._kl_target * 2.0, slower, torch.where(is_small, faster, rate)))
