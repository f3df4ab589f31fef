"""The gate of the safety core: every line and branch is run by its own tests; and, unless told otherwise, mutants.

python scripts/check_safety.py               coverage, then as many mutants as a minute and a half allow
python scripts/check_safety.py --coverage    coverage alone
python scripts/check_safety.py --all         coverage, then every mutant
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from safety_core import CORE, TESTS

REPOSITORY = Path(__file__).resolve().parent.parent


BUDGET_S = 90


def coverage() -> list[str]:
    """Run the core's tests under coverage; what no test reaches, in words."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "coverage.json"
        sources = [f"--cov={Path(file).with_suffix('').as_posix().replace('/', '.')}" for file in CORE]
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "--cov-branch"]
        command += [*sources, f"--cov-report=json:{report}", "--cov-report=", *TESTS]
        environment = {**os.environ, "COVERAGE_FILE": str(Path(folder) / "data")}
        done = subprocess.run(command, cwd=REPOSITORY, env=environment, capture_output=True, text=True, check=False)
        if done.returncode or not report.is_file():
            return [f"the tests of the safety core fail:\n{done.stdout[-3000:]}{done.stderr[-1000:]}"]
        files = json.loads(report.read_text(encoding="utf-8"))["files"]
    problems = [f"{file}: no test imports it" for file in CORE if file not in files]
    for file in CORE:
        found = files.get(file, {})
        lines, branches = found.get("missing_lines", []), found.get("missing_branches", [])
        if lines or branches:
            problems.append(f"{file}: lines {lines} and branches {branches} are never run")
    return problems


def main() -> None:
    """Check, and exit with what is missing."""
    problems = coverage()
    if problems:
        raise SystemExit("\n".join(problems))
    print(f"safety core: {len(CORE)} files, every line and branch is run by their tests")
    if "--coverage" in sys.argv[1:]:
        return
    words = [] if "--all" in sys.argv[1:] else ["--budget-s", str(BUDGET_S)]
    command = [sys.executable, "scripts/mutation.py", *words]
    raise SystemExit(subprocess.run(command, cwd=REPOSITORY, check=False).returncode)


if __name__ == "__main__":
    main()
