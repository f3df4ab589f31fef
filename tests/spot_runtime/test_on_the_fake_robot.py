"""The whole runtime against the fake robot over the vendor's API: a good run, bad beginnings, and bad ends."""

from __future__ import annotations

import io
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, MutableSequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import grpc
import numpy as np
import pytest

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_log import Run, read_run
from spot_log.write.logger_process import LoggerProcess
from spot_log.write.sink import LogSink
from spot_model.io.velocity_sequence import standing_sequence
from spot_model.policy.observation import N_OBSERVATION
from spot_model.policy.policy import TickResult, policy_from_bytes
from spot_model.robot import facts
from spot_model.robot.state import JointCommand, RobotState
from spot_protos import fake_admin_pb2
from spot_protos.stub import stub
from spot_runtime.config import RunConfig
from spot_runtime.control.memory import Step
from spot_runtime.control.safety.commands import LimitedSetpoint
from spot_runtime.control.set_point import Setpoint
from spot_runtime.hal.address import Address, parse_address
from spot_runtime.hal.base import Hal
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.command_stream import CommandStream
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.hal.spot.pace import Pace
from spot_runtime.host.clock import HostClock
from spot_runtime.host.journal import Console
from spot_runtime.session.run import RunRequest, run_once
from spot_runtime.session.summary import RunSummary
from spot_runtime.sources import Wanted
from spot_tools.sources import ScriptedSource

ROOT = Path(__file__).parents[2]
CONFIG = RunConfig.model_validate(
    {
        "real_time": {"fifo_priority": 0, "lock_memory": False, "freeze_garbage_collection": False},
        "handover": {"ramp_in_s": 1.0, "ramp_out_s": 0.3, "soft_stop_s": 0.3, "soft_stop_settle_s": 0.2},
    }
)


BRISK = "power: {power_on_s: 0.4}\nmotion: {stand_s: 0.8, sit_s: 0.8}\n"
"""The default robot, but quicker to its feet: these tests are about what lies between."""


@dataclass
class Fake:
    """A fake robot in lock-step, and the means to drive and break it."""

    address: FakeAddress
    admin: Any
    folder: Path
    monkeypatch: pytest.MonkeyPatch
    policy_bytes: bytes

    def drive(
        self,
        *,
        on_begin: Callable[[], None] = lambda: None,
        during: Callable[[], None] | None = None,
        seconds: float = 1.0,
        robot: str = "",
        **robot_config: Any,
    ) -> tuple[RunSummary, Run]:
        """One run; ``on_begin`` happens when joint control begins, ``during`` half a second after the hand-over."""
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
            return NotingHal(parse_address(where), config, sink, pace, on_begin)

        console = Console(io.StringIO())
        try:
            request = RunRequest(
                where, policy_from_bytes(self.policy_bytes, source="test policy"), source, config, path
            )
            summary = run_once(request, make_hal, LoggerProcess.start, console)
        finally:
            console.close()
        return summary, read_run(path)

    def inject(self, name: str, duration_s: float = 0.0, **parameters: float | str) -> None:
        numbers = {k: v for k, v in parameters.items() if isinstance(v, float)}
        texts = {k: v for k, v in parameters.items() if isinstance(v, str)}
        self.admin.InjectFault(
            fake_admin_pb2.InjectFaultRequest(name=name, numbers=numbers, texts=texts, duration_s=duration_s)
        )

    def truth(self, *, reset_extremes: bool = False) -> Any:
        return self.admin.GetTruth(fake_admin_pb2.GetTruthRequest(reset_extremes=reset_extremes))

    def status(self) -> Any:
        return self.admin.GetStatus(fake_admin_pb2.GetStatusRequest())

    def step(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.05)):
            self.admin.Step(fake_admin_pb2.StepRequest(duration_ns=50_000_000))


class NotingHal(BosdynHal):
    """The vendor adapter, with a look at the robot when joint control begins."""

    def __init__(self, address: Address, config: RunConfig, sink: LogSink, pace: Pace, on_begin: Any) -> None:
        super().__init__(address, config, sink, pace)
        self._on_begin = on_begin

    def begin_joint_control(self, first: JointCommand) -> None:
        self._on_begin()
        super().begin_joint_control(first)


class Meddling:
    """A source that does something to the robot half a second into the run."""

    def __init__(self, source: ScriptedSource, during: Callable[[], None] | None) -> None:
        self.name, self._source, self._during = source.name, source, during

    def sample(self, active_s: float, host_stamp_ns: int) -> Wanted:
        if self._during is not None and active_s >= 0.5:
            during, self._during = self._during, None
            during()
        return self._source.sample(active_s, host_stamp_ns)

    def close(self) -> None:
        self._source.close()


@contextmanager
def running(folder: Path, more: str = "") -> Iterator[tuple[FakeAddress, Any]]:
    """A robot's process, with more keys of its scenario: its address, and its admin service."""
    scenario = folder / "brisk.yaml"
    scenario.write_text(BRISK + more, encoding="utf-8")
    with (
        FakeProcess(scenario=str(scenario), is_lock_step=True, state_dir=folder / "state") as process,
        grpc.insecure_channel(process.address.admin) as channel,
    ):
        yield process.address, stub(channel, fake_admin_pb2)


@pytest.fixture(scope="module")
def shared_robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[FakeAddress, Any]]:
    with running(tmp_path_factory.mktemp("shared")) as started:
        yield started


@pytest.fixture
def standing_policy(make_policy_bytes: Callable[..., bytes]) -> bytes:
    """Carries the body in the pose of the fake's own stand; feedback of the pose makes the joints twice as stiff."""
    sides = np.where(np.arange(12) % 3 == 0, np.repeat([1.0, -1.0, 1.0, -1.0], 3), 1.0)
    offset_rad = np.tile([0.017, 0.842, -1.563], 4) * sides - facts.DEFAULT_POSITION_RAD
    load_nm = np.tile([-15.0, 1.0, 17.5], 4) * sides
    feedback = 1.0 / facts.ACTION_SCALE_RAD
    weight = np.zeros((48, 12))
    weight[12:24] = -feedback * np.eye(12)
    action = (offset_rad + load_nm / facts.POLICY_KP_NM_PER_RAD) / facts.ACTION_SCALE_RAD
    return make_policy_bytes(bias=action + feedback * offset_rad, weight=weight)


@pytest.fixture
def lone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standing_policy: bytes) -> Iterator[Fake]:
    """A robot that no other test needs."""
    with running(tmp_path) as (address, admin):
        yield Fake(address, admin, tmp_path, monkeypatch, standing_policy)


@pytest.fixture
def fake(
    shared_robot: tuple[FakeAddress, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, standing_policy: bytes
) -> Iterator[Fake]:
    """One robot for all tests that leave it without power, with its faults and leases taken back."""
    address, admin = shared_robot
    own = replace(address, environment=dict(address.environment))
    fake = Fake(own, admin, tmp_path, monkeypatch, standing_policy)
    yield fake
    assert fake.status().motor_power.lower().endswith("off")
    admin.ClearFaults(fake_admin_pb2.ClearFaultsRequest())
    fake.inject("lease_expired")


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


def test_a_later_run_in_lock_step_waits_for_its_own_commands(fake: Fake) -> None:
    """However slowly its stream opens: the keys of the run before, which were higher, do not count."""
    summary, _ = fake.drive(seconds=0.5)
    assert summary.exit_code == 0, summary.sentence
    commands = CommandStream._commands

    def late(stream: CommandStream) -> Iterator[bytes]:
        time.sleep(0.7)
        yield from commands(stream)

    fake.monkeypatch.setattr(CommandStream, "_commands", late)
    summary, log = fake.drive(seconds=0.5)
    assert summary.exit_code == 0, summary.sentence
    assert log.commands.key[0] == 1


def test_the_hand_over_drops_the_body_by_less_than_2_cm(fake: Fake) -> None:
    standing_m: list[float] = []
    lowest_m: list[float] = []

    def begin() -> None:
        standing_m.append(fake.truth(reset_extremes=True).body_height_m)

    summary, _ = fake.drive(on_begin=begin, during=lambda: lowest_m.append(fake.truth().body_height_min_m), seconds=0.6)
    assert summary.exit_code == 0, summary.sentence
    assert 0.4 < standing_m[0] < 0.6
    assert standing_m[0] - lowest_m[0] < 0.02


# Bad beginnings ------------------------------------------------------------------------------------------------------


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def refused(fake: Fake, outcome: str, exit_code: int, *words: str, **drive: Any) -> None:
    """The run ends before joint control, says why, leaves the robot without power and the log readable."""
    summary, log = fake.drive(**drive)
    assert (summary.outcome, summary.exit_code) == (outcome, exit_code), summary.sentence
    for word in words:
        assert word in summary.sentence
    assert log.outcome == outcome
    assert "connection_failed" in [event.name for event in log.events]
    assert len(log.commands.key) == 0
    assert fake.status().motor_power.lower().endswith("off")


def test_nobody_at_the_address(fake: Fake) -> None:
    refused(fake, "no_robot", 81, "Connection refused", robot=f"127.0.0.1:{free_port()}")


def test_a_certificate_that_is_not_trusted(fake: Fake) -> None:
    refused(fake, "certificate_not_trusted", 82, "--ca-file", ca_file=None)


def test_a_wrong_password(fake: Fake) -> None:
    fake.address.environment["BOSDYN_CLIENT_PASSWORD"] = "wrong-canary"  # noqa: S105
    refused(fake, "credentials_refused", 83, "check user name and password")
    assert b"canary" not in (fake.folder / "run.mcap").read_bytes()


def test_a_lease_that_somebody_else_holds(fake: Fake) -> None:
    fake.inject("lease_stolen", owner="tablet-7")
    refused(fake, "lease_held", 84, "tablet-7", "never taken by force")


def test_a_pressed_estop(fake: Fake) -> None:
    fake.inject("estop_pressed")
    refused(fake, "estop_pressed", 85, "pressed", "release it")


@pytest.mark.parametrize(
    ("fault", "parameters", "words"),
    [
        ("battery_fault", {}, "battery"),
        ("low_battery", {"percent": 5.0}, "the battery holds 5 %; needed: 8 %"),
    ],
)
def test_a_fault_of_the_robot(fake: Fake, fault: str, parameters: dict[str, Any], words: str) -> None:
    fake.inject(fault, **parameters)
    refused(fake, "robot_fault", 86, words)


def test_a_behaviour_fault(lone: Fake) -> None:
    lone.inject("behavior_fault")
    refused(lone, "robot_fault", 86, "behaviour fault")


def test_a_time_sync_that_is_never_ready(fake: Fake) -> None:
    fake.inject("time_sync_not_ready")
    refused(fake, "clock_not_synced", 88, "NOT_READY")


# Bad ends: most are rows of the fault matrix, tests/spot_runtime/faults ----------------------------------------------


@pytest.mark.parametrize("state", ["missing", "expired"])
def test_a_licence_that_does_not_hold(fake: Fake, state: str) -> None:
    fake.inject("license_invalid", state=state)
    summary, log = fake.drive()
    assert (summary.outcome, summary.exit_code) == ("activation_failed", 42), summary.sentence
    assert "licence" in summary.sentence
    assert log.outcome == "activation_failed"
    assert fake.status().motor_power.lower().endswith("off")


# Signals and sudden death, through the command line ------------------------------------------------------------------


def start_run(fake: Fake, *words: str) -> subprocess.Popen[str]:
    """``spot-rl run`` in a process of its own, until the policy is in control."""
    policy = fake.folder / "policy.onnx"
    policy.write_bytes(fake.policy_bytes)
    command = [sys.executable, "-c", "from spot_model.console.command_line import main; main()", "run"]
    command += ["--robot", fake.address.robot, "--policy", str(policy), "--duration", "600", *words]
    command += ["--lock-step", fake.address.admin, "--log-dir", str(fake.folder / "logs")]
    process = subprocess.Popen(
        command, env={**os.environ, **fake.address.environment}, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "→ active" in line:
            return process
    raise AssertionError(f"the run ended with exit code {process.wait()} before the policy was in control")


def finish(process: subprocess.Popen[str]) -> tuple[int, str]:
    _, said = process.communicate(timeout=120.0)
    return process.returncode, said


def test_two_signals_damp(lone: Fake) -> None:
    process = start_run(lone)
    process.send_signal(signal.SIGTERM)
    assert process.stderr is not None
    next(line for line in process.stderr if "soft_stop" in line)
    process.send_signal(signal.SIGTERM)
    code, said = finish(process)
    assert code == 11, said
    assert "damping" in said
    assert lone.status().motor_power.lower().endswith("off")


FORMS = (bytes, RobotState, JointCommand, Setpoint, LimitedSetpoint, TickResult, Step)
"""What a state message becomes: bytes, a state, the policy's result, a set-point, a command, and bytes again."""

COPIES = ("spot_log/write/",)
"""What only the log gets."""


class Way:
    """The files that a state message passes from its receipt to the command stream, as a profiler of the loop."""

    def __init__(self) -> None:
        self.files: list[str] = []
        self.went_up: set[tuple[str, str]] = set()
        self.is_whole = False
        self._has_begun = False
        self._stack: list[str] = []

    def __call__(self, frame: Any, event: str, value: Any) -> None:
        path = Path(frame.f_code.co_filename)
        if self.is_whole or event not in ("call", "return") or not path.is_relative_to(ROOT):
            return
        file, function = str(path.relative_to(ROOT)), frame.f_code.co_name
        if not file.startswith("spot_") or file.startswith(COPIES):
            return
        self._has_begun |= event == "call" and function == "feed"
        if not self._has_begun:
            return
        if event == "call":
            if file in self._stack[:-1] and file != self._stack[-1]:
                self.went_up.add((self._stack[-1], file))
            self._stack.append(file)
            names = frame.f_code.co_varnames[: frame.f_code.co_argcount + frame.f_code.co_kwonlyargcount]
            self._see(file, *(frame.f_locals[name] for name in names))
        else:
            self._stack = self._stack[:-1]
            self._see(file, value)
            self.is_whole = (
                function == "departed" and file.endswith("command_stream.py") and "policy.py" in str(self.files)
            )

    def _see(self, file: str, *values: Any) -> None:
        newest = (v[-1] if isinstance(v, MutableSequence) and v else v for v in values)
        is_passed = any(isinstance(v, FORMS) or getattr(v, "shape", ()) == (N_OBSERVATION,) for v in newest)
        if is_passed and file not in self.files:
            self.files.append(file)


def test_a_state_is_followed_to_its_command_in_twelve_files_without_going_back_up(fake: Fake) -> None:
    way = Way()
    try:
        summary, _ = fake.drive(seconds=0.7, during=lambda: sys.setprofile(way))
    finally:
        sys.setprofile(None)
    assert summary.exit_code == 0, summary.sentence
    assert way.is_whole
    # A robot in real time knows no lock step: the adapter hands the command to the stream itself.
    files = {file for file in way.files if not file.endswith("lock_step.py")} | {
        "spot_runtime/hal/spot/command_stream.py"
    }
    assert len(files) <= 12, "\n".join(files)
    assert {(below, above) for below, above in way.went_up if not above.endswith("lock_step.py")} == set()
