"""How fast the CPU plant steps; prints one JSON object.

Claim: the servo law and the paper's effects at every physics step cost little beside MuJoCo's own step, and one
simulation stays under 100 µs a step.

    python lab/benchmarks/plant_speed.py --threads 2
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable

import mujoco
import numpy as np
from mujoco.batch import Batch

from spot_model.io.model_file import load_model
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions, spot_mjcf

SUBSTEPS = 4
"""Physics steps a control period: 20 ms of 5 ms steps."""


def seconds_a_period(period: Callable[[], None], budget_s: float) -> float:
    """Median of five timings of one control period, after a warm-up."""
    period()
    start = time.perf_counter()
    period()
    n = max(3, int(budget_s / 5 / max(time.perf_counter() - start, 1e-6)))
    times = []
    for _ in range(5):
        start = time.perf_counter()
        for _ in range(n):
            period()
        times.append((time.perf_counter() - start) / n)
    return float(np.median(times))


def bare_period(n_sims: int, n_threads: int, mjcf: MjcfOptions) -> Callable[[], None]:
    """MuJoCo alone, with a PD law in one line."""
    model = mujoco.MjModel.from_xml_string(spot_mjcf(mjcf))
    batch = Batch(model, n_sims, nthread=n_threads)
    batch.reset(keyframe=0)
    qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")

    def period() -> None:
        for _ in range(SUBSTEPS):
            ctrl[:] = 60.0 * (facts.DEFAULT_POSITION_RAD - qpos[:, 7:]) - 1.5 * qvel[:, 6:]
            batch.step()

    return period


def plant_period(n_sims: int, n_threads: int, model: str, mjcf: MjcfOptions) -> Callable[[], None]:
    """The plant with a built-in model's effects."""
    plant = Plant(load_model(model).effects, n_sims, PlantOptions(mjcf, n_threads=n_threads))
    setpoint = facts.DEFAULT_POSITION_RAD + np.random.default_rng(0).normal(0.0, 0.05, (n_sims, facts.N_JOINTS))
    return lambda: plant.step(setpoint, SUBSTEPS)


def main() -> None:
    """Time every case and print the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--sims", type=int, nargs="+", default=[256, 1024])
    parser.add_argument("--seconds", type=float, default=2.0, help="time spent on each figure")
    args = parser.parse_args()

    figures: dict[str, object] = {"mujoco": mujoco.__version__, "threads": args.threads}
    sensors = MjcfOptions(link_torque_sensors=True)
    for n in args.sims:
        cases = {
            "bare": bare_period(n, args.threads, MjcfOptions()),
            "plant_ideal": plant_period(n, args.threads, "ideal", MjcfOptions()),
            "plant_paper": plant_period(n, args.threads, "paper_identified", MjcfOptions()),
            "plant_paper_link_torque": plant_period(n, args.threads, "paper_identified", sensors),
        }
        for name, period in cases.items():
            figures[f"{name}_{n}_steps_per_s"] = round(n * SUBSTEPS / seconds_a_period(period, args.seconds))
    one = {
        "bare": bare_period(1, 1, MjcfOptions()),
        "plant_ideal": plant_period(1, 1, "ideal", MjcfOptions()),
        "plant_paper": plant_period(1, 1, "paper_identified", MjcfOptions()),
        "plant_paper_link_torque": plant_period(1, 1, "paper_identified", sensors),
    }
    for name, period in one.items():
        figures[f"{name}_1_us_per_step"] = round(seconds_a_period(period, args.seconds) / SUBSTEPS * 1e6, 1)
    print(json.dumps(figures, indent=2))


if __name__ == "__main__":
    main()
