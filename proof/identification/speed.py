"""How fast evaluations are: batched rollouts with measures, against a plain loop over ``mj_step``."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from spot_log.format.records import RunHeader
from spot_log.read.run import run_of_columns
from spot_model.io.velocity_sequence import VelocitySequence, load_sequence
from spot_model.plant.start import StartState
from spot_model.policy.observation import N_OBSERVATION, Sensed, observed
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from spot_model.robot.control import pd_torque
from spot_model.robot.mjcf import MjcfOptions, default_height_m, spot_mjcf
from spot_model.robot.rotation import rotate_wxyz
from trainer.collect.plan import USER_SEQUENCE
from trainer.simulate.engine import Place
from trainer.simulate.rollout import RolloutCase, RolloutOptions, roll_out
from trainer.sysid.logs.logged_run import LoggedRun
from trainer.sysid.search.config import CONTACT_CHOICES_S, SearchConfig, SimulationConfig, SysidConfig
from trainer.sysid.search.problem import Problem, build_problem
from trainer.sysid.search.search import candidates_engine, evaluate

Array = NDArray[np.float64]
BASELINE_S: Final = 10.0
"""Simulated time of the plain loop."""


def bench_sysid(
    policy_path: Path, *, workers: int, generations: int, population: int = 10, device: str = "cpu"
) -> dict[str, float]:
    """Time the paper's search on four 20 s sequences; the first population, which compiles on a GPU, by itself.

    Returns:
        ``evaluation_s`` (wall time of one candidate through all four sequences), ``evaluations_1000_min``, the CPU time
        of one evaluation in one process and what a thousand would take by it on as many free cores as workers,
        ``simulated_s_per_s``, the same of a plain loop (``baseline_simulated_s_per_s``), ``ratio``, and what was timed.
    """
    policy = load_policy(policy_path)
    simulation, search = SimulationConfig(), SearchConfig(population=population)
    problem = _problem(policy, policy_path.read_bytes(), simulation)
    problem = replace(problem, options=replace(problem.options, device=device))
    rng = np.random.default_rng(0)
    spread = 0.05 * rng.standard_normal((generations + 1, search.population, problem.space.n))
    centre = problem.space.unit_of_values(problem.space.initial)
    candidates = problem.space.values_of_unit(np.clip(centre + spread, 0.0, 1.0))
    with candidates_engine(problem, Place(workers)) as engine:
        began_s = time.perf_counter()
        evaluate(engine, candidates[0])
        first_s = time.perf_counter() - began_s
        began_s = time.perf_counter()
        for generation in candidates[1:]:
            evaluate(engine, generation)
        wall_s = time.perf_counter() - began_s
    began_cpu_s = time.process_time()
    problem.evaluate(candidates[0])
    evaluation_cpu_s = (time.process_time() - began_cpu_s) / search.population
    evaluations = generations * search.population
    sim_s = sum(len(c.velocity_command) for cases in problem.cases for c in cases) / policy.contract.rate_hz
    baseline = plain_loop_simulated_s_per_s(policy, problem.cases[0][0].velocity_command)
    return {
        "first_population_s": first_s,
        "evaluation_s": wall_s / evaluations,
        "evaluations_1000_min": 1000.0 * wall_s / evaluations / 60.0,
        "evaluation_cpu_s": evaluation_cpu_s,
        "evaluations_1000_cpu_min": 1000.0 * evaluation_cpu_s / workers / 60.0,
        "simulated_s_per_s": evaluations * sim_s / wall_s,
        "baseline_simulated_s_per_s": baseline,
        "ratio": evaluations * sim_s / wall_s / baseline,
        "evaluations": evaluations,
        "sequences": len(problem.cases),
        "robots_per_sequence": simulation.robots_per_sequence,
        "timestep_s": simulation.timestep_s,
        "workers": workers,
    }


def plain_loop_simulated_s_per_s(policy: Policy, velocity_command: Array) -> float:
    """One robot, one core: policy at its rate, servo law and ``mj_step`` at each physics step."""
    timestep_s = SimulationConfig().timestep_s
    model = mujoco.MjModel.from_xml_string(
        spot_mjcf(MjcfOptions(timestep_s=timestep_s, cone="elliptic", collision="feet"))
    )
    data = mujoco.MjData(model)
    data.qpos[2] = default_height_m()
    data.qpos[7:] = facts.DEFAULT_POSITION_RAD
    gains = policy.gains()
    action = np.zeros(facts.N_JOINTS, dtype=np.float32)
    n_ticks = round(BASELINE_S * policy.contract.rate_hz)
    substeps = round(1.0 / (policy.contract.rate_hz * timestep_s))
    began_s = time.perf_counter()
    for tick in range(n_ticks):
        sensed = Sensed(
            position_rad=data.qpos[None, 7:],
            velocity_rad_s=data.qvel[None, 6:],
            world_from_body_wxyz=data.qpos[None, 3:7],
            linear_vel_of_body_in_world_m_s=data.qvel[None, :3],
            angular_vel_of_body_in_world_rad_s=np.asarray(rotate_wxyz(data.qpos[3:7], data.qvel[3:6]))[None],
        )
        command = velocity_command[tick % len(velocity_command)][None]
        action = policy.act(policy.observe_many(sensed, command, action[None])[0])
        setpoint = policy.setpoint_rad(action)
        for _ in range(substeps):
            data.ctrl[:] = pd_torque(
                position_rad=data.qpos[7:],
                velocity_rad_s=data.qvel[6:],
                setpoint_position_rad=setpoint,
                setpoint_velocity_rad_s=0.0,
                feedforward_nm=0.0,
                kp_nm_per_rad=gains.kp_nm_per_rad,
                kd_nm_s_per_rad=gains.kd_nm_s_per_rad,
            )
            mujoco.mj_step(model, data)
    return BASELINE_S / (time.perf_counter() - began_s)


def _problem(policy: Policy, policy_bytes: bytes, simulation: SimulationConfig) -> Problem:
    """Four sequences with two runs each, made by the model itself: what is compared does not change the time."""
    space = SysidConfig().space()
    contract = policy.contract
    sequences = [
        load_sequence(name).clipped(np.array(contract.velocity_command_low), np.array(contract.velocity_command_high))
        for name in ("forward", "six_directions", "random", str(USER_SEQUENCE))
    ]
    options = RolloutOptions(simulation.timestep_s, simulation.foot_friction, CONTACT_CHOICES_S[2])
    runs = [run for s in sequences for run in _made_runs(policy, space.model.effects, s, options)]
    return build_problem(
        space, policy_bytes, runs, options, robots_per_sequence=simulation.robots_per_sequence, weights={}
    )


def _made_runs(
    policy: Policy, effects: Sequence[object], sequence: VelocitySequence, options: RolloutOptions
) -> list[LoggedRun]:
    command = sequence.sampled(policy.contract.rate_hz)
    rng = np.random.default_rng(0)
    pose = [facts.DEFAULT_POSITION_RAD + 0.01 * rng.standard_normal(facts.N_JOINTS) for _ in range(2)]
    still, level = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    no_action = np.zeros(facts.N_JOINTS, dtype=np.float32)
    starts = [StartState(p, np.zeros(facts.N_JOINTS), level, still, still, no_action) for p in pose]
    cases = [RolloutCase(sequence.name, start, command) for start in starts]
    made = roll_out(effects, 1, cases, policy, options).features[0].astype(np.float64)  # type: ignore[arg-type]
    return [_run_of(policy, sequence.name, i, starts[i], command, made[i]) for i in range(2)]


def _run_of(
    policy: Policy, name: str, repeat: int, start: StartState, command: Array, features: NDArray[np.float64]
) -> LoggedRun:
    n = len(command)
    observation = np.zeros((n, N_OBSERVATION), dtype=np.float32)
    observed(observation, "joint_position_offset_rad")[...] = (
        features[:, :12] / facts.POLICY_KP_NM_PER_RAD - facts.DEFAULT_POSITION_RAD
    )
    observed(observation, "joint_velocity_rad_s")[...] = features[:, 12:24] / facts.POLICY_KD_NM_S_PER_RAD
    action = (features[:, 24:] / (facts.POLICY_KP_NM_PER_RAD * facts.ACTION_SCALE_RAD)).astype(np.float32)
    stamps = np.arange(n, dtype=np.int64) * 20_000_000
    header = RunHeader(
        run_id=f"{name} {repeat}",
        started_host_stamp_ns=0,
        command_sequence=name,
        repeat=repeat,
        policy_sha256=policy.sha256,
    )
    states = {
        "robot_stamp_ns": stamps[:1],
        "position_rad": start.position_rad[None, :],
        "velocity_rad_s": start.velocity_rad_s[None, :],
        "odom_from_body_wxyz": start.world_from_body_wxyz[None, :],
        "linear_vel_of_body_in_odom_m_s": start.linear_vel_of_body_in_world_m_s[None, :],
        "angular_vel_of_body_in_odom_rad_s": start.angular_vel_of_body_in_world_rad_s[None, :],
    }
    ticks = {"robot_stamp_ns": stamps, "observation": observation, "action": action, "velocity_command": command}
    run = run_of_columns(Path(header.run_id), header, states=states, commands={"key": stamps[:0]}, ticks=ticks)
    return LoggedRun.of(run)
