"""Where episodes start: the paper's randomisation of pose, velocity and joints."""

from __future__ import annotations

import functools

import torch

from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from trainer.backends.backend import InitialState, SimulationDraws
from trainer.backends.random_draws import Draws
from trainer.config.task_config import FREE_HEIGHT_M, RandomisationConfig, TerrainConfig


def draw_initial_state(config: RandomisationConfig, terrain: TerrainConfig, n: int, draws: Draws) -> InitialState:
    """Initial states for n robots, one draw each; see :class:`RandomisationConfig` for the ranges."""
    device = draws.device
    c = config
    half_yaw = 0.5 * draws.uniform(c.initial_yaw_rad, n)
    zero = torch.zeros(n, device=device)
    default, low, high = _joint_constants(device)
    position = torch.clamp(default + draws.uniform(c.initial_position_rad, n, facts.N_JOINTS), low, high)
    # The body starts level, so the lowest foot says how high it must be for none to start inside the ground.
    lowest = foot_position_in_body_m(position)[..., 2].amin(dim=-1)
    height = facts.FOOT_RADIUS_M + FREE_HEIGHT_M - lowest + (terrain.amplitude_m if terrain.kind == "noise" else 0.0)
    xy = draws.uniform(c.initial_xy_m, n, 2)
    if terrain.kind == "noise":
        # Spread over the ground, so that robots do not all learn the same few square metres.
        reach = max(0.0, terrain.half_size_m - 12.0)
        xy = xy + draws.uniform((-reach, reach), n, 2)
    return InitialState(
        body_position_m=torch.cat([xy, height[:, None]], dim=-1),
        world_from_body_wxyz=torch.stack([half_yaw.cos(), zero, zero, half_yaw.sin()], dim=-1),
        linear_vel_of_body_in_world_m_s=torch.stack(
            [draws.uniform(r, n) for r in (c.initial_v_x_m_s, c.initial_v_y_m_s, c.initial_v_z_m_s)], dim=-1
        ),
        angular_vel_of_body_in_body_rad_s=torch.stack(
            [
                draws.uniform(r, n)
                for r in (c.initial_roll_rate_rad_s, c.initial_pitch_rate_rad_s, c.initial_yaw_rate_rad_s)
            ],
            dim=-1,
        ),
        position_rad=position,
        velocity_rad_s=draws.uniform(c.initial_velocity_rad_s, n, facts.N_JOINTS),
    )


@functools.lru_cache(maxsize=8)
def _joint_constants(device: torch.device) -> tuple[torch.Tensor, ...]:
    """Default pose and joint stops; kept on the device, because a copy would make it wait."""
    values = (facts.DEFAULT_POSITION_RAD, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
    return tuple(torch.tensor(v, device=device, dtype=torch.float32) for v in values)


def draw_simulations(config: RandomisationConfig, n: int, draws: Draws) -> SimulationDraws:
    """Friction and mass of n simulations."""
    return SimulationDraws(
        foot_friction=draws.uniform(config.foot_friction, n),
        added_body_mass_kg=draws.uniform(config.added_body_mass_kg, n),
    )
