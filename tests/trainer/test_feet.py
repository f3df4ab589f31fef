"""The feet in a training: their timers, their motion and the ground below them."""

import mujoco
import numpy as np
import torch

from spot_model.plant.plant import Plant
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf
from spot_model.robot.rotation import rotate_wxyz
from spot_model.robot.terrain import TileTerrain
from trainer.config.task_config import RandomisationConfig, TaskConfig, TerrainConfig
from trainer.task.draws import Draws, draw_initial_state, draw_simulations
from trainer.task.feet import FootTimers, Ground, motion_at_feet
from trainer.task.plant_backend import PlantBackend
from trainer.task.task import Task

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
    backend.reset(
        torch.ones(4, dtype=torch.bool),
        draw_initial_state(RandomisationConfig(), Ground(config.terrain, "cpu"), 4, draws),
    )
    plant: Plant = backend.plant
    feet = motion_at_feet(backend.read())
    everywhere = plant.batch.bind("site_xpos")
    plant.batch.forward()
    sites = everywhere[:, [plant.model.site(f"{leg}_foot").id for leg in ("fl", "fr", "hl", "hr")]]
    np.testing.assert_allclose(feet.position_in_world_m.numpy(), sites, atol=1e-6)
    before = feet.position_in_world_m.double()
    # A step of no torque, short against the motion: the feet move by their velocity.
    plant.batch.expand("opt.timestep")[:] = 1e-6
    plant.batch.step()
    after = motion_at_feet(backend.read()).position_in_world_m.double()
    np.testing.assert_allclose((after - before) / 1e-6, feet.velocity_in_world_m_s, atol=0.3)


def test_ground_height_is_even_between_grid_points_and_the_edge_counts_as_outside() -> None:
    config = TerrainConfig(kind="noise", half_size_m=5.0, cell_m=0.5, seed=3)
    ground = Ground(config, "cpu")
    points = torch.tensor([[0.0, 0.0], [2.0, -3.0], [2.5, -3.0], [2.25, -3.0]])
    heights = ground.height_m(points)
    assert isinstance(heights, torch.Tensor)
    assert float(heights[0]) == 0.0
    assert float(heights[1]) != float(heights[2]) != 0.0
    torch.testing.assert_close(heights[3], heights[1:3].mean())
    inside = ground.is_outside(torch.tensor([[0.0, 0.0, 0.5], [4.5, 0.0, 0.5]]))
    assert inside.tolist() == [False, True]
    flat = Ground(TerrainConfig(), "cpu")
    assert flat.height_m(points) == 0.0
    assert not flat.is_outside(torch.full((1, 3), 1e6)).any()


TILES = TerrainConfig(kind="tiles", half_size_m=12.0, tile_m=6.0, tile_slope_deg=12.0, seed=2)


def test_ground_of_tiles_lies_where_mujoco_has_it() -> None:
    model = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(terrain=TILES.terrain())))
    data = mujoco.MjData(model)
    data.qpos[0] = 100.0  # the robot is not in the way
    mujoco.mj_forward(model, data)
    down, geom_id = np.array([0.0, 0.0, -1.0]), np.zeros(1, np.int32)
    points = np.random.default_rng(0).uniform(-11.0, 11.0, (200, 2))
    starts = [np.array([x, y, 3.0]) for x, y in points]
    expected = [3.0 - mujoco.mj_ray(model, data, start, down, None, True, -1, geom_id) for start in starts]
    heights = Ground(TILES, "cpu").height_m(torch.tensor(points, dtype=torch.float32))
    assert np.ptp(expected) > 0.5
    np.testing.assert_allclose(heights, expected, atol=1e-5)


def test_the_way_into_the_ground_follows_a_slope() -> None:
    terrain = TILES.terrain()
    assert isinstance(terrain, TileTerrain)
    row, column = divmod(terrain.kinds().index("slope up"), 4)
    # Half way from the tile's left edge to its landing, the ground rises along x.
    point = torch.tensor([[-12.0 + 6.0 * column + 1.4, -12.0 + 6.0 * row + 3.0]])
    normal = Ground(TILES, "cpu").normal(point)[0]
    tilt = float(torch.rad2deg(torch.atan2(-normal[0], normal[2])))
    assert 6.0 <= tilt <= 12.0
    assert abs(float(normal[1])) < 1e-3
    torch.testing.assert_close(normal.norm(), torch.tensor(1.0))


def test_a_body_parallel_to_a_slope_is_not_tilted_and_a_level_one_on_flat_ground_has_gravity_itself() -> None:
    for config in (TaskConfig(), TaskConfig(terrain=TILES)):
        draws = Draws(torch.Generator().manual_seed(0))
        backend = PlantBackend(config, (), draw_simulations(config.randomisation, 4, draws), n_threads=1)
        task = Task(config, backend, draws.generator)
        task.start()
        state, seen = backend.read(), torch.tensor([[0.0, 0.0, -1.0]]).repeat(4, 1)
        into = task.into_ground(state, seen)
        if config.terrain.kind == "flat":
            assert into is seen
        else:
            normal = Ground(TILES, "cpu").normal(state.body_position_m[:, :2])
            torch.testing.assert_close(rotate_wxyz(state.world_from_body_wxyz, into), -normal)
