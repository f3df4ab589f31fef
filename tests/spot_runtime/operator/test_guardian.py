"""The guardian acts whatever becomes of the control process, the note, the service, or the guardian before it."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest

from fake_robot.start.process import FakeAddress
from spot_model.process.child_process import LOOK_PERIOD_S, LivingProcess
from spot_runtime.rescue.guardian import ABORT_TAKES_S, Heartbeat, Hold, outlive

from .conftest import POLICIES, wait_until
from .test_serve import Service, at_rest, child_of, is_alive, mode_of

SPOT_RL = str(Path(sys.executable).with_name("spot-rl"))
SILENT_S = 3.0
SCENARIO = "services: {on_lease_expiry: nothing}\n"
"""Otherwise the robot would power off by itself some seconds after its lease went stale."""


class Scripted(LivingProcess):
    """A process whose heart beats as often as it is told, and which lives until a signal that it obeys."""

    def __init__(self, beats: Sequence[bool], obeys: Sequence[signal.Signals], hold: Hold = Hold.IN_HAND) -> None:
        super().__init__(0)
        self.heartbeat = Heartbeat.new()
        self.heartbeat.hold = hold
        self.looks, self.sent = 0, list[signal.Signals]()
        self._beats, self._obeys = beats, obeys

    def has_ended(self, within_s: float | None = 0.0) -> bool:
        if any(number in self._obeys for number in self.sent):
            return True
        if self.looks == len(self._beats):
            return True
        if self._beats[self.looks]:
            self.heartbeat.beat()
        self.looks += 1
        return False

    def send(self, number: signal.Signals) -> None:
        self.sent.append(number)


def watched(process: Scripted) -> list[signal.Signals]:
    outlive(process, process.heartbeat, SILENT_S)
    return process.sent


def test_who_beats_now_and_then_is_left_alone() -> None:
    seldom = [False] * round(SILENT_S / LOOK_PERIOD_S) + [True]
    assert watched(Scripted(seldom * 10, ())) == []


def test_who_is_silent_is_aborted_once() -> None:
    process = Scripted([True] * 5 + [False] * 1000, (signal.SIGABRT,))
    assert watched(process) == [signal.SIGABRT]
    assert process.looks == 5 + round(SILENT_S / LOOK_PERIOD_S) + 1


def test_who_does_not_obey_is_killed_also_if_it_wakes_meanwhile() -> None:
    silent = [False] * (round(SILENT_S / LOOK_PERIOD_S) + 1)
    assert watched(Scripted(silent + [True] * 1000, (signal.SIGKILL,))) == [signal.SIGABRT, signal.SIGKILL]


def test_who_cannot_be_killed_is_not_waited_for() -> None:
    process = Scripted([False] * 1000, ())
    assert signal.SIGKILL in watched(process)
    assert process.looks * LOOK_PERIOD_S <= SILENT_S + 2.0 * ABORT_TAKES_S + 2.0 * LOOK_PERIOD_S


def test_who_left_the_robot_without_power_may_be_silent() -> None:
    assert watched(Scripted([False] * 1000, (), Hold.AT_REST)) == []


def test_who_let_a_robot_go_that_may_have_power_must_end_in_time() -> None:
    process = Scripted([True] * 5 + [False] * 1000, (signal.SIGKILL,), Hold.LET_GO)
    assert watched(process) == [signal.SIGABRT, signal.SIGKILL]
    assert process.looks * LOOK_PERIOD_S <= 1.0 + SILENT_S + ABORT_TAKES_S + 2.0 * LOOK_PERIOD_S


def test_to_let_go_is_a_sign_of_life() -> None:
    looks = round(SILENT_S / LOOK_PERIOD_S)

    class LetsGo(Scripted):
        def has_ended(self, within_s: float | None = 0.0) -> bool:
            if self.looks == looks:
                self.heartbeat.hold = Hold.LET_GO
            return super().has_ended(within_s)

    assert watched(LetsGo([False] * 2 * looks, ())) == []
    assert watched(LetsGo([False] * (2 * looks + 2), ())) == [signal.SIGABRT]


def test_robot_time_that_stands_still_excuses_no_one_who_has_let_go() -> None:
    holds = (Hold.AT_REST, Hold.IN_HAND)
    for hold, sent in ((Hold.IN_HAND, []), (Hold.AT_REST, []), (Hold.LET_GO, [signal.SIGABRT])):
        process = Scripted([False] * 1000, (signal.SIGABRT,), hold)
        outlive(process, process.heartbeat, SILENT_S, holds)
        assert process.sent == sent


def test_what_one_process_shows_another_sees() -> None:
    shown = Heartbeat.new()
    seen = Heartbeat(os.dup(shown.descriptor))
    assert (seen.count, seen.hold) == (0, Hold.IN_HAND)
    shown.beat()
    shown.hold = Hold.AT_REST
    assert (seen.count, seen.hold) == (1, Hold.AT_REST)
    for _ in range(255):
        shown.beat()
    assert seen.count == 0
    assert not shown.looks
    for _ in range(255):
        seen.look()
    assert (shown.looks, shown.count, shown.hold) == (255, 0, Hold.AT_REST)
    seen.look()
    assert shown.looks == 1


# Real processes -------------------------------------------------------------------------------------------------------


@pytest.fixture
def service(tmp_path: Path, fake: FakeAddress) -> Iterator[Service]:
    started = Service(tmp_path, fake)
    yield started
    started.end()


@contextlib.contextmanager
def started_run(fake: FakeAddress, folder: Path, *words: str) -> Iterator[subprocess.Popen[bytes]]:
    """``spot-rl run``, with its note below the folder; killed at the end if it still runs."""
    environment = {**os.environ, **fake.environment, "XDG_STATE_HOME": str(folder / "state")}
    policy = str(POLICIES / "walk.onnx")
    command = [SPOT_RL, "run", "--robot", fake.robot, "--policy", policy, "--log-dir", str(folder / "logs")]
    with subprocess.Popen(
        [*command, "--duration", "600", "--sequence", "forward", *words],
        env=environment,
        stderr=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
    ) as run:
        try:
            yield run
        finally:
            run.kill()


def walks(run: subprocess.Popen[bytes], admin: Any) -> None:
    wait_until(lambda: "joint_control" in mode_of(admin) or run.poll() is not None, "the robot walks")
    assert run.poll() is None


def test_a_note_that_somebody_deletes_is_not_missed(tmp_path: Path, fake: FakeAddress, admin: Any) -> None:
    with started_run(fake, tmp_path, "--lock-step", fake.admin) as run:
        walks(run, admin)
        guardian = child_of(run.pid, "rescue.guardian")
        shutil.rmtree(tmp_path / "state")
        run.kill()
    wait_until(lambda: not is_alive(guardian), "the guardian has done its work")
    assert at_rest(admin)


def test_a_guardian_that_is_killed_has_a_successor(tmp_path: Path, fake: FakeAddress, admin: Any) -> None:
    with started_run(fake, tmp_path, "--lock-step", fake.admin) as run:
        walks(run, admin)
        first = child_of(run.pid, "rescue.guardian")
        os.kill(first, signal.SIGKILL)
        wait_until(lambda: not is_alive(first), "it has ended")
        wait_until(lambda: has_guardian(run.pid), "another one is there")
        guardian = child_of(run.pid, "rescue.guardian")
        run.kill()
    wait_until(lambda: not is_alive(guardian), "the guardian has done its work")
    assert at_rest(admin)


def has_guardian(pid: int) -> bool:
    try:
        return bool(is_alive(child_of(pid, "rescue.guardian")))
    except ValueError:
        return False


def test_a_service_that_hangs_is_not_waited_for(service: Service, admin: Any) -> None:
    service.ctl("arm", "walk")
    service.ctl("start")
    service.wait_for(mode="active")
    control = service.control_pid()
    guardian = child_of(control, "rescue.guardian")
    os.kill(service.process.pid, signal.SIGSTOP)
    os.kill(control, signal.SIGKILL)
    wait_until(lambda: not is_alive(guardian), "the guardian has done its work")
    assert at_rest(admin)
    os.kill(service.process.pid, signal.SIGCONT)
    service.wait_for(state="idle")


@pytest.mark.parametrize("fake", [False], indirect=True, ids=["real time"])
def test_a_run_that_hangs_is_killed_without_a_service(tmp_path: Path, fake: FakeAddress, admin: Any) -> None:
    config = tmp_path / "run.yaml"
    config.write_text("schema: spot-rl/run/1\nrobot: {rpc_timeout_s: 1.0}\n")
    with started_run(fake, tmp_path, "--config", str(config)) as run:
        walks(run, admin)
        guardian = child_of(run.pid, "rescue.guardian")
        os.kill(run.pid, signal.SIGSTOP)
        wait_until(lambda: run.poll() is not None, "the run is ended")
    wait_until(lambda: not is_alive(guardian), "the guardian has done its work")
    assert run.returncode == -signal.SIGKILL
    assert at_rest(admin)
    assert not list((tmp_path / "state").rglob("lease-*"))
