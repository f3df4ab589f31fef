"""Logs made ready: missing gains from the robot's file, loads from its motion, commands put in step with loads."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import mujoco
import numpy as np

from diagnosis.read.pairing import moved, rows_apart, servo_law
from diagnosis.read.robot_file import RobotFile
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from trainer.signals.smoothing import rate, smooth, too_coarse

MIN_AGREEMENT: Final = 0.6
"""Correlation of computed loads with the servo law's torque, at least."""


def prepared(runs: Sequence[Run], robot: RobotFile) -> tuple[tuple[Run, ...], tuple[str, ...]]:
    """Complete the logs; nothing changes in a log of the runtime on Spot.

    Returns:
        The logs, and what was done, a sentence each.

    Raises:
        BadInputError: The robot's MJCF does not fit it.
    """
    notes: list[str] = []
    out = [_without_gaps(run, notes) for run in runs]
    out = [_with_gains(run, robot) for run in out]
    if robot.load == "from_motion":
        model = _body(robot)
        out = [_with_load(run, model, robot, notes) for run in out]
        notes.append("loads are computed from the motion by the robot's MJCF: its errors count as the drive's")
    unstamped = [run for run in out if not (run.states.last_command_key > 0).any() and len(run.commands)]
    if unstamped and all(np.isfinite(run.states.load_nm).any() for run in unstamped):
        shift_s = rows_apart(unstamped) * _period_s(unstamped[0])
        if shift_s != 0.0:
            out = [_shifted(run, round(shift_s * 1e9)) if run in unstamped else run for run in out]
            notes.append(
                f"loads follow their commands by {1e3 * shift_s:.1f} ms; without receipts of commands nobody knows how "
                "much of that is the recording's own order, so it is taken off: a delay of that size cannot be found"
            )
    return tuple(out), tuple(notes)


def _without_gaps(run: Run, notes: list[str]) -> Run:
    """Leave out states with a joint signal that is not a number, if the log has the signal at all."""
    states = run.states
    bad = np.zeros(len(states), dtype=np.bool_)
    for values in (states.position_rad, states.velocity_rad_s, states.load_nm):
        if values.size and np.isfinite(values).any():
            bad |= ~np.isfinite(values).all(axis=1)
    if not bad.any():
        return run
    notes.append(f"log {run.path.name}: {int(bad.sum())} states with a signal that is not a number are left out")
    return replace(run, states=states.rows(~bad))


def _with_gains(run: Run, robot: RobotFile) -> Run:
    given = {"kp_nm_per_rad": robot.each(robot.kp_nm_per_rad), "kd_nm_s_per_rad": robot.each(robot.kd_nm_s_per_rad)}
    filled: dict[str, Any] = {}
    for name, gains in given.items():
        own = getattr(run.commands, name)
        if gains is not None and not np.isfinite(own).any():
            filled[name] = np.broadcast_to(gains, own.shape).copy()
    return replace(run, commands=replace(run.commands, **filled)) if filled else run


def _body(robot: RobotFile) -> mujoco.MjModel:
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
    model.dof_frictionloss[:] = 0.0
    model.dof_damping[:] = 0.0
    model.dof_armature[:] = 0.0
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT | off.mjDSBL_ACTUATION | off.mjDSBL_LIMIT
    return model


def _with_load(run: Run, model: mujoco.MjModel, robot: RobotFile, notes: list[str]) -> Run:
    """The load that the links' motion needs, from smoothed signals. Loads of the log itself are not used.

    No load where it would mean nothing: from states far apart, or unlike what was asked for.
    """
    states, period_s = run.states, _period_s(run)
    velocity = states.velocity_rad_s
    if not np.isfinite(velocity).any():
        velocity = rate(states.position_rad, period_s)
    position, speed, acceleration = smooth(states.position_rad), smooth(velocity), rate(velocity, period_s)
    data = mujoco.MjData(model)
    at = np.array([int(model.joint(name).qposadr[0]) for name in robot.joint_names])
    dof = np.array([int(model.joint(name).dofadr[0]) for name in robot.joint_names])
    load = np.empty_like(position)
    for i in range(len(position)):
        data.qpos[at], data.qvel[dof], data.qacc[dof] = position[i], speed[i], acceleration[i]
        mujoco.mj_inverse(model, data)
        load[i] = data.qfrc_inverse[dof]
    made = replace(run, states=replace(states, load_nm=load, velocity_rad_s=velocity))
    if coarse := too_coarse(period_s):
        notes.append(f"log {run.path.name}: {coarse}: loads computed from its motion are not used")
    elif (agreement := _agreement(made)) < MIN_AGREEMENT:
        notes.append(
            f"log {run.path.name}: loads computed from the motion do not follow the set-points (correlation "
            f"{agreement:.2f}; at least {MIN_AGREEMENT} is needed): velocities are too coarse, or the MJCF is of "
            "another robot; they are not used"
        )
    else:
        return made
    return replace(made, states=replace(made.states, load_nm=np.full_like(load, np.nan)))


def _agreement(run: Run) -> float:
    """Correlation of loads with the servo law's torque, in the median of the joints; 0 where nothing was asked."""
    if not len(run.commands):
        return 0.0
    pulled, own = servo_law(run)
    asked, load = smooth(moved(pulled, rows_apart([run])) - own), smooth(run.states.load_nm)
    found = [np.corrcoef(asked[:, j], load[:, j])[0, 1] for j in range(load.shape[1]) if asked[:, j].std() > 0]
    return float(np.median(found)) if found else 0.0


def _period_s(run: Run) -> float:
    return float(np.median(np.diff(run.states.robot_stamp_ns))) * 1e-9


def _shifted(run: Run, shift_ns: int) -> Run:
    c = run.commands
    end = np.where(c.end_robot_stamp_ns > 0, c.end_robot_stamp_ns + shift_ns, c.end_robot_stamp_ns)
    return replace(run, commands=replace(c, robot_stamp_ns=c.robot_stamp_ns + shift_ns, end_robot_stamp_ns=end))
