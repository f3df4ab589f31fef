"""Fail on what no tracked file may hold: paths of one machine, merge marks, and modules too long to hold one idea."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent
MAX_MODULE_LINES = 400
FORBIDDEN = {
    "path of one machine": re.compile(r"(?<![\w./$}])/(?:work|root|farm|home/\w+)/|/tmp/(?:team|bash_jobs)"),
    "address of a package index": re.compile(r"\bpypi\.org\b|pythonhosted\.org|file:///(?:opt|srv)"),
    "merge mark": re.compile(r"^(?:<{7}|>{7}) ", re.MULTILINE),
}
SELF = Path(__file__).resolve().relative_to(REPOSITORY).as_posix()


def tracked_files() -> list[str]:
    """Return the repository's tracked files, relative to its root."""
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    return [name for name in listing.stdout.split("\0") if name and name != SELF]


def findings_of(name: str, text: str) -> list[str]:
    """Return one line for each thing in the file ``name`` that may not stand there."""
    findings = [
        f"{name}:{text.count(chr(10), 0, match.start()) + 1}: {what}: {match.group().strip()}"
        for what, pattern in FORBIDDEN.items()
        for match in pattern.finditer(text)
    ]
    is_module = name.endswith(".py") and not name.startswith(("tests/", "spot_protos/"))
    line_count = text.count("\n")
    if is_module and line_count > MAX_MODULE_LINES:
        findings.append(f"{name}: {line_count} lines; a module has at most {MAX_MODULE_LINES}: split it by idea")
    return findings


def main() -> None:
    findings: list[str] = []
    for name in tracked_files():
        path = REPOSITORY / name
        try:
            findings += findings_of(name, path.read_text(encoding="utf-8"))
        except (UnicodeDecodeError, IsADirectoryError):
            continue  # a binary file; the link to the folder of policies
        except FileNotFoundError:
            continue  # deleted, and not committed yet
    if findings:
        sys.exit("\n".join(findings))


if __name__ == "__main__":
    main()
