"""Parts of a simulated robot, to be put into a model of it or taken away from it; for ``substitution.py``."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import mujoco
import numpy as np

from spot_model.effects.base import (
    BodyEstimate,
    CommandEffect,
    Draws,
    Effect,
    EstimateEffect,
    JointReading,
    Memory,
    ModelEffect,
    ModelFields,
    SensorEffect,
)
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.friction import Armature, CoulombFriction, ViscousFriction
from spot_model.effects.joint_sensors import EncoderOffset, LoadFilter, LoadSensorGain
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES, N_LEGS, STATE_PERIOD_NS, Array
from spot_model.robot.rotation import matrix_from_wxyz, rotate_inverse_wxyz
from withheld.simulator.body import LINK_NAMES, build_model
from withheld.simulator.estimator import FULL_FORCE_N, Estimator
from withheld.simulator.link import DOWN_SHAPE, UP_SHAPE
from withheld.simulator.parameters import GRAVITY_M_S2, EstimatorParameters, LinkParameters, Settings
from withheld.simulator.robot import Robot

# The truth as effects -------------------------------------------------------------------------------------------------


class Always:
    """An effect that has no parameter and acts."""

    is_null: ClassVar[bool] = False


@dataclass(frozen=True, kw_only=True)
class TrueBody(Always, ModelEffect):
    """Some fields of the bodies, or of the joints, as the robot has them."""

    name: ClassVar[str] = "true_body"

    truth: mujoco.MjModel
    fields: tuple[str, ...]

    def edit(self, fields: ModelFields) -> None:
        """Write them."""
        for name in self.fields:
            if name == "jnt_axis":
                fields[name][:, 1 : 1 + len(JOINT_NAMES)] = self.truth.jnt_axis[1 : 1 + len(JOINT_NAMES)]
                continue
            links = [f"{leg}_{link}" for leg in LEG_NAMES for link in LINK_NAMES]
            for body in links if name == "body_pos" else ("body", *links):
                fields[name][:, fields.body_id(body)] = getattr(self.truth, name)[self.truth.body(body).id]


@dataclass(frozen=True, kw_only=True)
class TrueFeet(Always, ModelEffect):
    """Some fields of the feet, and the stiffness of friction, as the robot has them."""

    name: ClassVar[str] = "true_feet"

    truth: mujoco.MjModel
    fields: tuple[str, ...]
    impratio: float | None = None

    def edit(self, fields: ModelFields) -> None:
        """Write them."""
        for name in self.fields:
            for leg in LEG_NAMES:
                foot = self.truth.geom(f"{leg}_foot").id
                fields[name][:, fields.geom_id(f"{leg}_foot")] = getattr(self.truth, name)[foot]
        if self.impratio is not None:
            fields["opt.impratio"][...] = self.impratio


@dataclass(frozen=True, kw_only=True)
class TrueEstimator(Always, EstimateEffect):
    """The robot's own estimator, with feet that bear their full load while they touch the ground."""

    name: ClassVar[str] = "true_estimator"

    parameters_of_it: EstimatorParameters

    def start(self, estimate: BodyEstimate) -> Memory:
        """The estimator is made at the first step, which tells how long a step is."""
        return {}

    def estimate(
        self, estimate: BodyEstimate, joints: JointReading, dt_s: float, memory: Memory, rng: Draws
    ) -> tuple[BodyEstimate, Memory]:
        """What it makes of noise-free readings."""
        rotation = matrix_from_wxyz(estimate.world_from_body_wxyz)
        velocity = np.matmul(rotation, estimate.linear_vel_of_body_in_body_m_s[..., None])[..., 0]
        if dt_s == 0.0:
            return estimate, memory
        if not memory:
            own = Estimator(self.parameters_of_it, estimate.world_from_body_wxyz, np.zeros((len(velocity), 3)), dt_s)
            own.velocity_m_s, own._filtered = velocity.copy(), velocity.copy()
            memory.update(own=own, before=velocity, age=np.zeros((len(velocity), N_LEGS)))
        own = memory["own"]
        felt = (velocity - memory["before"]) / dt_s + [0.0, 0.0, GRAVITY_M_S2]
        touches = estimate.foot_contact > 0.5
        memory["age"] = np.where(touches, memory["age"] + dt_s / STATE_PERIOD_NS * 1e9, 0.0)
        memory["before"] = velocity
        turn = estimate.angular_vel_of_body_in_body_rad_s
        in_body = np.matmul(rotation.transpose(0, 2, 1), felt[..., None])[..., 0]
        reading = joints.position_rad, joints.velocity_rad_s
        own.step(turn, in_body, *reading, memory["age"], FULL_FORCE_N * touches)
        linear = rotate_inverse_wxyz(own.attitude_wxyz, own.reported_velocity_m_s)
        attitude = own.attitude_wxyz.copy()
        return replace(estimate, linear_vel_of_body_in_body_m_s=linear, world_from_body_wxyz=attitude), memory


@dataclass(frozen=True, kw_only=True)
class TrueDamping(Always, SensorEffect):
    """The servos damp by more or less than they are told."""

    name: ClassVar[str] = "true_damping"

    scale: tuple[float, ...]

    def read(self, reading: JointReading, dt_s: float, memory: Memory, rng: Draws) -> tuple[JointReading, Memory]:
        """Scale the velocity that they damp."""
        return replace(reading, servo_velocity_rad_s=np.array(self.scale) * reading.velocity_rad_s), memory


@dataclass(frozen=True, kw_only=True)
class TrueRings(Always, SensorEffect):
    """The encoders' rings are off centre."""

    name: ClassVar[str] = "true_rings"

    size_rad: tuple[float, ...]
    phase_rad: tuple[float, ...]

    def read(self, reading: JointReading, dt_s: float, memory: Memory, rng: Draws) -> tuple[JointReading, Memory]:
        """Add what they say too much."""
        extra = np.array(self.size_rad) * np.sin(reading.position_rad + np.array(self.phase_rad))
        return replace(reading, position_rad=reading.position_rad + extra), memory


@dataclass(frozen=True, kw_only=True)
class TrueLink(Always, CommandEffect):
    """Delays up and down as the robot's link draws them."""

    name: ClassVar[str] = "true_link"

    link: LinkParameters

    def arrival_s(self, issued_s: Array, rng: Draws) -> Array:
        """Draw both."""
        k, n = self.link, issued_s.shape
        up = k.up_floor_s + k.up_scale_s * rng.standard_gamma(UP_SHAPE, n)  # type: ignore[attr-defined]
        down = k.down_floor_s + k.down_scale_s * rng.standard_gamma(DOWN_SHAPE, n)  # type: ignore[attr-defined]
        return np.asarray(issued_s + up + k.compute_s + down)


@dataclass(frozen=True)
class Part:
    """One part of the robot: what of the corrected model goes, and what comes in its place."""

    without: tuple[str, ...] = ()
    """Names of effects."""
    effects: tuple[Effect, ...] = ()

    def put_into(self, model: RobotModel) -> RobotModel:
        """The model with the truth of this part."""
        return replace(model, effects=(*(e for e in model.effects if e.name not in self.without), *self.effects))


def true_parts(robot: Robot, settings: Settings) -> dict[str, Part]:
    """By name."""
    truth, d, s, e = build_model(robot, settings), robot.drive, robot.sensing, robot.estimator

    def row(values: Array) -> Array:
        return np.asarray(values)[None]

    masses = ("body_mass", "body_ipos", "body_iquat", "body_inertia")
    return {
        "stiffness and damping of the ground": Part(
            ("ground_compliance",), (TrueFeet(truth=truth, fields=("geom_solref",)),)
        ),
        "friction of the ground, stiffness of friction": Part(
            ("ground_friction",), (TrueFeet(truth=truth, fields=("geom_friction",), impratio=settings.impratio),)
        ),
        "radii of the feet": Part(("foot_radius",), (TrueFeet(truth=truth, fields=("geom_size",)),)),
        "estimator": Part(("leg_odometry", "velocity_estimate", "imu_tilt"), (TrueEstimator(parameters_of_it=e),)),
        "load cells": Part(
            ("load_filter", "load_sensor_gain"),
            (
                LoadSensorGain(gain=row(s.load_gain), bias_nm=row(s.load_bias_nm)),
                LoadFilter(time_constant_s=s.load_filter_s),
            ),
        ),
        "masses, their centres, inertias": Part(
            ("leg_mass", "payload_mass", "com_offset", "body_inertia"), (TrueBody(truth=truth, fields=masses),)
        ),
        "axes and places of the joints": Part((), (TrueBody(truth=truth, fields=("jnt_axis", "body_pos")),)),
        "encoder zeros": Part(("encoder_offset",), (EncoderOffset(offset_rad=row(s.offset_rad)),)),
        "encoder rings": Part(
            (), (TrueRings(size_rad=tuple(s.eccentricity_rad), phase_rad=tuple(s.eccentricity_phase_rad)),)
        ),
        "noise of the sensors": Part(("sensor_noise",)),
        "transport": Part(("command_delay", "command_jitter", "command_drop"), (TrueLink(link=robot.link),)),
        "gains and motor constants": Part(
            ("torque_gain", "torque_offset", "velocity_filter"),
            (
                TorqueGain(gain=row(d.kp_scale * d.torque_constant)),
                TrueDamping(scale=tuple(d.kd_scale / d.kp_scale)),
            ),
        ),
        "friction and rotors": Part(
            ("coulomb_friction", "viscous_friction", "load_friction", "armature"),
            (
                CoulombFriction(level_nm=row(d.coulomb_nm)),
                ViscousFriction(damping_nm_s_per_rad=row(d.viscous_nm_s_per_rad)),
                Armature(inertia_kg_m2=row(d.rotor_inertia_kg_m2)),
            ),
        ),
    }


# Parts away from the truth --------------------------------------------------------------------------------------------

Change = Callable[[Robot, Settings], Settings]
"""Change a robot in place, and return the settings of its simulation."""


def _as_drawn(part: str, *names: str) -> Change:
    """Some numbers of a part as they are before errors and surroundings are drawn."""

    def change(robot: Robot, settings: Settings) -> Settings:
        for name in names:
            setattr(getattr(robot, part), name, getattr(getattr(Robot(), part), name))
        return settings

    return change


def _restored(*names: str) -> Change:
    """Some fields of the compiled body as they are before errors are drawn."""

    def change(robot: Robot, settings: Settings) -> Settings:
        plain = build_model(Robot(), settings)

        def restore(model: mujoco.MjModel) -> None:
            for name in names:
                getattr(model, name)[:] = getattr(plain, name)

        robot.model_edits.append(restore)
        return settings

    return change


def _usual_ground(_: Robot, settings: Settings) -> Settings:
    """MuJoCo's own time constant and damping ratio of a contact, with its own impedance of 0.95."""
    return replace(
        settings, contact_stiffness_per_s2=1.0 / (0.95 * 0.02) ** 2, contact_damping_per_s=2.0 / (0.95 * 0.02)
    )


def _usual_friction(robot: Robot, settings: Settings) -> Settings:
    robot.foot_friction = Robot().foot_friction
    return settings


def _no_slips(robot: Robot, settings: Settings) -> Settings:
    robot.link.slipped_share = 0.0
    return settings


AWAY: Final[Mapping[str, Change]] = {
    "nothing": lambda _, settings: settings,
    "stiffness and damping of the ground": _usual_ground,
    "friction of the ground": _usual_friction,
    "stiffness of friction": lambda _, settings: replace(settings, impratio=1.0),
    "physics step and integrator": lambda _, s: replace(s, steps_per_state=2, integrator="implicitfast"),
    "lag of the estimate": _as_drawn("estimator", "output_lag_s"),
    "time of the odometry": _as_drawn("estimator", "odometry_time_s"),
    "axes and places of the joints": _restored("jnt_axis", "body_pos"),
    "centres of mass": _restored("body_ipos"),
    "masses and inertias": _restored("body_mass", "body_inertia"),
    "load cells": _as_drawn("sensing", "load_filter_s", "load_gain", "load_bias_nm"),
    "encoder rings": _as_drawn("sensing", "eccentricity_rad"),
    "slipped ticks": _no_slips,
}
