"""A long run in lock-step: nothing in the process may grow."""

from __future__ import annotations

import json
import os
import tempfile
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Final

import typer

from proof.faulty import FaultyHal
from proof.rig import rig
from spot_model.console.command_registry import AsJson, PolicyFile, ScenarioName
from spot_model.io.velocity_sequence import load_sequence
from spot_model.policy.built_in import WALK
from spot_model.process.signals import exit_on_termination
from spot_runtime.session.summary import resident_mb
from spot_tools.sources import ScriptedSource

GROWTH_BOUND_MB: Final = 4.0
SAMPLES: Final = 120
DEFAULTS: Final[Mapping[str, Mapping[str, Any]]] = {}
"""A run as it is, and not the benches' quick one."""


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
            name: round(median(values[-quarter:]) - median(values[quarter : 2 * quarter]), 2)
            for name, values in asdict(self).items()
            if name != "robot_s"
        }


def soak(
    as_json: AsJson = False,
    minutes: Annotated[float, typer.Option(min=0.05, max=1440.0, help="Robot time.")] = 60.0,
    policy: PolicyFile = WALK,
    sequence: Annotated[str, typer.Option(help="Velocity commands; they repeat.")] = "standing",
    scenario: ScenarioName = "default",
) -> None:
    """Run for an hour of robot time in lock-step; memory, descriptors and threads must not grow."""
    samples, began_s = Samples(), time.monotonic()
    source = ScriptedSource(load_sequence(sequence), duration_s=minutes * 60.0)

    def sample(hal: FaultyHal, began_ns: int) -> None:
        """Look at the process now, and again after a period."""
        samples.take((hal.robot_now_ns() - began_ns) / 1e9)
        hal.plan(minutes * 60.0 / SAMPLES, lambda: sample(hal, began_ns))

    with (
        exit_on_termination(),
        tempfile.TemporaryDirectory(prefix="spot-rl-soak-") as folder,
        rig(Path(folder), policy, scenario=scenario) as robot,
    ):
        robot.calm, robot.wakes_at_every_state = DEFAULTS, False
        drive = robot.drive(lambda hal: sample(hal, hal.robot_now_ns()), at_s=0.0, source=source)
        log_mb = round(drive.log_path.stat().st_size / 1e6, 1) if drive.log_path.exists() else None
    summary, growth = drive.summary, samples.growth()
    is_flat = growth["rss_mb"] <= GROWTH_BOUND_MB and growth["descriptors"] <= 0 and growth["threads"] <= 0
    result = {
        "outcome": summary.outcome,
        "robot_s": samples.robot_s[-1],
        "wall_s": round(time.monotonic() - began_s, 1),
        "ticks": summary.ticks,
        "skipped_ticks": summary.skipped_ticks,
        "log_dropped": summary.log_dropped,
        "log_mb": log_mb,
        "growth": growth,
        "flat": is_flat and summary.outcome == "completed",
        "samples": asdict(samples),
    }
    if as_json:
        typer.echo(json.dumps(result))
    else:
        for name in ("outcome", "robot_s", "wall_s", "ticks", "growth", "flat"):
            typer.echo(f"{name:<10} {result[name]}")
    raise typer.Exit(0 if result["flat"] else 1)
