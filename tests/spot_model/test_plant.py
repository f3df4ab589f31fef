"""The plant against a plain MuJoCo loop, its laws, and what resets and randomisation do."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any, ClassVar

import mujoco
import numpy as np
import pytest

from spot_model.effects.base import Effect, Memory, Motion, TorqueEffect, parameter
from spot_model.effects.bodies import PayloadMass
from spot_model.effects.commands import CommandDelay
from spot_model.effects.drivetrain import TorqueBandwidth
from spot_model.effects.friction import CoulombFriction
from spot_model.effects.joint_sensors import EncoderOffset
from spot_model.effects.registry import BUILT_IN
from spot_model.effects.torque_limits import TorqueLimit
from spot_model.io.model_file import load_model
from spot_model.plant.plant import Plant, PlantDivergedError, PlantOptions, ServoCommand
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf

PAPER = load_model("paper_identified").effects


def setpoints(n_periods: int, n_sims: int) -> np.ndarray:
    """Random set-points around the default pose, shape (n_periods, n_sims, 12)."""
    noise = np.random.default_rng(5).normal(0.0, 0.15, (n_periods, n_sims, 12))
    return facts.DEFAULT_POSITION_RAD + noise


def run(plant: Plant, n_periods: int = 15) -> np.ndarray:
    """Full state after each control period, shape (n_periods, n_sims, 37)."""
    states = []
    for position in setpoints(n_periods, plant.n_sims):
        plant.step(position, 4)
        states.append(np.hstack([plant.batch.qpos, plant.batch.qvel]))
    return np.array(states)


@pytest.mark.parametrize(
    "mjcf", [MjcfOptions(), MjcfOptions(timestep_s=0.001, integrator="implicitfast", cone="elliptic")]
)
def test_a_plain_mujoco_loop_gives_the_same_bits(mjcf: MjcfOptions) -> None:
    plant = Plant((), 2, PlantOptions(mjcf))
    model = mujoco.MjModel.from_xml_string(spot_mjcf(mjcf))
    expected = []
    for sim in range(2):
        data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, data, 0)
        mujoco.mj_forward(model, data)
        states = []
        for position in setpoints(15, 2)[:, sim]:
            for _ in range(4):
                data.ctrl[:] = 60.0 * (position - data.qpos[7:]) - 1.5 * data.qvel[6:]
                mujoco.mj_step(model, data)
            states.append(np.hstack([data.qpos, data.qvel]))
        expected.append(states)
    np.testing.assert_array_equal(run(plant), np.swapaxes(expected, 0, 1))


def test_null_effects_change_no_bit() -> None:
    nulls = [cls() for cls in BUILT_IN.values()]
    assert all(effect.is_null for effect in nulls)
    np.testing.assert_array_equal(run(Plant(nulls, 3)), run(Plant((), 3)))


def test_the_papers_effects_change_something_and_repeat_exactly() -> None:
    states = run(Plant(PAPER, 3))
    np.testing.assert_array_equal(states, run(Plant(PAPER, 3)))
    assert np.abs(states - run(Plant((), 3))).max() > 1e-3


def test_any_number_of_threads_gives_the_same_bits() -> None:
    one, three = (run(Plant(PAPER, 5, PlantOptions(n_threads=n))) for n in (1, 3))
    np.testing.assert_array_equal(one, three)


def test_a_simulation_does_not_depend_on_its_neighbours() -> None:
    many = run(Plant(PAPER, 4))
    alone = Plant(PAPER, 1)
    for i, position in enumerate(setpoints(15, 4)[:, 2]):
        alone.step(position, 4)
        np.testing.assert_array_equal(alone.batch.qpos[0], many[i, 2, :19])


def test_applied_torque_by_hand() -> None:
    plant = Plant((TorqueLimit(joints=("hips",), limit_nm=45.0),), 1)
    plant.reset(joint_velocity_rad_s=2.0)
    position = facts.DEFAULT_POSITION_RAD + 0.5
    plant.command(ServoCommand(position, velocity_rad_s=1.0, load_nm=4.0, kp_nm_per_rad=100.0, kd_nm_s_per_rad=2.0))
    plant.advance()
    # 100·0.5 + 2·(1 − 2) + 4 = 52 N·m; the hips' limit is 45.
    np.testing.assert_allclose(plant.applied_torque_nm[0], np.tile([45.0, 45.0, 52.0], 4), rtol=1e-12)


def test_a_setpoint_beyond_a_stop_pulls_no_harder_than_the_stop() -> None:
    beyond, at_stop = Plant((), 1), Plant((), 1)
    beyond.step(facts.POSITION_HIGH_RAD + 1.0, 1)
    at_stop.step(facts.POSITION_HIGH_RAD, 1)
    np.testing.assert_array_equal(beyond.applied_torque_nm, at_stop.applied_torque_nm)


def test_a_parameter_may_differ_between_simulations() -> None:
    friction = np.array([[0.0], [2.0]])
    limit = np.array([[10.0], [30.0]])
    plant = Plant((CoulombFriction(level_nm=friction), TorqueLimit(limit_nm=limit)), 2)
    plant.step(facts.DEFAULT_POSITION_RAD + 2.0, 1)
    np.testing.assert_array_equal(plant.applied_torque_nm, np.broadcast_to(limit, (2, 12)))
    assert plant.fields["dof_frictionloss"][:, 6:].tolist() == [[0.0] * 12, [2.0] * 12]
    assert not plant.fields["dof_frictionloss"][:, :6].any()


def test_fields_randomise_mass_and_ground_friction_of_one_simulation() -> None:
    plant = Plant((), 2, PlantOptions(MjcfOptions(timestep_s=0.0025)))
    body, foot = plant.model.body("body").id, plant.model.geom("fl_foot").id
    plant.fields["body_mass"][1, body] += 10.0
    plant.fields["geom_friction"][1, foot, 0] = 0.3
    plant.fields.commit()
    assert plant.batch.get_model(1).body_subtreemass[body] == pytest.approx(41.6, abs=0.001)
    assert plant.batch.get_model(0).geom_friction[foot, 0] == 0.8
    for _ in range(60):
        plant.step(facts.DEFAULT_POSITION_RAD, 20)
    weight = plant.foot_force_in_world_n[:, :, 2].sum(axis=1)
    np.testing.assert_allclose(weight, 9.81 * np.array([31.6, 41.6]), rtol=0.03)


def test_a_reset_touches_its_simulations_only() -> None:
    plant = Plant((), 4)
    run(plant, 3)
    before = np.hstack([plant.batch.qpos, plant.batch.qvel])
    plant.reset(
        [1, 3],
        position_of_body_in_world_m=[[1.0, 2.0, 0.6], [3.0, 4.0, 0.7]],
        world_from_body_wxyz=[0.0, 0.0, 0.0, 1.0],
        joint_position_rad=0.5,
        linear_vel_of_body_in_world_m_s=[1.0, 0.0, 0.0],
        angular_vel_of_body_in_body_rad_s=[0.0, 0.0, 2.0],
        joint_velocity_rad_s=-1.0,
    )
    after = np.hstack([plant.batch.qpos, plant.batch.qvel])
    np.testing.assert_array_equal(after[[0, 2]], before[[0, 2]])
    np.testing.assert_array_equal(plant.position_of_body_in_world_m[[1, 3]], [[1.0, 2.0, 0.6], [3.0, 4.0, 0.7]])
    np.testing.assert_array_equal(after[3, 3:], [0, 0, 0, 1, *[0.5] * 12, 1, 0, 0, 0, 0, 2, *[-1.0] * 12])
    assert plant.time_s.tolist() == pytest.approx([0.06, 0.0, 0.06, 0.0])


def test_after_a_reset_a_simulation_runs_as_a_new_one() -> None:
    plant = Plant(PAPER, 3)
    run(plant, 4)
    plant.reset(np.array([False, True, False]))
    fresh = Plant(PAPER, 3)
    np.testing.assert_array_equal(run(plant)[:, 1], run(fresh)[:, 1])


@dataclasses.dataclass(frozen=True, kw_only=True)
class Lag(TorqueEffect):
    """Each step half of the way to the requested torque; a test double with memory."""

    name: ClassVar[str] = "lag"
    share: Any = parameter(null=0.0, low=0.0, high=1.0, unit="1", source="test")

    def start(self, torque_nm: np.ndarray) -> Memory:
        return {"torque": np.zeros_like(torque_nm), "constant": np.ones(7)}

    def torque(self, torque_nm: np.ndarray, motion: Motion, memory: Memory) -> tuple[np.ndarray, Memory]:
        out = self.share * memory["torque"] + (1.0 - self.share) * torque_nm
        return out, {"torque": out, "constant": memory["constant"]}


def test_a_reset_starts_an_effects_memory_afresh() -> None:
    plant = Plant((Lag(share=0.5),), 2)
    plant.step(facts.DEFAULT_POSITION_RAD + 0.1, 3)
    plant.reset([1])
    plant.step(facts.DEFAULT_POSITION_RAD + 0.1, 1)
    torque = plant.applied_torque_nm
    np.testing.assert_allclose(torque[1], 0.5 * 60.0 * 0.1, rtol=1e-12)
    assert np.all(np.abs(torque[0] - torque[1]) > 0.1)


def test_a_delayed_command_meets_the_servo_after_its_delay() -> None:
    plant = Plant((CommandDelay(delay_s=0.005),), 1)
    plant.step(facts.DEFAULT_POSITION_RAD + 0.1, 1)
    assert np.abs(plant.applied_torque_nm).max() == 0.0
    plant.advance()
    assert np.abs(plant.applied_torque_nm).min() > 1.0


def test_the_senders_array_may_change_after_a_command() -> None:
    plant = Plant((CommandDelay(delay_s=0.005),), 1)
    position = facts.DEFAULT_POSITION_RAD + 0.1
    plant.step(position, 1)
    position += 100.0
    plant.advance()
    assert np.abs(plant.applied_torque_nm).max() < 10.0


def test_a_snapshot_continues_bit_for_bit() -> None:
    effects = (*PAPER, Lag(share=0.5))
    plant = Plant(effects, 2)
    for position in setpoints(5, 2):
        plant.step(position, 4)
    plant.command(ServoCommand(facts.DEFAULT_POSITION_RAD))  # still on its way
    saved = plant.snapshot()
    expected = run(plant)
    other = Plant(effects, 2)
    other.restore(saved)
    np.testing.assert_array_equal(run(other), expected)
    plant.restore(saved)
    np.testing.assert_array_equal(run(plant), expected)


def test_a_snapshot_of_another_plant_is_refused() -> None:
    saved = Plant(PAPER, 2).snapshot()
    with pytest.raises(ValueError, match=r"the snapshot has shape \(2, .*the plant \(3, "):
        Plant(PAPER, 3).restore(saved)
    with pytest.raises(ValueError, match="memories of 3 effects, the plant 0"):
        Plant((), 2).restore(saved)


def test_a_push_adds_to_the_velocity_of_its_simulations() -> None:
    plant = Plant((), 3)
    plant.push([0, 2], linear_vel_in_world_m_s=[[0.5, 0, 0], [0, -0.5, 0]])
    assert plant.linear_vel_of_body_in_world_m_s.tolist() == [[0.5, 0, 0], [0, 0, 0], [0, -0.5, 0]]
    assert not plant.angular_vel_of_body_in_body_rad_s.any()


def test_divergence_is_raised_or_flagged_until_the_reset(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # MuJoCo appends its warnings to a file in the working directory
    wild = ServoCommand(facts.DEFAULT_POSITION_RAD, kp_nm_per_rad=1e9, kd_nm_s_per_rad=1e7)
    plant = Plant((), 1)
    plant.command(wild)
    plant.push(linear_vel_in_world_m_s=1.0)
    with pytest.raises(PlantDivergedError, match=r"simulation 0 of 1 diverged \(mjWARN_BAD.*steps of 0.005 s; use sh"):
        plant.advance(200)

    flagged = Plant((), 2, PlantOptions(on_divergence="flag"))
    gain = np.array([[60.0], [1e9]])
    flagged.command(dataclasses.replace(wild, kp_nm_per_rad=gain, kd_nm_s_per_rad=gain / 40.0))
    flagged.push(linear_vel_in_world_m_s=1.0)
    flagged.advance(200)
    assert flagged.diverged.tolist() == [False, True]
    flagged.reset([1])
    assert not flagged.diverged.any()


def bad_effect() -> Effect:
    class Nowhere(Effect):
        name = "nowhere"
        hook = CommandDelay.hook

    return Nowhere()


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (
            lambda: Plant((CoulombFriction(level_nm=np.zeros((3, 1))),), 2),
            ValueError,
            r"coulomb_friction.level_nm has shape \(3, 1\); allowed for 2 simulations: a number, \(2, 1\)",
        ),
        (lambda: Plant((bad_effect(),), 2), TypeError, "effect nowhere acts at command; the plant has no such place"),
        (lambda: Plant((), 2).reset([0, 2]), ValueError, r"ids \[0, 2\] must rise within 0 to 1"),
        (lambda: Plant((), 2).reset([1, 0]), ValueError, "must rise within"),
        (lambda: Plant((), 2).reset([True]), ValueError, r"shape \(1,\); it must be \(2,\)"),
        (lambda: Plant((), 2).reset(world_from_body_wxyz=[1, 1, 0, 0]), ValueError, "has not length 1; normalise it"),
        (lambda: Plant((), 2).step(np.zeros((3, 12)), 1), ValueError, r"position_rad has shape \(3, 12\)"),
        (lambda: Plant((), 2).link_torque_nm, ValueError, r"MjcfOptions\(link_torque_sensors=True\)"),
    ],
)
def test_wrong_use_is_refused(build: Any, error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        build()


SWITCHED = (
    *PAPER,
    CoulombFriction(joints=("knees",), level_nm=4.0),
    TorqueBandwidth(joints=("knees",), time_constant_s=0.02),
    PayloadMass(mass_kg=8.0, z_m=0.1),
    EncoderOffset(joints=("fl_kn",), offset_rad=0.05),
)


def test_effects_that_change_leave_the_motion_and_act_like_those_of_a_new_plant() -> None:
    plant = Plant(PAPER, 1)
    run(plant)
    before = plant.batch.state.copy()
    plant.change_effects(SWITCHED)
    assert np.array_equal(plant.batch.state, before)
    assert plant.reading.position_rad[0, 2] == pytest.approx(plant.joint_position_rad[0, 2] + 0.05)
    plant.reset()
    np.testing.assert_array_equal(run(plant), run(Plant(SWITCHED, 1)))


def test_effects_that_come_and_go_leave_no_trace() -> None:
    plant, other = Plant(PAPER, 1), Plant(PAPER, 1)
    run(plant)
    run(other)
    plant.change_effects(SWITCHED)
    plant.change_effects(PAPER)
    np.testing.assert_array_equal(run(plant), run(other))


def test_an_effect_that_stays_keeps_its_memory() -> None:
    late = TorqueBandwidth(joints=("all",), time_constant_s=0.1)
    plant, other = Plant((late,), 1), Plant((late,), 1)
    run(plant)
    run(other)
    plant.change_effects((PayloadMass(mass_kg=8.0), late))
    plant.change_effects((late,))
    np.testing.assert_array_equal(run(plant), run(other))
