"""Bodies as MuJoCo has them after each fault."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.facts import N_JOINTS, TOTAL_MASS_KG
from withheld.simulator.mechanics.body import build_model
from withheld.realities.fault_kind import Ask, Draw, flags_of
from withheld.realities.calibrating import body, ground, strange_body
from withheld.simulator.robot import Robot
from withheld.simulator.settings import Settings
from withheld.simulator.ordinary_errors import add_small_errors

KNEES = tuple(j for j in facts.JOINT_NAMES if j.endswith("kn"))


def model_with(
    draw: Draw | None, size: float = 1.0, joints: tuple[str, ...] = ()
) -> tuple[mujoco.MjModel, dict[str, float]]:
    robot = Robot()
    parameters: dict[str, float] = {}
    if draw is not None:
        built = draw(Ask(np.random.default_rng(3), size, flags_of(joints)))
        built.install(robot)
        parameters = dict(built.parameters)
    return build_model(robot, Settings()), parameters


def trunk(model: mujoco.MjModel) -> tuple[float, np.ndarray, np.ndarray]:
    """Mass, centre of mass and inertia (body axes) of the body with all that is fixed to it, but the legs."""
    parts = [i for i in range(model.nbody) if i == model.body("body").id or (
        model.body_parentid[i] == model.body("body").id and not model.body(i).name.endswith("_hip"))]
    mass = model.body_mass[parts]
    own = [np.zeros(3) if i == model.body("body").id else model.body_pos[i] for i in parts]
    at = np.array([p + model.body_ipos[i] for p, i in zip(own, parts, strict=True)])
    com = mass @ at / mass.sum()
    inertia = np.zeros((3, 3))
    for i, m, p in zip(parts, mass, at, strict=True):
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, model.body_iquat[i])
        rotation = axes.reshape(3, 3)
        arm = p - com
        inertia += rotation @ np.diag(model.body_inertia[i]) @ rotation.T
        inertia += m * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    return float(mass.sum()), com, inertia


def test_without_faults_it_weighs_what_spot_weighs_and_its_solver_is_a_third_one() -> None:
    model, _ = model_with(None)
    assert model.body_mass.sum() == pytest.approx(TOTAL_MASS_KG)
    assert model.nv == 6 + N_JOINTS
    assert model.opt.integrator == mujoco.mjtIntegrator.mjINT_IMPLICIT
    assert model.opt.timestep == pytest.approx(5e-4)
    assert model.geom("fl_foot").type == mujoco.mjtGeom.mjGEOM_ELLIPSOID
    assert model.dof_armature[6:9] == pytest.approx([0.0403, 0.0403, 0.0731], abs=1e-4)
    assert np.all(model.dof_frictionloss == 0.0)


def test_a_payload_adds_its_mass_at_its_place() -> None:
    plain, p = trunk(model_with(None)[0]), model_with(body.payload)
    mass, com, _ = trunk(p[0])
    kg = p[1]["payload_mass.mass_kg"]
    place = np.array([p[1][f"payload_mass.{axis}_m"] for axis in "xyz"])
    assert mass == pytest.approx(plain[0] + kg)
    assert com == pytest.approx((plain[0] * plain[1] + kg * place) / mass)


def test_ballast_moves_the_centre_and_no_weight() -> None:
    plain, (model, stated) = trunk(model_with(None)[0]), model_with(body.ballast)
    mass, com, _ = trunk(model)
    assert mass == pytest.approx(plain[0])
    assert com - plain[1] == pytest.approx([stated["com_offset.x_m"], stated["com_offset.y_m"], 0.0], abs=1e-9)


def test_dumbbells_scale_the_inertia_and_nothing_else() -> None:
    plain, (model, stated) = trunk(model_with(None)[0]), model_with(body.dumbbells)
    mass, com, inertia = trunk(model)
    assert mass == pytest.approx(plain[0])
    assert com == pytest.approx(plain[1], abs=1e-9)
    assert np.diag(inertia) == pytest.approx(stated["body_inertia.scale"] * np.diag(plain[2]), rel=1e-3)


def test_boots_are_on_the_links_that_they_are_said_to_be_on() -> None:
    model, _ = model_with(body.boots, 1.0, ("fl_kn",))
    assert model.body("fl_lleg_boot").mass[0] == pytest.approx(0.5 * facts.LOWER_LEG_FL.mass_kg)
    assert model.body_mass.sum() == pytest.approx(TOTAL_MASS_KG + 0.5 * facts.LOWER_LEG_FL.mass_kg)


def test_a_tank_weighs_nothing_more_and_can_move() -> None:
    model, _ = model_with(strange_body.slosh)
    assert model.body_mass.sum() == pytest.approx(TOTAL_MASS_KG)
    assert model.nv == 6 + N_JOINTS + 2
    assert model.joint("fl_hx").qposadr[0] == 7
    assert model.joint("slosh_x").qposadr[0] >= 7 + N_JOINTS


def test_worn_feet_are_smaller_and_as_wide() -> None:
    model, stated = model_with(body.worn_feet, 1.0, KNEES)
    plain, _ = model_with(None)
    size = model.geom("fl_foot").size
    assert size[0] == pytest.approx(facts.FOOT_RADIUS_M + stated["foot_radius.change_m"])
    assert size[1] == plain.geom("fl_foot").size[1]


def test_soft_and_slippery_ground() -> None:
    soft, stated = model_with(ground.soft, 1.0, KNEES)
    plain, _ = model_with(None)
    assert 0.0 > soft.geom("fl_foot").solref[0] > plain.geom("fl_foot").solref[0]
    assert stated["ground_compliance.time_constant_s"] > 0.0
    slippery, stated = model_with(ground.slippery, 0.5, KNEES)
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


def test_small_errors_are_small_and_everywhere() -> None:
    plain, _ = model_with(None)
    robot = Robot()
    add_small_errors(robot, np.random.default_rng(8))
    model = build_model(robot, Settings())
    mass = model.body_mass[1:] / plain.body_mass[1:]
    assert np.all(mass != 1.0)
    assert np.max(np.abs(mass - 1.0)) < 0.04
    frames = np.linalg.norm(model.body_pos[2:] - plain.body_pos[2:], axis=1)
    assert np.all(frames > 0.0)
    assert np.max(frames) < 2.5e-3
    for name in ("kp_scale", "kd_scale", "torque_constant"):
        gain = getattr(robot.drive, name)
        assert np.all(gain != 1.0)
        assert np.max(np.abs(gain - 1.0)) < 0.03
