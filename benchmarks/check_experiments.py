"""Every experiment that may be proposed, on robots drawn from wide errors: none falls, none exceeds a limit.

    python benchmarks/check_experiments.py --policy walk --out experiments.json [--figure experiments.svg]

Each robot is the paper's identified model with rotor inertia, and ordinary errors of twice the published ranges. Each
kind of experiment is run as first proposed, and with ``--bounds`` also with the most that its bounds allow; one that
the safety check refuses counts as refused, and is never run on a robot.
"""

from __future__ import annotations

import json
import sys
import time
from argparse import ArgumentParser
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from diagnosis.next.candidates import HEAT, candidates
from diagnosis.next.robots import compact, with_ordinary_errors
from diagnosis.next.trial import STAND_S, burden, refusals, try_on
from spot_log.read.run import Run
from spot_model.effects.friction import Armature
from spot_model.io.model_file import load_model
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from spot_model.robot.rotation import tilt_rad

WIDE = 2.0
SUSPECTS = ("fl_kn", "hr_hy", "hl_hx")


def tilts_deg(runs: Sequence[Run]) -> list[float]:
    """Largest tilt of each robot, degrees."""
    out = []
    for run in runs:
        s = run.states
        rows = s.robot_stamp_ns >= s.robot_stamp_ns[0] + round(0.5 * STAND_S * 1e9)
        out.append(float(np.degrees(tilt_rad(s.odom_from_body_wxyz[rows])).max()))
    return out


def main(arguments: Sequence[str]) -> None:
    """Run what is missing, print a line each, draw."""
    parser = ArgumentParser(description=__doc__)
    parser.add_argument("--policy", type=policy_file, required=True)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--figure", type=Path)
    parser.add_argument("--robots", type=int, default=50)
    parser.add_argument("--bounds", action="store_true")
    parser.add_argument("--only", default="", help="A part of the names of the experiments to run.")
    parser.add_argument("--once", action="store_true", help="Run one experiment, then stop; may be repeated.")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args(arguments)
    policy = load_policy(given.policy)
    rng = np.random.default_rng(given.seed)
    rotors = (
        Armature(joints=("hips",), inertia_kg_m2=facts.HIP_ARMATURE_KG_M2),
        Armature(joints=("knees",), inertia_kg_m2=facts.KNEE_ARMATURE_KG_M2),
    )
    nominal = load_model("paper_identified").with_effects(*rotors)
    models = [compact(with_ordinary_errors(nominal, rng, WIDE)) for _ in range(given.robots)]
    rows: dict[str, Any] = json.loads(given.out.read_text()) if given.out.exists() else {}
    for candidate in candidates(policy.contract, SUSPECTS, (HEAT,))[::-1]:
        most = {n: free.high for n, free in candidate.free.items()}
        sizes = {"as proposed": candidate, "at its bounds": replace(candidate, values=most)}
        for words, chosen in list(sizes.items())[: 2 if given.bounds else 1]:
            row = rows.setdefault(f"{candidate.name}, {words}", {"refused": [], "tilts_deg": []})
            if row["tilts_deg"] or given.only not in candidate.name:
                continue
            began_s = time.monotonic()
            runs = try_on(chosen.motion(), models, policy, np.random.default_rng(given.seed))
            row |= {"refused": refusals(runs), "tilts_deg": tilts_deg(runs), "loads": burden(runs)}
            given.out.write_text(json.dumps(rows))
            told = "; ".join(row["refused"]) or f"borne by all, {max(row['tilts_deg']):.0f} degrees of lean at most"
            seconds = time.monotonic() - began_s
            print(f"{candidate.name}, {words}: {told}; {row['loads']}; {seconds:.0f} s", flush=True)
            if given.once:
                return
    rows = {name: row for name, row in rows.items() if row["tilts_deg"]}
    borne = sum(not row["refused"] for row in rows.values())
    print(f"{borne} of {len(rows)} borne by all {given.robots} robots; the others are refused before they run")
    if given.figure is not None:
        given.figure.write_text(figure(rows))


def figure(rows: dict[str, Any]) -> str:
    """Largest tilts of all robots, a line an experiment; refused ones in red."""
    height = 22 * len(rows) + 50
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 760 {height}' font-family='sans-serif' font-size='12'>",
        f"<rect width='760' height='{height}' fill='white'/>",
    ]
    for number, (name, row) in enumerate(rows.items()):
        y, colour = 22 * number + 20, "#c0392b" if row["refused"] else "#2c6fbb"
        parts.append(f"<text x='230' y='{y + 4}' text-anchor='end'>{name}</text>")
        points = [
            f"<circle cx='{240 + 12 * min(t, 40.0):.1f}' cy='{y}' r='3' fill='{colour}' fill-opacity='0.4'/>"
            for t in row["tilts_deg"]
        ]
        parts += points
    base = 22 * len(rows) + 20
    for t in range(0, 41, 10):
        parts.append(f"<text x='{240 + 12 * t}' y='{base + 12}' text-anchor='middle'>{t}°</text>")
    parts.append(
        f"<text x='480' y='{base + 27}' text-anchor='middle'>largest tilt of the body, 40° and more at 40°</text>"
    )
    return "\n".join([*parts, "</svg>\n"])


if __name__ == "__main__":
    main(sys.argv[1:])
