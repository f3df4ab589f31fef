"""What a diagnosis costs: CPU seconds, wall time and peak memory of the whole command, in a process of its own.

The fake robot, with dry friction in its knees, walks N logs of S seconds in lock-step; the nominal model knows of none.
``--beside TREE`` runs another checkout's code on the same logs, in turns.

    python lab/benchmarks/diagnosis_cost.py --work DIR --logs 15 --seconds 8 --beside ../other-checkout
"""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import time
from pathlib import Path
from typing import Final

import spot_rl
from spot_model.io.model_file import save_model
from spot_model.policy.built_in import policy_file

POLICY: Final = "walk"
WALKS: Final = ((0.4, 0.0, 0.0), (0.9, 0.0, 0.0), (0.5, 0.0, 0.6), (0.0, 0.0, 0.5), (0.7, 0.2, 0.0))
ROTORS: Final = (
    {"effect": "armature", "joints": ["hips"], "inertia_kg_m2": 0.0403},
    {"effect": "armature", "joints": ["knees"], "inertia_kg_m2": 0.0731},
)
HIDDEN: Final = ({"effect": "coulomb_friction", "joints": ["knees"], "level_nm": 5.0},)


def record(work: Path, n_logs: int, seconds: float) -> None:
    """Walk the logs, unless they are there already."""
    if (work / "nominal.yaml").exists():
        return
    with spot_rl.FakeSpot(model=spot_rl.load_model("paper_identified", effects=HIDDEN)) as spot:
        for k in range(n_logs):
            spot.walk(POLICY, velocity=WALKS[k % len(WALKS)], duration_s=seconds, log_dir=work / "logs")
    save_model(spot_rl.load_model("paper_identified", effects=ROTORS), work / "nominal.yaml")


def cost(tree: Path, work: Path, out: Path) -> tuple[float, float, float]:
    """CPU seconds, wall seconds and peak memory (MB) of one diagnosis by the code of ``tree``."""
    words = ["diagnose", str(work / "logs"), "--nominal", str(work / "nominal.yaml"), "--out", str(out)]
    words += ["--policy", str(policy_file(POLICY))]
    words = [sys.executable, "-c", "from spot_model.__main__ import main; main()", *words]
    start = time.monotonic()
    with out.with_suffix(".log").open("w") as told:
        child = subprocess.Popen(words, cwd=tree, env={**os.environ, "PYTHONPATH": str(tree)}, stderr=told, stdout=told)  # noqa: S603
        _, status, used = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(f"the diagnosis by {tree} failed; see {told.name}")
    return used.ru_utime + used.ru_stime, time.monotonic() - start, used.ru_maxrss / 1024


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--work", type=Path, required=True, help="Folder of logs and results; logs there are used again."
    )
    parser.add_argument("--logs", type=int, default=15, help="Number of logs.")
    parser.add_argument("--seconds", type=float, default=8.0, help="Length of each.")
    parser.add_argument("--beside", type=Path, action="append", default=[], help="Another checkout; repeatable.")
    given = parser.parse_args()
    record(given.work.absolute(), given.logs, given.seconds)
    print(f"{platform.node()}, {os.cpu_count()} cores; {given.logs} logs of {given.seconds:g} s")
    print(f"{'tree':<32}{'CPU s':>8}{'wall s':>8}{'peak MB':>9}")
    for tree in (Path(__file__).absolute().parents[2], *(other.absolute() for other in given.beside)):
        found = cost(tree, given.work.absolute(), given.work.absolute() / f"{tree.name}-{time.time_ns()}")
        print(f"{tree.name:<32}{found[0]:8.1f}{found[1]:8.1f}{found[2]:9.0f}", flush=True)
