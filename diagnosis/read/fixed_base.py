"""A robot on a fixed base, from its MJCF: loads that a motion takes, drives, and the motion under given commands."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
import yaml
from scipy.optimize import nnls

from diagnosis.read.robot_file import DriveNumbers, RobotFile
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.robot.facts import Array
from trainer.signals.motor_torque import direction
from trainer.signals.recording import Flags, Stamps
from trainer.signals.smoothing import rate_over, smooth

STEP_S: Final = 1e-3
"""Longest step of a simulation."""
RESTART_S: Final = 1.0
"""A prediction starts anew from the measured state after so long: a pendulum that swings up is chaotic."""
ONSET_S: Final = 0.1
"""Recorded at first without the commands before it, which a delay needs."""


@dataclass(frozen=True)
class Drives:
    """What the drives add to the rigid bodies; each array has shape (J,)."""

    inertia_kg_m2: Array
    """Of the rotor, at the joint."""
    friction_nm: Array
    """Dry."""
    damping_nm_s_per_rad: Array
    offset_nm: Array
    """A constant torque beside the servo's."""
    delay_s: float = 0.0
    """From a command's stamp to its torque."""

    @staticmethod
    def of(robot: RobotFile) -> Drives:
        """Those of a robot file; of one without any, drives that add nothing."""
        told = robot.drive or DriveNumbers()
        n = (len(robot.joint_names),)
        return Drives(**{name: np.broadcast_to(getattr(told, name), n) for name in EACH}, delay_s=told.delay_s)

    def numbers(self) -> DriveNumbers:
        """The same for a robot file."""
        each = {name: tuple(float(f"{x:.4g}") for x in getattr(self, name)) for name in EACH}
        return DriveNumbers(**each, delay_s=self.delay_s)


ROBOT_FILE: Final = "corrected_robot.yaml"
MJCF_FILE: Final = "corrected_robot.xml"
EACH: Final = ("inertia_kg_m2", "friction_nm", "damping_nm_s_per_rad", "offset_nm")


def rigid_bodies(robot: RobotFile) -> mujoco.MjModel:
    """The MJCF's bodies with the robot's joints, in its order; without friction, rotors, contact and limits.

    Raises:
        BadInputError: It cannot be read, or has other joints.
    """
    try:
        model = mujoco.MjModel.from_xml_path(str(robot.mjcf))
    except ValueError as error:
        raise BadInputError(f"mjcf {robot.mjcf} cannot be read: {str(error).splitlines()[0]}") from error
    names = [model.joint(i).name for i in range(model.njnt)]
    lacking = [name for name in robot.joint_names if name not in names]
    if lacking:
        raise BadInputError(f"mjcf {robot.mjcf} has no joint {lacking[0]!r}; it has: {', '.join(names)}")
    if model.nv != len(robot.joint_names):
        raise BadInputError(
            f"mjcf {robot.mjcf} has {model.nv} degrees of freedom, robot {robot.name} {len(robot.joint_names)} joints; "
            "loads come from motion only where the base is fixed: take its free joint out, or use load: measured"
        )
    for name in ("dof_frictionloss", "dof_damping", "dof_armature"):
        getattr(model, name)[:] = 0.0
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_ACTUATION | off.mjDSBL_LIMIT
    return model


def dofs(model: mujoco.MjModel, robot: RobotFile) -> Array:
    """Where the robot's joints stand in the model's positions and velocities, shape (J,)."""
    return np.array([int(model.joint(name).dofadr[0]) for name in robot.joint_names])


def loads_nm(robot: RobotFile, position_rad: Array, velocity_rad_s: Array, acceleration_rad_s2: Array) -> Array:
    """What the links' motion takes at the joints, gravity included; all of shape (n, J)."""
    model = rigid_bodies(robot)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, at, load = mujoco.MjData(model), dofs(model, robot), np.empty_like(position_rad)
    for i in range(len(position_rad)):
        data.qpos[at], data.qvel[at], data.qacc[at] = position_rad[i], velocity_rad_s[i], acceleration_rad_s2[i]
        mujoco.mj_inverse(model, data)
        load[i] = data.qfrc_inverse[at]
    return load


def fitted_drives(torque_nm: Array, velocity_rad_s: Array, stamps_ns: Stamps) -> tuple[Drives, Array]:
    """Drives by least squares from what the servos give beyond the links' loads, and what they leave; shape (n, J).

    No number of a drive is negative: none of them gives power.
    """
    one = np.ones_like(velocity_rad_s)
    smoothed, acceleration = smooth(velocity_rad_s), rate_over(velocity_rad_s, stamps_ns)
    columns = np.stack([acceleration, direction(smoothed), smoothed, one, -one], axis=-1)
    each = [nnls(c, y)[0] for c, y in zip(np.moveaxis(columns, 1, 0), torque_nm.T, strict=True)]
    inertia, friction, damping, more, less = np.array(each).T
    left = torque_nm - np.einsum("njc,jc->nj", columns, np.array(each))
    return Drives(inertia, friction, damping, less - more), left


def predicted(robot: RobotFile, run: Run, drives: Drives, restart_s: float | None = RESTART_S) -> Array:
    """Positions (n, J) under the log's commands, from its measured states on, each time for ``restart_s``.

    Without a restart (None) it is one simulation from the first state on. Gains are those of the log.
    """
    model = rigid_bodies(robot)
    data, at, c = mujoco.MjData(model), dofs(model, robot), run.commands
    time_ns = run.states.robot_stamp_ns
    n_steps = max(1, int(np.ceil(np.median(np.diff(time_ns)) * 1e-9 / STEP_S)))
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.dof_armature[at], model.dof_frictionloss[at] = drives.inertia_kg_m2, drives.friction_nm
    kp, kd = np.nan_to_num(c.kp_nm_per_rad), np.nan_to_num(c.kd_nm_s_per_rad)
    asked = kp * np.nan_to_num(c.position_rad) + kd * np.nan_to_num(c.velocity_rad_s) + np.nan_to_num(c.load_nm)
    velocity = smooth(np.nan_to_num(run.states.velocity_rad_s))
    out, started = np.empty_like(run.states.position_rad), -1
    for i in range(len(time_ns)):
        if started < 0 or (restart_s is not None and time_ns[i] - time_ns[started] >= restart_s * 1e9):
            mujoco.mj_resetData(model, data)
            data.qpos[at] = run.states.position_rad[i]
            data.qvel[at] = velocity[i]
            started = i
        out[i] = data.qpos[at]
        if i + 1 == len(time_ns):
            break
        model.opt.timestep = (time_ns[i + 1] - time_ns[i]) * 1e-9 / n_steps
        for k in range(n_steps):
            now_ns = time_ns[i] + (k * model.opt.timestep - drives.delay_s) * 1e9
            row = max(0, int(np.searchsorted(c.robot_stamp_ns, now_ns, side="right")) - 1)
            # The servo's damping is the joint's, so that it is implicit; its stiffness is much softer than a step.
            model.dof_damping[at] = drives.damping_nm_s_per_rad + kd[row]
            data.qfrc_applied[at] = asked[row] - kp[row] * data.qpos[at] + drives.offset_nm
            mujoco.mj_step(model, data)
    return out


def error_rad(robot: RobotFile, run: Run, drives: Drives, restart_s: float | None = RESTART_S) -> Array:
    """Root mean square of a prediction's error, shape (J,)."""
    off = predicted(robot, run, drives, restart_s) - run.states.position_rad
    rows: Flags = run.states.robot_stamp_ns - run.states.robot_stamp_ns[0] > ONSET_S * 1e9
    return np.asarray(np.sqrt(np.mean(off[rows] ** 2, axis=0)))


def corrected_files(robot: RobotFile, drives: Drives) -> Mapping[str, str]:
    """Texts of a robot's corrected files by their names: its robot file with drives and, where it has one, its MJCF.

    The MJCF is the robot's own with drives in it; its meshes stay where they are.
    """
    told = robot.model_copy(update={"drive": drives.numbers(), "mjcf": None if robot.mjcf is None else MJCF_FILE})
    data = told.model_dump(by_alias=True, exclude_none=True, mode="json")
    texts = {ROBOT_FILE: yaml.safe_dump(data, sort_keys=False)}
    if robot.mjcf is not None:
        spec = mujoco.MjSpec.from_file(robot.mjcf)
        for i, name in enumerate(robot.joint_names):
            joint = spec.joint(name)
            joint.armature, joint.frictionloss = float(drives.inertia_kg_m2[i]), float(drives.friction_nm[i])
            # Its first coefficient is the linear one, where damping is a polynomial.
            joint.damping = np.eye(np.size(joint.damping))[0] * drives.damping_nm_s_per_rad[i]
        beside = Path(robot.mjcf).parent.absolute()
        spec.meshdir, spec.texturedir = (str(beside / own) for own in (spec.meshdir, spec.texturedir))
        spec.compile()
        texts[MJCF_FILE] = spec.to_xml()
    return texts
