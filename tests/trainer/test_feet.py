"""The feet in a training: their timers, their motion and the ground below them."""

import numpy as np
import torch

from spot_model.plant.plant import Plant
from trainer.config.task_config import RandomisationConfig, TaskConfig, TerrainConfig
from trainer.task.draws import Draws, draw_initial_state, draw_simulations
from trainer.task.feet import FootTimers, Ground, foot_motion
from trainer.task.plant_backend import PlantBackend

DT = 0.02


def contacts(*flags: bool) -> torch.Tensor:
    return torch.tensor([[*flags, True, True]]) if len(flags) == 2 else torch.tensor([list(flags)])


def test_times_count_up_and_phases_are_kept_when_they_end() -> None:
    feet = FootTimers(1, "cpu")
    air, ground = contacts(False, True), contacts(True, True)
    for _ in range(3):
        assert not feet.update(air, DT).any()
    # Three periods in the air, 0.06 s; the other feet have stood as long.
    torch.testing.assert_close(feet.air_time_s, torch.tensor([[0.06, 0.0, 0.0, 0.0]]))
    torch.testing.assert_close(feet.contact_time_s, torch.tensor([[0.0, 0.06, 0.06, 0.06]]))
    touched = feet.update(ground, DT)
    assert touched.tolist() == [[True, False, False, False]]
    # The phase that ended counts the period in which it ended: 0.08 s.
    torch.testing.assert_close(feet.last_air_time_s, torch.tensor([[0.08, 0.0, 0.0, 0.0]]))
    assert feet.air_time_s[0, 0] == 0.0
    feet.update(air, DT)
    torch.testing.assert_close(feet.last_contact_time_s[0, 0], torch.tensor(0.04))


def test_duty_is_a_mean_that_forgets() -> None:
    feet = FootTimers(1, "cpu", duty_window_s=0.1)
    feet.update(contacts(True, False), DT)
    # One period of 0.02 s out of 0.1 s.
    torch.testing.assert_close(feet.duty, torch.tensor([[0.2, 0.0, 0.2, 0.2]]))
    feet.update(contacts(False, False), DT)
    torch.testing.assert_close(feet.duty, torch.tensor([[0.16, 0.0, 0.36, 0.36]]))
    feet.reset(torch.tensor([True]))
    assert not feet.duty.any()


def test_a_foot_that_stood_for_half_a_period_counts_half() -> None:
    feet = FootTimers(1, "cpu", duty_window_s=0.1)
    feet.update(contacts(True, False), DT, torch.tensor([[0.5, 0.25, 1.0, 1.0]]))
    torch.testing.assert_close(feet.duty, torch.tensor([[0.1, 0.05, 0.2, 0.2]]))


def test_reset_touches_only_the_chosen_robots() -> None:
    feet = FootTimers(2, "cpu")
    feet.update(torch.zeros(2, 4, dtype=torch.bool), DT)
    feet.reset(torch.tensor([True, False]))
    assert feet.air_time_s[0].sum() == 0.0
    torch.testing.assert_close(feet.air_time_s[1], torch.full((4,), DT))


def test_support_is_who_stands_and_in_flight_who_stood_last() -> None:
    feet = FootTimers(1, "cpu")
    feet.update(torch.tensor([[True, False, False, True]]), DT)
    feet.update(torch.tensor([[False, False, False, False]]), DT)
    assert feet.support.tolist() == [[True, False, False, True]]
    feet.update(torch.tensor([[False, True, True, False]]), DT)
    assert feet.support.tolist() == [[False, True, True, False]]
    feet.reset(torch.tensor([True]))
    assert not feet.support.any()


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
