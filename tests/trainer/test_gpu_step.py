"""A training step on a GPU's plant, which computes on the cores here, is one that CUDA can record."""

from __future__ import annotations

from importlib.util import find_spec
from typing import Any

import pytest
import torch
from torch.overrides import TorchFunctionMode

from spot_model.io.model_file import RobotModel, load_model
from trainer.config.task_config import RandomisationConfig, TaskConfig, TerrainConfig
from trainer.task.draws import Draws, draw_initial_state, draw_simulations
from trainer.task.feet import Ground
from trainer.task.plant_backend import PlantBackend
from trainer.task.task import Task

pytestmark = pytest.mark.skipif(find_spec("mujoco_warp") is None, reason="mujoco_warp is not installed (extra gpu)")

FROM_HOST = {torch.tensor, torch.as_tensor, torch.asarray, torch.from_numpy}
TO_HOST = {torch.Tensor.item, torch.Tensor.__bool__, torch.Tensor.__float__, torch.Tensor.numpy, torch.Tensor.tolist}


class NothingCrosses(TorchFunctionMode):
    """Refuses copies between host and device, which a recorded CUDA graph cannot hold."""

    def __torch_function__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        crosses = func in FROM_HOST and not isinstance(args[0], torch.Tensor)
        if crosses or func in TO_HOST:
            raise AssertionError(f"{func.__name__}({args[0]!r:.60}) moves values between host and device")
        return func(*args, **(kwargs or {}))


def a_task(model: RobotModel) -> Task:
    generator = torch.Generator()
    generator.manual_seed(0)
    config = TaskConfig()
    simulations = draw_simulations(RandomisationConfig(), 3, Draws(generator))
    return Task(config, PlantBackend(config, model.effects, simulations, "warp-cpu"), generator)


def test_no_value_crosses_between_host_and_device_in_a_step() -> None:
    task = a_task(load_model("paper_identified"))
    task.start()
    with torch.inference_mode():
        task.step(torch.zeros(3, 12))
        with NothingCrosses():
            for _ in range(3):
                result = task.step(torch.zeros(3, 12))
    assert torch.isfinite(result.observation).all()


def test_no_value_crosses_where_robots_start_on_tiles_and_look_up_the_ground() -> None:
    ground = Ground(TerrainConfig(kind="tiles", half_size_m=14.0), "cpu")
    draws = Draws(torch.Generator().manual_seed(0))
    # What is kept on the device is brought there by the first draw.
    draw_initial_state(RandomisationConfig(), ground, 3, draws)
    with NothingCrosses():
        start = draw_initial_state(RandomisationConfig(), ground, 3, draws)
        normal = ground.normal(start.body_position_m[:, :2])
    assert torch.isfinite(normal).all()


def test_a_crossing_is_seen() -> None:
    with pytest.raises(AssertionError, match="moves values"), NothingCrosses():
        torch.zeros(2).sum().item()
