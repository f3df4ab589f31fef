"""How near does `mujoco.sysid` come to the truths that claims/identification.py gives to `spot-rl sysid`?

Claim it supports: *Beside peers* in docs/evidence/identification.md. A fake robot with a known truth walks in lock-
step; its joints, body and set-points, as logged, go into `mujoco.sysid` as its documentation shows: one MuJoCo model
with position servos, windows that start at logged states, least squares over joint positions and velocities,
intervals from the Jacobian. It searches what a MuJoCo model has a number for: friction, rotor inertia, the knees'
range of torque, and the delay of commands (an actuator's `delay`, with `interp="linear"`: by default a delay of N steps
is N or N + 1; of less than a step it is none, so that steps are 1 ms).
Feet start as deep as they are under load. Torque limits that change with speed are not among its parameters, so their
truths are left out. `mujoco.rollout` gives sensors of the state before each step, and the package stamps them
with the time after it; here they get their own time. Intervals are of 90 %, as this project states them.

    pip install 'mujoco[sysid]==4.0.0'
    python lab/benchmarks/mujoco_sysid.py [--truth 0] [--seed 1] [--seconds 6] [--window 0.03]
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid

from spot_model.policy.built_in import policy_file

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from identify_fake import scenario_data, truths

from fake_robot.scenario.scenario import Scenario
from spot_log import Run
from spot_model.plant.closed_loop import StartState, standing_height_m
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf
from spot_model.robot.rotation import rotate_inverse_wxyz
from spot_rl.fake_spot import FakeSpot

SEQUENCES = ("forward", "six_directions")
STATES_S = facts.STATE_PERIOD_NS * 1e-9
TIMESTEP_S = 0.001
"""Shorter than the delay of commands, of which an actuator has a time step at least."""
HISTORY = 16
"""Set-points, one a time step, that an actuator keeps for its delay."""
SINKS_M = 0.002
"""Two feet that carry the robot sink so far into MuJoCo's ground (four that stand: 1.1 mm). From feet that just touch
it, the model's robot falls for the first third of a piece: delay, friction and inertia then make up for that.
"""
SCALE = np.repeat([0.01, 0.5], facts.N_JOINTS)
"""Of a residual: rad, rad/s."""
PARAMETERS = {
    # name: start, least, most
    "hip_friction_nm": (0.3, 0.0, 2.0),
    "knee_friction_nm": (0.3, 0.0, 2.0),
    "hip_inertia_kg_m2": (0.02, 0.0, 0.2),
    "knee_inertia_kg_m2": (0.02, 0.0, 0.2),
    "torque_max_nm": (100.0, 30.0, 160.0),
    "torque_min_nm": (-100.0, -160.0, -30.0),
    "command_delay_s": (0.005, TIMESTEP_S, 0.015),
}


def position_servos() -> mujoco.MjSpec:
    """The project's model with MuJoCo's own position servos, and sensors of what is compared."""
    text = spot_mjcf(MjcfOptions(timestep_s=TIMESTEP_S, visuals=False))
    for name in facts.JOINT_NAMES:
        hips = "" if name.endswith("kn") else ' forcelimited="true" forcerange="-45 45"'
        gains = f'kp="{facts.POLICY_KP_NM_PER_RAD}" kv="{facts.POLICY_KD_NM_S_PER_RAD}"'
        gains += f' delay="{PARAMETERS["command_delay_s"][0]}" interp="linear" nsample="{HISTORY}"'
        text = text.replace(
            f'<motor name="{name}" joint="{name}" gear="1"/>', f'<position name="{name}" joint="{name}" {gains}{hips}/>'
        )
    sensors = "".join(
        f'<{kind} name="{name}_{kind}" joint="{name}"/>'
        for kind in ("jointpos", "jointvel")
        for name in facts.JOINT_NAMES
    )
    before, rest = text.split("<sensor>")
    return mujoco.MjSpec.from_string(before + "<sensor>" + sensors + rest[rest.index("</sensor>") :])


def apply(spec: mujoco.MjSpec, parameter: Any) -> None:
    """Write one parameter into the model."""
    value = float(parameter.value[0])
    if parameter.name == "body_mass_kg":
        spec.body("body").mass = value
        return
    if parameter.name == "command_delay_s":
        for name in facts.JOINT_NAMES:
            spec.actuator(name).delay = value
        return
    is_of_hips = parameter.name.startswith("hip")
    for name in facts.JOINT_NAMES:
        if parameter.name.startswith("torque"):
            if name.endswith("kn"):
                servo = spec.actuator(name)
                servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
                servo.forcerange[int(parameter.name == "torque_max_nm")] = value
        elif name.endswith("kn") != is_of_hips:
            joint = spec.joint(name)
            if parameter.name.endswith("friction_nm"):
                joint.frictionloss = value
            elif parameter.name.endswith("nm_s_per_rad"):
                joint.damping[0] = value
            else:
                joint.armature = value


def windows(run: Run, model: mujoco.MjModel, length_s: float) -> list[Any]:
    """The log in pieces, each from a measured state on."""
    states, commands = run.states, run.commands

    def sent(stamps_ns: np.ndarray) -> np.ndarray:
        """The newest command by then: the delay until the robot has it is a parameter."""
        return np.maximum(np.searchsorted(commands.robot_stamp_ns, stamps_ns, side="right") - 1, 0)

    # Not while the gains still ramp from the vendor's stand, or back to it.
    has_policy_gains = np.isclose(commands.kp_nm_per_rad, facts.POLICY_KP_NM_PER_RAD).all(axis=1) & (
        commands.load_nm == 0.0
    ).all(axis=1)
    followed = np.flatnonzero(has_policy_gains[sent(states.robot_stamp_ns)])
    n = round(length_s / STATES_S)
    steps = np.arange(-HISTORY, round((n - 1) * STATES_S / TIMESTEP_S) + 1)
    found = []
    for begin in range(followed[0] + n, followed[-1] - n, n):
        rows = slice(begin, begin + n)
        stamps = states.robot_stamp_ns[rows]
        if np.abs(np.diff(stamps) - facts.STATE_PERIOD_NS).max() > 0.1 * facts.STATE_PERIOD_NS:
            continue
        times = (stamps - stamps[0]) * 1e-9
        measured = np.hstack([states.position_rad[rows], states.velocity_rad_s[rows]])
        sensors = sysid.TimeSeries.from_names(times, measured, model, [model.sensor(i).name for i in range(24)])
        # Held from step to step: the package would draw a line between set-points that are farther apart.
        setpoint = commands.position_rad[sent(stamps[0] + np.round(steps * TIMESTEP_S * 1e9).astype(np.int64))]
        control = sysid.TimeSeries.from_control_names(steps[HISTORY:] * TIMESTEP_S, setpoint[HISTORY:], model)
        found.append((initial_state(model, start_of(run, begin), setpoint[:HISTORY]), control, sensors))
    return found


def initial_state(model: mujoco.MjModel, start: tuple[np.ndarray, np.ndarray], before: np.ndarray) -> np.ndarray:
    """The package's state vector, with the set-points (HISTORY, 12) that a delay reaches back to."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = start
    for i in range(model.nu):
        mujoco.mj_initCtrlHistory(model, data, i, np.arange(-HISTORY, 0) * TIMESTEP_S, before[:, i])
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_FULLPHYSICS))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_FULLPHYSICS)
    return state


def start_of(run: Run, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities of a logged state; the lowest foot carries weight."""
    states = run.states
    attitude = states.odom_from_body_wxyz[row]
    start = StartState(
        states.position_rad[row],
        states.velocity_rad_s[row],
        attitude,
        states.linear_vel_of_body_in_odom_m_s[row],
        states.angular_vel_of_body_in_odom_rad_s[row],
        np.zeros(12, dtype=np.float32),
    )
    height = standing_height_m(start) - SINKS_M
    turning = rotate_inverse_wxyz(attitude, start.angular_vel_of_body_in_world_rad_s)
    qpos = np.concatenate([[0.0, 0.0, height], attitude, start.position_rad])
    qvel = np.concatenate([start.linear_vel_of_body_in_world_m_s, np.asarray(turning), start.velocity_rad_s])
    return qpos, qvel


def difference(_: Any, predicted: Any, measured: Any, *__: Any, **___: Any) -> tuple[Any, Any, Any]:
    """Residual in fixed units: the package's own is relative to each signal's size, and joints that rest would rule."""
    # Sensors are of the state before the step; their stamp is of the one after it.
    predicted = sysid.TimeSeries(predicted.times - TIMESTEP_S, predicted.data, predicted.signal_mapping)
    measured = sysid.apply_delayed_ts_window(measured, predicted, 0.0, 0.0)
    predicted = predicted.resample(measured.times)
    return (predicted.data - measured.data) / SCALE, predicted, measured


def fitted(spec: mujoco.MjSpec, pieces: list[Any], ranges: dict[str, tuple[float, float, float]]) -> Any:
    """Least squares over pieces: the package's result, 90 % half-widths, and the residuals of each piece."""
    parameters = sysid.ParameterDict()
    for name, (start, least, most) in ranges.items():
        parameters.add(sysid.Parameter(name, start, least, most, modifier=apply))
    initial, control, sensors = (list(column) for column in zip(*pieces, strict=True))
    names = [f"piece {i}" for i in range(len(pieces))]
    sequences = sysid.ModelSequences("spot", spec, names, initial, control, sensors)
    residual = sysid.build_residual_fn(models_sequences=[sequences], modify_residual=difference)
    found, result = sysid.optimize(parameters, residual, verbose=False, x_scale="jac")
    residuals, _, _ = residual(result.x, found)
    _, half = sysid.calculate_intervals(residuals, result.jac, alpha=0.1)
    return result, half, residuals


def some(pieces: list[Any], most: int) -> list[Any]:
    """At most so many, evenly chosen."""
    return [pieces[i] for i in np.unique(np.linspace(0, len(pieces) - 1, most).round().astype(int))]


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=1, help="of the fake robot")
    parser.add_argument("--truth", type=int, default=0)
    parser.add_argument("--policy", type=policy_file, default="baseline")
    parser.add_argument("--seconds", type=float, default=6.0, help="of each of the four runs")
    parser.add_argument("--window", type=float, default=0.03, help="length of a piece, s")
    parser.add_argument("--most", type=int, default=60, help="pieces, evenly chosen")
    chosen = parser.parse_args()
    truth = truths()[chosen.truth]
    spec = position_servos()
    model = spec.copy().compile()
    pieces: list[Any] = []
    with tempfile.TemporaryDirectory() as name, FakeSpot(scenario_data(truth, chosen.seed, inertia=True)) as spot:
        for sequence in SEQUENCES * 2:
            run = spot.walk(chosen.policy, sequence=sequence, duration_s=chosen.seconds, log_dir=Path(name))
            pieces += windows(run, model, chosen.window)
    pieces = some(pieces, chosen.most)
    begin_s = time.perf_counter()
    result, half, residuals = fitted(spec, pieces, PARAMETERS)
    physics = Scenario().physics
    true = {
        "hip_inertia_kg_m2": physics.armature_hip_kg_m2,
        "knee_inertia_kg_m2": physics.armature_knee_kg_m2,
        "command_delay_s": 0.003,
    }
    told = {}
    for name, value, width in zip(PARAMETERS, result.x, half, strict=True):
        truly = true[name] if name in true else getattr(truth, name)
        scale = 0.3 if name.endswith("friction_nm") else abs(truly)
        told[name] = {
            "true": truly,
            "found": round(float(value), 4),
            "half_width": round(float(width), 4),
            "error_percent": round(100 * abs(float(value) - truly) / scale, 1),
            "holds": int(abs(value - truly) <= width),
        }
    cost, took_s = 0.5 * sum(float(np.sum(np.square(r))) for r in residuals), time.perf_counter() - begin_s
    print(json.dumps({"pieces": len(pieces), "cost": round(cost), "identify_s": round(took_s, 1), **told}))


if __name__ == "__main__":
    main()
