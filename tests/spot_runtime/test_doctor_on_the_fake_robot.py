"""The doctor looks at a fake robot, which is made ill in every way that it knows."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import grpc
import pytest
import typer
from bosdyn.api import robot_state_pb2
from bosdyn.client.lease import LeaseClient
from bosdyn.client.sdk import create_standard_sdk
from typer.testing import CliRunner

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_protos import fake_admin_pb2
from spot_protos.stub import stub as stub_of
from spot_runtime.config import RunConfig
from spot_runtime.hal.errors import HalError, NoServiceError
from spot_tools.checks import CheckResult, Finding, is_fit
from spot_tools.doctor import doctor
from spot_tools.robot_checks import LOOKS, RobotDoctor

CheckUp = Callable[..., dict[str, Finding]]
CONFIG = RunConfig()


def inject(admin: Any, name: str, **parameters: Any) -> None:
    numbers = {k: v for k, v in parameters.items() if isinstance(v, float)}
    texts = {k: v for k, v in parameters.items() if isinstance(v, str)}
    admin.InjectFault(fake_admin_pb2.InjectFaultRequest(name=name, numbers=numbers, texts=texts))
    admin.Step(fake_admin_pb2.StepRequest(duration_ns=500_000_000))


def look_at(address: FakeAddress, robot: str = "", **config: Any) -> dict[str, Finding]:
    settings = RunConfig.model_validate({"robot": {"ca_file": address.ca_file, "rpc_timeout_s": 2.0, **config}})
    with closing(RobotDoctor(robot or address.robot, settings)) as patient:
        return {check.name.rpartition(" ")[2]: check.make() for check in patient.checks()}


@pytest.fixture(autouse=True)
def _is_well(admin: Any) -> Iterator[None]:
    yield
    admin.ClearFaults(fake_admin_pb2.ClearFaultsRequest())


@pytest.fixture
def check_up(fake: FakeAddress, monkeypatch: pytest.MonkeyPatch) -> CheckUp:
    def check_up(robot: str = "", password: str = "", **config: Any) -> dict[str, Finding]:
        for name, value in fake.environment.items():
            monkeypatch.setenv(name, value)
        if password:
            monkeypatch.setenv("BOSDYN_CLIENT_PASSWORD", password)
        return look_at(fake, robot, **config)

    return check_up


def failed(results: dict[str, Finding]) -> set[str]:
    return {name for name, result in results.items() if result.verdict is CheckResult.FAIL}


def after(results: dict[str, Finding], name: str) -> set[CheckResult]:
    names = list(results)
    return {results[later].verdict for later in names[names.index(name) + 1 :]}


def test_a_healthy_robot_is_looked_at_and_left_as_it_was(check_up: CheckUp, admin: Any) -> None:
    before = admin.GetStatus(fake_admin_pb2.GetStatusRequest())
    results = check_up()
    assert failed(results) == set()
    # The link may be slow on a busy computer, which is a warning.
    assert [r.verdict for r in results.values()].count(CheckResult.OK) >= 8
    assert results["lease"].found == "free"
    assert "operator's tablet" in results["e-stop"].found
    assert results["clock"].verdict is CheckResult.WARN  # the fake's clock is minutes off, as a robot's may be
    status = admin.GetStatus(fake_admin_pb2.GetStatusRequest())
    for name in ("mode", "motor_power", "estop_level", "lease_owner", "commands_received", "robot_stamp_ns"):
        assert getattr(status, name) == getattr(before, name)


ILL = [
    ("clock", "time_sync_not_ready", {}, "time sync", ""),
    ("faults", "battery_fault", {}, "battery_fault", "robot's own page"),
    ("battery", "low_battery", {"percent": 5.0}, "5 %", "charge"),
    ("motors", "motor_over_temperature", {"joint": "hl_kn", "temperature_c": 90.0}, "hl_kn, 90 °C", "cool down"),
    ("e-stop", "estop_pressed", {}, "pressed", "release"),
    ("licence", "license_invalid", {"state": "missing"}, "no_license", "joint control"),
    ("licence", "license_invalid", {"state": "expired"}, "expired", "joint control"),
]
APART = {"joints", "lease"}
"""No fault of the fake robot's moves an arm; who holds the lease is tested with a client that does."""


def test_every_check_has_a_robot_that_does_not_pass() -> None:
    """A new check without one fails here."""
    assert LOOKS.keys() == {check for check, *_ in ILL} | APART


@pytest.mark.parametrize(("check", "fault", "parameters", "words", "advice"), ILL)
def test_an_ill_robot(
    check_up: CheckUp, admin: Any, check: str, fault: str, parameters: dict[str, Any], words: str, advice: str
) -> None:
    inject(admin, fault, **parameters)
    results = check_up()
    assert failed(results) == {check}, results
    assert words in results[check].found
    assert advice in results[check].advice


def test_wall_power_is_told_before_the_motors_are_refused_it() -> None:
    message = robot_state_pb2.RobotState()
    reader: Any = SimpleNamespace(state=lambda: message)
    message.power_state.shore_power_state = message.power_state.SHORE_POWER_STATE_OFF
    assert LOOKS["faults"](reader, CONFIG).verdict is CheckResult.OK
    message.power_state.shore_power_state = message.power_state.SHORE_POWER_STATE_ON
    told = LOOKS["faults"](reader, CONFIG)
    assert (told.verdict, told.advice) == (CheckResult.FAIL, "unplug it or have it leave its dock")


def test_an_arm_is_told_before_a_run_is_refused_for_it() -> None:
    message = robot_state_pb2.RobotState()
    reader: Any = SimpleNamespace(state=lambda: message)
    message.kinematic_state.joint_states.add(name="hr.kn")
    assert LOOKS["joints"](reader, CONFIG).verdict is CheckResult.OK
    shoulder = message.kinematic_state.joint_states.add(name="arm0.sh1")
    shoulder.position.value = -3.1
    told = LOOKS["joints"](reader, CONFIG)
    assert (told.verdict, told.found) == (CheckResult.OK, "2, with an arm, stowed: it is held while the legs walk")
    shoulder.position.value = -1.0
    told = LOOKS["joints"](reader, CONFIG)
    assert told.verdict is CheckResult.FAIL
    assert told.found == "the robot's arm is not stowed: arm0_sh1 at -1.00 rad (allowed: -3.3 to -2.8)"
    assert told.advice == "stow it, with its gripper closed, then start again"


def test_a_robot_without_a_licence_service_may_run_and_one_whose_service_is_silent_is_not_fit() -> None:
    def reader(error: HalError) -> Any:
        def license_info() -> Any:
            raise error

        return SimpleNamespace(license_info=license_info)

    told = LOOKS["licence"](reader(NoServiceError("finding license: not registered")), CONFIG)
    assert (told.verdict, told.found) == (CheckResult.WARN, "the robot offers no licence service")
    assert "joint control" in told.advice
    with pytest.raises(HalError, match="did not answer"):
        LOOKS["licence"](reader(HalError("reading the licence: the robot did not answer")), CONFIG)


def test_a_lease_that_a_client_holds(check_up: CheckUp, fake: FakeAddress) -> None:
    sdk = create_standard_sdk("somebody-else", cert_resource_glob=str(fake.ca_file))
    host, _, port = fake.robot.rpartition(":")
    robot = sdk.create_robot(host)
    robot.update_secure_channel_port(int(port))
    robot.authenticate(fake.environment["BOSDYN_CLIENT_USERNAME"], fake.environment["BOSDYN_CLIENT_PASSWORD"])
    client = robot.ensure_client(LeaseClient.default_service_name)
    lease = client.acquire()
    assert failed(check_up()) == {"lease"}
    client.return_lease(lease)
    assert check_up()["lease"].found == "free"


def test_a_wrong_password_ends_there(check_up: CheckUp) -> None:
    results = check_up(password="s3cret-canary")  # noqa: S106
    assert failed(results) == {"account"}
    assert after(results, "account") == {CheckResult.SKIPPED}
    assert "s3cret" not in str(results)


def test_a_certificate_that_is_not_trusted_ends_there(check_up: CheckUp) -> None:
    results = check_up(ca_file=None)
    assert failed(results) == {"certificate"}
    assert "not trusted" in results["certificate"].found
    assert "--ca-file" in results["certificate"].advice
    assert after(results, "certificate") == {CheckResult.SKIPPED}


def test_a_certificate_file_that_is_not_there(check_up: CheckUp, tmp_path: Path) -> None:
    results = check_up(ca_file=tmp_path / "none.pem")
    assert "none.pem cannot be read: No such file" in results["certificate"].found


def test_nobody_at_the_address(check_up: CheckUp) -> None:
    results = check_up(robot="127.0.0.1:1")
    assert failed(results) == {"route"}
    assert "Connection refused" in results["route"].found
    assert after(results, "route") == {CheckResult.SKIPPED}
    assert "allowed" in check_up(robot="not an address")["route"].advice


def test_a_robot_that_nobody_can_stop_and_what_stays_until_a_person_clears_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    scenario = tmp_path / "alone.yaml"
    scenario.write_text("services: {operator_estop: false}\nbattery: {charge_percent: 6.0}\n")
    with FakeProcess(scenario=str(scenario), is_lock_step=True, state_dir=tmp_path / "state") as fake:
        for name, value in fake.address.environment.items():
            monkeypatch.setenv(name, value)

        def look(estop: str) -> dict[str, Finding]:
            results = look_at(fake.address, estop=estop)
            assert not is_fit(results.values())
            return results

        assert failed(look("external")) == {"e-stop", "battery"}
        assert look("auto")["e-stop"].verdict is CheckResult.WARN
        with grpc.insecure_channel(fake.address.admin) as channel:
            admin = stub_of(channel, fake_admin_pb2)
            inject(admin, "behavior_fault", cause="fall")
            inject(admin, "lease_stolen", owner="tablet-7")
        results = look("auto")
        assert failed(results) == {"battery", "faults", "lease"}
        assert results["faults"].found.startswith("behaviour fault: fall")
        assert results["faults"].advice == "clear it on the tablet"
        assert results["lease"].found == "held by tablet-7"
        assert "never takes it by force" in results["lease"].advice


def test_the_command(fake: FakeAddress, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    app = typer.Typer()
    app.command()(doctor)
    for name, value in fake.environment.items():
        monkeypatch.setenv(name, value)
    words = ["--robot", fake.robot, "--log-dir", str(tmp_path)]
    told = CliRunner().invoke(app, [*words, "--json"])
    data = json.loads(told.output)
    assert (told.exit_code, data["fit"]) == (0, True), told.output
    assert {check["verdict"] for check in data["checks"]} <= {"ok", "warn", "skipped"}
    assert set(data["checks"][0]) == {"name", "verdict", "found", "advice"}
    told = CliRunner().invoke(app, [*words, "--robot", "127.0.0.1:1"])
    assert told.exit_code == 1
    assert "fail     127.0.0.1:1 route: no robot at 127.0.0.1:1: Connection refused; check address" in told.output
