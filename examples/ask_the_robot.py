"""Hide slow motors in the fake robot, walk it once, and let the diagnosis ask for what it needs to name them.

    python examples/ask_the_robot.py asked [FAULT]

One walk of five seconds leaves several causes possible. ``spot-rl diagnose next --run`` diagnoses it, chooses
experiments, runs them on the robot, and ends where one cause stands; ``OUT/found/asked/story.html`` tells how.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from argparse import ArgumentParser
from pathlib import Path
from typing import Any, Final

import spot_rl
from spot_model.io.model_file import save_model

POLICY: Final = "walk"
ROTORS: Final = (
    {"effect": "armature", "joints": ["hips"], "inertia_kg_m2": 0.0403},
    {"effect": "armature", "joints": ["knees"], "inertia_kg_m2": 0.0731},
)
HIDDEN: Final[dict[str, dict[str, Any]]] = {
    "torque_bandwidth": {"effect": "torque_bandwidth", "joints": ["all"], "time_constant_s": 0.008},
    "command_delay": {"effect": "command_delay", "joints": ["all"], "delay_s": 0.008},
    "backlash": {"effect": "backlash", "joints": ["fr_kn"], "gap_rad": 0.03},
    "knee_spring": {"effect": "joint_compliance", "joints": ["knees"], "compliance_rad_per_nm": 0.002},
    "slippery": {"effect": "ground_friction", "joints": ["all"], "scale": 0.5},
    "soft_ground": {"effect": "ground_compliance", "joints": ["all"]},
}


def main(out: Path, fault: str) -> None:
    """Walk once, then one command."""
    hidden = spot_rl.load_model("paper_identified", effects=[HIDDEN[fault]])
    out.mkdir(parents=True)
    save_model(spot_rl.load_model("paper_identified", effects=ROTORS), out / "nominal.yaml")
    with spot_rl.FakeSpot(model=hidden) as spot:
        spot.walk(POLICY, velocity=(0.5, 0.0, 0.0), duration_s=5.0, log_dir=out / "logs")
        words = ["diagnose", "next", str(out / "found"), "--logs", str(out / "logs"), "--nominal"]
        words += [str(out / "nominal.yaml"), "--policy", POLICY, "--run", "--yes", "--robot", spot.address]
        words += ["--lock-step", spot.admin]
        began_s = time.monotonic()
        command, environment = [sys.executable, "-m", "spot_model", *words], {**os.environ, **spot.environment}
        subprocess.run(command, env=environment, check=True)  # noqa: S603 - our own command
    print(f"hidden: {HIDDEN[fault]}; {time.monotonic() - began_s:.0f} s")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, nargs="?", default=Path("asked"))
    parser.add_argument("fault", choices=HIDDEN, nargs="?", default="torque_bandwidth")
    given = parser.parse_args()
    main(given.out, given.fault)
