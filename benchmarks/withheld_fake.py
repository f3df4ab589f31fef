"""The default fake robot, recorded by ``spot-rl collect`` and diagnosed against its own true model: no gap is right.

    python benchmarks/withheld_fake.py --work DIR [--policy policies/baseline.onnx] [--repeats 3]

Leaves logs and verdict in DIR, prints what was said, and exits with 1 where anything but ``no_gap`` was.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Final

sys.path.insert(0, str(Path(__file__).resolve().parent))

from diagnose_fake import _environment, diagnose, nominal_file, sequences

from fake_robot.start.process import FakeProcess
from spot_model.io.velocity_sequence import save_sequence

COMMAND: Final = "from spot_model.io.command_line import main; main()"


def record(folder: Path, policy: Path, repeats: int) -> None:
    """Collect three sequences on the fake robot as it starts without a scenario."""
    names = []
    for sequence in sequences():
        path = folder / f"{sequence.name}.yaml"
        if not path.exists():
            save_sequence(sequence, path)
        names.append(str(path))
    with FakeProcess(is_lock_step=True) as fake:
        words = ["collect", "--robot", fake.address.robot, "--policy", str(policy), "--out", str(folder / "logs")]
        words += ["--sequences", ",".join(names), "--repeats", str(repeats), "--lock-step", fake.address.admin]
        subprocess.run([sys.executable, "-c", COMMAND, *words], env=_environment(fake.address), check=True)  # noqa: S603 - our own command


def main() -> int:
    """Record, diagnose and judge."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--policy", type=Path, default=Path("policies/baseline.onnx"))
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    given.work.mkdir(parents=True, exist_ok=True)
    record(given.work, given.policy, given.repeats)
    took_s = diagnose(given.work, nominal_file(given.work), given.policy, [])
    verdict = json.loads((given.work / "diagnosis" / "verdict.json").read_text(encoding="utf-8"))
    named = ", ".join(f"{e['name']} {e['probability']:.2f}" for e in verdict["effects"]) or "nothing"
    print(f"{verdict['status']}, P(no gap) {verdict['probability_none']:.2f}; listed: {named}; {took_s:.0f} s")
    return int(verdict["status"] != "no_gap")


if __name__ == "__main__":
    sys.exit(main())
