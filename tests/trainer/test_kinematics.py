import numpy as np
import torch

from spot_model.plant.plant import Plant
from trainer.config.task_config import RandomisationConfig, TaskConfig, TerrainConfig
from trainer.task.draws import Draws, draw_initial_state, draw_simulations
from trainer.task.feet import Ground, foot_motion
from trainer.task.plant_backend import PlantBackend


def test_feet_are_where_mujoco_has_them() -> None:
    draws = Draws(torch.Generator().manual_seed(0))
    config = TaskConfig()
    backend = PlantBackend(config, (), draw_simulations(config.randomisation, 4, draws), n_threads=1)
    backend.reset(torch.ones(4, dtype=torch.bool), draw_initial_state(RandomisationConfig(), config.terrain, 4, draws))
    plant: Plant = backend.plant
    feet = foot_motion(backend.read())
    everywhere = plant.batch.bind("site_xpos")
    plant.batch.forward()
    sites = everywhere[:, [plant.model.site(f"{leg}_foot").id for leg in ("fl", "fr", "hl", "hr")]]
    np.testing.assert_allclose(feet.position_in_world_m.numpy(), sites, atol=1e-6)
    before = feet.position_in_world_m.double()
    # A step of no torque, short against the motion: the feet move by their velocity.
    plant.batch.expand("opt.timestep")[:] = 1e-6
    plant.batch.step()
    after = foot_motion(backend.read()).position_in_world_m.double()
    np.testing.assert_allclose((after - before) / 1e-6, feet.velocity_in_world_m_s, atol=0.3)


def test_ground_height_is_that_of_the_grid_point_and_the_edge_counts_as_outside() -> None:
    config = TerrainConfig(kind="noise", half_size_m=5.0, cell_m=0.5, seed=3)
    ground = Ground(config, "cpu")
    points = torch.tensor([[0.0, 0.0], [2.0, -3.0], [2.1, -2.9]])
    heights = ground.height_m(points)
    assert float(heights[0]) == 0.0
    assert float(heights[1]) == float(heights[2]) != 0.0
    inside = ground.is_outside(torch.tensor([[0.0, 0.0, 0.5], [4.5, 0.0, 0.5]]))
    assert inside.tolist() == [False, True]
    flat = Ground(TerrainConfig(), "cpu")
    assert flat.height_m(points) == 0.0
    assert not flat.is_outside(torch.full((1, 3), 1e6)).any()
