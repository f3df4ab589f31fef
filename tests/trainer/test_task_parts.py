import dataclasses

import pytest
import torch

from trainer.config.train_config import TrainConfig
from trainer.task import task as make_task
from trainer.task.task import StepResult
from trainer.task.task_parts import TaskParts


@pytest.fixture
def config(tiny: TrainConfig, monkeypatch: pytest.MonkeyPatch) -> TrainConfig:
    """Seven robots in parts of three, two and two."""
    monkeypatch.setattr(make_task, "PART_SIZE", 3)
    return tiny.model_copy(update={"n_envs": 7})


def actions(n: int, steps: int) -> torch.Tensor:
    return 0.5 * torch.randn(steps, n, 12, generator=torch.Generator().manual_seed(3))


def assert_same(one: StepResult, other: StepResult) -> None:
    for field in dataclasses.fields(StepResult):
        assert torch.equal(getattr(one, field.name), getattr(other, field.name)), field.name


def test_parts_side_by_side_are_the_parts_one_by_one(config: TrainConfig) -> None:
    together = TaskParts(make_task.make_tasks(config, "cpu"))
    alone = make_task.make_tasks(config, "cpu")
    assert together.sizes == [2, 3, 2]
    together.start()
    for part in alone:
        part.start()
    for action in actions(7, 30):
        with torch.inference_mode():
            result = together.step(action)
        each = [part.step(piece) for part, piece in zip(alone, torch.split(action, together.sizes), strict=True)]
        assert torch.equal(result.observation, torch.cat([r.observation for r in each]))
        assert torch.equal(result.reward, torch.cat([r.reward for r in each]))
    assert result.done.shape == (7,)
    # Every part draws for itself.
    assert not torch.equal(each[0].observation, each[2].observation)


def test_parts_continue_exactly_from_a_snapshot(config: TrainConfig) -> None:
    first, second = (TaskParts(make_task.make_tasks(config, "cpu")) for _ in range(2))
    first.start()
    second.start()
    for action in actions(7, 5):
        first.step(action)
    second.restore(first.snapshot())
    assert torch.equal(first.episode_steps, second.episode_steps)
    for action in actions(7, 5):
        assert_same(first.step(action), second.step(action))


def test_statistics_are_means_over_all_parts_episodes(config: TrainConfig) -> None:
    robots = TaskParts(make_task.make_tasks(config, "cpu"))
    robots.start()
    assert robots.drain_stats() == {}
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
