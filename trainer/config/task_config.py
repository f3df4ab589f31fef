"""The task: commands, randomisation, noise, terrain, rewards and episode, as data."""

from __future__ import annotations

from collections.abc import Iterable
from importlib.metadata import entry_points
from typing import Annotated, Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, ConfigDict, Field, field_validator, model_validator

from spot_model.io.settings import Settings
from spot_model.policy.observation import OBSERVATION
from spot_model.robot.terrain import FlatTerrain, NoiseTerrain, Terrain, TileTerrain

ENTRY_POINT_GROUP: Final = "spot_rl.rewards"
"""Where installed packages name their rewards."""


def check_reward_names(names: Iterable[str]) -> None:
    """Check that each name is ours, installed, or ``module:function``; raises ValueError."""
    known = [*RewardWeights.model_fields, *(entry.name for entry in entry_points(group=ENTRY_POINT_GROUP))]
    for name in names:
        if name not in known and ":" not in name:
            allowed = f"{', '.join(known)}, or module:function for one of your own"
            raise ValueError(f"no reward is called {name}; allowed: {allowed}")


class RewardWeights(Settings):
    """One weight a reward term; each term is weighted, multiplied by the policy period and added up.

    A reward of one's own has the key ``module:function``, or the name under which it is installed in the entry-point
    group ``spot_rl.rewards``; see :func:`trainer.task.rewards.reward_term`.

    Source: Isaac Lab's released Spot task (BSD-3-Clause) for the defaults; the paper names foot impact and foot
    distance without weights, so those two are this project's choice.
    """

    model_config = ConfigDict(extra="allow")
    __pydantic_extra__: dict[str, float] = Field(init=False)

    linear_velocity: float = 5.0
    yaw_rate: float = 5.0
    air_time: float = 5.0
    gait: float = 10.0
    trot: float = 0.0
    """Not in the paper. The gait term compares times, so that short strides make a hop look like a trot."""
    short_swing: float = 0.0
    """Not in the paper."""
    long_phase: float = 0.0
    """Not in the paper. It penalises phases for which air_time only stops paying, which keeps strides short."""
    foot_clearance: float = 0.5
    action_smoothness: float = -1.0
    air_time_variance: float = -1.0
    uneven_duty: float = 0.0
    """Not in the paper. Differences of less than a policy period are invisible to air_time_variance."""
    fall: float = 0.0
    """Not in the paper. Like all weights it is multiplied by the period: -1000 costs 20 for each fall."""
    base_motion: float = -2.0
    orientation: float = -3.0
    foot_slip: float = -0.5
    foot_impact: float = -0.5
    foot_distance: float = -2.0
    joint_acceleration: float = -1.0e-4
    joint_velocity: float = -1.0e-2
    joint_position: float = -0.7
    joint_torque: float = -5.0e-4
    power: float = 0.0
    """Not in the paper."""

    @model_validator(mode="after")
    def _known(self) -> RewardWeights:
        check_reward_names(self.model_extra or {})
        return self

    def by_name(self) -> dict[str, float]:
        """Every weight, those of one's own rewards last."""
        return {name: float(weight) for name, weight in self.model_dump().items()}


class RewardShape(Settings):
    """The numbers inside the reward formulas; see :mod:`trainer.task.rewards`."""

    linear_velocity_scale_m_s: float = Field(default=1.0, gt=0.0)
    """Velocity error at which *linear_velocity* falls to 1/e."""
    linear_velocity_ramp_from_m_s: float = Field(default=1.0, ge=0.0)
    """Commanded speed from which *linear_velocity* is worth more."""
    linear_velocity_ramp_s_per_m: float = Field(default=0.5, ge=0.0)
    """How much more, per m/s."""
    yaw_rate_scale_rad_s: float = Field(default=2.0, gt=0.0)
    """Error at which *yaw_rate* falls to 1/e."""
    swing_time_s: float = Field(default=0.3, gt=0.0)
    """Longest swing or stance that *air_time* rewards."""
    moving_above_m_s: float = Field(default=0.5, ge=0.0)
    """A robot that is commanded to stand counts as moving above this speed."""
    standing_command_below: float = Field(default=0.05, ge=0.0)
    """A command whose norm over V_x, V_y (m/s), ω_z (rad/s) is below this means: stand."""
    gait_scale_s2: float = Field(default=0.1, gt=0.0)
    """Scale of the squared time differences in *gait*."""
    gait_largest_error_s: float = Field(default=0.2, gt=0.0)
    """Larger time differences count as this in *gait*."""
    gait_stride_s: float = Field(default=0.0, ge=0.0)
    """*gait* scales its times to strides of this length; 0: seconds, as in the paper."""
    flight_allowed_m_s: tuple[float, float] = (1.0, 2.0)
    """Commanded speeds from which flight starts to count as part of a trot, and from which it counts fully."""
    clearance_height_m: float = Field(default=0.1, gt=0.0)
    """Desired height of a swinging foot."""
    clearance_scale_m2: float = Field(default=0.05, gt=0.0)
    """Scale of the squared height error in *foot_clearance*."""
    clearance_speed_factor_s_per_m: float = Field(default=2.0, gt=0.0)
    """Height errors are weighted by tanh(this × horizontal speed of the foot)."""
    variance_cap_s: float = Field(default=0.5, gt=0.0)
    """Longer phases count as this in *air_time_variance*."""
    duty_window_s: float = Field(default=1.0, ge=0.02)
    """Time constant of the mean behind uneven_duty."""
    foot_impact_relief_s_per_m: float = Field(default=0.0, ge=0.0)
    """Touch-down speeds are divided by 1 + this × commanded speed, because fast feet cannot land as softly."""
    foot_distance_m: float = Field(default=0.18, gt=0.0)
    """Horizontal distance below which two feet count as too close."""
    standing_position_factor: float = Field(default=5.0, ge=0.0)
    """Factor of *joint_position* when the robot is commanded to stand."""


def _rises(value: tuple[float, float]) -> tuple[float, float]:
    if value[0] > value[1]:
        raise ValueError(f"low {value[0]} exceeds high {value[1]}; allowed: [low, high] with low <= high")
    return value


Range = Annotated[tuple[float, float], AfterValidator(_rises)]
"""Bounds [low, high] of a uniform draw; equal bounds give a constant."""


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

    def sigmas(self) -> NDArray[np.float32]:
        """Noise of each observation feature, shape (48,), canonical joint order; command and last action have none."""
        values: list[float] = []
        for field in OBSERVATION:
            sigma = getattr(self, field.noise) if field.noise else 0.0
            values += sigma if isinstance(sigma, tuple) else (sigma,) * field.width
        return self.scale * np.array(values, dtype=np.float32)


class TerrainConfig(Settings):
    """The ground: level, ``noise``, which is low-poly rough ground, or ``tiles`` of slopes, rough ground and steps."""

    kind: Literal["flat", "noise", "tiles"] = "flat"
    """`flat`; `noise`: rough ground; `tiles`: level, rough, slopes, stairs and single blocks, side by side."""
    seed: int = 0
    """Random seed of the ground."""
    amplitude_m: float = Field(default=0.03, gt=0.0, le=0.3)
    """Largest height of rough ground, up and down; each rough tile has half of it to all of it."""
    cell_m: float = Field(default=0.25, gt=0.0)
    """Distance between the points of rough ground; in tiles the largest, and 0.1 m the smallest."""
    half_size_m: float = Field(default=20.0, gt=0.0)
    """Half the side of the square of ground."""
    tile_m: float = Field(default=8.0, ge=2.0)
    """Side of a tile."""
    tile_slope_deg: float = Field(default=10.0, gt=0.0, le=30.0)
    """Steepest slope of a tile; each has half of it to all of it."""
    tile_step_m: float = Field(default=0.05, gt=0.0, le=0.3)
    """Highest step of stairs and blocks; each has half of it to all of it."""
    tile_grid_m: float = Field(default=0.05, gt=0.0)
    """Grid spacing of the tiles: within it, a step rises. A finer one costs time."""

    def terrain(self) -> Terrain:
        """The plant's terrain."""
        if self.kind == "flat":
            return FlatTerrain()
        if self.kind == "noise":
            return NoiseTerrain(
                seed=self.seed, amplitude_m=self.amplitude_m, cell_m=self.cell_m, half_size_m=self.half_size_m
            )
        return TileTerrain(
            seed=self.seed,
            half_size_m=self.half_size_m,
            tile_m=self.tile_m,
            slope_deg=self.tile_slope_deg,
            step_m=self.tile_step_m,
            amplitude_m=self.amplitude_m,
            rough_cell_m=self.cell_m,
            cell_m=self.tile_grid_m,
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
