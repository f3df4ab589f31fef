import mujoco
import numpy as np
import pytest
import torch

from spot_model.effects.base import Motion
from spot_model.io.model_file import load_model
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf
from trainer.config.task_config import RandomisationConfig, RewardWeights, TaskConfig, TerrainConfig
from trainer.task.draws import Draws, draw_initial_state
from trainer.task.feet import Ground
from trainer.task.plant_backend import InitialState, PlantBackend, SimulationDraws

N = 3
PERIODS = 12


def draws(seed: int = 0) -> Draws:
    generator = torch.Generator()
    generator.manual_seed(seed)
    return Draws(generator)


def a_start() -> InitialState:
    return draw_initial_state(RandomisationConfig(), Ground(TerrainConfig(), "cpu"), N, draws())


def a_backend(config: TaskConfig | None = None) -> PlantBackend:
    simulations = SimulationDraws(torch.linspace(0.4, 0.9, N), torch.linspace(-2.0, 2.0, N))
    return PlantBackend(config or TaskConfig(), load_model("paper_identified").effects, simulations, n_threads=1)


def setpoints() -> torch.Tensor:
    pose = torch.tensor(facts.DEFAULT_POSITION_RAD, dtype=torch.float32)
    return pose + 0.2 * draws(1).normal(PERIODS, N, facts.N_JOINTS)


def by_hand(start: InitialState, targets: torch.Tensor, robot: int) -> np.ndarray:
    """One robot in a plain mj_step loop: PD law, hip limit, knee friction, one physics step of delay."""
    model = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions()))
    friction, added = np.linspace(0.4, 0.9, N)[robot], np.linspace(-2.0, 2.0, N)[robot]
    for leg in facts.LEG_NAMES:
        model.geom(f"{leg}_foot").friction[0] = np.float32(friction)
    body = model.body("body")
    ratio = 1.0 + np.float32(added) / body.mass[0]
    body.mass[:] *= ratio
    body.inertia[:] *= ratio
    model.dof_frictionloss[6:] = np.tile([0.008, 0.008, 0.18], 4)
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    mujoco.mj_resetData(model, data)
    attitude = start.world_from_body_wxyz[robot].double()
    data.qpos[:] = torch.cat(
        [start.body_position_m[robot].double(), attitude / attitude.norm(), start.position_rad[robot].double()]
    )
    data.qvel[:] = torch.cat(
        [
            start.linear_vel_of_body_in_world_m_s[robot],
            start.angular_vel_of_body_in_body_rad_s[robot],
            start.velocity_rad_s[robot],
        ]
    )
    mujoco.mj_forward(model, data)
    effects = [
        e.arrays_like(np.zeros((1, 12))) for e in load_model("paper_identified").effects if e.hook.value == "torque"
    ]
    held = start.position_rad[robot].numpy().astype(np.float64)
    for target in targets[:, robot].numpy().astype(np.float64):
        for substep in range(4):
            goal = held if substep == 0 else target  # 5 ms after it was issued
            torque = (60.0 * (goal - data.qpos[7:]) - 1.5 * data.qvel[6:])[None]
            for effect in effects:
                motion = Motion(data.qpos[None, 7:], data.qvel[None, 6:], 0.005)
                torque, _ = effect.apply(torque, motion, effect.start(torque), effect.mask)
            data.ctrl[:] = torque[0]
            mujoco.mj_step(model, data)
        held = target
    return np.concatenate([data.qpos, data.qvel])


def test_it_agrees_with_a_single_mj_step_loop_from_the_same_states() -> None:
    backend, start, targets = a_backend(), a_start(), setpoints()
    backend.reset(torch.ones(N, dtype=torch.bool), start)
    for target in targets:
        backend.step(target)
    state = backend.plant.batch.state
    qpos, qvel = backend.plant.batch.bind("qpos"), backend.plant.batch.bind("qvel")
    assert state.shape[0] == N
    for robot in range(N):
        expected = by_hand(start, targets, robot)
        np.testing.assert_allclose(np.concatenate([qpos[robot], qvel[robot]]), expected, rtol=0, atol=1e-9)


def test_duty_is_counted_at_every_physics_step_without_changing_the_motion() -> None:
    counting, plain = a_backend(TaskConfig(rewards=RewardWeights(uneven_duty=-1.0))), a_backend()
    everyone, start = torch.ones(N, dtype=torch.bool), a_start()
    shares = set()
    for backend in (counting, plain):
        backend.reset(everyone, start)
    for target in setpoints():
        for backend in (counting, plain):
            backend.step(target)
        mine, other = counting.read(), plain.read()
        assert torch.equal(mine.position_rad, other.position_rad)
        assert torch.equal(other.foot_duty, other.foot_contact.float())
        shares |= set(mine.foot_duty.flatten().tolist())
    # Feet land and lift within periods of four steps.
    assert shares <= {0.0, 0.25, 0.5, 0.75, 1.0}
    assert shares & {0.25, 0.5, 0.75}


def test_reset_moves_only_the_chosen_robots() -> None:
    backend, start = a_backend(), a_start()
    everyone = torch.ones(N, dtype=torch.bool)
    backend.reset(everyone, start)
    backend.step(setpoints()[0])
    before = backend.read()
    backend.reset(torch.tensor([False, True, False]), start)
    after = backend.read()
    torch.testing.assert_close(after.position_rad[[0, 2]], before.position_rad[[0, 2]], rtol=0, atol=0)
    torch.testing.assert_close(after.position_rad[1], start.position_rad[1])
    torch.testing.assert_close(after.body_position_m[1], start.body_position_m[1])


def test_a_push_changes_only_the_linear_velocity() -> None:
    backend = a_backend()
    backend.reset(torch.ones(N, dtype=torch.bool), a_start())
    before = backend.read()
    delta = torch.tensor([[0.5, -0.25, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    backend.add_velocity(delta)
    after = backend.read()
    change = after.linear_vel_of_body_in_world_m_s - before.linear_vel_of_body_in_world_m_s
    torch.testing.assert_close(change, delta)
    torch.testing.assert_close(after.velocity_rad_s, before.velocity_rad_s)


def test_a_snapshot_continues_bit_for_bit() -> None:
    backend, targets = a_backend(), setpoints()
    backend.reset(torch.ones(N, dtype=torch.bool), a_start())
    for target in targets[:5]:
        backend.step(target)
    kept = backend.snapshot()
    for target in targets[5:]:
        backend.step(target)
    expected = backend.read()
    backend.restore(kept)
    for target in targets[5:]:
        backend.step(target)
    for name, value in vars(backend.read()).items():
        assert torch.equal(value, getattr(expected, name)), name


def test_mass_and_friction_reach_the_physics() -> None:
    backend = a_backend()
    body = backend.plant.model.body("body").id
    mass = backend.plant.batch.expanded("body_mass")[:, body]
    np.testing.assert_allclose(mass, facts.BODY.mass_kg + np.linspace(-2.0, 2.0, N), rtol=1e-6)
    total = backend.plant.batch.expanded("body_subtreemass")[:, body]
    np.testing.assert_allclose(total, facts.TOTAL_MASS_KG + np.linspace(-2.0, 2.0, N), rtol=1e-6)


@pytest.mark.parametrize("kind", ["flat", "noise", "tiles"])
def test_robots_start_clear_of_the_ground(kind: str) -> None:
    config = TaskConfig(terrain=TerrainConfig(kind=kind, half_size_m=16.0))
    simulations = SimulationDraws(torch.full((16,), 0.8), torch.zeros(16))
    backend = PlantBackend(config, (), simulations, n_threads=1)
    start = draw_initial_state(RandomisationConfig(), Ground(config.terrain, "cpu"), 16, draws())
    backend.reset(torch.ones(16, dtype=torch.bool), start)
    state = backend.read()
    assert not state.foot_contact.any()
    assert not state.body_contact.any()
