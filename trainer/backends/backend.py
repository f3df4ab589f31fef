"""The interface between the task and the physics: many robots, stepped by one policy period at a time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import torch

Tensor = torch.Tensor


@dataclass(frozen=True)
class PlantState:
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


class Backend(Protocol):
    """Physics of ``n_envs`` robots under the policy's PD law, the model's effects included."""

    n_envs: int
    device: torch.device
    generators: list[torch.Generator]
    """On a GPU, what its effects draw from."""

    def step(self, setpoint_position_rad: Tensor) -> None:
        """Advance one policy period. Set-points of shape (n, 12) reach the servo after the model's command delay."""

    def read(self) -> PlantState:
        """The state now."""

    def read_reported(self, truth: PlantState) -> PlantState:
        """What the robots report where effects falsify it; ``truth`` itself where they do not."""

    def reset(self, mask: Tensor, initial: InitialState) -> None:
        """Put the robots of ``mask`` (bool, shape (n,)) into their initial state; what is under way is lost."""

    def add_velocity(self, delta_m_s: Tensor) -> None:
        """Push: change the body's linear velocity in the world, shape (n, 3)."""

    def snapshot(self) -> dict[str, Any]:
        """All that :meth:`restore` needs to continue bit for bit, as tensors by name."""

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot of a back end of the same size and config."""
