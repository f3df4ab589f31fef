"""What the plant reports, against MuJoCo's own quantities."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from spot_model.effects.friction import CoulombFriction
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions


def moving_plant(n_sims: int = 3) -> Plant:
    plant = Plant((), n_sims)
    rng = np.random.default_rng(2)
    quaternion = rng.normal(size=(n_sims, 4)) * [1.0, 0.2, 0.2, 1.0]
    plant.reset(
        position_of_body_in_world_m=[0.3, -0.2, 1.5],
        world_from_body_wxyz=quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True),
        linear_vel_of_body_in_world_m_s=rng.normal(size=(n_sims, 3)),
        angular_vel_of_body_in_body_rad_s=rng.normal(size=(n_sims, 3)),
        joint_velocity_rad_s=rng.normal(size=(n_sims, 12)),
    )
    plant.step(facts.DEFAULT_POSITION_RAD + rng.normal(0.0, 0.1, (n_sims, 12)), 3)
    return plant


def object_velocity(model: mujoco.MjModel, data: mujoco.MjData, kind: int, ident: int, *, local: bool) -> np.ndarray:
    """Angular, then linear velocity."""
    velocity = np.zeros(6)
    mujoco.mj_objectVelocity(model, data, kind, ident, velocity, int(local))
    return velocity


def test_body_and_feet_are_mujocos() -> None:
    plant = moving_plant()
    for sim in range(plant.n_sims):
        model, data = plant.batch.get_model(sim), plant.batch.get_data(sim)
        mujoco.mj_forward(model, data)
        body, kind = model.body("body").id, mujoco.mjtObj.mjOBJ_XBODY
        in_world = object_velocity(model, data, kind, body, local=False)
        in_body = object_velocity(model, data, kind, body, local=True)
        np.testing.assert_array_equal(plant.position_of_body_in_world_m[sim], data.xpos[body])
        np.testing.assert_allclose(plant.world_from_body_wxyz[sim], data.xquat[body], atol=1e-12)
        np.testing.assert_allclose(plant.angular_vel_of_body_in_world_rad_s[sim], in_world[:3], atol=1e-12)
        np.testing.assert_allclose(plant.linear_vel_of_body_in_world_m_s[sim], in_world[3:], atol=1e-12)
        np.testing.assert_allclose(plant.angular_vel_of_body_in_body_rad_s[sim], in_body[:3], atol=1e-12)
        np.testing.assert_allclose(plant.linear_vel_of_body_in_body_m_s[sim], in_body[3:], atol=1e-12)
        for leg, name in enumerate(facts.LEG_NAMES):
            site = model.site(f"{name}_foot").id
            foot = object_velocity(model, data, mujoco.mjtObj.mjOBJ_SITE, site, local=False)
            np.testing.assert_allclose(plant.foot_position_in_world_m[sim, leg], data.site_xpos[site], atol=1e-12)
            np.testing.assert_allclose(plant.foot_velocity_in_world_m_s[sim, leg], foot[3:], atol=1e-12)


def test_what_is_read_is_a_copy() -> None:
    plant = moving_plant(1)
    for name in ("joint_position_rad", "joint_velocity_rad_s", "world_from_body_wxyz", "time_s", "applied_torque_nm"):
        seen = getattr(plant, name)
        kept = seen.copy()
        seen += 1.0
        np.testing.assert_array_equal(getattr(plant, name), kept)


def test_feet_touch_when_standing_and_not_in_the_air() -> None:
    plant = Plant((), 2)
    plant.reset([1], position_of_body_in_world_m=[0.0, 0.0, 2.0])
    plant.step(facts.DEFAULT_POSITION_RAD, 40)
    assert plant.foot_contact.tolist() == [[True] * 4, [False] * 4]
    assert np.all(plant.foot_force_in_world_n[0, :, 2] > 0.0)
    assert not plant.foot_force_in_world_n[1].any()
    assert not plant.body_contact.any()


@pytest.mark.parametrize("position_m", [[0.0, 0.0, 0.09], [0.0, 0.0, 0.08]])
def test_body_contact_is_told_from_foot_contact(position_m: list[float]) -> None:
    plant = Plant((), 2)
    legs_up = np.tile([0.0, 2.2, -0.3], 4)
    plant.reset([1], position_of_body_in_world_m=position_m, joint_position_rad=legs_up)
    assert plant.body_contact.tolist() == [False, position_m[2] < 0.085]
    assert not plant.foot_contact[1].any()


def test_link_torque_is_motor_torque_less_friction_damping_and_armature() -> None:
    options = MjcfOptions(timestep_s=0.001, armature_kg_m2=0.04, link_torque_sensors=True)
    plant = Plant((CoulombFriction(level_nm=0.5),), 2, PlantOptions(options))
    plant.fields["dof_damping"][:, 6:] = 0.3
    plant.fields.commit()
    rng = np.random.default_rng(4)
    for _ in range(50):
        plant.step(facts.DEFAULT_POSITION_RAD + rng.normal(0.0, 0.1, (2, 12)), 5)
    before = [plant.batch.get_data(sim) for sim in range(2)]
    plant.advance()
    for sim, data in enumerate(before):
        model = plant.batch.get_model(sim)
        data.ctrl[:] = plant.applied_torque_nm[sim]
        mujoco.mj_forward(model, data)
        assert data.efc_type[: data.nf].tolist() == [mujoco.mjtConstraint.mjCNSTR_FRICTION_DOF] * 12
        friction = data.efc_force[: data.nf]
        damping, inertia = -0.3 * data.qvel[6:], 0.04 * data.qacc[6:]
        expected = data.ctrl + friction + damping - inertia
        np.testing.assert_allclose(plant.link_torque_nm[sim], expected, atol=1e-9)
        assert np.abs(friction).max() == pytest.approx(0.5)


def test_link_torque_is_motor_torque_where_nothing_is_lost() -> None:
    plant = Plant((), 1, PlantOptions(MjcfOptions(link_torque_sensors=True)))
    plant.step(facts.DEFAULT_POSITION_RAD + 0.1, 20)
    np.testing.assert_allclose(plant.link_torque_nm, plant.applied_torque_nm, atol=1e-9)
