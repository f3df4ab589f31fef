"""The gymnasium environments: what gymnasium asks of them, their seeds, and what other libraries learn with them."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from tensordict import TensorDict

import spot_rl
from spot_model.errors import BadInputError
from spot_rl.camera import Camera
from spot_rl.episodes import ACTION_BOUND, OBSERVATION_BOUND

from .conftest import REPOSITORY

ID = "spot_rl.environment:spot_rl/Velocity-v0"
FORWARD = {"command": (1.0, 0.0, 0.0)}


def _can_draw() -> bool:
    env = spot_rl.make_env(render_mode="rgb_array")
    try:
        Camera(env.config.task.terrain.terrain()).close()
    except BadInputError:
        return False
    return True


@pytest.mark.parametrize("raw", [False, True])
def test_gymnasiums_checker_has_nothing_to_say(raw: bool) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        if raw:  # what the checker advises against is what policies need
            warnings.filterwarnings("ignore", message=r".*symmetric and normalized space")
        check_env(spot_rl.make_env(raw_actions=raw), skip_render_check=not _can_draw())
        check_env(gymnasium.make(ID, raw_actions=raw).unwrapped, skip_render_check=True)


def test_a_picture_shows_the_robot() -> None:
    if not _can_draw():
        pytest.skip("no OpenGL without a display here")
    env = spot_rl.make_env(render_mode="rgb_array")
    env.reset(seed=0)
    picture = env.render()
    assert picture.shape == (320, 480, 3)
    assert ((picture[..., 0] > 180) & (picture[..., 2] < 60)).sum() > 500, "nothing yellow"
    env.close()
    several = spot_rl.make_vec_env(2, render_mode="rgb_array")
    several.reset(seed=0)
    first, second = several.render()
    assert first.shape == picture.shape
    assert not np.array_equal(first, second)
    several.close()


def test_without_opengl_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails() -> Any:
        raise RuntimeError("no display")

    monkeypatch.setattr("trainer.play.film.gl_context", fails)
    env = spot_rl.make_env(render_mode="rgb_array")
    env.reset(seed=0)
    with pytest.raises(spot_rl.SpotRlError, match=r"MuJoCo cannot draw .*no display.*libegl1 or libosmesa6"):
        env.render()


def test_spaces_are_finite_and_hold_what_comes() -> None:
    env = spot_rl.make_vec_env(16)
    observation, _ = env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(40):
        assert observation in env.observation_space
        observation, *_ = env.step(rng.uniform(-1.0, 1.0, (16, 12)).astype(np.float32))
    assert np.isfinite(env.single_observation_space.high).all()
    assert (env.single_action_space.low == -1.0).all()


def test_an_action_of_one_is_three_radians_or_a_policys_unit() -> None:
    quiet = {"noise.scale": 0.0}
    plain, raw = spot_rl.make_env(changes=quiet), spot_rl.make_env(changes=quiet, raw_actions=True)
    for env in (plain, raw):
        env.reset(seed=4, options=FORWARD)
    action = np.linspace(-0.9, 0.9, 12, dtype=np.float32)
    ours, theirs = plain.step(action / ACTION_BOUND)[0], raw.step(action)[0]
    np.testing.assert_allclose(ours, theirs, atol=1e-5)
    np.testing.assert_allclose(theirs[36:], action, atol=1e-6)
    with pytest.raises(
        spot_rl.SpotRlError, match=r"action: 1.5 is the largest magnitude; allowed: -1 to 1.*raw_actions"
    ):
        plain.step(np.full(12, 1.5, np.float32))
    assert (raw.step(np.full(12, 99.0, np.float32))[0][36:] == ACTION_BOUND).all()


def test_the_last_observation_of_an_episode_is_of_the_robot_that_fell() -> None:
    env = spot_rl.make_env(changes={"noise.scale": 0.0}, raw_actions=True)
    env.reset(seed=5, options=FORWARD)
    fell = False
    for _ in range(500):
        observation, _, fell, timed_out, info = env.step(np.full(12, 10.0, np.float32))
        assert (info["velocity_command"] == FORWARD["command"]).all()
        if fell or timed_out:
            break
    assert fell
    assert (observation[36:] == 10.0).all()
    env.reset()


def test_many_robots_are_seeded_and_begin_again_within_a_step() -> None:
    env = gymnasium.make_vec(ID, num_envs=8, vectorization_mode="vector_entry_point", raw_actions=True)
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    action = np.full((8, 12), 10.0, np.float32)

    def episode(seed: int) -> list[np.ndarray]:
        env.reset(seed=seed, options=FORWARD)
        return [env.step(action)[0] for _ in range(3)]

    np.testing.assert_array_equal(episode(1), episode(1))
    assert not np.array_equal(episode(1), episode(2))
    for _ in range(500):
        observation, reward, fell, timed_out, info = env.step(action)
        assert reward.shape == fell.shape == timed_out.shape == (8,)
        assert (info["velocity_command"] == FORWARD["command"]).all()
        if fell.any():
            break
    robot = int(np.flatnonzero(fell)[0])
    assert info["_final_obs"][robot]
    assert (info["final_obs"][robot][36:] == 10.0).all()
    assert (observation[robot, 36:] == 0.0).all(), "the next episode has begun"
    assert (observation[:, 9:12] == FORWARD["command"]).all()
    assert all(info["final_obs"][i] is None for i in np.flatnonzero(~info["_final_obs"]))


def test_a_robot_alone_and_among_others_does_the_same() -> None:
    changes = {"noise.scale": 0.0}
    alone, among = spot_rl.make_env(changes=changes), spot_rl.make_vec_env(1, changes=changes)
    still = np.zeros(12, np.float32)
    first, _ = alone.reset(seed=3)
    several, _ = among.reset(seed=3)
    np.testing.assert_array_equal(first, several[0])
    for _ in range(5):
        np.testing.assert_array_equal(alone.step(still)[0], among.step(still[None])[0][0])


def test_a_network_of_another_library_becomes_a_policy(tmp_path: Path) -> None:
    torch.manual_seed(0)
    parts = [torch.nn.Linear(48, 8), torch.nn.ELU(), torch.nn.Linear(8, 12)]
    env = spot_rl.make_env(changes={"commands.v_x_m_s": [-1.0, 0.2]})
    policy = spot_rl.load_policy(
        spot_rl.export(torch.nn.Sequential(*parts), tmp_path / "mine.onnx", name="mine", env=env)
    )
    seen = np.random.default_rng(0).normal(size=48).astype(np.float32)
    with torch.no_grad():
        wanted = torch.nn.Sequential(*parts)(torch.from_numpy(seen)).numpy()
    np.testing.assert_allclose(policy.act(seen), ACTION_BOUND * wanted, atol=1e-4)
    assert (policy.contract.name, policy.contract.velocity_command_high[0]) == ("mine", 0.2)
    for network, told in (
        (torch.nn.Sequential(parts[0], torch.nn.Tanh(), parts[2]), r"Tanh.*allowed: torch.nn.Linear layers"),
        (torch.nn.Linear(47, 12), r"48 numbers in and 12 out"),
    ):
        with pytest.raises(spot_rl.SpotRlError, match=told):
            spot_rl.export(network, tmp_path / "other.onnx", env=env)
    with pytest.raises(spot_rl.SpotRlError, match=r"env = None; allowed: the environment"):
        spot_rl.export(torch.nn.Sequential(*parts), tmp_path / "other.onnx")
    assert not (tmp_path / "other.onnx").exists()


def test_the_normaliser_of_an_rsl_rl_actor_goes_into_the_file(tmp_path: Path) -> None:
    models = pytest.importorskip("rsl_rl.models")
    torch.manual_seed(0)
    seen = TensorDict({"policy": 3.0 * torch.randn(64, 48) + torch.linspace(-2.0, 2.0, 48)}, batch_size=[64])
    actor = models.MLPModel(seen, {"actor": ["policy"]}, "actor", 12, [8], "elu", obs_normalization=True)
    actor.obs_normalizer.update(seen["policy"])
    policy = spot_rl.load_policy(spot_rl.export(actor, tmp_path / "mine.onnx", name="mine", env=spot_rl.make_env()))
    with torch.no_grad():
        wanted = actor(seen)[0].numpy()
    np.testing.assert_allclose(policy.act(seen["policy"][0].numpy()), ACTION_BOUND * wanted, atol=1e-4)


def test_observation_bounds_have_a_number_for_each_column() -> None:
    assert OBSERVATION_BOUND.shape == (48,)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "module"), [("rsl_rl", "rsl_rl"), ("sb3", "stable_baselines3"), ("skrl", "skrl")])
def test_other_libraries_learn_with_it(name: str, module: str, tmp_path: Path) -> None:
    if importlib.util.find_spec(module) is None:
        pytest.skip(f"{module} is not installed")
    example = REPOSITORY / "examples" / f"learn_{name}.py"
    text = example.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 40
    assert "make_vec_env(256," in text
    small = text.replace("make_vec_env(256,", "make_vec_env(8,").replace("batch_size=1536", "batch_size=48")
    told = subprocess.run(
        [sys.executable, "-c", small, "mine.onnx"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert told.returncode == 0, told.stderr
    assert "policy: mine.onnx" in told.stdout
    assert spot_rl.load_policy(tmp_path / "mine.onnx").act(np.zeros(48)).shape == (12,)
