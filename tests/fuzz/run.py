"""Coverage-guided fuzzing of one parser, by atheris.

python tests/fuzz/run.py TARGET -runs=1000000        libFuzzer's options follow the name; findings are files crash-*
python tests/fuzz/run.py all -jobs=4 -runs=1000000 -seconds=600     every parser, in so many processes at once
python tests/fuzz/run.py TARGET FILE                 one input again
"""

from __future__ import annotations

import re
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
sys.path.insert(0, str(Path(__file__).resolve().parent))

WATCHED = ["spot_model", "spot_runtime", "fake_robot", "yaml", "mcap"]


def fuzz(name: str, options: list[str]) -> None:
    """Fuzz until the options say that it is enough; the process ends here."""
    import atheris  # type: ignore[import-untyped, import-not-found, unused-ignore]

    with atheris.instrument_imports(include=WATCHED):
        from targets import TARGETS, folder

        target = TARGETS[name]
        seeds = target.seeds()
        target.run(seeds[0])  # whatever is imported inside functions
    corpus = folder() / "corpus"
    corpus.mkdir(exist_ok=True)
    for number, seed in enumerate(seeds):
        (corpus / f"seed{number}").write_bytes(seed)
    files = [] if any(not option.startswith("-") for option in options) else [str(corpus)]
    atheris.Setup([sys.argv[0], "-rss_limit_mb=4096", "-timeout=30", *options, *files], target.run)
    atheris.Fuzz()


def fuzz_all(options: list[str]) -> int:
    """Every target, each split over some processes; a table of what was run."""
    from targets import TARGETS

    jobs, runs, seconds = (int(_option(options, name, default)) for name, default in DEFAULTS.items())
    parts = max(1, jobs // len(TARGETS)) if jobs > len(TARGETS) else 1
    each = [f"-runs={-(-runs // parts)}", f"-max_total_time={seconds}", "-print_final_stats=1"]
    tasks = [(name, part) for part in range(parts) for name in TARGETS]
    began_s = time.monotonic()
    with ThreadPoolExecutor(jobs) as pool:
        done = list(pool.map(lambda task: _fuzz_part(task[0], [*each, f"-seed={task[1] + 1}"]), tasks))
    for name in TARGETS:
        mine = [outcome for (task, _), outcome in zip(tasks, done, strict=True) if task == name]
        count, busy_s = sum(c for c, _, _ in mine), sum(s for _, s, _ in mine)
        findings = [words for _, _, words in mine if words]
        words = "FINDING: " + findings[0] if findings else "no finding"
        sys.stdout.write(f"{name:<14} {count:>9} inputs, {count / busy_s:7.0f}/s a process: {words}\n")
    sys.stdout.write(f"{len(TARGETS)} parsers, {jobs} processes, {time.monotonic() - began_s:.0f} s\n")
    return 1 if any(words for _, _, words in done) else 0


DEFAULTS = {"jobs": "1", "runs": "1000000", "seconds": "600"}


def _option(options: list[str], name: str, default: str) -> str:
    found = [option.partition("=")[2] for option in options if option.startswith(f"-{name}=")]
    return found[-1] if found else default


def _fuzz_part(name: str, options: list[str]) -> tuple[int, float, str]:
    began_s = time.monotonic()
    command = [sys.executable, __file__, name, *options]
    done = subprocess.run(command, capture_output=True, text=True, errors="replace", check=False)
    found = re.findall(r"stat::number_of_executed_units: (\d+)", done.stderr)
    return int(found[-1]) if found else 0, time.monotonic() - began_s, done.stderr[-2000:] if done.returncode else ""


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    if sys.argv[1] == "all":
        raise SystemExit(fuzz_all(sys.argv[2:]))
    fuzz(sys.argv[1], sys.argv[2:])
