"""Somebody stays with a robot whose lease another client holds, for however long, and powers it off once that is free.

With processes of their own: the run or the service, its guardian, and the fake robot. In lock-step: in real time a busy
computer ends a run before anybody has taken its lease.
"""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from bosdyn.client.lease import LeaseClient

from fake_robot.start.process import FakeAddress
from spot_protos import fake_admin_pb2
from spot_runtime.config import RobotConfig
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.spot.session import RobotCalls
from spot_runtime.host.clock import HostClock, RobotClockEstimate

from .conftest import wait_until
from .test_guardian import started_run, walks
from .test_serve import Service, child_of, is_alive

SCENARIO = "services: {on_lease_expiry: nothing, lease_timeout_s: 3600}\n"
"""The robot does nothing by itself, and a lease is free only once it is given back."""
HOLDS_S = (0.01, 3.0, 6.0)
"""Shorter than a run waits for its lease by itself, about as long, and longer."""


class Thief:
    """Takes the lease by force, and keeps it without a command, as a tablet does that lies on a table."""

    def __init__(self, fake: FakeAddress, monkeypatch: pytest.MonkeyPatch) -> None:
        for name, value in fake.environment.items():
            monkeypatch.setenv(name, value)
        clock, config = HostClock(), RobotConfig(ca_file=fake.ca_file)
        self._session = RobotCalls(parse_address(fake.robot), config, clock, RobotClockEstimate(), clock.now_ns)
        self._session.log_in()

    def take(self) -> None:
        self._session.adopt_lease(self._session.calls.client(LeaseClient).take().lease_proto)
        self._session.retain_lease()

    def give_back(self) -> None:
        self._session.close()


@pytest.fixture
def thief(fake: FakeAddress, monkeypatch: pytest.MonkeyPatch) -> Iterator[Thief]:
    thief = Thief(fake, monkeypatch)
    yield thief
    thief.give_back()


def status(admin: Any) -> Any:
    return admin.GetStatus(fake_admin_pb2.GetStatusRequest())


def is_powered(admin: Any) -> bool:
    return not status(admin).motor_power.lower().endswith("off")


def notes(folder: Path) -> list[Path]:
    return list(folder.rglob("lease-*"))


@pytest.mark.parametrize("held_s", HOLDS_S)
def test_a_run(held_s: float, tmp_path: Path, fake: FakeAddress, admin: Any, thief: Thief) -> None:
    with started_run(fake, tmp_path, "--lock-step", fake.admin) as run:
        walks(run, admin)
        guardian = child_of(run.pid, "rescue.guardian")
        thief.take()
        time.sleep(held_s)
        assert is_powered(admin)  # a lease is never taken by force
        thief.give_back()
        wait_until(lambda: run.poll() is not None, "the run ends")
    assert run.returncode not in (0, -signal.SIGKILL)
    wait_until(lambda: not is_alive(guardian), "the guardian has done its work")
    assert not is_powered(admin)
    assert not status(admin).lease_owner
    assert not notes(tmp_path)


@pytest.mark.parametrize("held_s", [HOLDS_S[0], HOLDS_S[-1]])
def test_a_service(held_s: float, tmp_path: Path, fake: FakeAddress, admin: Any, thief: Thief) -> None:
    service = Service(tmp_path, fake)
    try:
        service.ctl("arm", "walk")
        thief.take()
        time.sleep(held_s)
        assert is_powered(admin)
        thief.give_back()
        service.wait_for(state="idle")
    finally:
        service.end()
    assert not is_powered(admin)
    assert not status(admin).lease_owner
    assert not notes(tmp_path)


def test_a_service_that_is_told_to_end_leaves_somebody_behind(
    tmp_path: Path, fake: FakeAddress, admin: Any, thief: Thief
) -> None:
    service = Service(tmp_path, fake)
    service.environment["COLUMNS"] = "500"
    service.ctl("arm", "walk")
    control = service.control_pid()
    guardian = child_of(control, "rescue.guardian")
    thief.take()
    os.kill(control, signal.SIGKILL)
    wait_until(lambda: "commands nothing" in service.ctl("events").stdout, "the service says who has the lease")
    service.process.terminate()
    wait_until(lambda: service.process.poll() is not None, "the service ends")
    assert is_powered(admin)
    assert notes(tmp_path)
    thief.give_back()
    wait_until(lambda: not is_powered(admin), "whoever was left powers it off")
    wait_until(lambda: not is_alive(guardian), "the guardian has seen so")
    service.end()
