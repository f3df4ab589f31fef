"""The default fake robot, recorded by ``spot-rl collect`` and diagnosed against its true model: no difference is right.

    python lab/benchmarks/withheld_fake.py --work DIR [--policy baseline] [--repeats 3]

Leaves logs and verdict in DIR, prints what was said, and exits with 1 where a difference or something unknown was.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from spot_model.policy.built_in import policy_file

sys.path.insert(0, str(Path(__file__).resolve().parent))

from diagnose_fake import collect, diagnose, nominal_file


def main() -> int:
    """Record, diagnose and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--policy", type=policy_file, default="baseline")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    collect("default", given.work, given.policy, given.repeats)
    took_s = diagnose(given.work, nominal_file(given.work), given.policy, [])
    verdict = json.loads((given.work / "diagnosis" / "verdict.json").read_text(encoding="utf-8"))
    named = ", ".join(f"{e['name']} {e['probability']:.2f}" for e in verdict["differences"]) or "nothing"
    print(f"{verdict['status']}, P(none) {verdict['probability_none']:.2f}; listed: {named}; {took_s:.0f} s")
    return int(verdict["status"] not in ("no_gap", "calibration"))


if __name__ == "__main__":
    sys.exit(main())
