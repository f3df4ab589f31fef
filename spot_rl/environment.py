"""The walking task as a gymnasium environment: one simulated Spot that follows a velocity command."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.robot import facts
from spot_rl.camera import Camera
from spot_rl.checks import AnyPath, with_our_errors
from spot_rl.episodes import (
    ID,
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


class SpotEnv(gymnasium.Env[Numbers, Numbers]):
    """One Spot. Observation: the policy's 48 numbers. Action: 12 offsets of set-points from the default pose.

    An action of 1 is 3 rad, and larger ones are refused. With ``raw_actions=True`` it is 0.2 rad, the unit of policies,
    and actions are clipped to ±15. Observations are clipped to the bounds of ``observation_space``, which a robot on
    its feet does not reach. They are ±20 m/s and ±40 rad/s for the body, ±2 for gravity, ±10 for the command, and
    ±4 rad and ±100 rad/s for joints.
    The last action in them is in a policy's unit.

    The reward is the sum of the config's terms; an episode terminates when the body or a leg but its foot touches the
    ground, and is truncated after 20 s. ``info`` has ``velocity_command``. ``render()`` gives a picture of shape
    (320, 480, 3) with ``render_mode="rgb_array"``, and None without.

    ``reset(seed=..., options={"command": (v_x, v_y, yaw_rate)})`` holds one command, in m/s and rad/s, for the episode.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - gymnasium's own attribute
        "render_modes": list(RENDER_MODES),
        "render_fps": facts.POLICY_RATE_HZ,
    }

    def __init__(
        self,
        config: AnyPath | Mapping[str, Any] | None = None,
        *,
        model: str | AnyPath | RobotModel | None = None,
        changes: Mapping[str, Any] | None = None,
        raw_actions: bool = False,
        render_mode: str | None = None,
    ) -> None:
        self.render_mode = render_mode_of(render_mode)
        self.observation_space, self.action_space = env_spaces(raw_actions=raw_actions)  # type: ignore[assignment]
        self.config, self.model = env_config(config, model, changes, 1)
        self._task: Episodes | None = None
        self._camera: Camera | None = None
        self._has_ended = True

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Numbers, dict[str, Any]]:
        """Begin an episode; the same seed gives the same episode for the same actions."""
        held = command_of(options)
        if self._task is None or seed is not None:
            drawn = seed_of(seed, self.np_random)
            super().reset(seed=seed)
            self._task = made_episodes(self.config, self.model, drawn, held)[0]
        self._task.held, self._has_ended = held, False
        return clipped(self._task.start().observation)[0], self._info()

    def step(self, action: Numbers) -> tuple[Numbers, float, bool, bool, dict[str, Any]]:
        """Hold the action's set-points for 20 ms."""
        if self._task is None or self._has_ended:
            raise BadInputError("the episode has ended, or none has begun; call reset() first")
        given, info = given_actions(action, self.action_space), self._info()
        result = self._task.step(given[None])
        final = self._task.final
        self._has_ended = final is not None
        if final is None:
            return clipped(result.observation)[0], float(result.reward[0]), False, False, self._info()
        timed_out = bool(result.timed_out[0])
        return clipped(final)[0], float(result.reward[0]), not timed_out, timed_out, info

    def render(self) -> NDArray[np.uint8] | None:
        """A picture of the robot, shape (320, 480, 3); None without a render mode."""
        if self.render_mode is None:
            return None
        if self._task is None:
            raise BadInputError("no episode has begun; call reset() first")
        if self._camera is None:
            self._camera = Camera(self.config.task.terrain.terrain())
        return self._camera.picture(self._task.poses[0])

    def close(self) -> None:
        """Free what drawing took."""
        if self._camera is not None:
            self._camera.close()
            self._camera = None

    def _info(self) -> dict[str, Any]:
        assert self._task is not None  # noqa: S101 - callers have a task
        return {"velocity_command": self._task.commands.command[0].numpy().astype(np.float64)}


@with_our_errors
def make_env(
    config: AnyPath | Mapping[str, Any] | None = None,
    *,
    model: str | AnyPath | RobotModel | None = None,
    changes: Mapping[str, Any] | None = None,
    raw_actions: bool = False,
    render_mode: str | None = None,
) -> SpotEnv:
    """Make the walking task as a gymnasium environment with one robot, on the CPU.

    With gymnasium's wrappers: ``gymnasium.make("spot_rl.environment:spot_rl/Velocity-v0", ...)``, the same keywords.

    Args:
        config: A training config: a built-in name, a YAML file, or its keys as a mapping; the paper's task by default.
        model: The simulated robot, in place of the config's: a built-in name, a model file, or a model.
        changes: Keys of the config to change, such as ``{"rewards.gait": 10.0, "noise.scale": 0.0}``.
        raw_actions: Whether actions are in a policy's unit, as ``policy.act`` gives them and learners with a standard
            deviation of 1 like them; otherwise they are normalised to ±1.
        render_mode: ``"rgb_array"`` for ``render()``, which needs EGL or OSMesa.

    Returns:
        The environment. Observation: shape (48,), action: shape (12,), both float32 with finite bounds.

    Raises:
        SpotRlError: The config is not valid; the message lists the allowed keys.
    """
    given = {
        "config": config,
        "model": model,
        "changes": changes,
        "raw_actions": raw_actions,
        "render_mode": render_mode,
    }
    env = SpotEnv(**given)  # type: ignore[arg-type]
    env.spec = copy.deepcopy(gymnasium.spec(ID))
    env.spec.kwargs = {key: value for key, value in given.items() if value is not None}
    return env


gymnasium.register(
    id=ID, entry_point="spot_rl.environment:SpotEnv", vector_entry_point="spot_rl.vector_environment:SpotVectorEnv"
)
