"""Numbers behind the diagnosis' probabilities, learned from planted logs: none, each effect, and each left out.

Every planted reality is explained with the whole library and with its effect left out. From the first come the
threshold (none) and the share of right answers; from the second the predictable share of what is left when the effect
is unknown to the library. Writes the calibrator with ``--write``.

    python benchmarks/calibrate_diagnosis.py --policy policies/baseline.onnx --out calibration_runs.json [--write]
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any, Final

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from diagnosis.diagnose import explain
from diagnosis.library.registry import LIBRARY
from diagnosis.posterior import FILE, Calibration
from spot_model.effects.registry import make_effect
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy
from tests.diagnosis.planted import Truth, planted_runs
from tests.diagnosis.scripted_gait import ScriptedGait

NONES: Final = 3
REALITIES: Final[tuple[dict[str, Any], ...]] = (
    {"effect": "coulomb_friction", "joints": ["knees"], "level_nm": 2.0},
    {"effect": "viscous_friction", "joints": ["hy"], "damping_nm_s_per_rad": 0.5},
    {"effect": "load_friction", "joints": ["all"], "share": 0.15},
    {"effect": "torque_gain", "joints": ["fl"], "gain": 0.85},
    {"effect": "torque_limit", "joints": ["knees"], "limit_nm": 30.0},
    {"effect": "armature", "joints": ["all"], "inertia_kg_m2": 0.04},
    {"effect": "torque_bandwidth", "joints": ["all"], "time_constant_s": 0.012},
    {"effect": "torque_ripple", "joints": ["fl_hy"], "amplitude_nm": 2.5, "cycles_per_rad": 12.0},
    {"effect": "backlash", "joints": ["fr_kn"], "gap_rad": 0.02},
    {"effect": "payload_mass", "joints": ["all"], "mass_kg": 6.0},
)


def main() -> None:
    """Make logs, explain them, fit the calibrator."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--policy", type=Path, default=None, help="without it a scripted gait")
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--write", action="store_true")
    given = parser.parse_args()
    policy = load_policy(given.policy) if given.policy else None
    actor = (lambda: policy) if policy is not None else ScriptedGait
    nominal = RobotModel()
    calibration = Calibration.load()
    table: list[dict[str, Any]] = []
    cases: list[dict[str, Any] | None] = [None] * NONES + list(REALITIES)
    for number, case in enumerate(cases):
        effects = (
            () if case is None else (make_effect(case["effect"], {k: v for k, v in case.items() if k != "effect"}),)
        )
        runs = planted_runs(Truth(effects=effects), given.runs, seed=100 + number, actor=actor)
        for left_out in (False, True) if case is not None else (False,):
            library = {n: e for n, e in LIBRARY.items() if not (left_out and case is not None and n == case["effect"])}
            found = explain(runs, nominal, None, library, calibration, lambda _: None)
            best = found.selection.best
            table.append({
                "truth": case["effect"] if case else "none", "left_out": left_out,
                "found": [t.effect.name for t in best.terms] if best else [],
                "top_nats": found.selection.first[0].value if found.selection.first else 0.0,
                "left_nats": found.left.total_nats, "explained_nats": found.left.explained_nats,
            })  # fmt: skip
            print(table[-1], flush=True)
            given.out.write_text(json.dumps(table, indent=1))
    if given.write:
        _write(table)


def _write(table: list[dict[str, Any]]) -> None:
    """Threshold above all nones; the usual remainder between known and unknown."""
    data = json.loads(FILE.read_text())
    none = [r["top_nats"] for r in table if r["truth"] == "none"]
    known = np.array([r["left_nats"] / (1.0 + r["explained_nats"]) for r in table if not r["left_out"]])
    missing = np.array([r["left_nats"] / (1.0 + r["explained_nats"]) for r in table if r["left_out"]])
    data["threshold_nats"] = max(10.0, 1.3 * max(none, default=0.0))
    data["unknown_share"] = float(0.5 * (np.quantile(known, 0.9) + np.median(missing)))
    data["made_by"] = "python benchmarks/calibrate_diagnosis.py --out calibration_runs.json --write"
    FILE.write_text(json.dumps(data, indent=2) + "\n")


if __name__ == "__main__":
    main()
