"""The nominal model's rigid body without contact, friction and rotors: inverse dynamics seen from the links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from diagnosis.channels.channel_view import Array
from spot_model.effects.base import Effect
from spot_model.plant.model_fields import FIRST_JOINT_DOF, edit_model
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf

N_DOFS = FIRST_JOINT_DOF + facts.N_JOINTS


@dataclass(frozen=True)
class Inputs:
    """What inverse dynamics start from, n rows; a correction of a sensor replaces one of these."""

    world_from_body_wxyz: Array
    angular_vel_in_body_rad_s: Array
    linear_acc_in_world_m_s2: Array
    angular_acc_in_body_rad_s2: Array
    position_rad: Array
    velocity_rad_s: Array
    acceleration_rad_s2: Array
    load_nm: Array


class BodyModel:
    """Spot's rigid body with the model effects of a robot model.

    Args:
        effects: Their model edits (masses, centres of mass, inertias) apply; friction and armature do not count, since
            loads are measured behind them.
    """

    def __init__(self, effects: Sequence[Effect] = ()) -> None:
        model = mujoco.MjModel.from_xml_string(spot_mjcf(MjcfOptions(collision="feet", visuals=False)))
        edit_model(model, effects)
        model.dof_frictionloss[:] = 0.0
        model.dof_damping[:] = 0.0
        model.dof_armature[:] = 0.0
        off = mujoco.mjtDisableBit
        model.opt.disableflags |= (
            off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT | off.mjDSBL_SENSOR | off.mjDSBL_ACTUATION | off.mjDSBL_LIMIT
        )
        self._model = model
        self._data = mujoco.MjData(model)
        mujoco.mj_setConst(model, self._data)
        self.foot_radius_m = np.array([model.geom(f"{leg}_foot").size[0] for leg in facts.LEG_NAMES])
        """Shape (4,)."""
        self.foot_friction = np.array([model.geom(f"{leg}_foot").friction[0] for leg in facts.LEG_NAMES])
        """Sliding friction coefficient, shape (4,)."""

    def inverse_dynamics(self, x: Inputs) -> Array:
        """Generalised forces that make this motion, gravity included.

        The body's velocity does not matter: the equations of motion are the same in every steadily moving frame.

        Returns:
            Shape (n, 18): force on the body in the world, moment about the body's origin in the body, joint torques.
        """
        n = len(x.position_rad)
        at_rest = np.zeros((n, 3))
        positions = np.concatenate([at_rest, x.world_from_body_wxyz, x.position_rad], axis=1)
        velocities = np.concatenate([at_rest, x.angular_vel_in_body_rad_s, x.velocity_rad_s], axis=1)
        accelerations = np.concatenate(
            [x.linear_acc_in_world_m_s2, x.angular_acc_in_body_rad_s2, x.acceleration_rad_s2], axis=1
        )
        out = np.empty((n, N_DOFS))
        data, model = self._data, self._model
        qpos, qvel, qacc = data.qpos, data.qvel, data.qacc
        # What is left of mj_inverse without contact, constraints, passive forces and rotors: a fifth faster.
        for i in range(n):
            qpos[:] = positions[i]
            qvel[:] = velocities[i]
            qacc[:] = accelerations[i]
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            mujoco.mj_rne(model, data, 1, out[i])
        return out
