"""The gate of the safety core: every line and branch is run by its own tests; and, unless told otherwise, mutants.

python scripts/check_safety.py               coverage, then as many mutants as a minute and a half allow
python scripts/check_safety.py --coverage    coverage alone
python scripts/check_safety.py --all         coverage, then every mutant
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from mutants import mutants_of
from mutation import durations, try_mutants
from safety_core import CORE, TESTS

BUDGET_S = 90


def covered() -> tuple[list[str], dict[str, float]]:
    """Run the core's tests under coverage; what no test reaches, in words, and how long each test takes, s."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "coverage.json"
        sources = [f"--cov={Path(file).with_suffix('').as_posix().replace('/', '.')}" for file in CORE]
        took_s = durations(TESTS, "--cov-branch", *sources, f"--cov-report=json:{report}", "--cov-report=")
        files = json.loads(report.read_text(encoding="utf-8"))["files"]
    problems = [f"{file}: no test imports it" for file in CORE if file not in files]
    for file in CORE:
        found = files.get(file, {})
        lines, branches = found.get("missing_lines", []), found.get("missing_branches", [])
        if lines or branches:
            problems.append(f"{file}: lines {lines} and branches {branches} are never run")
    return problems, took_s


def main() -> None:
    """Check, and exit with what is missing."""
    problems, took_s = covered()
    if problems:
        raise SystemExit("\n".join(problems))
    print(f"safety core: {len(CORE)} files, every line and branch is run by their tests")
    if "--coverage" not in sys.argv[1:]:
        mutants = [mutant for file in CORE for mutant in mutants_of(file)]
        try_mutants(mutants, took_s, float("inf") if "--all" in sys.argv[1:] else BUDGET_S)


if __name__ == "__main__":
    main()
