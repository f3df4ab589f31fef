"""Many simulated Spots as one gymnasium vector environment, on the batched plant that training uses."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
import torch
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.robot import facts
from spot_rl.camera import Camera
from spot_rl.checks import AnyPath, whole, with_our_errors
from spot_rl.episodes import (
    MOST_ROBOTS,
    OBSERVATION_BOUND,
    RENDER_MODES,
    Episodes,
    Numbers,
    clipped,
    command_of,
    env_config,
    env_spaces,
    given_actions,
    made_episodes,
    render_mode_of,
    seed_of,
)
from trainer.ppo.vec_env import TaskVecEnv


class SpotVectorEnv(gymnasium.vector.VectorEnv[Numbers, Numbers, NDArray[Any]]):
    """``num_envs`` Spots, each as in :class:`SpotEnv`; observations have shape (n, 48), actions (n, 12).

    A robot whose episode ends is reset within the same step (``AutoresetMode.SAME_STEP``). The observation is the first
    of the next episode, and ``info["final_obs"]`` holds the last one where ``info["_final_obs"]`` is true.
    ``info["velocity_command"]`` has shape (n, 3). A command in ``reset``'s options is held until the next ``reset``.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - gymnasium's own attribute
        "autoreset_mode": AutoresetMode.SAME_STEP,
        "render_modes": list(RENDER_MODES),
        "render_fps": facts.POLICY_RATE_HZ,
    }

    def __init__(
        self,
        num_envs: int,
        config: AnyPath | Mapping[str, Any] | None = None,
        *,
        model: str | AnyPath | RobotModel | None = None,
        changes: Mapping[str, Any] | None = None,
        raw_actions: bool = False,
        render_mode: str | None = None,
    ) -> None:
        self.num_envs = whole(num_envs, "num_envs", 1, MOST_ROBOTS)
        self.render_mode = render_mode_of(render_mode)
        self.single_observation_space, self.single_action_space = env_spaces(raw_actions=raw_actions)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self.config, self.model = env_config(config, model, changes, self.num_envs)
        self._parts: list[Episodes] = []
        self._robots: TaskVecEnv | None = None
        self._camera: Camera | None = None

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Numbers, dict[str, Any]]:
        """Begin an episode with every robot; the same seed gives the same episodes for the same actions."""
        held, drawn = command_of(options), seed_of(seed, self.np_random)
        super().reset(seed=seed)
        self._parts = made_episodes(self.config, self.model, drawn, held)
        self._robots = TaskVecEnv(self._parts, self.config.ppo.steps_per_iteration)
        return clipped(self._robots.get_observations()["policy"]), self._info()

    def step(
        self, actions: Numbers
    ) -> tuple[Numbers, NDArray[Any], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Hold each action's set-points for 20 ms."""
        if self._robots is None:
            raise BadInputError("no episode has begun; call reset() first")
        given = given_actions(actions, self.action_space)
        observations, reward, done, extras = self._robots.step(given)
        truncated, ended, info = extras["time_outs"].numpy(), done.numpy(), self._info()
        if ended.any():
            info["final_obs"], info["_final_obs"] = self._final(ended), ended.copy()
        return clipped(observations["policy"]), reward.numpy(), ended & ~truncated, truncated, info

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """A picture of each robot, shape (320, 480, 3); None without a render mode."""
        if self.render_mode is None:
            return None
        if self._robots is None:
            raise BadInputError("no episode has begun; call reset() first")
        if self._camera is None:
            self._camera = Camera(self.config.task.terrain.terrain())
        return tuple(self._camera.picture(qpos) for part in self._parts for qpos in part.poses)

    def close_extras(self, **_: Any) -> None:
        """Free what drawing took."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def _info(self) -> dict[str, Any]:
        return {"velocity_command": torch.cat([part.commands.command for part in self._parts]).numpy()}

    def _final(self, ended: NDArray[np.bool_]) -> NDArray[Any]:
        """The last observations of the episodes that ended, None elsewhere: gymnasium's own form, shape (n,)."""
        parts = [torch.zeros(p.n_envs, len(OBSERVATION_BOUND)) if p.final is None else p.final for p in self._parts]
        last = clipped(torch.cat(parts))
        final = np.full(self.num_envs, None, dtype=object)
        for robot in np.flatnonzero(ended):
            final[robot] = last[robot]
        return final


@with_our_errors
def make_vec_env(
    num_envs: int,
    config: AnyPath | Mapping[str, Any] | None = None,
    *,
    model: str | AnyPath | RobotModel | None = None,
    changes: Mapping[str, Any] | None = None,
    raw_actions: bool = False,
    render_mode: str | None = None,
) -> SpotVectorEnv:
    """Make the walking task as a gymnasium vector environment with many robots, on all CPU cores.

    The same as ``gymnasium.make_vec("spot_rl.environment:spot_rl/Velocity-v0", num_envs=N)``. More robots at a time
    make more steps a second: from about 500 on, two cores are full.

    Args:
        num_envs: Number of robots, 1 to 65,536.
        config: A training config: a built-in name, a YAML file, or its keys as a mapping; the paper's task by default.
        model: The simulated robot, in place of the config's: a built-in name, a model file, or a model.
        changes: Keys of the config to change, such as ``{"rewards.gait": 10.0, "noise.scale": 0.0}``.
        raw_actions: Whether actions are in a policy's unit, as ``policy.act`` gives them and learners with a standard
            deviation of 1 like them; otherwise they are normalised to ±1.
        render_mode: ``"rgb_array"`` for ``render()``, which needs EGL or OSMesa.

    Returns:
        The environment. Robots whose episodes end are reset within the same step.

    Raises:
        SpotRlError: The config is not valid; the message lists the allowed keys.
    """
    return SpotVectorEnv(
        num_envs, config, model=model, changes=changes, raw_actions=raw_actions, render_mode=render_mode
    )
