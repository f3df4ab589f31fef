"""The arm's kinematics and weight against MuJoCo's, and the model of a robot that carries it."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from fake_robot.services.reports.robot_state import urdf
from spot_model.effects.bodies import StowedArm
from spot_model.errors import BadInputError
from spot_model.io.model_file import load_model, model_from_data
from spot_model.plant.plant import Plant
from spot_model.robot import facts
from spot_model.robot.arm import ARM_JOINT_NAMES, ARM_LINK_NAMES, ARM_MASS_KG, STOWED_RAD, arm_as_one_body, arm_frames


@pytest.mark.parametrize("pose_rad", [STOWED_RAD, np.linspace(-0.5, 0.4, 7) + np.eye(7)[2] - np.eye(7)[6]])
def test_links_are_where_mujoco_has_them(pose_rad: np.ndarray) -> None:
    model = mujoco.MjModel.from_xml_string(urdf(has_arm=True))
    data = mujoco.MjData(model)
    for name, at_rad in zip(ARM_JOINT_NAMES, pose_rad, strict=True):
        data.joint(name.replace("_", ".")).qpos[0] = at_rad
    mujoco.mj_forward(model, data)
    bodies = [model.body(f"arm0.{name}").id for name in ARM_LINK_NAMES]
    for body, (rotation, origin) in zip(bodies, arm_frames(pose_rad), strict=True):
        np.testing.assert_allclose(data.xpos[body], origin, atol=1e-9)
        np.testing.assert_allclose(data.xmat[body].reshape(3, 3), rotation, atol=1e-9)
    whole = arm_as_one_body(pose_rad)
    mass = model.body_mass[bodies]
    assert mass.sum() == pytest.approx(whole.mass_kg)
    np.testing.assert_allclose(mass @ data.xipos[bodies] / mass.sum(), whole.com_m, atol=1e-9)
    inertia = np.zeros((3, 3))
    for body in bodies:
        axes, off = data.ximat[body].reshape(3, 3), data.xipos[body] - whole.com_m
        inertia += axes @ np.diag(model.body_inertia[body]) @ axes.T
        inertia += model.body_mass[body] * (off @ off * np.eye(3) - np.outer(off, off))
    np.testing.assert_allclose(np.diag(inertia), whole.inertia_kg_m2[:3], rtol=1e-4)


def test_a_model_of_a_robot_with_an_arm_has_its_weight_where_it_is() -> None:
    model = load_model("spot_with_arm")
    assert model.robot == "spot_with_arm"
    plant = Plant(model.effects)
    body = plant.fields.body_id("body")
    mass, com = plant.fields["body_mass"][0, body], plant.fields["body_ipos"][0, body]
    assert mass == pytest.approx(facts.BODY.mass_kg + ARM_MASS_KG, abs=1e-3)
    parts = ((facts.BODY.mass_kg, facts.BODY.com_m), (ARM_MASS_KG, arm_as_one_body(STOWED_RAD).com_m))
    np.testing.assert_allclose(com * mass, sum(m * np.array(at) for m, at in parts), atol=1e-3)


def test_the_arm_of_a_model_file_is_added_once_and_may_have_another_weight() -> None:
    assert model_from_data({"robot": "spot_with_arm"}).effects == (StowedArm.published(),)
    assert model_from_data({}).robot == "spot"
    heavy = {"robot": "spot_with_arm", "effects": [{"effect": "stowed_arm", "mass_kg": 8.0}]}
    model = model_from_data(heavy)
    assert model.effects == (StowedArm(mass_kg=8.0),)
    assert model_from_data(model.to_data()) == model
    assert model.to_data()["robot"] == "spot_with_arm"
    with pytest.raises(BadInputError, match="spot_with_arm"):
        model_from_data({"robot": "spot_with_two_arms"})
