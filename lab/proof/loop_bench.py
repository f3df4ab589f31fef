"""Measure the runtime on this machine."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated, Any, Final

import typer

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_model.console.command_registry import AsJson, PolicyFile, ScenarioName
from spot_model.errors import SpotRlError
from spot_model.policy.built_in import WALK
from spot_model.process.child_process import ChildProcess, module_command
from spot_model.process.signals import exit_on_termination

FAKE_PRIORITY: Final = 35
"""Below the runtime's: a real robot computes elsewhere, so the fake must not wait for the busy processes either."""

PREFIX: Final = "spot-rl-bench-"
BUSY: Final = "import os, sys\nwhile os.getppid() == int(sys.argv[1]):\n    sum(range(1_000_000))"
"""A program that computes until the process ends that started it."""

KEYS: Final = (
    "tick_compute_p50_us",
    "tick_compute_p99_us",
    "state_to_command_p50_ms",
    "state_to_command_p99_ms",
    "state_age_p50_ms",
    "state_age_p99_ms",
    "acquisition_age_p50_ms",
    "acquisition_age_p99_ms",
    "rate_hz",
    "slipped_ticks",
    "rss_mb",
    "rss_growth_mb",
    "ticks",
    "log_dropped",
    "outcome",
    "real_time_refusals",
    "loop_cpus",
)


class BenchError(SpotRlError):
    """A measurement could not be made."""

    exit_code = 92


def loop(
    as_json: AsJson = False,
    seconds: Annotated[float, typer.Option(min=2.0, max=3600.0, help="Policy time of each measurement.")] = 60.0,
    policy: PolicyFile = WALK,
    scenario: ScenarioName = "default",
    sequence: Annotated[str, typer.Option(help="Velocity commands.")] = "standing",
    busy_processes: Annotated[int, typer.Option(min=0, max=64, help="Busy processes of the second part.")] = 2,
) -> None:
    """Run the loop against a fake robot in real time: on an idle machine, then beside busy processes."""
    results: dict[str, Any] = {}
    for name, count in (("idle", 0), ("busy", busy_processes)):
        if not as_json:
            typer.echo(f"{name}: {seconds:g} s of policy time beside {count} busy processes …", err=True)
        results[name] = measure(seconds=seconds, policy=policy, scenario=scenario, sequence=sequence, busy=count)
    if as_json:
        typer.echo(json.dumps(results))
        return
    for key in KEYS:
        typer.echo(f"{key:<26} " + "  ".join(f"{name}: {_short(results[name][key]):>12}" for name in results))


def measure(*, seconds: float, policy: Path, scenario: str, sequence: str, busy: int) -> dict[str, Any]:
    """One measurement: a fake robot, ``spot-rl run`` against it, and ``busy`` processes that only burn time.

    Raises:
        BenchError: The run did not complete; the message holds its last words.
    """
    with robot_beside(busy, scenario) as (address, loop_cpus), tempfile.TemporaryDirectory(prefix=PREFIX) as folder:
        real_time = {"cpu_affinity": loop_cpus}
        summary = run_once(address, Path(folder), seconds, policy, sequence, real_time)
    summary["slipped_ticks"] = summary["skipped_ticks"]
    summary["loop_cpus"] = loop_cpus
    return {key: summary[key] for key in KEYS}


@contextmanager
def robot_beside(busy: int, scenario: str) -> Iterator[tuple[FakeAddress, list[int]]]:
    """A fake robot in real time and ``busy`` processes while it is entered; its address, and the CPUs of the loop."""
    fake_cpus, loop_cpus = share_cpus(sorted(os.sched_getaffinity(0)))
    with exit_on_termination(), ExitStack() as stack:
        fake = stack.enter_context(FakeProcess(scenario=scenario, fifo_priority=FAKE_PRIORITY, cpus=fake_cpus))
        for _ in range(busy):
            process = ChildProcess.start([sys.executable, "-Ic", BUSY, str(os.getpid())])
            stack.callback(process.end, 0.0)
        yield fake.address, loop_cpus


def share_cpus(allowed: list[int]) -> tuple[list[int], list[int]]:
    """CPUs of the fake robot and of the runtime: its own is the last, as on a robot with cores set apart.

    Empty lists, which mean all, where there is one CPU.
    """
    return (allowed[:-1], allowed[-1:]) if len(allowed) > 1 else ([], [])


def run_once(
    address: FakeAddress, folder: Path, seconds: float, policy: Path, sequence: str, real_time: Mapping[str, Any]
) -> dict[str, Any]:
    """``spot-rl run`` with its log in ``folder``; returns its summary.

    Raises:
        BenchError: The run did not complete; the message holds its last words.
    """
    config, summary = folder / "run.yaml", folder / "summary.json"
    config.write_text(json.dumps({"real_time": real_time}), encoding="utf-8")
    words = ["run", "--robot", address.robot, "--policy", str(policy), "--sequence", sequence]
    words += ["--config", str(config)]
    words += ["--duration", str(seconds), "--log-dir", str(folder), "--summary-json", str(summary)]
    command = module_command("spot_model", *words)
    environment = {**os.environ, **address.environment}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)  # noqa: S603
    if done.returncode != 0 or not summary.is_file():
        last = "\n".join((done.stdout + done.stderr).splitlines()[-8:])
        raise BenchError(f"the run ended with exit code {done.returncode}:\n{last}")
    result: dict[str, Any] = json.loads(summary.read_text(encoding="utf-8"))
    return result


def _short(value: Any) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)
