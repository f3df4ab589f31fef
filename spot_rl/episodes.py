"""What the environments share: the task with the ends of its episodes, the spaces, and what a reset may be told."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final, cast

import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.observation import OBSERVATION
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_rl.checks import AnyPath, flag, mapping, numbers, text, whole
from spot_rl.config import training_config
from spot_rl.inputs import model_of
from trainer.config.train_config import TrainConfig
from trainer.task.plant_backend import TaskState
from trainer.task.task import StepResult, Task, make_tasks

ID: Final = "spot_rl/Velocity-v0"
RENDER_MODES: Final = ("rgb_array",)
MOST_ROBOTS: Final = 65_536
ACTION_BOUND: Final = 15.0
"""Largest action in a policy's unit of 0.2 rad: set-points 3 rad around the default pose. The built-in policies stay
within 11.5; no joint can move farther than 2 rad from the default pose."""
COMMAND_BOUND: Final = 10.0
"""m/s and rad/s: the most that a velocity sequence may ask for."""
BOUNDS: Final = {
    "linear_vel_of_body_in_body_m_s": 20.0,
    "angular_vel_of_body_in_body_rad_s": 40.0,
    "projected_gravity_in_body": 2.0,
    "velocity_command": COMMAND_BOUND,
    "joint_position_offset_rad": 4.0,
    "joint_velocity_rad_s": 100.0,
    "last_action": ACTION_BOUND,
}
"""Observations are clipped to these, far outside of what a robot on its feet reports."""

Numbers = NDArray[np.float32]
OBSERVATION_BOUND: Final = np.concatenate([np.full(f.width, BOUNDS[f.name], np.float32) for f in OBSERVATION])
_BOUND: Final = torch.from_numpy(OBSERVATION_BOUND)


class Episodes(Task):
    """A task that keeps the last observations of episodes, and can hold one velocity command."""

    held: torch.Tensor | None = None
    """V_x, V_y (m/s) and ω_z (rad/s) that every robot is told, shape (3,)."""
    final: torch.Tensor | None = None
    """Observations before the robots that ended in the last step were reset, shape (n, 48); None if none ended."""
    _is_stepping = False

    @property
    def poses(self) -> Array:
        """Body position, attitude (wxyz) and joints of each robot, shape (n, 19): MuJoCo's ``qpos``."""
        plant = self.backend.plant
        return np.concatenate(
            [plant.position_of_body_in_world_m, plant.world_from_body_wxyz, plant.joint_position_rad], axis=1
        )

    def step(self, action: torch.Tensor) -> StepResult:
        """Step the task as usual, and keep the last observations of the episodes that ended."""
        self.final, self._is_stepping = None, True
        try:
            return super().step(action)
        finally:
            self._is_stepping = False

    def _reset(self, mask: torch.Tensor) -> None:
        if self._is_stepping and mask.any():
            none = torch.zeros_like(mask)
            self.final = self._observed(self.backend.read(), none.float(), none, none).observation
        super()._reset(mask)

    def _observed(self, state: TaskState, reward: torch.Tensor, *flags: torch.Tensor) -> StepResult:
        if self.held is not None:
            self.commands.command[:] = self.held
        return super()._observed(state, reward, *flags)


def env_spaces(*, raw_actions: bool) -> tuple[spaces.Box, spaces.Box]:
    """Spaces of one robot's observation and action."""
    bound = ACTION_BOUND if flag(raw_actions, "raw_actions") else 1.0
    return (
        spaces.Box(-OBSERVATION_BOUND, OBSERVATION_BOUND, dtype=np.float32),
        spaces.Box(-bound, bound, (facts.N_JOINTS,), np.float32),
    )


def env_config(
    config: AnyPath | Mapping[str, Any] | None,
    model: str | AnyPath | RobotModel | None,
    changes: Mapping[str, Any] | None,
    n: int,
) -> tuple[TrainConfig, RobotModel | None]:
    """The config of ``n`` robots, and the model that takes the place of the config's."""
    chosen = {**(mapping(changes, "changes", "a mapping of keys of the config") if changes is not None else {})}
    base = config if config is not None else {"name": "env", "iterations": 1}
    made = training_config(base, {**chosen, "n_envs": n})
    return made, None if model is None else model_of(model)[0]


def made_episodes(
    config: TrainConfig, model: RobotModel | None, seed: int, held: torch.Tensor | None
) -> list[Episodes]:
    """The robots of a config, in parts, before their first episode."""
    seeded = config.model_copy(update={"seed": seed})
    parts = cast("list[Episodes]", make_tasks(seeded, "cpu", kind=Episodes, model=model))
    for part in parts:
        part.held = held
    return parts


def seed_of(seed: int | None, rng: np.random.Generator) -> int:
    """The seed that was given, or one that is drawn.

    Raises:
        BadInputError: It is not allowed.
    """
    return int(rng.integers(2**31)) if seed is None else whole(seed, "seed", most=2**32 - 1)


def command_of(options: Mapping[str, Any] | None) -> torch.Tensor | None:
    """The command that a reset's options hold, shape (3,).

    Raises:
        BadInputError: They hold something else.
    """
    if options is None:
        return None
    unknown = sorted(set(mapping(options, "options", 'a mapping such as {"command": (1.0, 0.0, 0.0)}')) - {"command"})
    if unknown:
        raise BadInputError(f"options: {unknown[0]!r} is unknown; allowed: command")
    if "command" not in options:
        return None
    allowed = f"three numbers within ±{COMMAND_BOUND:g}, V_x and V_y in m/s and ω_z in rad/s"
    return torch.tensor(numbers(options["command"], "options: command", allowed, COMMAND_BOUND))


def render_mode_of(mode: str | None) -> str | None:
    """The mode that was given.

    Raises:
        BadInputError: It is unknown.
    """
    if mode is not None and text(mode, "render_mode", "None or 'rgb_array'") not in RENDER_MODES:
        raise BadInputError(f"render_mode = {mode!r}; allowed: None or 'rgb_array'")
    return mode


def given_actions(actions: Any, space: spaces.Space[Any]) -> torch.Tensor:
    """Actions in a policy's unit.

    Raises:
        BadInputError: They have another shape, are not finite, or exceed ±1 where the space is ±1.
    """
    try:
        given = np.asarray(actions, dtype=np.float32)
    except (TypeError, ValueError):
        given = np.empty(0, np.float32)
    if given.shape != space.shape or not np.isfinite(given).all():
        raise BadInputError(f"action of shape {np.shape(given)}; allowed: finite numbers of shape {space.shape}")
    if action_unit(space) == 1.0:
        return torch.from_numpy(np.clip(given, -ACTION_BOUND, ACTION_BOUND))
    largest = float(np.abs(given).max())
    if largest > 1.0:
        raise BadInputError(
            f"action: {largest:g} is the largest magnitude; allowed: -1 to 1. A learner's actions can be clipped "
            "(gymnasium.wrappers.ClipAction); a policy's own need make_env(raw_actions=True)"
        )
    return torch.from_numpy(given * np.float32(ACTION_BOUND))


def action_unit(space: spaces.Space[Any]) -> float:
    """What an action of 1 is in a policy's unit."""
    assert isinstance(space, spaces.Box)  # noqa: S101 - both environments have a Box
    return ACTION_BOUND / float(space.high.flat[0])


def clipped(observations: torch.Tensor) -> Numbers:
    """Observations within their bounds, a copy."""
    return cast("Numbers", torch.clamp(observations, -_BOUND, _BOUND).numpy())
