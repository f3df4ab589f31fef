"""Collections on fake robots: a fresh one for each run, so that a fall costs one run, and many at once if wanted."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from typing import Final

import yaml

from fake_robot.scenario.scenario import load_scenario
from fake_robot.start.process import FakeProcess
from trainer.collect.collect_run import Collection, Part, PlannedRun

SEED_STEP: Final = 1_000
"""Between the scenario's seed in one repeat and in the next: repeats differ by noise and delays, as on a robot."""


def collect_on_fakes(
    scenario: str | Path,
    collection: Collection,
    scratch: Path,
    *,
    at_once: int = 1,
    say: Callable[[str], None] = lambda _: None,
) -> tuple[PlannedRun, ...]:
    """Make what is missing of a collection, in lock-step, each run on a fake robot of its own.

    Args:
        scenario: Name or file; each run gets its truth with another seed.
        collection: What is wanted.
        scratch: Folder of the scenarios with their seeds.
        at_once: Runs at a time; the logs do not depend on it.
        say: Where progress goes.

    Returns:
        Runs that did not complete, a fall for instance; their logs are there.
    """
    single = [
        (number, replace(part, plan=(run,), folder=part.folder / f"{run.sequence.name}-{run.repeat}"))
        for part in collection.parts
        for number, run in enumerate(part.plan)
    ]

    def make(job: tuple[int, Part]) -> tuple[PlannedRun, ...]:
        number, part = job
        run = part.plan[0]
        folder = scratch / f"{part.label}-{run.sequence.name}-{run.repeat}"
        folder.mkdir(parents=True, exist_ok=True)
        part.folder.mkdir(parents=True, exist_ok=True)
        path = _with_seed(scenario, SEED_STEP * run.repeat + number, folder)

        def start(arguments: list[str]) -> int:
            with FakeProcess(scenario=str(path), is_lock_step=True) as fake:
                where = ["--robot", fake.address.robot, "--lock-step", fake.address.admin]
                return _spot_rl([*arguments, *where], fake.address.environment, folder / "run.log")

        return Collection((part,)).record((), start, attempts=1, say=say)

    with ThreadPoolExecutor(at_once) as pool:
        return tuple(run for left in pool.map(make, single) for run in left)


def _with_seed(scenario: str | Path, more: int, folder: Path) -> Path:
    loaded = load_scenario(scenario)
    path = folder / "scenario.yaml"
    data = loaded.with_changes(seed=loaded.seed + more).to_data()
    path.write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return path


def _spot_rl(arguments: Sequence[str], environment: dict[str, str], output: Path) -> int:
    command = [sys.executable, "-m", "spot_model", *arguments]
    with output.open("ab") as file:
        return subprocess.run(  # noqa: S603 - our own command line
            command, env={**os.environ, **environment}, stdout=file, stderr=file, check=False
        ).returncode
