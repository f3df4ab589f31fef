"""The plant under the task: on the cores in NumPy, on a GPU in torch; the task sees tensors of one device."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
import torch
from torch import Tensor

from spot_model.effects.base import Effect, EstimateEffect, SensorEffect
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.memory import map_leaves
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions
from spot_model.robot.rotation import rotate_wxyz
from trainer.config.task_config import TaskConfig

FOOT_GEOMS = tuple(f"{leg}_foot" for leg in facts.LEG_NAMES)

DISABLE_FLAGS = int(mujoco.mjtDisableBit.mjDSBL_MIDPHASE | mujoco.mjtDisableBit.mjDSBL_WARMSTART)
"""On the cores. Thirteen shapes and one ground need no search for near pairs: the same bits without it. Without a warm
start a physics step takes 14 % less CPU time, and after twelve policy periods joints are within 4e-7 rad of where the
warm start has them (``lab/benchmarks/solver_options.py``)."""


@dataclass(frozen=True)
class TaskState:
    """What the task sees of the robots; float32 tensors on the back end's device, canonical joint order."""

    position_rad: Tensor
    """Shape (n, 12)."""
    velocity_rad_s: Tensor
    """Shape (n, 12)."""
    torque_nm: Tensor
    """Motor torque of the last physics step, after all limits. Shape (n, 12)."""
    body_position_m: Tensor
    """Body origin in the world, shape (n, 3)."""
    world_from_body_wxyz: Tensor
    """Shape (n, 4)."""
    linear_vel_of_body_in_world_m_s: Tensor
    """Shape (n, 3)."""
    angular_vel_of_body_in_world_rad_s: Tensor
    """Shape (n, 3)."""
    foot_contact: Tensor
    """Bool, shape (n, 4), legs fl, fr, hl, hr; as of the last physics step."""
    body_contact: Tensor
    """Bool, shape (n,): the body, an upper or a lower leg touches the ground."""
    foot_duty: Tensor
    """Share of the last period's physics steps in which each foot stood, shape (n, 4); where uneven_duty weighs
    nothing, of the last physics step alone."""


@dataclass(frozen=True)
class InitialState:
    """Where robots start; rows that are not reset are ignored."""

    body_position_m: Tensor
    """Shape (n, 3)."""
    world_from_body_wxyz: Tensor
    """Shape (n, 4)."""
    linear_vel_of_body_in_world_m_s: Tensor
    """Shape (n, 3)."""
    angular_vel_of_body_in_body_rad_s: Tensor
    """Shape (n, 3)."""
    position_rad: Tensor
    """Shape (n, 12)."""
    velocity_rad_s: Tensor
    """Shape (n, 12)."""


@dataclass(frozen=True)
class SimulationDraws:
    """What differs between simulations for good, drawn once."""

    foot_friction: Tensor
    """Sliding coefficient between foot and ground, shape (n,)."""
    added_body_mass_kg: Tensor
    """Shape (n,)."""


class PlantBackend:
    """``n_envs`` robots under the policy's PD law with the model's effects; no step on a GPU waits for it.

    Args:
        config: Physics rate and terrain are taken from it.
        effects: What acts in the robots.
        draws: Friction and mass of each simulation.
        device: "cpu", "cuda:N", or "warp-cpu" for checks.
        n_threads: On the cores, 0 for all.
        seed: Seed of what effects draw.
    """

    def __init__(
        self,
        config: TaskConfig,
        effects: tuple[Effect, ...],
        draws: SimulationDraws,
        device: str = "cpu",
        n_threads: int = 0,
        seed: int = 0,
    ) -> None:
        self.n_envs = n = len(draws.foot_friction)
        self._is_on_cores = device == "cpu"
        self.device = torch.device("cpu" if device == "warp-cpu" else device)
        self._substeps = round(config.physics_rate_hz / facts.POLICY_RATE_HZ)
        options = PlantOptions(mjcf=mjcf_options(config), device=device, n_threads=n_threads, seed=seed)
        self._is_falsified = any(isinstance(e, (SensorEffect, EstimateEffect)) and not e.is_null for e in effects)
        self.plant = Plant(effects, n, options)
        # On a GPU, what the effects draw from.
        self.generators: list[torch.Generator] = [] if self._is_on_cores else self.plant.generators()
        if self._is_on_cores:
            self.plant.fields["opt.disableflags"][...] |= DISABLE_FLAGS
        randomise(self.plant, draws)
        self.plant.reset()
        self._duty = torch.zeros(n, facts.N_LEGS, device=self.device) if config.counts_duty else None

    def step(self, setpoint_position_rad: Tensor) -> None:
        """Advance one policy period. Set-points of shape (n, 12) reach the servo after the model's command delay."""
        if self._duty is None:
            self.plant.step(self._into_plant(setpoint_position_rad), self._substeps)
            return
        self.plant.command(ServoCommand(position_rad=self._into_plant(setpoint_position_rad)))
        self._duty.zero_()
        for _ in range(self._substeps):
            self.plant.advance()
            self._duty += _tensor(self.plant.physics.standing()) / self._substeps

    def read(self) -> TaskState:
        """The state now, as float32 copies."""
        p = self.plant
        foot_contact, body_contact = (_tensor(flags) for flags in p.physics.contacts())
        return TaskState(
            position_rad=_float(p.joint_position_rad),
            velocity_rad_s=_float(p.joint_velocity_rad_s),
            torque_nm=_float(p.applied_torque_nm),
            body_position_m=_float(p.position_of_body_in_world_m),
            world_from_body_wxyz=_float(p.world_from_body_wxyz),
            linear_vel_of_body_in_world_m_s=_float(p.linear_vel_of_body_in_world_m_s),
            angular_vel_of_body_in_world_rad_s=_float(p.angular_vel_of_body_in_world_rad_s),
            foot_contact=foot_contact,
            body_contact=body_contact,
            foot_duty=foot_contact.float() if self._duty is None else self._duty.clone(),
        )

    def read_reported(self, truth: TaskState) -> TaskState:
        """What sensors and estimator report where effects falsify it; ``truth`` itself where they do not."""
        if not self._is_falsified:
            return truth
        joints, body = self.plant.reading, self.plant.estimate
        attitude = body.world_from_body_wxyz
        return dataclasses.replace(
            truth,
            position_rad=_float(joints.position_rad),
            velocity_rad_s=_float(joints.velocity_rad_s),
            world_from_body_wxyz=_float(attitude),
            linear_vel_of_body_in_world_m_s=_float(rotate_wxyz(attitude, body.linear_vel_of_body_in_body_m_s)),
            angular_vel_of_body_in_world_rad_s=_float(rotate_wxyz(attitude, body.angular_vel_of_body_in_body_rad_s)),
        )

    def reset(self, mask: Tensor, initial: InitialState) -> None:
        """Put the robots of ``mask`` (bool, shape (n,)) into their initial state; what is under way is lost."""
        if self._is_on_cores and not mask.any():
            return

        def of(tensor: Tensor) -> Any:
            return tensor[mask].numpy().astype(np.float64) if self._is_on_cores else tensor

        attitude = of(initial.world_from_body_wxyz)
        if self._is_on_cores:
            attitude /= np.linalg.norm(attitude, axis=-1, keepdims=True)
        self.plant.reset(
            mask.numpy() if self._is_on_cores else mask,
            position_of_body_in_world_m=of(initial.body_position_m),
            world_from_body_wxyz=attitude,
            joint_position_rad=of(initial.position_rad),
            linear_vel_of_body_in_world_m_s=of(initial.linear_vel_of_body_in_world_m_s),
            angular_vel_of_body_in_body_rad_s=of(initial.angular_vel_of_body_in_body_rad_s),
            joint_velocity_rad_s=of(initial.velocity_rad_s),
        )

    def add_velocity(self, delta_m_s: Tensor) -> None:
        """Push: change the body's linear velocity in the world, shape (n, 3)."""
        if not self._is_on_cores:
            self.plant.push(linear_vel_in_world_m_s=delta_m_s)
            return
        delta = delta_m_s.numpy()
        rows = delta.any(axis=-1)
        if rows.any():
            self.plant.push(rows, linear_vel_in_world_m_s=delta[rows])

    def snapshot(self) -> dict[str, Any]:
        """The plant's own snapshot, with its arrays as tensors."""
        plain: dict[str, Any] = map_leaves(
            lambda v: torch.from_numpy(v) if isinstance(v, np.ndarray) else v, self.plant.snapshot()
        )
        return plain

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot; a GPU's sums are not bit-exact from run to run."""
        if self._is_on_cores:
            snapshot = map_leaves(lambda v: v.numpy() if isinstance(v, Tensor) else v, snapshot)
        self.plant.restore(snapshot)

    def _into_plant(self, tensor: Tensor) -> Any:
        return tensor.numpy().astype(np.float64) if self._is_on_cores else tensor


def mjcf_options(config: TaskConfig) -> MjcfOptions:
    """The physics model that a task trains on."""
    return MjcfOptions(timestep_s=1.0 / config.physics_rate_hz, terrain=config.terrain.terrain(), visuals=False)


def randomise(plant: Plant, draws: SimulationDraws) -> None:
    """Give each simulation its foot friction and body mass; inertia grows with the mass."""
    friction = plant.fields["geom_friction"]
    for name in FOOT_GEOMS:
        friction[:, plant.model.geom(name).id, 0] = draws.foot_friction.cpu().numpy()
    body = plant.model.body("body").id
    mass, inertia = plant.fields["body_mass"], plant.fields["body_inertia"]
    ratio = 1.0 + draws.added_body_mass_kg.cpu().numpy() / mass[:, body]
    mass[:, body] *= ratio
    inertia[:, body] *= ratio[:, None]
    plant.fields.commit()


def _tensor(array: Any) -> Tensor:
    return torch.from_numpy(array) if isinstance(array, np.ndarray) else array


def _float(array: Any) -> Tensor:
    return _tensor(array).float()
