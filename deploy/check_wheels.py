"""Prove against the package index that the runtime has a wheel of every package for each target, as recorded.

    python deploy/check_wheels.py            # compare with deploy/hashes/
    python deploy/check_wheels.py --write    # record anew, after a change of requirements.lock

Needs a network, and python3.10 and python3.12 on PATH; so it is no part of the tests.
"""

from __future__ import annotations

import sys

from wheel_targets import HASHES, MACHINES, PYTHONS, Wheel, hash_file, resolve

HEADER = """\
# Digests of the wheels for {machines}, Python {python}; written by deploy/check_wheels.py.
# pip refuses every other file: pip download --require-hashes --no-deps -r THIS
"""


def recorded_text(python: str, found: dict[str, list[Wheel]]) -> str:
    """A requirements file with a digest for each machine's wheel."""
    digests: dict[str, set[str]] = {}
    for wheels in found.values():
        for wheel in wheels:
            digests.setdefault(f"{wheel.name}=={wheel.version}", set()).add(wheel.sha256)
    lines = [HEADER.format(machines=" and ".join(MACHINES), python=python)]
    for name in sorted(digests):
        options = "".join(f" \\\n    --hash=sha256:{digest}" for digest in sorted(digests[name]))
        lines.append(f"{name}{options}\n")
    return "".join(lines)


def main() -> None:
    is_writing = sys.argv[1:] == ["--write"]
    HASHES.mkdir(exist_ok=True)
    differing = []
    for python in PYTHONS:
        found = {machine: resolve(python, machine) for machine in MACHINES}
        versions = {machine: [(w.name, w.version) for w in wheels] for machine, wheels in found.items()}
        if len({tuple(v) for v in versions.values()}) != 1:
            sys.exit(f"Python {python}: the versions differ between {' and '.join(MACHINES)}: {versions}")
        for machine, wheels in found.items():
            own = sum("none-any" not in wheel.file for wheel in wheels)
            print(f"Python {python} {machine}: {len(wheels)} wheels, {own} of them built for the machine")
        text, path = recorded_text(python, found), hash_file(python)
        if is_writing:
            path.write_text(text, encoding="utf-8")
        elif not path.is_file() or path.read_text(encoding="utf-8") != text:
            differing.append(path.name)
    if differing:
        sys.exit(
            f"deploy/hashes differs from the index in {', '.join(differing)}: run with --write, and look at the change"
        )


if __name__ == "__main__":
    main()
