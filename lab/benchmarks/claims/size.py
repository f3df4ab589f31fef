"""Claim: the runtime and all that it needs take less than 200 MB.

Sizes are of the installed distributions that each extra pulls in, compiled files included and this project not.

    python lab/benchmarks/claims/size.py
"""

from __future__ import annotations

import json
import re
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

EXTRAS = ("", "runtime", "fake", "sysid", "diagnosis", "train", "all")


def needed(extra: str) -> set[str]:
    """Names of the installed distributions that an extra needs, this project not among them."""
    found: set[str] = set()
    left = [("spot-rl", frozenset({extra}))]
    seen = set(left)
    while left:
        name, extras = left.pop()
        for line in metadata.requires(name) or ():
            requirement = Requirement(line)
            environments = [{"extra": e} for e in (extras or {""})]
            if requirement.marker and not any(requirement.marker.evaluate(e) for e in environments):
                continue
            wanted = re.sub(r"[-_.]+", "-", requirement.name).lower()
            try:
                metadata.distribution(wanted)
            except metadata.PackageNotFoundError:
                continue
            if wanted != "spot-rl":
                found.add(wanted)
            item = (wanted, frozenset(requirement.extras))
            if item not in seen:
                seen.add(item)
                left.append(item)
    return found


def megabytes(names: set[str]) -> float:
    """Installed size of distributions."""
    files = {Path(str(f.locate())) for name in names for f in metadata.files(name) or ()}
    return round(sum(path.stat().st_size for path in files if path.is_file()) / 1e6, 1)


def main() -> None:
    """Print one JSON object: packages and MB of each extra."""
    told = {}
    for extra in EXTRAS:
        names = needed(extra)
        told[extra or "none"] = {"packages": len(names), "mb": megabytes(names)}
    print(json.dumps(told))


if __name__ == "__main__":
    main()
