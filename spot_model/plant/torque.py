"""Motor torque of the active command: the servo law, then the torque effects in order."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from spot_model.effects.base import JointReading, Memory, Motion, TorqueEffect
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.memory import keeper, leaves, own_tensors, restarted, tensors_of, with_leaves
from spot_model.robot.arrays import namespace_of
from spot_model.robot.control import pd_torque
from spot_model.robot.rotation import AnyArray


class TorqueChain:
    """The torque effects of many simulations with their memories, on arrays like ``like``, shape (n_sims, 12)."""

    def __init__(self, effects: Sequence[TorqueEffect], like: AnyArray) -> None:
        xp = namespace_of(like)
        self._where = xp.where
        self._keep = keeper(like)
        self._effects = tuple(effect.arrays_like(like) for effect in effects)
        self._masks = tuple(None if effect.mask.all() else effect.mask_like(like) for effect in self._effects)
        self._fresh: list[Memory] = [effect.start(xp.zeros_like(like)) for effect in self._effects]
        self._memory: list[Memory] = [own_tensors(fresh) for fresh in self._fresh]

    def torque_nm(self, command: ServoCommand, motion: Motion, reading: JointReading | Motion) -> AnyArray:
        """Motor torque at this physics step; moves the effects' memories on by one step.

        Returns:
            Shape (n_sims, 12), N·m.
        """
        damped = reading.servo_velocity_rad_s if isinstance(reading, JointReading) else None
        torque = pd_torque(
            position_rad=reading.position_rad,
            velocity_rad_s=reading.velocity_rad_s if damped is None else damped,
            setpoint_position_rad=command.position_rad,
            setpoint_velocity_rad_s=command.velocity_rad_s,
            feedforward_nm=command.load_nm,
            kp_nm_per_rad=command.kp_nm_per_rad,
            kd_nm_s_per_rad=command.kd_nm_s_per_rad,
        )
        for i, (effect, mask) in enumerate(zip(self._effects, self._masks, strict=True)):
            # As Effect.apply does, without its look-up of the array library.
            changed, memory = effect.torque(torque, motion, self._memory[i])
            self._memory[i] = self._keep(self._memory[i], memory)
            torque = changed if mask is None else self._where(mask, changed, torque)
        return torque

    def leaves(self) -> list[Any]:
        """On a GPU, the tensors of all memories."""
        return tensors_of(self._memory)

    def reset(self, rows: AnyArray) -> None:
        """Start the memories afresh in the simulations of ``rows``, shape (n_sims,)."""
        for i, fresh in enumerate(self._fresh):
            self._memory[i] = self._keep(self._memory[i], restarted(rows, fresh, self._memory[i]))

    def snapshot(self) -> list[list[Any]]:
        """The memories as plain arrays and numbers, one list an effect."""
        return [leaves(memory) for memory in self._memory]

    def restore(self, snapshot: list[list[Any]]) -> None:
        """Continue from a snapshot.

        Raises:
            ValueError: It was made with other effects.
        """
        if len(snapshot) != len(self._effects):
            raise ValueError(f"the snapshot has memories of {len(snapshot)} effects, the plant {len(self._effects)}")
        self._memory = [with_leaves(memory, values) for memory, values in zip(self._memory, snapshot, strict=True)]
