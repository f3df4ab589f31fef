"""A robot whose control process died sits down and loses power; somebody else's robot is left alone."""

from __future__ import annotations

import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import grpc
import pytest
from bosdyn.api.power_pb2 import PowerCommandRequest
from bosdyn.client.lease import LeaseClient
from bosdyn.client.power import PowerClient
from bosdyn.client.robot_command import RobotCommandBuilder, RobotCommandClient

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_log.write.sink import NullSink
from spot_protos import fake_admin_pb2
from spot_protos.stub import stub
from spot_runtime.config import RunConfig, for_lock_step
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.errors import CertificateError, HalError, LeaseHeldError, MotionError
from spot_runtime.hal.spot.keepalive import SILENT_S
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.hal.spot.session import RobotCalls
from spot_runtime.host.clock import HostClock, RobotClockEstimate
from spot_runtime.operator.server.run_process import Rescue
from spot_runtime.rescue.guarded import NotingHal
from spot_runtime.rescue.lease_note import (
    HeldNote,
    LeaseNote,
    LeaseNoteError,
    NoteHeldError,
    note_folder,
    note_path,
)
from spot_runtime.rescue.make_safe import WAITING, NotSafeError, make_safe_by_note, when_new

SPOT_RL = str(Path(sys.executable).with_name("spot-rl"))
SCENARIO = "services: {on_lease_expiry: nothing}\n"
"""Otherwise the robot would power off by itself some seconds after its lease went stale."""


@dataclass
class Robot:
    """The fake robot, and a folder for notes."""

    fake: FakeAddress
    admin: Any
    folder: Path

    @property
    def config(self) -> RunConfig:
        config = for_lock_step(RunConfig())
        return config.model_copy(
            update={"robot": config.robot.model_copy(update={"ca_file": self.fake.ca_file, "rpc_timeout_s": 10.0})}
        )

    @property
    def note(self) -> Path:
        return note_path(self.fake.robot, self.folder)

    def hal(self, on_pause: Callable[[], None] = lambda: None) -> NotingHal:
        pace = LockStep(self.fake.admin, HostClock().now_ns())
        address = parse_address(self.fake.robot)
        return NotingHal(address, self.config, NullSink(), pace, folder=self.folder, on_pause=on_pause)

    def leave_standing(self) -> LeaseNote:
        """Stand the robot up, then let go of everything without a word, as a process does that dies."""
        hal = self.hal()
        hal.connect()
        hal.stand()
        note = LeaseNote(**json.loads(self.note.read_bytes()))
        hal.close()  # without power off it gives nothing back
        assert self.note.exists()
        assert self.is_powered()
        return note

    def make_safe_by_note(self, **options: Any) -> str:
        wanted = {"lock_step": self.fake.admin, "within_s": 0.0, **options}
        return make_safe_by_note(self.fake.robot, self.config, self.folder, **wanted)

    def session(self) -> RobotCalls:
        session = RobotCalls(
            parse_address(self.fake.robot), self.config.robot, HostClock(), RobotClockEstimate(), HostClock().now_ns
        )
        session.log_in()
        return session

    def inject(self, name: str, **texts: str) -> None:
        self.admin.InjectFault(fake_admin_pb2.InjectFaultRequest(name=name, texts=texts))

    def status(self) -> Any:
        return self.admin.GetStatus(fake_admin_pb2.GetStatusRequest())

    def step(self, seconds: float) -> None:
        self.admin.Step(fake_admin_pb2.StepRequest(duration_ns=round(seconds * 1e9)))

    def tidy_up(self) -> None:
        """Whoever has the robot: it sits, and nobody has it."""
        session = self.session()
        session.sync_clocks()
        client = session.calls.client(LeaseClient)
        session.adopt_lease(client.take().lease_proto)
        session.calls.client(RobotCommandClient).robot_command(RobotCommandBuilder.safe_power_off_command())
        self.step(5.0)
        session.close()
        assert not self.is_powered()

    def is_powered(self) -> bool:
        return not self.status().motor_power.lower().endswith("off")


@pytest.fixture
def robot(fake: FakeAddress, admin: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Robot]:
    for name, value in fake.environment.items():
        monkeypatch.setenv(name, value)
    robot = Robot(fake, admin, tmp_path)
    yield robot
    admin.ClearFaults(fake_admin_pb2.ClearFaultsRequest())
    robot.tidy_up()


def test_a_robot_that_stands_by_itself_sits_and_loses_power(robot: Robot) -> None:
    robot.leave_standing()
    said = robot.make_safe_by_note()
    assert "is safe" in said
    assert "sat down" in said
    status = robot.status()
    assert not robot.is_powered()
    assert not status.lease_owner
    assert not robot.note.exists()


def test_no_password_is_needed_for_it(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    # systemd shows its credentials to no process that it runs after a stop.
    note = robot.leave_standing()
    assert robot.note.stat().st_mode & 0o077 == 0
    assert note.token not in repr(note)
    for name in ("BOSDYN_CLIENT_USERNAME", "BOSDYN_CLIENT_PASSWORD"):
        monkeypatch.delenv(name)
    assert "sat down" in robot.make_safe_by_note()
    for name, value in robot.fake.environment.items():
        monkeypatch.setenv(name, value)


def test_a_token_that_is_no_longer_taken_is_replaced_by_the_password(robot: Robot) -> None:
    note = robot.leave_standing()
    HeldNote.write(robot.note, replace(note, token="none")).let_go()  # noqa: S106
    assert "sat down" in robot.make_safe_by_note()


def test_a_lease_that_went_stale_in_dead_hands_is_taken_up_again(robot: Robot) -> None:
    robot.leave_standing()
    robot.inject("lease_expired")
    assert "sat down" in robot.make_safe_by_note()
    assert not robot.is_powered()
    assert not robot.status().lease_owner


def test_whoever_took_and_commanded_the_robot_meanwhile_keeps_it(robot: Robot) -> None:
    robot.leave_standing()
    other = robot.session()
    other.sync_clocks()
    other.adopt_lease(other.calls.client(LeaseClient).take().lease_proto)
    other.calls.client(RobotCommandClient).robot_command(RobotCommandBuilder.synchro_stand_command())
    assert "was left to its holder" in robot.make_safe_by_note()
    assert robot.is_powered()
    assert robot.status().lease_owner
    assert not robot.note.exists()
    other.close()


def test_a_lease_that_somebody_has_and_does_not_use_is_asked_for_until_it_is_free(robot: Robot) -> None:
    robot.leave_standing()
    other = robot.session()
    client = other.calls.client(LeaseClient)
    other.adopt_lease(client.take().lease_proto)
    said: list[str] = []

    def tell(words: str) -> None:
        said.append(words)
        assert robot.is_powered()
        if len(said) == 3:
            other.close()  # gives it back
        else:
            other.retain_lease()

    assert "sat down" in robot.make_safe_by_note(tell=tell)
    assert len(said) == 3
    assert said[0].startswith(f"{WAITING}THE ROBOT MAY HAVE POWER")
    assert "has its lease and commands nothing" in said[0]
    assert not robot.is_powered()
    assert not robot.status().lease_owner
    assert not robot.note.exists()


def test_words_are_told_again_only_where_they_changed() -> None:
    said: list[str] = []
    tell = when_new(said.append)
    for words in ("a", "a", "b", "b", "a"):
        tell(words)
    assert said == ["a", "b", "a"]


def test_a_robot_that_nobody_has_any_more_sits_and_loses_power(robot: Robot) -> None:
    robot.leave_standing()
    robot.inject("lease_expired")
    other = robot.session()
    other.acquire_lease()
    other.close()
    assert "sat down" in robot.make_safe_by_note()
    assert not robot.is_powered()
    assert not robot.status().lease_owner


def test_a_robot_without_power_is_safe_and_its_lease_free(robot: Robot) -> None:
    robot.leave_standing()
    robot.inject("estop_pressed")
    robot.step(10.0)
    assert not robot.is_powered()
    assert "had no power already" in robot.make_safe_by_note()
    assert not robot.status().lease_owner


def test_a_note_of_another_start_of_the_robot_is_nobodys(robot: Robot) -> None:
    note = robot.leave_standing()  # a lease that has been used
    HeldNote.write(robot.note, replace(note, epoch="another epoch")).let_go()
    assert "was left to its holder" in robot.make_safe_by_note()
    assert robot.is_powered()


def test_a_robot_that_cannot_be_reached_is_tried_again_and_then_told_of(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    robot.leave_standing()
    tries: list[str] = []

    def log_in(session: RobotCalls, token: str = "") -> str:
        tries.append("try")
        raise HalError("nothing answers")

    with monkeypatch.context() as patched:
        patched.setattr(RobotCalls, "log_in", log_in)
        with pytest.raises(NotSafeError, match=r"THE ROBOT MAY HAVE POWER, see to it: nothing answers"):
            robot.make_safe_by_note(within_s=1.5)
    assert len(tries) == 2
    assert robot.note.exists()  # for the next try
    assert "sat down" in robot.make_safe_by_note()


def test_what_no_second_try_mends_is_told_of_at_once(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    robot.leave_standing()

    def log_in(session: RobotCalls, token: str = "") -> str:
        raise CertificateError("not trusted")

    with monkeypatch.context() as patched:
        patched.setattr(RobotCalls, "log_in", log_in)
        with pytest.raises(NotSafeError, match="not trusted"):
            robot.make_safe_by_note(within_s=600.0)
    assert "sat down" in robot.make_safe_by_note()


def test_a_run_that_ends_well_leaves_no_note(robot: Robot) -> None:
    hal = robot.hal()
    hal.connect()
    assert not robot.note.exists()
    hal.stand()
    with pytest.raises(NoteHeldError, match="stop that one instead"):
        robot.make_safe_by_note()
    hal.power_off()
    hal.close()
    assert not robot.note.exists()
    assert not robot.is_powered()
    assert robot.make_safe_by_note().startswith("nothing to do")


def test_each_look_at_a_motion_of_the_vendor_s_is_told(robot: Robot) -> None:
    """So that a watchdog is fed while the robot sits down, also when nobody else is left to feed it."""
    looks: list[int] = []
    hal = robot.hal(lambda: looks.append(len(looks)))
    hal.connect()
    hal.stand()
    before = len(looks)
    assert before > 10
    hal.power_off()
    assert len(looks) > before + 10
    hal.close()


def test_a_lease_under_which_power_off_failed_is_not_given_back(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    hal = robot.hal()
    hal.connect()
    hal.stand()

    def refuse(*_: object, **__: object) -> None:
        raise MotionError("refused")

    with monkeypatch.context() as patched:
        patched.setattr("spot_runtime.hal.spot.motions.Motions.power_off", refuse)
        with pytest.raises(MotionError, match="refused"):
            hal.power_off()
        hal.close()
    assert robot.status().lease_owner
    assert "sat down" in robot.make_safe_by_note()
    assert not robot.is_powered()


@pytest.mark.parametrize("seconds", [0.0, 1.0])
def test_a_lease_that_somebody_took_for_a_moment_is_taken_up_to_power_off(robot: Robot, seconds: float) -> None:
    hal = robot.hal()
    hal.connect()
    hal.stand()
    thief = robot.session()
    client = thief.calls.client(LeaseClient)
    lease = client.take()
    robot.step(0.02)
    if not seconds:
        client.return_lease(lease)
    with pytest.raises(LeaseHeldError):  # the job that keeps it notices
        hal._pause(0.5)
    if seconds:
        original, waited = hal._pace.pause, [0.0]

        def pause(duration_s: float) -> None:
            original(duration_s)
            waited[0] += duration_s
            if waited[0] >= seconds and not waited[0] - duration_s >= seconds:
                client.return_lease(lease)

        hal._pace.pause = pause  # type: ignore[method-assign]
    hal.power_off()
    assert not robot.is_powered()
    hal.close()
    thief.close()
    assert not robot.note.exists()
    assert not robot.status().lease_owner


def test_the_note_names_a_lease_that_was_taken_up_again(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Otherwise who dies while the robot sits down would be taken for somebody who commands it."""
    hal = robot.hal()
    hal.connect()
    hal.stand()
    robot.inject("lease_expired")

    def refuse(*_: object, **__: object) -> None:
        hal._session.retain_lease()
        raise MotionError("refused")

    with monkeypatch.context() as patched:
        patched.setattr("spot_runtime.hal.spot.motions.Motions.power_off", refuse)
        with pytest.raises(MotionError, match="refused"):
            hal.power_off()
    hal.close()
    assert robot.status().lease_owner
    assert "sat down" in robot.make_safe_by_note(tell=pytest.fail)


def test_a_lease_that_somebody_keeps_is_theirs_and_they_are_named(robot: Robot) -> None:
    hal = robot.hal()
    hal.connect()
    hal.stand()
    robot.inject("lease_stolen", owner="tablet-7")
    with pytest.raises(LeaseHeldError, match=r"held by tablet-7.*whoever commands the robot is answerable"):
        hal.power_off()
    hal.close()
    assert robot.is_powered()
    assert robot.note.exists()  # for the guardian, which looks once more
    assert robot.status().lease_owner == "tablet-7"


def test_motors_that_are_just_getting_power_are_powered_off_too(robot: Robot) -> None:
    hal = robot.hal()
    hal.connect()
    hal._session.calls.client(PowerClient).power_command(PowerCommandRequest.REQUEST_ON_MOTORS)
    assert not hal._session.poll().motors_powered
    hal.power_off()
    robot.step(5.0)
    assert not robot.is_powered()
    hal.close()


def test_a_damaged_note_and_a_folder_in_the_way(robot: Robot) -> None:
    robot.note.write_text("{")
    with pytest.raises(LeaseNoteError, match="see to the robot, then delete it"):
        robot.make_safe_by_note()
    with pytest.raises(LeaseNoteError, match="cannot be opened"):
        HeldNote.write(robot.note / "below", LeaseNote("a", "body", "e", 1, ""))


def test_a_note_that_does_not_fit_on_the_disk_is_no_note(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(descriptor: int) -> None:
        raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(LeaseNoteError, match=r"cannot be written: Disk quota exceeded; make room"):
        HeldNote.write(robot.note, LeaseNote("a", "body", "e", 1, ""))
    assert HeldNote.find(robot.note) is None


def test_a_note_can_be_read_by_its_owner_alone_whatever_was_there(robot: Robot) -> None:
    robot.note.write_text("an old one")
    robot.note.chmod(0o666)
    with robot.note.open() as reader:  # who had it open sees nothing of the new one
        before = os.umask(0o777)
        try:
            HeldNote.write(robot.note, LeaseNote("a", "body", "e", 1, "token")).let_go()
        finally:
            os.umask(before)
        assert reader.read() == "an old one"
    assert robot.note.stat().st_mode & 0o777 == 0o600
    found = HeldNote.find(robot.note)
    assert found is not None
    assert found[1] == LeaseNote("a", "body", "e", 1, "token")
    with pytest.raises(NoteHeldError):
        HeldNote.write(robot.note, LeaseNote("a", "body", "e", 2, "token"))
    found[0].remove()
    assert not list(robot.note.parent.glob(".lease*"))
    robot.note.symlink_to(robot.folder / "elsewhere")
    with pytest.raises(LeaseNoteError, match="cannot be opened"):
        HeldNote.write(robot.note, LeaseNote("a", "body", "e", 1, "token"))
    assert not (robot.folder / "elsewhere").exists()


def test_the_command_by_its_own_name(robot: Robot) -> None:
    robot.leave_standing()
    words = ["make-safe", "--robot", robot.fake.robot, "--ca-file", str(robot.fake.ca_file)]
    words += ["--state-dir", str(robot.folder), "--lock-step", robot.fake.admin]
    for said in ("is safe after", "nothing to do"):
        told = subprocess.run([SPOT_RL, *words], env=dict(os.environ), capture_output=True, text=True, check=False)
        assert told.returncode == 0, told.stderr
        assert said in told.stdout


def test_where_notes_lie(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert note_folder({"STATE_DIRECTORY": "/var/lib/spot-rl:/other"}) == Path("/var/lib/spot-rl")
    assert note_folder({"XDG_STATE_HOME": "/x"}) == Path("/x/spot-rl")
    assert note_folder({"XDG_STATE_HOME": "relative"}) == Path.home() / ".local" / "state" / "spot-rl"
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    assert not Rescue.is_due("192.168.50.3")
    note = LeaseNote("192.168.50.3:443", "body", "e", 1, "")
    HeldNote.write(note_path(str(parse_address("192.168.50.3")), tmp_path), note).let_go()
    assert Rescue.is_due("192.168.50.3")


def test_a_robot_that_hears_from_nobody_sits_down_by_itself_unless_it_has_been_taken(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "scenario.yaml").write_text("services: {on_lease_expiry: nothing, liveness_clock: robot}\n")
    fake = FakeProcess(is_lock_step=True, scenario=str(tmp_path / "scenario.yaml"), state_dir=tmp_path)
    with fake as process, grpc.insecure_channel(process.address.admin) as channel:
        for name, value in process.address.environment.items():
            monkeypatch.setenv(name, value)
        admin = stub(channel, fake_admin_pb2)
        robot = Robot(process.address, admin, tmp_path)
        hal = robot.hal()
        hal.connect()
        hal.stand()
        hal._pause(SILENT_S + 5.0)
        assert robot.is_powered()  # it heard the check-ins
        hal.close()  # as a process does that dies: nothing is given back
        robot.step(SILENT_S - 3.0)
        assert robot.is_powered()
        robot.step(10.0)
        assert not robot.is_powered()
        robot.note.unlink()

        robot.leave_standing()
        session = robot.session()
        session.adopt_lease(session.calls.client(LeaseClient).take().lease_proto)
        robot.step(SILENT_S + 10.0)
        assert robot.is_powered()  # whoever has it now is answerable
        session.close()
        robot.tidy_up()
