"""How fast does mjlab train its own velocity task on this computer? The keys of ``spot-rl bench train --json``.

Claim it supports: the training speed of this project beside mjlab's, on the same GPU at the same number of robots.
Environment: one of its own (``pip install mjlab==1.6.0``; it pins other versions of MuJoCo and rsl-rl than this
project); nothing of this project is imported. One JSON line a size; a size that the time no longer allows is left out.

What is the same as in ``lab/proof/training.py``: rsl-rl's PPO, 24 steps an iteration, 5 epochs of 4 mini-batches,
network 512-256-128, 50 Hz of policy and 200 Hz of physics, 10 solver iterations, TF32, an untrained policy, two
iterations to warm up, the same loop without logs. What is not: the robot (Unitree Go1), its contacts (elliptic cone,
feet with rolling friction, legs that touch each other), observations that are normalised, and mjlab's task.
``--simple-contacts`` takes the contacts closer to this project's: pyramidal cone, no rolling or spinning friction.
"""

# mypy: disable-error-code="import-not-found"
from __future__ import annotations

import argparse
import contextlib
import gc
import io
import json
import resource
import time
from dataclasses import asdict
from importlib.metadata import version
from typing import Any

import torch

TASKS = {"flat": "Mjlab-Velocity-Flat-Unitree-Go1", "rough": "Mjlab-Velocity-Rough-Unitree-Go1"}


def main() -> None:
    """Measure each size in turn, as long as there is time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--device", default="cuda:0", help="cuda:N, or cpu (slow, for checks)")
    parser.add_argument("--n-envs", type=int, nargs="+", default=[4096, 8192, 16384])
    parser.add_argument("--iterations", type=int, default=5, help="how many to time")
    parser.add_argument("--warm-up", type=int, default=2, help="iterations before those; more: robots that stand")
    parser.add_argument("--task", choices=sorted(TASKS), default="flat")
    parser.add_argument("--simple-contacts", action="store_true", help="pyramidal cone, sliding friction alone")
    parser.add_argument("--seconds", type=float, default=100.0, help="no size is begun, no iteration added, after this")
    options = parser.parse_args()
    deadline = time.monotonic() + options.seconds
    for n_envs in options.n_envs:
        if time.monotonic() > deadline:
            print(json.dumps({"n_envs": n_envs, "left_out": f"--seconds {options.seconds:g} are over"}), flush=True)
            continue
        print(json.dumps(measure(options, n_envs, deadline)), flush=True)
        free_memory(options.device)


def measure(options: argparse.Namespace, n_envs: int, deadline: float) -> dict[str, Any]:
    """Make task and PPO for so many robots, then time iterations and physics alone."""
    start = time.perf_counter()
    device: str = options.device
    with contextlib.redirect_stdout(io.StringIO()):
        runner = make_runner(options, n_envs)
        for _ in range(options.warm_up):
            iterate(runner, device)
    ready = time.perf_counter()
    times = [iterate(runner, device)]
    while len(times) < options.iterations and time.monotonic() < deadline:
        times.append(iterate(runner, device))
    env = runner.env.unwrapped
    physics_s = seconds_of_physics(env, device)
    steps = runner.cfg["num_steps_per_env"]
    collect_s = sum(t[0] for t in times) / len(times)
    learn_s = sum(t[1] for t in times) / len(times)
    total_s = collect_s + learn_s
    algorithm = runner.cfg["algorithm"]
    result = {
        "processes": 1,
        "device": device if device == "cpu" else torch.cuda.get_device_name(device),
        "n_envs": n_envs,
        "network": list(runner.cfg["actor"]["hidden_dims"]),
        "policy_steps_per_s": round(n_envs * steps / total_s),
        "collect_steps_per_s": round(n_envs * steps / collect_s),
        "physics_steps_per_s": round(n_envs * env.cfg.decimation / physics_s),
        "physics_share": round(physics_s * steps / total_s, 4),
        "task_share": round((collect_s - physics_s * steps) / total_s, 4),
        "learning_share": round(learn_s / total_s, 4),
        "peak_memory_mb": round(peak_memory_mb(device)),
        "task": TASKS[options.task] + (" with simple contacts" if options.simple_contacts else ""),
        "policy_rate_hz": round(1.0 / env.step_dt, 3),
        "steps_per_iteration": steps,
        "epochs": algorithm["num_learning_epochs"],
        "mini_batches": algorithm["num_mini_batches"],
        "warm_up_iterations": options.warm_up,
        "iterations_timed": len(times),
        "cuda_graph": env.sim.use_cuda_graph,
        "seconds_to_start": round(ready - start, 1),
        "versions": {name: version(name) for name in ("mjlab", "mujoco-warp", "warp-lang", "rsl-rl-lib", "torch")},
    }
    env.close()
    return result


def make_runner(options: argparse.Namespace, n_envs: int) -> Any:
    """As mjlab's own training script makes it, without log folder and upload."""
    import mjlab.tasks  # noqa: F401  # fills the registry
    import warp
    from mjlab.envs import ManagerBasedRlEnv
    from mjlab.rl import MjlabOnPolicyRunner, RslRlVecEnvWrapper
    from mjlab.tasks.registry import load_env_cfg, load_rl_cfg
    from mjlab.utils.torch import configure_torch_backends

    warp.config.quiet = True
    configure_torch_backends()
    config = load_env_cfg(TASKS[options.task])
    agent = load_rl_cfg(TASKS[options.task])
    config.scene.num_envs = n_envs
    config.seed = agent.seed
    if options.simple_contacts:
        simplify_contacts(config)
    env = RslRlVecEnvWrapper(ManagerBasedRlEnv(cfg=config, device=options.device), clip_actions=agent.clip_actions)
    runner = MjlabOnPolicyRunner(env, asdict(agent), None, options.device)
    runner.alg.train_mode()
    return runner


def simplify_contacts(config: Any) -> None:
    """Pyramidal cone, feet with three contact dimensions in place of six."""
    config.sim.mujoco.cone = "pyramidal"
    config.sim.mujoco.impratio = 1.0
    for collision in config.scene.entities["robot"].collisions:
        if isinstance(collision.condim, dict):
            collision.condim = {pattern: min(value, 3) for pattern, value in collision.condim.items()}


def iterate(runner: Any, device: str) -> tuple[float, float]:
    """One iteration; seconds of collecting and of learning."""
    observations = runner.env.get_observations()
    start = now(device)
    with torch.inference_mode():
        for _ in range(runner.cfg["num_steps_per_env"]):
            actions = runner.alg.act(observations)
            observations, rewards, dones, extras = runner.env.step(actions)
            runner.alg.process_env_step(observations, rewards, dones, extras)
        collected = now(device)
        runner.alg.compute_returns(observations)
    runner.alg.update()
    return collected - start, now(device) - collected


def seconds_of_physics(env: Any, device: str, n: int = 20) -> float:
    """Seconds of one policy period of physics alone, from where training stands."""
    with torch.inference_mode():
        start = now(device)
        for _ in range(n * env.cfg.decimation):
            env.sim.step()
        return (now(device) - start) / n


def now(device: str) -> float:
    """Wall clock, once the device is done."""
    if device != "cpu":
        torch.cuda.synchronize(device)
    return time.perf_counter()


def peak_memory_mb(device: str) -> float:
    """Of the process on a CPU, of the whole GPU otherwise."""
    if device == "cpu":
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    free, total = torch.cuda.mem_get_info(device)
    return float((total - free) / 2**20)


def free_memory(device: str) -> None:
    """Give back what one size took, so that the next one's figure holds its own memory alone."""
    gc.collect()
    if device == "cpu":
        return
    import warp

    warp.set_mempool_release_threshold(device, 0)
    torch.cuda.empty_cache()
    torch.cuda.synchronize(device)


if __name__ == "__main__":
    main()
