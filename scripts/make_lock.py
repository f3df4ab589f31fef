"""Write requirements.lock: every package, direct or not, at the version that resolves today, as a constraints file.

The full set (extras all and dev) is resolved for the running Python; the runtime extra also for Python 3.10 and 3.12 on
x86-64 and aarch64, from wheels alone. Where a Python needs another version, the line carries a marker. pip reads the
markers of a package's own requirements for the running Python, also when it resolves for another; those of this
project are read here.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from pathlib import Path

import tomllib
from packaging.requirements import Requirement

REPOSITORY = Path(__file__).resolve().parent.parent
LOCK = REPOSITORY / "requirements.lock"
MACHINES = ("x86_64", "aarch64")
GLIBC = ("manylinux_2_28", "manylinux_2_27", "manylinux_2_17", "manylinux2014")
HEADER = """\
# Every package at the version that the project was tested with; written by 'make lock'. Use it as constraints:
#   pip install -c requirements.lock -e '.[all,dev]'
"""

Versions = dict[str, str]


def resolve(requirements: list[str], *options: str) -> Versions:
    """Return what pip would install: version by normalised name, without local version labels."""
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.json"
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed"]
        command += ["--no-build-isolation", "--report", str(report), *options, *requirements]
        subprocess.run(command, check=True)
        packages = [item["metadata"] for item in json.loads(report.read_text(encoding="utf-8"))["install"]]
    names = {package["name"].lower().replace("_", "-"): package["version"] for package in packages}
    return {name: version.partition("+")[0] for name, version in names.items() if name != "spot-rl"}


def runtime_requirements(python: str) -> list[str]:
    """Return the exact requirements of the runtime extra that hold for ``python``, such as "3.10"."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    stated = [Requirement(line) for line in project["dependencies"] + project["optional-dependencies"]["runtime"]]
    environment = {"python_version": python, "python_full_version": f"{python}.0"}
    return [f"{r.name}{r.specifier}" for r in stated if r.marker is None or r.marker.evaluate(environment)]


def resolve_runtime(python: str) -> Versions:
    """Resolve the runtime extra for another Python from wheels; both machines must agree."""
    found = []
    for machine in MACHINES:
        platforms = [word for glibc in GLIBC for word in ("--platform", f"{glibc}_{machine}")]
        target = ["--only-binary=:all:", "--python-version", python, "--target", "unused"]
        found.append(resolve(runtime_requirements(python), *target, *platforms))
    if found[0] != found[1]:
        differences = sorted(found[0].items() ^ found[1].items())
        raise SystemExit(f"Python {python}: the wheels of {' and '.join(MACHINES)} differ: {differences}")
    return found[0]


def lock_lines(base: Versions, old: Versions) -> list[str]:
    """Merge the base resolution (Python 3.11 and later) with that of Python 3.10."""
    lines = []
    for name in sorted(base.keys() | old.keys()):
        new_version, old_version = base.get(name), old.get(name)
        if new_version is None:
            lines.append(f'{name}=={old_version}; python_version < "3.11"')
        elif old_version in (None, new_version):
            lines.append(f"{name}=={new_version}")
        else:
            lines.append(f'{name}=={new_version}; python_version >= "3.11"')
            lines.append(f'{name}=={old_version}; python_version < "3.11"')
    return lines


def main() -> None:
    base = resolve([f"{REPOSITORY}[all,dev]"])
    for name, version in resolve_runtime("3.12").items():
        if base.get(name) != version:
            raise SystemExit(f"{name}: {version} on Python 3.12, {base.get(name)} here; pin it in pyproject.toml")
    lines = lock_lines(base, resolve_runtime("3.10"))
    LOCK.write_text(HEADER + "\n".join(lines) + "\n", encoding="utf-8")
    print(f"wrote {LOCK.name}: {len(lines)} lines")


if __name__ == "__main__":
    main()
