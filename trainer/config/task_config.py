"""The task: commands, randomisation, noise, terrain and episode, as data."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field, field_validator, model_validator

from spot_model.io.settings import Settings
from spot_model.robot.mjcf_options import FlatTerrain, NoiseTerrain, Terrain
from trainer.config.range import Range
from trainer.config.reward_config import RewardShape, RewardWeights, check_reward_names

FREE_HEIGHT_M = 0.01
"""Room under the lowest foot at the start of an episode."""


class CommandConfig(Settings):
    """Velocity commands: drawn uniformly, held, then drawn again. Source: the paper."""

    v_x_m_s: Range = (-2.0, 5.5)
    """Range of the forward command."""
    v_y_m_s: Range = (-1.5, 1.5)
    """Range of the command to the left."""
    yaw_rate_rad_s: Range = (-2.0, 2.0)
    """Range of the turn command."""
    resample_s: float = Field(default=10.0, gt=0.0)
    """Time after which a new command is drawn."""
    standing_share: float = Field(default=0.1, ge=0.0, le=1.0)
    """Share of commands that are zero."""
    straight_share: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of commands with V_y and ω_z zero."""
    turning_share: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of commands with V_x and V_y zero."""
    slow_share: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of commands that are scaled to a quarter, so that slow walking is trained, too."""
    lateral_acceleration_limit_m_s2: float = Field(default=1.0e3, gt=0.0)
    """V_y and ω_z are scaled down where |V_x·ω_z| exceeds this."""
    curriculum_iterations: int = Field(default=0, ge=0)
    """Iterations over which the ranges grow from ``curriculum_start`` of their width to all of it; 0: at once."""
    curriculum_start: float = Field(default=0.3, gt=0.0, le=1.0)
    """Share of the ranges at the first iteration of the curriculum."""


class RandomisationConfig(Settings):
    """What is drawn for each episode (initial state) and for each simulation (friction, mass). Source: the paper."""

    foot_friction: Range = (0.3, 1.0)
    """One sliding coefficient per simulation; MuJoCo has no separate static one."""
    added_body_mass_kg: Range = (-2.5, 2.5)
    """Mass added to the body."""
    initial_xy_m: Range = (-0.5, 0.5)
    """Initial position."""
    initial_yaw_rad: Range = (-3.14159, 3.14159)
    """Initial heading."""
    initial_v_x_m_s: Range = (-1.5, 1.5)
    """Initial forward velocity."""
    initial_v_y_m_s: Range = (-1.0, 1.0)
    """Initial velocity to the left."""
    initial_v_z_m_s: Range = (-0.5, 0.5)
    """Initial vertical velocity."""
    initial_roll_rate_rad_s: Range = (-0.7, 0.7)
    """Initial roll rate."""
    initial_pitch_rate_rad_s: Range = (-0.7, 0.7)
    """Initial pitch rate."""
    initial_yaw_rate_rad_s: Range = (-1.0, 1.0)
    """Initial yaw rate."""
    initial_position_rad: Range = (-0.2, 0.2)
    """Initial offset of each joint from the default pose."""
    initial_velocity_rad_s: Range = (-2.5, 2.5)
    """Initial velocity of each joint."""
    push_m_s: Range = (-0.5, 0.5)
    """Change of the body's velocity by a push, each horizontal direction."""
    push_interval_s: Range = (10.0, 15.0)
    """Time between pushes."""
    replaced_effects: tuple[str, ...] = ()
    """Names of the model's effects that an entry below replaces."""
    effects: tuple[dict[str, Any], ...] = ()
    """Additional effects, as in a model file; a parameter may be [low, high], drawn once per simulation."""


class NoiseConfig(Settings):
    """Standard deviations of the observation noise.

    Source: the paper's estimate (spectrum times frequency, averaged over the upper half of the band), applied to a
    published log of a real Spot (MIT, KyleM73/spot-rl-deployment).
    """

    scale: float = Field(default=1.0, ge=0.0)
    """Multiplies all; 0 switches the noise off."""
    linear_vel_m_s: tuple[float, float, float] = (0.005, 0.022, 0.016)
    """Body velocity: x, y, z."""
    angular_vel_rad_s: tuple[float, float, float] = (0.105, 0.051, 0.020)
    """Turn rate of the body: x, y, z."""
    gravity: tuple[float, float, float] = (0.001, 0.002, 0.001)
    """Direction of gravity in the body frame: x, y, z."""
    joint_position_rad: float = Field(default=0.006, ge=0.0)
    """Joint positions."""
    joint_velocity_rad_s: float = Field(default=0.45, ge=0.0)
    """Joint velocities."""


class TerrainConfig(Settings):
    """The ground; ``noise`` is low-poly rough ground."""

    kind: Literal["flat", "noise"] = "flat"
    """`flat`, or `noise`: rough ground."""
    seed: int = 0
    """Random seed of the rough ground."""
    amplitude_m: float = Field(default=0.03, gt=0.0, le=0.3)
    """Largest height of the rough ground."""
    cell_m: float = Field(default=0.25, gt=0.0)
    """Distance between its grid points."""
    half_size_m: float = Field(default=20.0, gt=0.0)
    """Half the side of the square of rough ground."""

    def terrain(self) -> Terrain:
        """The plant's terrain."""
        if self.kind == "flat":
            return FlatTerrain()
        return NoiseTerrain(
            seed=self.seed, amplitude_m=self.amplitude_m, cell_m=self.cell_m, half_size_m=self.half_size_m
        )


class LateRewards(Settings):
    """Reward weights that change during the training, so that the gait is learned first and refined later."""

    weights: dict[str, float] = Field(default_factory=dict)
    """By the names of the rewards."""
    from_iteration: int = Field(default=0, ge=0)
    """Iteration at which they begin to change."""
    over_iterations: int = Field(default=1, ge=1)
    """Iterations over which the weights change evenly."""

    @field_validator("weights")
    @classmethod
    def _known(cls, weights: dict[str, float]) -> dict[str, float]:
        check_reward_names(weights)
        return weights

    def share(self, iteration: int) -> float:
        """How much of the change is done, 0 to 1."""
        return min(1.0, max(0.0, (iteration - self.from_iteration) / self.over_iterations))


class TaskConfig(Settings):
    """Episodes and physics."""

    episode_s: float = Field(default=20.0, gt=0.0)
    """Length of an episode."""
    short_episode_s: float = Field(default=3.0, gt=0.0)
    """Length of a short episode."""
    short_episode_share: float = Field(default=0.0, ge=0.0, le=1.0)
    """Share of the robots with short episodes, so that starts are practised more often."""
    physics_rate_hz: float = Field(default=200.0, gt=0.0)
    """Physics steps per second."""
    commands: CommandConfig = CommandConfig()
    randomisation: RandomisationConfig = RandomisationConfig()
    noise: NoiseConfig = NoiseConfig()
    terrain: TerrainConfig = TerrainConfig()
    rewards: RewardWeights = RewardWeights()
    reward_shape: RewardShape = RewardShape()
    late_rewards: LateRewards = LateRewards()
    critic_sees_noise: bool = False
    """Whether the critic gets noisy observations, like the actor."""

    @property
    def counts_duty(self) -> bool:
        """Whether duty factors are measured at every physics step."""
        return self.rewards.uneven_duty != 0.0 or self.late_rewards.weights.get("uneven_duty", 0.0) != 0.0

    @model_validator(mode="after")
    def _whole_substeps(self) -> TaskConfig:
        substeps = self.physics_rate_hz / 50.0
        if substeps != round(substeps) or substeps < 1:
            raise ValueError(f"physics_rate_hz = {self.physics_rate_hz}; allowed: a multiple of the policy's 50 Hz")
        return self
