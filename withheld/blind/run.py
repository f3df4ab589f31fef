"""Many cases on many cores or machines: each independent, done once, kept when a run is interrupted."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from trainer.simulate.engine import Engine, EngineError, Tell
from withheld.blind.execute import Job, case_folder, execute
from withheld.blind.ledger import Ledger, read_ledger
from withheld.outcome import Outcome


def run_case(_: None, job: Job, __: Tell) -> Outcome:
    """What an engine does with a job."""
    return execute(job)


def run_cases(
    jobs: Sequence[Job],
    engine: Engine[Any, Job, Outcome],
    out: Path,
    until_s: float,
    on_done: Callable[[int, str], None],
) -> int:
    """Run cases that are not there yet; returns how many are left.

    After ``until_s`` none is begun; those in the making are finished. A case that fails for a reason of its own is told
    of and left for ``--resume``.

    Args:
        jobs: All cases.
        engine: Where they run.
        out: The run's folder.
        until_s: Seconds from now.
        on_done: Called with number and text of each case that ends.
    """
    ledger = Ledger(out / "ledger.jsonl")
    end_s = time.monotonic() + until_s
    waiting = [job for job in jobs if not (case_folder(out, job.number) / "outcome.json").exists()]
    waiting.reverse()
    running: dict[Any, Job] = {}
    failed = 0
    while waiting or running:
        while waiting and len(running) < engine.places and time.monotonic() < end_s:
            job = waiting.pop()
            running[engine.start(job)] = job
        if not running:
            break
        for ticket in engine.finished(list(running), 10.0):
            job = running.pop(ticket)
            try:
                outcome = engine.result(ticket)
            except Exception as error:
                if isinstance(error, EngineError) and not engine.place.ray:
                    raise  # Without one of its processes, the pool does nothing more; a cluster goes on.
                failed += 1
                on_done(job.number, f"failed: {type(error).__name__}: {error}")
                continue
            last = read_ledger(case_folder(out, job.number) / "ledger.jsonl")[-1]
            ledger.add("case", case=job.number, ledger=last.hash, seal=outcome.seal, verdict=outcome.verdict_sha256)
            on_done(job.number, f"{outcome.status}, {sum(outcome.seconds.values()):.0f} s")
    return len(waiting) + failed
