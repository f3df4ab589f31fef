"""The MuJoCo model of one fake robot: the facts, the scenario's ground and payload, and the effects on the model."""

from __future__ import annotations

import mujoco
import numpy as np

from fake_robot.scenario.parts import PayloadConfig
from fake_robot.scenario.scenario import Scenario
from spot_model.plant.model_fields import edit_model
from spot_model.robot.facts import JOINT_NAMES, Array
from spot_model.robot.mjcf import spot_mjcf
from spot_model.robot.mjcf_options import MjcfOptions
from spot_model.robot.terrain import FlatTerrain, NoiseTerrain

_ACCELEROMETER = '<accelerometer name="imu" site="imu"/>'
"""The last of the sensors: specific force where the inertial unit sits, in the body's axes."""


def build_model(scenario: Scenario) -> mujoco.MjModel:
    """The model that this scenario describes, its payload and model effects included."""
    xml = spot_mjcf(_options(scenario)).replace("</sensor>", f"{_ACCELEROMETER}</sensor>")
    model = mujoco.MjModel.from_xml_string(xml)
    model.site_pos[model.site("imu").id] = scenario.sensors.imu_from_body_m
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    _add_payload(model, scenario.payload)
    edit_model(model, scenario.robot_model.effects)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    return model


def scene_model(scenario: Scenario) -> mujoco.MjModel:
    """The world to look at: the same bodies and ground, and one camera on the robot's body."""
    xml = spot_mjcf(_options(scenario)).replace('<site name="imu"', '<camera name="lens"/><site name="imu"')
    return mujoco.MjModel.from_xml_string(xml)


def _options(scenario: Scenario) -> MjcfOptions:
    physics, ground = scenario.physics, scenario.terrain
    noise = NoiseTerrain(
        seed=scenario.seed,
        amplitude_m=ground.amplitude_m,
        cell_m=ground.cell_m,
        half_size_m=ground.half_size_m,
        goes_on=True,
    )
    armature = [
        physics.armature_knee_kg_m2 if name.endswith("kn") else physics.armature_hip_kg_m2 for name in JOINT_NAMES
    ]
    return MjcfOptions(
        timestep_s=physics.timestep_s,
        integrator=physics.integrator,
        cone=physics.cone,
        solver_iterations=physics.solver_iterations,
        contact_solref=(physics.contact_time_constant_s, physics.contact_damping_ratio),
        foot_friction=ground.friction,
        terrain=FlatTerrain() if ground.kind == "flat" else noise,
        collision="all",
        armature_kg_m2=tuple(armature),
        link_torque_sensors=True,
    )


def _add_payload(model: mujoco.MjModel, payload: PayloadConfig) -> None:
    """Add a point mass to the body: mass, centre of mass and inertia as one rigid body."""
    if payload.mass_kg == 0.0:
        return
    body = model.body("body").id
    mass, com = float(model.body_mass[body]), model.body_ipos[body].copy()
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[body])
    rotation = axes.reshape(3, 3)
    inertia = rotation @ np.diag(model.body_inertia[body]) @ rotation.T
    total = mass + payload.mass_kg
    centre = (mass * com + payload.mass_kg * np.array(payload.com_in_body_m)) / total
    for part_mass, part_com in ((mass, com), (payload.mass_kg, np.array(payload.com_in_body_m))):
        inertia = inertia + part_mass * _point_inertia(part_com - centre)
    moments, vectors = np.linalg.eigh(inertia)
    vectors[:, 2] *= np.sign(np.linalg.det(vectors))
    model.body_mass[body] = total
    model.body_ipos[body] = centre
    model.body_inertia[body] = moments
    mujoco.mju_mat2Quat(model.body_iquat[body], np.ascontiguousarray(vectors).ravel())


def _point_inertia(arm_m: Array) -> Array:
    return np.asarray(np.dot(arm_m, arm_m) * np.eye(3) - np.outer(arm_m, arm_m))
