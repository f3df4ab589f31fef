"""Claim: `spot-rl --help` answers within 0.3 s; the runtime has its first state within 1.5 s and 150 MB.

Beside the command line: a Python that does nothing, and one that imports the vendor's client. The runtime's first state
is looked for in its log, from the start of the process; a fake robot in real time stands ready. Sizes are of the
installed distributions that each extra pulls in, this project without them left out.

    python benchmarks/claims/start_up.py [--only time|size]
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
import tempfile
import time
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

from proof.loop_bench import robot_beside, run_once
from spot_log.read.reader import read_run

EXTRAS = ("", "runtime", "fake", "sysid", "diagnosis", "train", "all")
PROGRAMS = {
    "python": "pass",
    "import_vendor_client": "import bosdyn.client",
    "spot_rl_help": "from spot_model.io.command_line import main; main(['--help'])",
}


def seconds(code: str) -> float:
    """Wall time of a Python program, the best of three: what it takes, not what else the machine did."""
    times = []
    for _ in range(3):
        begin_s = time.perf_counter()
        subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)  # noqa: S603
        times.append(time.perf_counter() - begin_s)
    return round(min(times), 3)


def first_state() -> dict[str, float]:
    """From the start of `spot-rl run` to its first state, and its memory."""
    with robot_beside(0, "default") as (address, cpus), tempfile.TemporaryDirectory() as folder:
        begin_ns = time.time_ns()
        summary = run_once(address, Path(folder), 2.0, Path("policies/walk.onnx"), "standing", {"cpu_affinity": cpus})
        received_ns = int(read_run(summary["log_path"]).states.host_stamp_ns[0])
    return {"first_state_s": round((received_ns - begin_ns) / 1e9, 2), "runtime_rss_mb": round(summary["rss_mb"], 1)}


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


def sizes() -> dict[str, dict[str, float]]:
    """Packages and MB of each extra."""
    told = {}
    for extra in EXTRAS:
        names = needed(extra)
        told[extra or "none"] = {"packages": len(names), "mb": megabytes(names)}
    return told


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--only", choices=("time", "size"))
    chosen = parser.parse_args()
    told: dict[str, object] = {}
    if chosen.only != "size":
        told |= {f"{name}_s": seconds(code) for name, code in PROGRAMS.items()} | first_state()
    if chosen.only != "time":
        told["installed"] = sizes()
    print(json.dumps(told))


if __name__ == "__main__":
    main()
