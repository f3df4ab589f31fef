"""The whole runtime against the fake robot over the vendor's API: a good run, bad beginnings, and bad ends."""

from __future__ import annotations

import io
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import grpc
import numpy as np
import pytest

from spot_model import facts
from spot_model.policy import Policy
from spot_model.velocity_sequence import standing_sequence
from spot_protos import fake_admin_pb2, fake_admin_pb2_grpc
from spot_runtime.clock import HostClock
from spot_runtime.config import RunConfig
from spot_runtime.console import Console
from spot_runtime.fake_process import FakeAddress, FakeProcess
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.base import Hal
from spot_runtime.hal.bosdyn import BosdynHal
from spot_runtime.hal.lock_step import LockStep
from spot_runtime.log import Run, read_run
from spot_runtime.log.logger_process import LoggerProcess
from spot_runtime.log.sink import LogSink
from spot_runtime.run import RunRequest, run
from spot_runtime.sources.base import VelocityCommand
from spot_runtime.sources.scripted import ScriptedSource
from spot_runtime.summary import RunSummary

CONFIG = RunConfig.model_validate(
    {
        "real_time": {"fifo_priority": 0, "lock_memory": False, "freeze_garbage_collection": False},
        "handover": {"ramp_in_s": 1.0},
    }
)


@dataclass
class Fake:
    """A fake robot in lock-step, and the means to drive and break it."""

    address: FakeAddress
    admin: Any
    folder: Path
    monkeypatch: pytest.MonkeyPatch
    policy: Policy

    def drive(
        self, *, during: Callable[[], None] | None = None, seconds: float = 1.0, robot: str = "", **robot_config: Any
    ) -> tuple[RunSummary, Run]:
        """One run; ``during`` happens once, half a second into the policy's control."""
        for name, value in self.address.environment.items():
            self.monkeypatch.setenv(name, value)
        fields = {"ca_file": self.address.ca_file, **robot_config}
        config = CONFIG.model_copy(update={"robot": CONFIG.robot.model_copy(update=fields)})
        source = Meddling(ScriptedSource(standing_sequence(), duration_s=seconds), during)
        where = robot or self.address.robot
        path = self.folder / "run.mcap"
        path.unlink(missing_ok=True)

        def make_hal(sink: LogSink) -> Hal:
            pace = LockStep(self.address.admin, HostClock().now_ns())
            return BosdynHal(parse_address(where), config, sink, pace)

        console = Console(io.StringIO())
        try:
            request = RunRequest(where, self.policy, source, config, path)
            summary = run(request, make_hal, LoggerProcess.start, console)
        finally:
            console.close()
        return summary, read_run(path)

    def inject(self, name: str, duration_s: float = 0.0, **parameters: float | str) -> None:
        numbers = {k: v for k, v in parameters.items() if isinstance(v, float)}
        texts = {k: v for k, v in parameters.items() if isinstance(v, str)}
        self.admin.InjectFault(
            fake_admin_pb2.InjectFaultRequest(name=name, numbers=numbers, texts=texts, duration_s=duration_s)
        )

    def truth(self) -> Any:
        return self.admin.GetTruth(fake_admin_pb2.GetTruthRequest())

    def status(self) -> Any:
        return self.admin.GetStatus(fake_admin_pb2.GetStatusRequest())

    def step(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.admin.Step(fake_admin_pb2.StepRequest(duration_ns=50_000_000))


class Meddling:
    """A source that does something to the robot half a second into the run."""

    def __init__(self, source: ScriptedSource, during: Callable[[], None] | None) -> None:
        self.name, self._source, self._during = source.name, source, during

    def sample(self, active_s: float, host_stamp_ns: int) -> VelocityCommand:
        if self._during is not None and active_s >= 0.5:
            during, self._during = self._during, None
            during()
        return self._source.sample(active_s, host_stamp_ns)

    def close(self) -> None:
        self._source.close()


@contextmanager
def running(folder: Path, monkeypatch: pytest.MonkeyPatch, policy: Policy, scenario: str = "default") -> Iterator[Fake]:
    with (
        FakeProcess(scenario=scenario, is_lock_step=True, state_dir=folder / "state") as process,
        grpc.insecure_channel(process.address.admin) as channel,
    ):
        admin = fake_admin_pb2_grpc.FakeAdminStub(channel)  # type: ignore[no-untyped-call]
        yield Fake(process.address, admin, folder, monkeypatch, policy)


@pytest.fixture
def standing_policy(make_policy: Callable[..., Policy]) -> Policy:
    """Its constant set-points carry the body at 60 N·m/rad in the pose of the fake's own stand."""
    sides = np.repeat([1.0, -1.0, 1.0, -1.0], 3)
    pose_rad = np.tile([0.017, 0.842, -1.563], 4) * np.where(np.arange(12) % 3 == 0, sides, 1.0)
    load_nm = np.tile([-19.2, 1.0, 16.3], 4) * np.where(np.arange(12) % 3 == 0, sides, 1.0)
    setpoint_rad = pose_rad + load_nm / facts.POLICY_KP_NM_PER_RAD
    return make_policy(bias=(setpoint_rad - facts.DEFAULT_POSITION_RAD) / facts.ACTION_SCALE_RAD)


@pytest.fixture
def fake(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standing_policy: Policy) -> Iterator[Fake]:
    with running(tmp_path, monkeypatch, standing_policy) as started:
        yield started


def kept_every_limit(log: Run) -> bool:
    position = log.commands.position_rad
    is_within = (position >= facts.POSITION_LOW_RAD).all() and (position <= facts.POSITION_HIGH_RAD).all()
    return bool(is_within and np.isfinite(position).all() and (np.diff(log.commands.key) > 0).all())


def test_a_good_run(fake: Fake) -> None:
    summary, log = fake.drive(seconds=2.0)
    assert (summary.outcome, summary.exit_code) == ("completed", 0), summary.sentence
    assert log.outcome == "completed"
    assert fake.status().motor_power.lower().endswith("off")
    assert not fake.truth().has_fallen
    assert kept_every_limit(log)
    ticks = log.ticks.robot_stamp_ns
    assert (len(ticks) - 1) / ((ticks[-1] - ticks[0]) / 1e9) == pytest.approx(50.0, abs=0.05)
    assert (np.diff(log.states.robot_stamp_ns) == facts.STATE_PERIOD_NS).all()
    assert [e.name for e in log.events].count("mode") == 6
    assert len(log.slow_states.robot_stamp_ns) >= 4 * log.duration_s


def test_two_runs_on_one_robot_and_the_second_finds_it_as_it_was(fake: Fake) -> None:
    for _ in range(2):
        summary, _ = fake.drive(seconds=0.5)
        assert summary.exit_code == 0
