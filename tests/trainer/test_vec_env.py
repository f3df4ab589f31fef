import pytest
import torch

from spot_model.plant.physics import PlantDivergedError
from trainer.config.train_config import TrainConfig
from trainer.ppo.vec_env import TaskVecEnv
from trainer.task import task


@pytest.fixture
def config(tiny: TrainConfig, monkeypatch: pytest.MonkeyPatch) -> TrainConfig:
    """Seven robots in parts of three, two and two."""
    monkeypatch.setattr(task, "PART_SIZE", 3)
    return tiny.model_copy(update={"n_envs": 7})


def actions(n: int, steps: int) -> torch.Tensor:
    return 0.5 * torch.randn(steps, n, 12, generator=torch.Generator().manual_seed(3))


def test_parts_side_by_side_are_the_parts_one_by_one(config: TrainConfig) -> None:
    together = TaskVecEnv(task.make_tasks(config, "cpu"), 6)
    alone = task.make_tasks(config, "cpu")
    assert together.sizes == [2, 3, 2]
    for part in alone:
        part.start()
    for action in actions(7, 30):
        with torch.inference_mode():
            observed, reward, done, _ = together.step(action)
        each = [part.step(piece) for part, piece in zip(alone, torch.split(action, together.sizes), strict=True)]
        assert torch.equal(observed["policy"], torch.cat([r.observation for r in each]))
        assert torch.equal(reward, torch.cat([r.reward for r in each]))
    assert done.shape == (7,)
    # Every part draws for itself.
    assert not torch.equal(each[0].observation, each[2].observation)


def test_parts_continue_exactly_from_a_snapshot(config: TrainConfig) -> None:
    first, second = (TaskVecEnv(task.make_tasks(config, "cpu"), 6) for _ in range(2))
    for action in actions(7, 5):
        first.step(action)
    second.restore(first.snapshot())
    assert torch.equal(first.episode_length_buf, second.episode_length_buf)
    for action in actions(7, 5):
        one, other = first.step(action), second.step(action)
        assert torch.equal(one[0]["policy"], other[0]["policy"])
        assert torch.equal(one[0]["critic"], other[0]["critic"])
        for mine, theirs in zip((*one[1:3], one[3]["time_outs"]), (*other[1:3], other[3]["time_outs"]), strict=True):
            assert torch.equal(mine, theirs)


def test_statistics_are_means_over_all_parts_episodes(config: TrainConfig) -> None:
    robots = TaskVecEnv(task.make_tasks(config, "cpu"), 6)
    assert robots.drain_stats() == {"command_share": 1.0}
    # One episode ends in the first part after 3 steps, and one in the last after 5.
    for i, length in ((0, 3), (2, 5)):
        stats = robots.parts[i].stats
        stats.length += length - 1
        ended = torch.tensor([True, False])
        stats.add(torch.ones(2, len(stats.terms)), ended, ended)
    drained = robots.drain_stats()
    assert drained["episodes"] == 2
    assert drained["episode_length"] == 4.0
    assert drained["fall_share"] == 1.0


def test_lost_contacts_are_told_each_iteration_and_refused_beyond_a_share(
    config: TrainConfig, monkeypatch: pytest.MonkeyPatch
) -> None:
    robots = TaskVecEnv(task.make_tasks(config, "cpu"), 6)
    physics = robots.parts[1].backend.plant.physics
    monkeypatch.setattr(physics, "contacts_lost", lambda: 0.005)
    assert robots.drain_stats() == {"command_share": 1.0, "contacts_lost": 0.005}
    monkeypatch.setattr(physics, "contacts_lost", lambda: 0.02)
    with pytest.raises(PlantDivergedError, match=r"2\.0% of the contacts"):
        robots.drain_stats()
