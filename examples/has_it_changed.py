"""Has my robot changed? Five weeks of a fake robot, each diagnosed against the week before, and their page.

    python examples/has_it_changed.py changed [--weeks 5] [--repeats 3] [--seed 1]

About ten minutes on two idle cores. In the third week a knee has worn, and is mended by the fifth; in the fourth a
payload was left on. The robot's own numbers are drawn from the seed. The page is OUT/history/history.html.
"""

from __future__ import annotations

import os
import subprocess
import sys
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from pathlib import Path
from typing import Any, Final

import numpy as np

import spot_rl
from fake_robot.scenario.scenario import load_scenario
from spot_model.robot.facts import JOINT_NAMES

POLICY: Final = "walk"
WALKS: Final = ((0.5, 0.0, 0.0), (1.2, 0.0, 0.0), (-0.3, 0.3, 0.4))
FIRST_DAY: Final = np.datetime64("2026-10-29")
WORN: Final = {"effect": "coulomb_friction", "joints": ["fr_kn"], "level_nm": 2.0}
WEEKS: Final[tuple[dict[str, Any], ...]] = (
    {"what": "as delivered"},
    {"what": "nothing has changed"},
    {"what": "a knee has worn", "effects": [WORN]},
    {"what": "a payload was left on", "effects": [WORN], "payload": {"mass_kg": 4.0}},
    {"what": "the knee is mended, the payload gone"},
)


def own_numbers(seed: int) -> list[dict[str, Any]]:
    """What every robot has by itself: gains and zeros that are a few per cent off."""
    rng = np.random.default_rng(seed)
    gains = [{"effect": "torque_gain", "joints": [kind], "gain": rng.normal(1.0, 0.04)} for kind in ("hx", "hy", "kn")]
    joints = rng.choice(JOINT_NAMES, 3, replace=False).tolist()
    zeros = [{"effect": "encoder_offset", "joints": [j], "offset_rad": rng.normal(0.0, 0.004)} for j in joints]
    return [*gains, {"effect": "leg_mass", "joints": ["all"], "scale": rng.normal(1.0, 0.03)}, *zeros]


def record(week: int, seed: int, repeats: int, logs: Path) -> None:
    """Walk the robot as it is in a week."""
    given = WEEKS[week]
    scenario = load_scenario("default").to_data()
    scenario["model"]["effects"] += [*own_numbers(seed), *given.get("effects", [])]
    scenario |= {"payload": given.get("payload", {"mass_kg": 0.0}), "seed": 1000 * seed + week}
    with spot_rl.FakeSpot(scenario) as spot:
        for velocity in WALKS:
            for _ in range(repeats):
                spot.walk(POLICY, velocity=velocity, duration_s=5.0, log_dir=logs)


def main(out: Path, weeks: int, repeats: int, seed: int) -> None:
    """Record and diagnose week by week; a week whose logs or diagnosis are there is not done again."""
    for week in range(weeks):
        # The fake's logs are all of today; the name of the folder says which date they stand for.
        date, logs = out / "history" / str(FIRST_DAY + 7 * week), out / f"week-{week + 1}"
        print(f"{date.name}: {WEEKS[week]['what']}", flush=True)
        if not logs.exists():
            record(week, seed, repeats, logs)
        if not date.exists():
            words = ["diagnose", str(logs), "--history", str(date.parent), "--out", str(date), "--policy", POLICY]
            words += [] if week else ["--nominal", "paper_identified"]
            # A terminal shows the same, without "python -m spot_model": spot-rl diagnose LOGS --history HISTORY
            subprocess.run([sys.executable, "-m", "spot_model", *words], env={**os.environ}, check=True)  # noqa: S603
    print(f"page: {out / 'history' / 'history.html'}")


if __name__ == "__main__":
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("out", nargs="?", type=Path, default=Path("changed"), help="folder of logs and history")
    parser.add_argument("--weeks", type=int, choices=range(1, len(WEEKS) + 1), default=len(WEEKS))
    parser.add_argument("--repeats", type=int, default=3, help="runs of each walk in a week")
    parser.add_argument("--seed", type=int, default=1, help="of the robot's own numbers")
    given = parser.parse_args()
    main(given.out, given.weeks, given.repeats, given.seed)
