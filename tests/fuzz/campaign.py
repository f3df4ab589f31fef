"""Every parser to so many inputs, in slices over some processes; what was counted is kept, so it may be broken off.

python tests/fuzz/run.py all --jobs 4 --runs 1000000 --seconds 540 --counts build/fuzz/counts.json

A slice is one process of atheris for some ten seconds. The parser that would be done last has the next slice; slices
of one parser share a corpus. The table says how many inputs each has had, over all that the counts file remembers.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import threading
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

from targets import TARGETS

FIRST_SLICE_S = 12.0
SLICE_S = 60.0
UNKNOWN_RATE = 1000.0
START_S = 4.0
"""What importing and instrumenting costs a slice."""


@dataclass
class Count:
    """What one parser has had."""

    inputs: int = 0
    seconds: float = 0.0
    slices: int = 0
    edges: int = 0
    features: int = 0
    findings: list[str] = field(default_factory=list)
    planned: int = 0
    """Inputs of slices that run now."""

    @property
    def rate(self) -> float:
        """Inputs a second of one process, its start included."""
        return self.inputs / self.seconds if self.seconds and self.inputs else UNKNOWN_RATE


class Campaign:
    """Counts, and who fuzzes what next."""

    def __init__(self, options: argparse.Namespace) -> None:
        self._runs, self._file = int(options.runs), options.counts
        self._until_s = time.monotonic() + options.seconds
        self._lock = threading.Lock()
        names = options.only.split(",") if options.only else list(TARGETS)
        unknown = sorted(set(names) - set(TARGETS))
        if unknown:
            raise SystemExit(f"no parser {unknown[0]!r}; there are: {', '.join(TARGETS)}")
        known = json.loads(self._file.read_text()) if self._file.exists() else {}
        self.counts = {name: Count(**{**known.get(name, {}), "planned": 0}) for name in names}

    def work(self) -> None:
        """Slice after slice, until all is done or the time is over."""
        while (slice_ := self._next()) is not None:
            name, runs, seconds, number = slice_
            began_s = time.monotonic()
            inputs, edges, features, finding = fuzz_slice(name, runs, seconds, number)
            with self._lock:
                count = self.counts[name]
                count.planned -= runs
                count.inputs += inputs
                count.seconds += time.monotonic() - began_s
                count.edges, count.features = max(count.edges, edges), max(count.features, features)
                if finding:
                    count.findings.append(finding)
                self._file.write_text(json.dumps({n: asdict(c) for n, c in self.counts.items()}, indent=1))

    def _next(self) -> tuple[str, int, float, int] | None:
        with self._lock:
            left_s = self._until_s - time.monotonic() - START_S
            left = {n: self._runs - c.inputs - c.planned for n, c in self.counts.items()}
            # A parser that breaks again and again tells nothing new.
            open_ = [n for n in left if left[n] > 0 and len(self.counts[n].findings) < 5]
            if left_s < 5.0 or not open_:
                return None
            name = max(open_, key=lambda n: (self.counts[n].slices == 0, left[n] / self.counts[n].rate))
            count = self.counts[name]
            seconds = min(left_s, SLICE_S if count.inputs else FIRST_SLICE_S)
            runs = min(left[name], max(2000, int(1.2 * seconds * count.rate)) if count.inputs else left[name])
            count.planned += runs
            count.slices += 1
            return name, runs, seconds, count.slices

    def table(self) -> str:
        """For a person."""
        lines = [f"{'parser':<14} {'inputs':>9} {'core s':>7} {'/s':>7} {'edges':>6}  findings; what bounds the rate"]
        for name, c in self.counts.items():
            said = "; ".join(c.findings) or "none"
            why = f"; {TARGETS[name].why_slow}" if TARGETS[name].why_slow else ""
            lines.append(f"{name:<14} {c.inputs:>9} {c.seconds:>7.0f} {c.rate:>7.0f} {c.edges:>6}  {said}{why}")
        short = [name for name, c in self.counts.items() if c.inputs < self._runs]
        total = sum(c.inputs for c in self.counts.values())
        lines.append(f"{len(self.counts)} parsers, {total} inputs; short of {self._runs}: {', '.join(short) or 'none'}")
        return "\n".join(lines)


def fuzz_slice(name: str, runs: int, seconds: float, number: int) -> tuple[int, int, int, str]:
    """One process. Returns inputs, edges, features, and the finding in words, empty if there is none."""
    command = [sys.executable, str(Path(__file__).with_name("run.py")), name, f"-runs={runs}", f"-seed={number}"]
    command += [f"-max_total_time={max(1, int(seconds))}", "-print_final_stats=1", f"-artifact_prefix={name}-"]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(command, capture_output=True, check=False, env=environment)
    said = done.stderr.decode("utf-8", errors="replace") + done.stdout.decode("utf-8", errors="replace")
    inputs = [int(n) for n in re.findall(r"stat::number_of_executed_units: (\d+)", said)]
    inputs = inputs or [int(n) for n in re.findall(r"^#(\d+)\t", said, re.MULTILINE)]
    edges = [int(n) for n in re.findall(r" cov: (\d+)", said)]
    features = [int(n) for n in re.findall(r" ft: (\d+)", said)]
    finding = ""
    if done.returncode:
        artifact = re.findall(r"Test unit written to (\S+)", said)
        words = re.findall(r"^(\w*(?:Error|Exception)\w*:? .*|ERROR: .*)$", said, re.MULTILINE)
        finding = f"{artifact[-1] if artifact else 'no file'}: {(words or [said[-300:]])[-1]}"
        Path(f"{name}-{number}.txt").write_text(said[-20_000:], encoding="utf-8")
    return max(inputs, default=0), max(edges, default=0), max(features, default=0), finding


def main(arguments: list[str]) -> int:
    """Run; 1 where something was found, 2 where a parser has had too few inputs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=1_000_000, help="inputs of each parser")
    parser.add_argument("--jobs", type=int, default=1, help="processes at once")
    parser.add_argument("--seconds", type=float, default=600.0, help="time for all of it")
    parser.add_argument("--only", default="", help="parsers, with commas between")
    parser.add_argument("--counts", type=Path, default=Path("counts.json"), help="file that remembers")
    campaign = Campaign(parser.parse_args(arguments))
    workers = [threading.Thread(target=campaign.work) for _ in range(parser.parse_args(arguments).jobs)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    sys.stdout.write(campaign.table() + "\n")
    if any(count.findings for count in campaign.counts.values()):
        return 1
    return 2 if "short of" in campaign.table() and not campaign.table().endswith("none") else 0
