"""``spot-rl bench sysid``: how fast evaluations are, as batched rollouts and as a plain loop over ``mj_step``."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Annotated, Final

import mujoco
import numpy as np
import typer
from numpy.typing import NDArray

from spot_log import Run
from spot_model.console.command_registry import AsJson, PolicyFile
from spot_model.effects.base import CommandEffect
from spot_model.io.velocity_sequence import load_sequence
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.built_in import WALK
from spot_model.policy.observation import Sensed
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from spot_model.robot.control import pd_torque
from spot_model.robot.mjcf import MjcfOptions, default_height_m, spot_mjcf
from spot_model.robot.rotation import rotate_wxyz
from trainer.collect.collect_run import USER_SEQUENCE
from trainer.simulate.engine import Place
from trainer.simulate.recorded_loop import Course, RecordedLoop
from trainer.simulate.rollout import RolloutOptions
from trainer.sysid.config import CONTACT_CHOICES_S, SearchConfig, SimulationConfig, SysidConfig
from trainer.sysid.search import SysidProblem, build_problem, candidates_engine, evaluate_candidates

Array = NDArray[np.float64]
BASELINE_S: Final = 10.0
"""Simulated time of the plain loop."""
REPEATS: Final = 2


def sysid(
    policy: PolicyFile = WALK,
    workers: Annotated[int, typer.Option("--workers", min=1, max=256, help="Processes.")] = 2,
    generations: Annotated[int, typer.Option("--generations", min=1, help="Generations to time.")] = 3,
    population: Annotated[int, typer.Option("--population", min=4, help="Candidates of a generation.")] = 10,
    device: Annotated[str, typer.Option("--device", help="Where the physics runs: cpu, or cuda.")] = "cpu",
    as_json: AsJson = False,
) -> None:
    """Measure the speed of an identification against a plain mj_step loop."""
    result = measure(policy, workers=workers, generations=generations, population=population, device=device)
    if as_json:
        typer.echo(json.dumps(result))
        return
    for key, value in result.items():
        typer.echo(f"{key:>27} {value:g}")


def measure(policy_path: Path, *, workers: int, generations: int, population: int, device: str) -> dict[str, float]:
    """Time the paper's search on four 20 s sequences; the first population, which compiles on a GPU, by itself.

    Returns:
        ``evaluation_s`` (wall time of one candidate through all four sequences), ``evaluations_1000_min``, the CPU time
        of one evaluation in one process and what a thousand would take by it on as many free cores as workers,
        ``simulated_s_per_s``, the same of a plain loop (``baseline_simulated_s_per_s``), ``ratio``, and what was timed.
    """
    policy = load_policy(policy_path)
    simulation, search = SimulationConfig(), SearchConfig(population=population)
    problem = _problem(policy, policy_path.read_bytes(), simulation, device)
    rng = np.random.default_rng(0)
    spread = 0.05 * rng.standard_normal((generations + 1, search.population, problem.space.n))
    centre = problem.space.unit_of_values(problem.space.initial)
    candidates = problem.space.values_of_unit(np.clip(centre + spread, 0.0, 1.0))
    with candidates_engine(problem, Place(workers)) as engine:
        began_s = time.perf_counter()
        evaluate_candidates(engine, candidates[0])
        first_s = time.perf_counter() - began_s
        began_s = time.perf_counter()
        for generation in candidates[1:]:
            evaluate_candidates(engine, generation)
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


def _problem(policy: Policy, policy_bytes: bytes, simulation: SimulationConfig, device: str) -> SysidProblem:
    """Four sequences with two runs each, made by the model itself: what is compared does not change the time."""
    space, contract, rng = SysidConfig().space(), policy.contract, np.random.default_rng(0)
    effects = [effect for effect in space.model.effects if not isinstance(effect, CommandEffect)]
    runs: list[Run] = []
    for name in ("forward", "six_directions", "random", str(USER_SEQUENCE)):
        sequence = load_sequence(name)
        sequence = sequence.clipped(np.array(contract.velocity_command_low), np.array(contract.velocity_command_high))
        told = [Course(sequence.name, repeat, sequence.sampled(contract.rate_hz)) for repeat in range(REPEATS)]
        plant = Plant(effects, REPEATS, PlantOptions(n_threads=1))
        pose = facts.DEFAULT_POSITION_RAD + 0.01 * rng.standard_normal((REPEATS, facts.N_JOINTS))
        plant.reset(joint_position_rad=pose, position_of_body_in_world_m=(0.0, 0.0, default_height_m() + 0.01))
        no_action = np.zeros((REPEATS, facts.N_JOINTS), dtype=np.float32)
        loop = RecordedLoop(plant, policy, told, pose, no_action, channel=(), rng=rng, only_ticks=True)
        runs += loop.runs()
    options = RolloutOptions(simulation.timestep_s, simulation.foot_friction, CONTACT_CHOICES_S[2], device=device)
    robots = simulation.robots_per_sequence
    return build_problem(space, policy_bytes, runs, options, robots_per_sequence=robots, weights={})
