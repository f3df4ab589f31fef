"""The closed formula of the feet against MuJoCo's kinematics and against torch."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from spot_model.robot import facts
from spot_model.robot.leg_kinematics import foot_position_and_jacobian, foot_position_in_body_m
from spot_model.robot.mjcf import spot_mjcf


def random_joints(n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    return rng.uniform(facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD, (n, 12)), rng.normal(0.0, 3.0, (n, 12))


def test_feet_of_a_straight_leg_by_hand() -> None:
    feet = foot_position_in_body_m(np.zeros(12))
    # Knee at (0.29785 + 0.025, 0.055 + 0.110945, −0.3205), foot straight below it by 0.3365.
    np.testing.assert_allclose(feet[0], [0.32285, 0.165945, -0.657], atol=1e-12)
    np.testing.assert_allclose(feet[3], [-0.27285, -0.165945, -0.657], atol=1e-12)


def test_feet_and_jacobians_are_those_of_the_mujoco_model() -> None:
    model = mujoco.MjModel.from_xml_string(spot_mjcf())
    data = mujoco.MjData(model)
    positions, _ = random_joints(20)
    feet, jacobians = foot_position_and_jacobian(positions)
    for i, position in enumerate(positions):
        data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *position]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        for leg, name in enumerate(facts.LEG_NAMES):
            site = model.site(f"{name}_foot").id
            np.testing.assert_allclose(feet[i, leg], data.site_xpos[site], atol=1e-12)
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jacSite(model, data, jacobian, None, site)
            np.testing.assert_allclose(jacobians[i, leg], jacobian[:, 6 + 3 * leg : 9 + 3 * leg], atol=1e-12)


def test_velocity_is_the_derivative_of_position() -> None:
    position, velocity = random_joints(5)
    step_s = 1e-6
    ahead, behind = (foot_position_in_body_m(position + sign * step_s * velocity) for sign in (1, -1))
    expected = (ahead - behind) / (2 * step_s)
    _, jacobian = foot_position_and_jacobian(position)
    found = np.einsum("nlij,nlj->nli", jacobian, velocity.reshape(-1, 4, 3))
    np.testing.assert_allclose(found, expected, atol=1e-8)


def test_torch_gives_what_numpy_gives() -> None:
    torch = pytest.importorskip("torch")
    position, _ = random_joints(3)
    for of_torch, of_numpy in zip(
        foot_position_and_jacobian(torch.as_tensor(position)), foot_position_and_jacobian(position), strict=True
    ):
        np.testing.assert_allclose(of_torch.numpy(), of_numpy, atol=1e-12)
