"""Hide slow motors in the fake robot, walk it once, ask what to record next, record it, and diagnose both logs.

python examples/record_more.py OUT [FAULT]
"""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from argparse import ArgumentParser
from pathlib import Path
from typing import Any, Final

import spot_rl
from diagnosis.document import Verdict
from spot_model.io.model_file import save_model

POLICY: Final = "walk"
ROTORS: Final = (
    {"effect": "armature", "joints": ["hips"], "inertia_kg_m2": 0.0403},
    {"effect": "armature", "joints": ["knees"], "inertia_kg_m2": 0.0731},
)
HIDDEN: Final[dict[str, dict[str, Any]]] = {
    "torque_bandwidth": {"effect": "torque_bandwidth", "joints": ["all"], "time_constant_s": 0.008},
    "backlash": {"effect": "backlash", "joints": ["fr_kn"], "gap_rad": 0.03},
    "knee_spring": {"effect": "joint_compliance", "joints": ["knees"], "compliance_rad_per_nm": 0.002},
}


def main(out: Path, fault: str) -> None:
    """Walk, diagnose, ask, record, diagnose."""
    out.mkdir(parents=True)
    save_model(spot_rl.load_model("paper_identified", effects=ROTORS), out / "nominal.yaml")
    with spot_rl.FakeSpot(model=spot_rl.load_model("paper_identified", effects=[HIDDEN[fault]])) as spot:
        spot.walk(POLICY, velocity=(0.5, 0.0, 0.0), duration_s=5.0, log_dir=out / "logs")
        tell("one walk", spot_rl.diagnose(out / "logs", out / "nominal.yaml", out / "first", policy=POLICY))
        menu = spot_rl.next_experiment(out / "first", policy=POLICY)
        if menu["best"] is None:
            print(f"nothing worth running: {menu['nothing']}")
            return
        print(f"recording {menu['best']}; page: {menu['page']}")
        words = shlex.split(menu["commands"][0])[1:]
        places = {"MORE_LOGS": str(out / "more"), "HOST": spot.address}
        run = [sys.executable, "-m", "spot_model", *(places.get(w, w) for w in words), "--lock-step", spot.admin]
        subprocess.run(run, env={**os.environ, **spot.environment}, check=True)  # noqa: S603 - our own command
    logs = [out / "logs", out / "more"]
    tell("both logs", spot_rl.diagnose(logs, out / "nominal.yaml", out / "second", policy=POLICY))


def tell(what: str, verdict: Verdict) -> None:
    """Print the numbers of all differences."""
    print(f"{what}: {verdict.headline}")
    for d in verdict.differences:
        numbers = (f"{name} {p.value:.4g} ± {0.5 * (p.high - p.low):.2g} {p.unit}" for name, p in d.parameters.items())
        print(f"  {d.title}, P {d.probability:.2f}: {', '.join(numbers)}")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path, nargs="?", default=Path("more"))
    parser.add_argument("fault", choices=HIDDEN, nargs="?", default="torque_bandwidth")
    given = parser.parse_args()
    main(given.out, given.fault)
