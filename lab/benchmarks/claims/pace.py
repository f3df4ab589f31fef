"""Claim: what PACE's published method finds of the truths that claims/identification.py gives to `spot-rl sysid`.

The method, written anew from the paper (Bjelonic, Tischhauser, Hutter, *Towards bridging the gap*, arXiv:2509.06342)
and its documentation (pace.filipbjelonic.com), in MuJoCo in place of Isaac Sim: the robot's body is held, all joints
follow chirps from 0.1 to 10 Hz, encoders alone are recorded, and CMA-ES (cmaes, step 0.5 of bounds of ±1, mean of the
last generation) searches rotor inertia, viscous friction, dry friction and encoder bias of each joint and one delay of
whole physics steps, 49 numbers, for the least mean square of joint positions. What is smaller than published: legs do
not act on each other while the body is held, so each is searched by itself, side by side, by 12 numbers and the delay,
with 32 candidates a generation for 512 to 4,096 on a GPU. It states no intervals, and torque limits are not among its
numbers.

The robot: the project's bodies, held, at steps of 1 ms, with the truth's friction and torque limits, the default fake
robot's rotor inertia, and its sensor noise; set-points take 3 ms.

    python lab/benchmarks/claims/pace.py [--truth 0] [--generations 100] [--population 32] [--seconds 5]
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import time
from pathlib import Path

import mujoco
import numpy as np
from cmaes import CMA
from mujoco import rollout
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from identify_fake import scenario_data, truths

from fake_robot.scenario.scenario import scenario_from_data
from spot_model.effects.base import Motion, TorqueEffect
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.effect_chains import TorqueChain
from spot_model.robot import facts
from spot_model.robot.facts import PaperActuator, per_joint
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf

Array = NDArray[np.float64]

STEP_S = facts.STATE_PERIOD_NS * 1e-9
"""Of samples and of PACE's simulation."""
FINE_STEPS = 3
"""Of the robot's physics in a sample."""
DELAY_S = 0.003
CHIRP_HZ = (0.1, 10.0)
AMPLITUDE_RAD = per_joint(0.1, 0.2, 0.2)
"""Twice as far, and joints that swing at 10 Hz meet their limits of torque and speed, which PACE does not search."""
KINDS = ("inertia_kg_m2", "viscous_nm_s_per_rad", "friction_nm", "bias_rad")
BOUNDS = np.array([*np.repeat([(1e-5, 0.3), (0.0, 5.0), (0.0, 2.0), (-0.1, 0.1)], 3, axis=0), (0.0, 5.0)])
"""Of a leg: the four kinds, joint by joint, and the delay in steps."""


def held(step_s: float, *, servos: bool) -> mujoco.MjModel:
    """The robot with its body held in the air, with motors or with MuJoCo's position servos."""
    text = spot_mjcf(MjcfOptions(timestep_s=step_s, integrator="implicitfast", visuals=False))
    before, rest = text.split('<freejoint name="base"/>')
    rest, keyframe = rest.split("<keyframe>")
    rest = rest[: rest.index("<sensor>")] + rest[rest.index("</sensor>") + len("</sensor>") :]
    text = before + rest + keyframe[keyframe.index("</keyframe>") + len("</keyframe>") :]
    gains = f'kp="{facts.POLICY_KP_NM_PER_RAD}" kv="{facts.POLICY_KD_NM_S_PER_RAD}"'
    if servos:
        for name in facts.JOINT_NAMES:
            text = text.replace(
                f'<motor name="{name}" joint="{name}" gear="1"/>', f'<position name="{name}" joint="{name}" {gains}/>'
            )
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT.value
    return model


def chirp(seconds: float) -> Array:
    """Set-points, shape (n, 12): one chirp for all joints, the right side turned, around the default pose."""
    t = np.arange(round(seconds / STEP_S)) * STEP_S
    low, high = CHIRP_HZ
    swing = np.sin(2.0 * np.pi * (low * t + (high - low) / (2.0 * seconds) * t**2))
    side = np.repeat([1.0, -1.0, 1.0, -1.0], 3)
    return np.asarray(facts.DEFAULT_POSITION_RAD + swing[:, None] * AMPLITUDE_RAD * side)


def recorded(truth: PaperActuator, setpoint: Array, rng: np.random.Generator) -> Array:
    """Encoder positions of the robot at each set-point's instant, shape (n, 12)."""
    scenario = scenario_from_data(scenario_data(truth, 1, inertia=True))
    chain = TorqueChain([e for e in scenario.robot_model.effects if isinstance(e, TorqueEffect)], np.zeros((1, 12)))
    physics, fine_s = scenario.physics, STEP_S / FINE_STEPS
    model = held(fine_s, servos=False)
    model.dof_frictionloss[:] = per_joint(truth.hip_friction_nm, truth.hip_friction_nm, truth.knee_friction_nm)
    model.dof_armature[:] = per_joint(
        physics.armature_hip_kg_m2, physics.armature_hip_kg_m2, physics.armature_knee_kg_m2
    )
    data = mujoco.MjData(model)
    data.qpos[:] = setpoint[0]
    late = round(DELAY_S / fine_s)
    found = np.empty_like(setpoint)
    for step in range(FINE_STEPS * len(setpoint)):
        if step % FINE_STEPS == 0:
            found[step // FINE_STEPS] = data.qpos
        motion = Motion(data.qpos[None].copy(), data.qvel[None].copy(), fine_s)
        command = ServoCommand(position_rad=setpoint[None, max(0, step - late) // FINE_STEPS]).copied_for(1)
        data.ctrl[:] = chain.torque_nm(command, motion, motion)[0]
        mujoco.mj_step(model, data)
    return found + scenario.sensors.position_rad * rng.standard_normal(found.shape)


class Simulator:
    """PACE's simulations: one model a candidate, all chirps at once."""

    def __init__(self, setpoint: Array, measured: Array, population: int, threads: int) -> None:
        first = held(STEP_S, servos=True)
        self._models = [first.__copy__() for _ in range(population)]
        self._data = [mujoco.MjData(first) for _ in range(threads)]
        self._setpoint, self._measured = setpoint, measured

    def costs(self, candidates: Array) -> Array:
        """Mean square of a leg's joint positions; candidates of shape (population, 4, 13), costs (population, 4)."""
        population, n = len(candidates), len(self._setpoint)
        by_kind = candidates[:, :, :-1].reshape(population, facts.N_LEGS, len(KINDS), 3).swapaxes(1, 2)
        inertia, viscous, friction, bias = by_kind.reshape(population, len(KINDS), facts.N_JOINTS).swapaxes(0, 1)
        for row, model in enumerate(self._models):
            model.dof_armature[:], model.dof_damping[:] = inertia[row], viscous[row]
            model.dof_frictionloss[:] = friction[row]
        delay = np.repeat(candidates[:, :, -1].astype(int), 3, axis=1)
        rows = np.maximum(np.arange(n)[None, :, None] - delay[:, None, :], 0)
        control = np.take_along_axis(self._setpoint[None], rows, axis=1) + bias[:, None, :]
        start = np.zeros((population, 1 + 2 * facts.N_JOINTS))
        start[:, 1 : 1 + facts.N_JOINTS] = self._measured[0] + bias
        states, _ = rollout.rollout(self._models, self._data, start, control, persistent_pool=True)
        # A state is that after its step; the first sample is the start.
        position = states[:, :-1, 1 : 1 + facts.N_JOINTS] - bias[:, None, :]
        by_joint = np.mean(np.square(position - self._measured[1:]), axis=1)
        return np.asarray(by_joint.reshape(population, facts.N_LEGS, 3).mean(axis=2))


def searched(simulator: Simulator, population: int, generations: int) -> tuple[Array, float]:
    """By leg, the mean of the last generation, shape (4, 13), and the mean of the best costs."""
    low, high = BOUNDS.T
    bounds = np.tile([-1.0, 1.0], (len(BOUNDS), 1))
    optimisers = [
        CMA(mean=np.zeros(len(BOUNDS)), sigma=0.5, bounds=bounds, seed=leg, population_size=population)
        for leg in range(facts.N_LEGS)
    ]
    costs = np.zeros((population, facts.N_LEGS))
    for _ in range(generations):
        points = np.array([[optimiser.ask() for optimiser in optimisers] for _ in range(population)])
        costs = simulator.costs(low + 0.5 * (points + 1.0) * (high - low))
        for leg, optimiser in enumerate(optimisers):
            optimiser.tell([(points[row, leg], float(costs[row, leg])) for row in range(population)])
    means = np.clip([optimiser.mean for optimiser in optimisers], -1.0, 1.0)
    return low + 0.5 * (means + 1.0) * (high - low), float(costs.min(axis=0).mean())


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--truth", type=int, default=0)
    parser.add_argument("--seconds", type=float, default=5.0, help="of the chirp")
    parser.add_argument("--population", type=int, default=32)
    parser.add_argument("--generations", type=int, default=100)
    chosen = parser.parse_args()
    truth = truths()[chosen.truth]
    setpoint = chirp(chosen.seconds)
    measured = recorded(truth, setpoint, np.random.default_rng(chosen.truth))
    begin_s = time.perf_counter()
    simulator = Simulator(setpoint, measured, chosen.population, len(os.sched_getaffinity(0)))
    found, cost = searched(simulator, chosen.population, chosen.generations)
    took_s = time.perf_counter() - begin_s
    physics = scenario_from_data(scenario_data(truth, 1, inertia=True)).physics
    inertia, viscous, friction, bias = found[:, :-1].reshape(facts.N_LEGS, len(KINDS), 3).swapaxes(0, 1)
    told = {
        "hip_friction_nm": error(friction[:, :2], truth.hip_friction_nm, 0.3),
        "knee_friction_nm": error(friction[:, 2:], truth.knee_friction_nm, 0.3),
        "hip_inertia_kg_m2": error(inertia[:, :2], physics.armature_hip_kg_m2, physics.armature_hip_kg_m2),
        "knee_inertia_kg_m2": error(inertia[:, 2:], physics.armature_knee_kg_m2, physics.armature_knee_kg_m2),
        "delay_ms": {"true": 1e3 * DELAY_S, "found": round(1e3 * STEP_S * float(np.mean(found[:, -1].astype(int))), 2)},
        "viscous_nm_s_per_rad": {"true": 0.0, "found": round(float(viscous.mean()), 4)},
        "worst_bias_mrad": round(1e3 * float(np.abs(bias).max()), 2),
    }
    print(json.dumps({"identify_s": round(took_s, 1), "rms_mrad": round(1e3 * np.sqrt(cost), 2), **told}))


def error(values: Array, true: float, scale: float) -> dict[str, float]:
    """Mean and worst of the joints beside the truth, errors as shares of a scale."""
    off = np.abs(values - true) / scale
    return {
        "true": true,
        "found": round(float(values.mean()), 4),
        "error_percent": round(100.0 * abs(float(values.mean()) - true) / scale, 1),
        "worst_joint_percent": round(100.0 * float(off.max()), 1),
    }


if __name__ == "__main__":
    main()
