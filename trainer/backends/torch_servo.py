"""The servo on the GPU: delayed set-points, PD law and torque effects as torch operations without synchronisation."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import torch

from spot_model.effects.base import CommandEffect, Effect, ModelEffect, Motion, TorqueEffect
from spot_model.errors import BadInputError
from spot_model.plant.memory import map_leaves, restarted
from spot_model.robot import facts
from spot_model.robot.control import pd_torque

Tensor = torch.Tensor


class DelayedSetpoints:
    """Set-points under way to the servos of n simulations; each simulation has its own constant delay.

    Raises:
        BadInputError: A command effect's delay is not constant in time, which this back end does not do.
    """

    def __init__(self, effects: tuple[Effect, ...], like: Tensor, timestep_s: float, substeps: int) -> None:
        n = len(like)
        delay_s = np.zeros(n)
        for effect in effects:
            if isinstance(effect, CommandEffect) and not effect.is_null:
                delay_s += constant_delay_s(effect, n)
        steps = np.ceil(delay_s / timestep_s - 1e-6).astype(np.int64)
        self._substeps = substeps
        self._delay_steps = torch.as_tensor(steps, device=like.device)[:, None]
        self._shared_steps = int(steps[0]) if np.all(steps == steps[0]) else None
        self.history = [like.clone() for _ in range(math.ceil(int(steps.max()) / substeps) + 1)]
        """Set-points by age in periods, the newest first, each of shape (n, 12)."""

    def issue(self, setpoint_rad: Tensor) -> None:
        """Send set-points, shape (n, 12)."""
        for newer, older in reversed(list(zip(self.history, self.history[1:], strict=False))):
            older.copy_(newer)
        self.history[0].copy_(setpoint_rad)

    def at(self, substep: int) -> Tensor:
        """The set-points in effect in this physics step of the period."""
        if self._shared_steps is not None:
            return self.history[max(0, math.ceil((self._shared_steps - substep) / self._substeps))]
        active = self.history[-1]
        for age in reversed(range(len(self.history) - 1)):
            arrived = self._delay_steps <= age * self._substeps + substep
            active = torch.where(arrived, self.history[age], active)
        return active

    def reset(self, mask: Tensor, position_rad: Tensor) -> None:
        """Drop what is under way in the simulations of ``mask``; their servos hold ``position_rad``."""
        for setpoint in self.history:
            setpoint.copy_(torch.where(mask[:, None], position_rad, setpoint))


class TorchTorqueChain:
    """PD law and torque effects of n simulations."""

    def __init__(self, effects: tuple[Effect, ...], like: Tensor) -> None:
        chosen = [e for e in effects if isinstance(e, TorqueEffect) and not e.is_null]
        self._effects = [e.arrays_like(like) for e in chosen]
        self._masks = [None if e.mask.all() else torch.as_tensor(e.mask, device=like.device) for e in chosen]
        self._fresh = [e.start(torch.zeros_like(like)) for e in self._effects]
        self.memory: list[Any] = [map_leaves(_own, fresh) for fresh in self._fresh]
        """Updated in place, so that a recorded step finds it where it was."""

    def torque_nm(self, setpoint_rad: Tensor, position_rad: Tensor, velocity_rad_s: Tensor, dt_s: float) -> Tensor:
        """Motor torque at this physics step, shape (n, 12)."""
        torque: Tensor = pd_torque(
            position_rad=position_rad,
            velocity_rad_s=velocity_rad_s,
            setpoint_position_rad=setpoint_rad,
            setpoint_velocity_rad_s=0.0,
            feedforward_nm=0.0,
            kp_nm_per_rad=facts.POLICY_KP_NM_PER_RAD,
            kd_nm_s_per_rad=facts.POLICY_KD_NM_S_PER_RAD,
        )
        motion = Motion(position_rad, velocity_rad_s, dt_s)
        for i, (effect, mask) in enumerate(zip(self._effects, self._masks, strict=True)):
            torque, memory = effect.apply(torque, motion, self.memory[i], mask)
            map_leaves(_overwrite, self.memory[i], memory)
        return torque

    def reset(self, mask: Tensor) -> None:
        """Start the memories afresh in the simulations of ``mask``."""
        for fresh, memory in zip(self._fresh, self.memory, strict=True):
            map_leaves(_overwrite, memory, restarted(mask, fresh, memory))


def _own(leaf: Any) -> Any:
    return leaf.clone() if isinstance(leaf, Tensor) else leaf


def _overwrite(kept: Any, new: Any) -> None:
    if isinstance(kept, Tensor) and new is not kept:
        kept.copy_(new)


def refuse_other_effects(effects: tuple[Effect, ...]) -> None:
    """Check that every effect acts on the model, on torque or on commands.

    Raises:
        BadInputError: One acts elsewhere.
    """
    for effect in effects:
        if not isinstance(effect, (ModelEffect, TorqueEffect, CommandEffect)) and not effect.is_null:
            raise BadInputError(
                f"effect {effect.name} acts at {effect.hook.value}; a GPU has places for model, torque and command: "
                "train on the CPU, or leave it out"
            )


def constant_delay_s(effect: CommandEffect, n: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """The delay of a command effect, shape (n,), s.

    Raises:
        BadInputError: It depends on when the command was issued.
    """
    rng = np.random.default_rng(0)
    delays = [np.broadcast_to(np.asarray(effect.arrival_s(np.full(n, t), rng)), (n,)) - t for t in (0.0, 1.0, 1.37)]
    if not np.allclose(delays, delays[0], atol=1e-9) or not np.all(np.isfinite(delays)):
        raise BadInputError(
            f"effect {effect.name}: its delay changes with time; on a GPU only constant delays are possible, "
            "train on the CPU or leave it out"
        )
    return delays[0]
