"""The walking task as a gymnasium environment: one simulated Spot that follows a velocity command."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import gymnasium
import numpy as np
import torch
from gymnasium import spaces
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.observation import N_OBSERVATION
from spot_model.robot import facts
from spot_rl.checks import AnyPath
from spot_rl.inputs import model_of
from spot_rl.learning import training_config
from trainer.config.train_config import TrainConfig
from trainer.task.draws import Draws, draw_simulations, training_effects
from trainer.task.plant_backend import PlantBackend
from trainer.task.task import Task

ID: Final = "spot_rl/Velocity-v0"
ACTION_BOUND: Final = 10.0
"""Actions are offsets from the default pose in units of 0.2 rad; policies stay well inside."""

COMMAND: Final = slice(9, 12)
"""Where the velocity command stands in an observation."""

Observation = NDArray[np.float32]


class _OneRobot(Task):
    """A task that leaves a robot whose episode has ended as it is, so that its last observation can be seen."""

    is_stepping = False

    def step(self, action: torch.Tensor) -> Any:
        self.is_stepping = True
        try:
            return super().step(action)
        finally:
            self.is_stepping = False

    def _reset(self, mask: torch.Tensor) -> None:
        if not self.is_stepping:
            super()._reset(mask)


class SpotEnv(gymnasium.Env[Observation, Observation]):
    """One Spot. Observation: the policy's 48 numbers. Action: 12 offsets from the default pose, in 0.2 rad.

    The reward is the sum of the config's terms; an episode terminates when the body touches the ground, and is
    truncated after 20 s. ``info`` has ``velocity_command`` and, at the end of an episode, ``fell``.

    ``reset(seed=..., options={"command": (v_x, v_y, yaw_rate)})`` holds one command, in m/s and rad/s, for the episode.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - gymnasium's own attribute

    def __init__(
        self,
        config: AnyPath | Mapping[str, Any] | None = None,
        *,
        model: str | AnyPath | RobotModel | None = None,
        changes: Mapping[str, Any] | None = None,
    ) -> None:
        self.observation_space = spaces.Box(-np.inf, np.inf, (N_OBSERVATION,), np.float32)
        self.action_space = spaces.Box(-ACTION_BOUND, ACTION_BOUND, (facts.N_JOINTS,), np.float32)
        chosen = {**(changes or {}), "n_envs": 1}
        self.config = training_config(config if config is not None else {"name": "env", "iterations": 1}, chosen)
        self.model = model_of(model if model is not None else self.config.model)[0]
        self._task: _OneRobot | None = None
        self._has_ended = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; the same seed gives the same episode for the same actions."""
        super().reset(seed=seed)
        held = _command(options)
        if self._task is None or seed is not None:
            drawn = int(self.np_random.integers(2**31)) if seed is None else seed
            self._task = _one_robot(self.config, self.model, drawn)
        self._has_ended = False
        result = self._task.start()
        if held is not None:
            self._task.commands.command[:] = held
            self._task.commands.time_left_s.fill_(torch.inf)
            result.observation[:, COMMAND] = held  # it was made before the command was held
        return _numpy(result.observation), self._info()

    def step(self, action: Observation) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Hold the action's set-points for 20 ms."""
        if self._task is None or self._has_ended:
            raise BadInputError("the episode has ended, or none has begun; call reset() first")
        given = np.asarray(action, dtype=np.float32)
        if given.shape != (facts.N_JOINTS,) or not np.isfinite(given).all():
            raise BadInputError(f"action has shape {given.shape}; allowed: 12 finite numbers, shape (12,)")
        command = self._task.commands.command.clone()
        result = self._task.step(torch.from_numpy(given[None]))
        timed_out = bool(result.timed_out[0])
        self._has_ended = bool(result.done[0])
        fell = self._has_ended and not timed_out
        info = self._info()
        if self._has_ended:  # the task has drawn the next episode's command already
            result.observation[:, COMMAND] = command
            info = {"velocity_command": command[0].numpy().astype(np.float64), "fell": fell}
        return _numpy(result.observation), float(result.reward[0]), fell, timed_out, info

    def _info(self) -> dict[str, Any]:
        assert self._task is not None  # noqa: S101 - callers have a task
        return {"velocity_command": self._task.commands.command[0].numpy().astype(np.float64)}


def make_env(
    config: AnyPath | Mapping[str, Any] | None = None,
    *,
    model: str | AnyPath | RobotModel | None = None,
    changes: Mapping[str, Any] | None = None,
) -> SpotEnv:
    """Make the walking task as a gymnasium environment with one robot, on the CPU.

    With gymnasium's wrappers: ``gymnasium.make("spot_rl.environment:spot_rl/Velocity-v0", ...)``, the same keywords.

    Args:
        config: A training config (YAML), or its keys as a mapping; the paper's task by default.
        model: The simulated robot, in place of the config's: a built-in name, a model file, or a model.
        changes: Keys of the config to change, such as ``{"rewards.gait": 10.0, "noise.scale": 0.0}``.

    Returns:
        The environment. Observation: shape (48,), action: shape (12,), both float32.

    Raises:
        SpotRlError: The config is not valid; the message lists the allowed keys.
    """
    return SpotEnv(config, model=model, changes=changes)


def _one_robot(config: TrainConfig, model: RobotModel, seed: int) -> _OneRobot:
    generator = torch.Generator(device="cpu")
    generator.manual_seed(seed)
    draws = Draws(generator)
    randomisation = config.task.randomisation
    effects = training_effects(model, randomisation, 1, draws)
    simulations = draw_simulations(randomisation, 1, draws)
    return _OneRobot(config.task, PlantBackend(config.task, effects, simulations, n_threads=1, seed=seed), generator)


def _command(options: Mapping[str, Any] | None) -> torch.Tensor | None:
    if not options:
        return None
    unknown = sorted(set(options) - {"command"})
    if unknown:
        raise BadInputError(f"options: {unknown[0]!r} is unknown; allowed: command")
    given: Sequence[float] = options.get("command", ())
    if len(given) != 3 or not np.isfinite(np.asarray(given, dtype=np.float64)).all():
        raise BadInputError(f"options: command = {given!r}; allowed: three numbers, V_x, V_y (m/s) and ω_z (rad/s)")
    return torch.tensor([list(map(float, given))])


def _numpy(observation: torch.Tensor) -> Observation:
    return np.array(observation[0].numpy(), dtype=np.float32)


gymnasium.register(id=ID, entry_point="spot_rl.environment:SpotEnv")
