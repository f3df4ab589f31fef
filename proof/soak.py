"""A long run in lock-step: nothing in the process may grow."""

from __future__ import annotations

import io
import json
import os
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median
from typing import Annotated, Final

import typer

from fake_robot.start.process import FakeProcess
from spot_log.write.logger_process import LoggerProcess
from spot_log.write.sink import LogSink
from spot_model.errors import BadInputError
from spot_model.io.signals import exit_on_termination
from spot_model.io.velocity_sequence import load_sequence
from spot_model.policy.policy import load_policy
from spot_model.robot.state import RobotState
from spot_runtime.config import RunConfig, for_lock_step
from spot_runtime.hal.base import Hal
from spot_runtime.hal.connection.address import parse_address
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.host.clock import HostClock
from spot_runtime.host.console import Console
from spot_runtime.session.run import RunRequest, run
from spot_runtime.session.summary import resident_mb
from spot_tools.run.scripted import ScriptedSource

GROWTH_BOUND_MB: Final = 4.0


@dataclass
class Samples:
    """What was seen, once a period of robot time."""

    robot_s: list[float] = field(default_factory=list)
    rss_mb: list[float] = field(default_factory=list)
    descriptors: list[int] = field(default_factory=list)
    threads: list[int] = field(default_factory=list)

    def take(self, robot_s: float) -> None:
        """Look at this process."""
        self.robot_s.append(round(robot_s, 1))
        self.rss_mb.append(round(resident_mb(), 2))
        self.descriptors.append(len(os.listdir("/proc/self/fd")))  # noqa: PTH208 - a count, no paths
        self.threads.append(len(os.listdir("/proc/self/task")))  # noqa: PTH208

    def growth(self) -> dict[str, float]:
        """Median of the last quarter less that of the second: what comes and goes within a quarter is not growth."""
        quarter = max(1, len(self.robot_s) // 4)
        return {
            name: round(median(getattr(self, name)[-quarter:]) - median(getattr(self, name)[quarter : 2 * quarter]), 2)
            for name in ("rss_mb", "descriptors", "threads")
        }


class Watched(BosdynHal):
    """The vendor adapter, which also samples the process."""

    samples: Samples
    period_ns: int
    _next_ns: int = 0
    _began_ns: int = 0

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        """Sample where it is time."""
        now_ns = self.robot_now_ns()
        self._began_ns = self._began_ns or now_ns
        if now_ns >= self._next_ns:
            self._next_ns = now_ns + self.period_ns
            self.samples.take((now_ns - self._began_ns) / 1e9)
        return super().receive(until_robot_ns, timeout_s)


def soak(
    json_output: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    minutes: Annotated[float, typer.Option(min=0.05, max=1440.0, help="Robot time.")] = 60.0,
    policy: Annotated[Path, typer.Option(help="ONNX file with its contract.")] = Path("policies/walk.onnx"),
    sequence: Annotated[str, typer.Option(help="Velocity commands; they repeat.")] = "standing",
    scenario: Annotated[str, typer.Option(help="Scenario of the fake robot.")] = "default",
) -> None:
    """Run for an hour of robot time in lock-step; memory, descriptors and threads must not grow."""
    if not policy.is_file():
        raise BadInputError(f"policy {policy} is no file; give an ONNX file with its contract")
    result = measure(minutes=minutes, policy=policy, sequence=sequence, scenario=scenario)
    if json_output:
        typer.echo(json.dumps(result))
    else:
        for name in ("outcome", "robot_s", "wall_s", "ticks", "growth", "flat"):
            typer.echo(f"{name:<10} {result[name]}")
    raise typer.Exit(0 if result["flat"] else 1)


def measure(*, minutes: float, policy: Path, sequence: str, scenario: str) -> dict[str, object]:
    """One run, and what grew."""
    samples, began_s = Samples(), time.monotonic()
    with (
        exit_on_termination(),
        tempfile.TemporaryDirectory(prefix="spot-rl-soak-") as folder,
        FakeProcess(scenario=scenario, is_lock_step=True, state_dir=Path(folder) / "state") as fake,
    ):
        os.environ.update(fake.address.environment)
        config = for_lock_step(RunConfig.model_validate({"robot": {"ca_file": str(fake.address.ca_file)}}))
        source = ScriptedSource(load_sequence(sequence), duration_s=minutes * 60.0)
        path = Path(folder) / "soak.mcap"
        request = RunRequest(fake.address.robot, load_policy(policy), source, config, path)

        def make_hal(sink: LogSink) -> Hal:
            pace = LockStep(fake.address.admin, HostClock().now_ns())
            hal = Watched(parse_address(fake.address.robot), config, sink, pace)
            hal.samples, hal.period_ns = samples, round(minutes * 60e9 / 120)
            return hal

        console = Console(io.StringIO())
        try:
            summary = run(request, make_hal, LoggerProcess.start, console)
        finally:
            console.close()
        log_mb = round(path.stat().st_size / 1e6, 1) if path.exists() else None
    growth = samples.growth()
    is_flat = growth["rss_mb"] <= GROWTH_BOUND_MB and growth["descriptors"] <= 0 and growth["threads"] <= 0
    return {
        "outcome": summary.outcome,
        "robot_s": samples.robot_s[-1] if samples.robot_s else 0.0,
        "wall_s": round(time.monotonic() - began_s, 1),
        "ticks": summary.ticks,
        "skipped_ticks": summary.skipped_ticks,
        "log_dropped": summary.log_dropped,
        "log_mb": log_mb,
        "growth": growth,
        "flat": bool(is_flat and summary.outcome == "completed"),
        "samples": {name: getattr(samples, name) for name in Samples.__dataclass_fields__},
    }
