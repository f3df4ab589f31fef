"""Bodies as MuJoCo has them after each fault."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.facts import N_JOINTS
from withheld.realities.calibrating import body as calibrating_body
from withheld.realities.fault_kind import Ask, Install, flags_of
from withheld.realities.judging import body, outside
from withheld.simulator.body import build_model
from withheld.simulator.parameters import Settings
from withheld.simulator.robot import Robot

KNEES = tuple(j for j in facts.JOINT_NAMES if j.endswith("kn"))


def model_with(
    install: Install | None, size: float = 1.0, joints: tuple[str, ...] = ()
) -> tuple[mujoco.MjModel, dict[str, float]]:
    robot = Robot()
    ask = Ask(np.random.default_rng(3), size, flags_of(joints))
    parameters = {} if install is None else install(robot, ask)
    return build_model(robot, Settings()), parameters


def test_soft_and_slippery_ground() -> None:
    soft, stated = model_with(calibrating_body.soft, 1.0, KNEES)
    plain, _ = model_with(None)
    assert 0.0 > soft.geom("fl_foot").solref[0] > plain.geom("fl_foot").solref[0]
    assert stated["ground_compliance.time_constant_s"] > 0.0
    slippery, stated = model_with(calibrating_body.slippery, 0.5, KNEES)
    assert slippery.geom("hr_foot").friction[0] == pytest.approx(0.8 * stated["ground_friction.scale"])


def test_elastic_gears_are_stable_in_every_pose_with_a_fifth_to_spare() -> None:
    robot, settings = Robot(), Settings()
    robot.drive.is_elastic = np.ones(N_JOINTS, dtype=np.bool_)
    model = build_model(robot, settings)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    drive, dt_s = robot.drive, settings.step_s
    k, c = (np.diag(1.2 * v) for v in (drive.gear_stiffness_nm_per_rad, drive.gear_damping_nm_s_per_rad))
    for _ in range(200):
        data.qpos[7:19] = rng.uniform(facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
        mujoco.mj_forward(model, data)
        mass = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        free = np.zeros((24, 24))
        free[:12, :12] = np.diag(1.0 / drive.rotor_inertia_kg_m2)
        free[12:, 12:] = np.linalg.inv(mass)[6:18, 6:18]
        pull, drag = (dt_s * free @ np.block([[m, -m], [-m, m]]) for m in (k, c))
        after = np.eye(24) - drag
        step = np.block([[np.eye(24) - dt_s * pull, dt_s * after], [-pull, after]])
        assert np.abs(np.linalg.eigvals(step)).max() < 1.0 + 1e-6


def test_without_faults_it_weighs_what_spot_weighs_with_inertias_of_its_own() -> None:
    model, _ = model_with(None)
    assert 31.6 < model.body_mass.sum() < 32.5
    assert model.nv == 6 + N_JOINTS
    assert model.geom("fl_foot").type == mujoco.mjtGeom.mjGEOM_ELLIPSOID
    assert model.dof_armature[6:9] == pytest.approx([0.0403, 0.0403, 0.0731], abs=1e-4)
    assert np.all(model.dof_frictionloss == 0.0)
    thigh = model.body("fr_uleg")
    assert thigh.inertia == pytest.approx(facts.UPPER_LEG_FL.inertia_kg_m2[:3], rel=0.06)
    assert not np.allclose(thigh.inertia, facts.UPPER_LEG_FL.inertia_kg_m2[:3], rtol=1e-3)


def test_bags_add_their_mass_on_both_sides() -> None:
    (model, stated), (plain, _) = model_with(body.saddlebags), model_with(None)
    assert model.body_mass.sum() - plain.body_mass.sum() == pytest.approx(stated["payload_mass.mass_kg"])
    assert model.body("bag+1").pos[1] == -model.body("bag-1").pos[1]


def test_a_pendulum_weighs_nothing_more_and_can_swing() -> None:
    (model, _), (plain, _) = model_with(outside.pendulum), model_with(None)
    assert model.body_mass.sum() == pytest.approx(plain.body_mass.sum())
    assert model.nv == 6 + N_JOINTS + 2
    assert model.joint("fl_hx").qposadr[0] == 7


def test_shifted_spread_and_heavy_bodies_are_as_stated() -> None:
    plain, _ = model_with(None)
    moved, stated = model_with(body.shifted)
    assert (moved.body("body").ipos - plain.body("body").ipos)[:2] == pytest.approx(
        [stated["com_offset.x_m"], stated["com_offset.y_m"]]
    )
    wide, stated = model_with(body.spread)
    assert wide.body("body").inertia / plain.body("body").inertia == pytest.approx(stated["body_inertia.scale"])
    heavy, stated = model_with(body.heavy_links, 1.0, ("fl_kn",))
    assert heavy.body("fl_lleg").mass / plain.body("fl_lleg").mass == pytest.approx(stated["leg_mass.scale"])
