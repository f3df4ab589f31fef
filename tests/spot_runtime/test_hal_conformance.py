"""What every adapter must do, whatever robot is behind it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner

from fake_robot.start.process import FakeAddress
from spot_log.write.sink import MemorySink
from spot_model.errors import BadInputError
from spot_model.robot import facts
from spot_model.robot.state import Gains, JointCommand, RobotState
from spot_protos import fake_admin_pb2
from spot_runtime.config import RunConfig
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.base import Hal
from spot_runtime.hal.credentials import PASSWORD_VARIABLE, USERNAME_VARIABLE
from spot_runtime.hal.errors import CredentialsError, MotionError
from spot_runtime.hal.registry import Adapter, HalRequest, find_adapter
from spot_runtime.hal.spot.adapter import BosdynHal
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.host.clock import HostClock
from spot_tools.hal_conformance import (
    CHECKS,
    ConformanceError,
    brings_states_in_order,
    takes_commands_and_hands_back,
)
from spot_tools.run import run
from tests.spot_runtime.conftest import HandMadeRobot

MS = 1_000_000
WALK = Path(__file__).parents[2] / "policies" / "walk.onnx"


def spot(fake: FakeAddress, sink: MemorySink, monkeypatch: pytest.MonkeyPatch) -> BosdynHal:
    """The vendor's adapter of that robot."""
    for name, value in fake.environment.items():
        monkeypatch.setenv(name, value)
    robot = RunConfig().robot.model_copy(update={"ca_file": fake.ca_file})
    config = RunConfig().model_copy(update={"robot": robot})
    return BosdynHal(parse_address(fake.robot), config, sink, LockStep(fake.admin, HostClock().now_ns()))


@pytest.fixture(params=["hand-made", "bosdyn"])
def hal(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Hal]:
    """Each adapter, not yet connected."""
    if request.param == "hand-made":
        yield request.getfixturevalue("robot")
    else:
        yield spot(request.getfixturevalue("fake"), MemorySink(), monkeypatch)


def receive(hal: Hal, count: int) -> list[RobotState]:
    states: list[RobotState] = []
    for _ in range(10 * count):
        if len(states) >= count:
            return states
        states += hal.receive(hal.robot_now_ns() + 3 * MS, 0.1)
    raise AssertionError(f"only {len(states)} of {count} states came")


def commands(hal: Hal, state: RobotState) -> Iterator[JointCommand]:
    zeros = np.zeros(facts.N_JOINTS)
    for key in itertools.count(1):
        end_ns = hal.robot_now_ns() + 50 * MS
        yield JointCommand(key, state.position_rad, zeros, state.load_nm, Gains.stand(), end_ns)


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_every_adapter_keeps_the_protocol(hal: Hal, check: Callable[[Hal], None]) -> None:
    check(hal)


class Lazy(HandMadeRobot):
    """Breaks one promise: states of which none is newer than the last."""

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        return super().receive(until_robot_ns, timeout_s) * 2


class Deaf(HandMadeRobot):
    """Breaks another: it never takes joint control up."""

    activates = False


def test_the_suite_finds_adapters_that_break_promises() -> None:
    with pytest.raises(ConformanceError, match="robot stamps do not rise"):
        brings_states_in_order(Lazy())
    with pytest.raises(ConformanceError, match="pending, not active"):
        takes_commands_and_hands_back(Deaf(activates=False))
    silent = HandMadeRobot(mutate=lambda _: [])
    with pytest.raises(ConformanceError, match="only 0 of 100 states came"):
        brings_states_in_order(silent)
    assert silent.calls[-4:] == ["release", "power_off", "close", "close"]


# By name -------------------------------------------------------------------------------------------------------------


def request(hal: str, robot: str = "127.0.0.1:1") -> HalRequest:
    config = RunConfig.model_validate({"robot": {"hal": hal}})
    return HalRequest(robot, config)


def make_hand_made(request: HalRequest) -> Adapter:
    """An adapter of a user: this function is all that there is to write beside the class."""
    return Adapter(request.robot, lambda _: HandMadeRobot())


def test_adapters_are_found_by_name() -> None:
    spot = find_adapter(request("spot", "192.168.80.3"))
    assert spot.robot == "192.168.80.3:443"
    assert isinstance(spot.make(MemorySink()), BosdynHal)
    own = find_adapter(request(f"{__name__}:make_hand_made", "anything at all"))
    assert own.robot == "anything at all"
    assert isinstance(own.make(MemorySink()), HandMadeRobot)


def test_a_run_without_credentials_is_refused_before_it_has_a_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in (USERNAME_VARIABLE, PASSWORD_VARIABLE, "CREDENTIALS_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    words = ["--robot", "127.0.0.1:1", "--policy", str(WALK), "--log-dir", str(tmp_path)]
    app = typer.Typer()
    app.command()(run)
    ended = CliRunner().invoke(app, words)
    assert isinstance(ended.exception, CredentialsError)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("spott", "HAL adapter 'spott' is unknown; allowed: .*spot, or module:function of your own"),
        ("nowhere_at_all:make", "cannot be loaded: No module named 'nowhere_at_all'; check module and function"),
    ],
)
def test_an_adapter_that_is_not_there(name: str, words: str) -> None:
    with pytest.raises(BadInputError, match=words):
        find_adapter(request(name))


def test_the_robot_confirms_the_keys_it_has_received(fake: FakeAddress, monkeypatch: pytest.MonkeyPatch) -> None:
    sink = MemorySink()
    hal = spot(fake, sink, monkeypatch)
    hal.connect()
    hal.stand()
    following = commands(hal, receive(hal, 1)[-1])
    hal.begin_joint_control(next(following))
    for _ in range(40):
        states = receive(hal, 1)
        hal.send(next(following))
    assert 30 < states[-1].last_command_key < 41
    assert states[-1].last_command_robot_stamp_ns < states[-1].robot_stamp_ns
    assert hal.slow_state is not None
    assert hal.slow_state.motors_powered
    # What goes to the log is what came over the wire, message by message.
    assert len(sink.states) > 500
    hal.power_off()
    hal.close()


def test_motors_that_lost_power_are_not_powered_on_again(
    fake: FakeAddress, admin: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever cut the power may stand beside the robot, while a run that ends asks it to stand once more."""
    hal = spot(fake, MemorySink(), monkeypatch)
    hal.connect()
    hal.stand()
    admin.InjectFault(fake_admin_pb2.InjectFaultRequest(name="power_loss", duration_s=0.1))
    admin.Step(fake_admin_pb2.StepRequest(duration_ns=500_000_000))
    with pytest.raises(MotionError, match="standing"):
        hal.stand()
    assert admin.GetStatus(fake_admin_pb2.GetStatusRequest()).motor_power == "off"
    hal.power_off()
    hal.close()
