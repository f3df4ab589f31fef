"""What effects on the model take away between motor and load cell, without a simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import pytest

from spot_model.effects.base import ModelEffect, ModelFields, parameter
from spot_model.effects.bodies import PayloadMass
from spot_model.effects.friction import STICK_SPEED_RAD_S, Armature, CoulombFriction, ViscousFriction, smooth_sign
from spot_model.plant.model_fields import LossMotion, has_joint_loss, joint_losses_nm

MOTION = LossMotion(
    velocity_rad_s=np.full((2, 12), 3.0), acceleration_rad_s2=np.full((2, 12), 10.0), direction=np.full((2, 12), 0.5)
)


@dataclass(frozen=True, kw_only=True)
class Grease(ModelEffect):
    """A user's own."""

    name: ClassVar[str] = "grease"
    drag_nm_s_per_rad: Any = parameter(null=0.0, low=0.0, high=5.0, unit="N·m·s/rad", source="made up")

    def edit(self, fields: ModelFields) -> None:
        fields["dof_damping"][:, fields.joint_dofs] += self.drag_nm_s_per_rad * self.mask


@pytest.mark.parametrize(
    ("effect", "knee_nm"),
    [
        (ViscousFriction(damping_nm_s_per_rad=0.2, joints=("knees",)), 0.6),
        (CoulombFriction(level_nm=1.0, joints=("knees",)), 0.5),
        (Armature(inertia_kg_m2=0.05, joints=("knees",)), 0.5),
        (Grease(drag_nm_s_per_rad=0.4, joints=("knees",)), 1.2),
    ],
)
def test_each_loss_by_hand_on_its_joints_alone(effect, knee_nm):
    loss = joint_losses_nm([effect], MOTION)
    np.testing.assert_allclose(loss[:, 2::3], knee_nm)
    assert not loss[:, 0::3].any()
    assert has_joint_loss(effect)


def test_losses_add_up_and_other_effects_have_none():
    effects = [ViscousFriction(damping_nm_s_per_rad=0.2), CoulombFriction(level_nm=1.0), PayloadMass(mass_kg=3.0)]
    np.testing.assert_allclose(joint_losses_nm(effects, MOTION), np.full((2, 12), 1.1))
    assert not has_joint_loss(effects[-1])


def test_an_effect_at_null_has_no_loss_now_and_could_have_one():
    grease = Grease()
    assert not joint_losses_nm([grease], MOTION).any()
    assert has_joint_loss(grease)


def test_the_sign_is_smooth_at_rest_and_sharp_beyond():
    assert smooth_sign(np.array(0.0)) == 0.0
    assert smooth_sign(np.array(10.0 * STICK_SPEED_RAD_S)) == pytest.approx(1.0, abs=1e-8)
    assert smooth_sign(np.array(-0.05), 0.05) == pytest.approx(-np.tanh(1.0))
