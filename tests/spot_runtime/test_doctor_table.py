"""Every check of the doctor's has a scenario that it does not pass; a new check without one fails here."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import grpc
import pytest

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_protos import fake_admin_pb2, fake_admin_pb2_grpc
from spot_runtime.config import RunConfig
from spot_runtime.rescue.lease_note import HeldNote, LeaseNote, note_path
from spot_tools.doctor.check import Verdict, make
from spot_tools.doctor.computer import checks_of_computer
from spot_tools.doctor.robot import RobotDoctor
from tests.spot_runtime.test_doctor_on_this_computer import REQUIREMENTS, HandMadeHost, files

ROBOT: dict[str, tuple[str, dict[str, float], dict[str, str]] | dict[str, Any]] = {
    # Something about the way there:
    "route": {"address": "127.0.0.1:1"},
    "certificate": {"ca_file": None},
    "account": {"password": "wrong"},
    # A fault of the fake robot's, as 'spot-rl fake-robot fault' injects it:
    "clock": ("time_sync_not_ready", {}, {}),
    "faults": ("battery_fault", {}, {}),
    "battery": ("low_battery", {"percent": 5.0}, {}),
    "motors": ("motor_over_temperature", {"temperature_c": 90.0}, {"joint": "hl_kn"}),
    "e-stop": ("estop_pressed", {}, {}),
    "licence": ("license_invalid", {}, {"state": "missing"}),
    "lease": ("lease_stolen", {}, {"owner": "tablet"}),
}

HEALTHY = {"requirements": REQUIREMENTS, "installed": {"typer": "0.29.1", "numpy": "2.2.6"}, "free": 10**12}
APART = {"joints": "test_doctor_on_the_fake_robot.py: no fault of the fake robot's gives it an arm"}

COMPUTER: dict[str, tuple[Verdict, dict[str, Any]]] = {
    "python": (Verdict.FAIL, {"python": (3, 9, 2)}),
    "packages": (Verdict.FAIL, {"installed": {}}),
    "policy": (Verdict.FAIL, {"policy": b"none"}),
    # A run goes without these, but worse:
    "cpu governor": (Verdict.WARN, {"governor": "powersave"}),
    "real-time priority": (Verdict.WARN, {"fifo": "Operation not permitted"}),
    "memory lock": (Verdict.WARN, {"lock": "Operation not permitted"}),
    "cpu isolation": (Verdict.FAIL, {"cpus": (7,)}),
    "disk for logs": (Verdict.FAIL, {"free": 10**8}),
    "left behind": (Verdict.WARN, {"note": LeaseNote("192.168.50.3:443", "body", "epoch", 7, "")}),
}


@pytest.fixture(scope="module")
def fake(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FakeAddress]:
    with FakeProcess(is_lock_step=True, state_dir=tmp_path_factory.mktemp("fake")) as process:
        yield process.address


@pytest.fixture
def admin(fake: FakeAddress) -> Iterator[Any]:
    with grpc.insecure_channel(fake.admin) as channel:
        stub = fake_admin_pb2_grpc.FakeAdminStub(channel)  # type: ignore[no-untyped-call]
        yield stub
        stub.ClearFaults(fake_admin_pb2.ClearFaultsRequest())


@pytest.fixture
def look(fake: FakeAddress, monkeypatch: pytest.MonkeyPatch) -> Callable[..., dict[str, Verdict]]:
    def look(address: str = "", password: str = "", **robot: Any) -> dict[str, Verdict]:
        for name, value in fake.environment.items():
            monkeypatch.setenv(name, value)
        if password:
            monkeypatch.setenv("BOSDYN_CLIENT_PASSWORD", password)
        config = RunConfig.model_validate({"robot": {"ca_file": fake.ca_file, "rpc_timeout_s": 5.0, **robot}})
        patient = RobotDoctor(address or fake.robot, config)
        try:
            return {check.name.rpartition(" ")[2]: make(check).verdict for check in patient.checks()}
        finally:
            patient.close()

    return look


def test_the_tables_name_every_check() -> None:
    names = {c.name.rpartition(" ")[2] for c in RobotDoctor("192.168.80.3", RunConfig()).checks()}
    assert names == ROBOT.keys() | APART.keys()
    assert {c.name for c in checks_of_computer(HandMadeHost(), RunConfig(), None)} == set(COMPUTER)


@pytest.mark.parametrize("check", ROBOT)
def test_a_robot_that_does_not_pass(check: str, look: Callable[..., dict[str, Verdict]], admin: Any) -> None:
    what = ROBOT[check]
    if isinstance(what, dict):
        verdicts = look(**what)
    else:
        name, numbers, texts = what
        admin.InjectFault(fake_admin_pb2.InjectFaultRequest(name=name, numbers=numbers, texts=texts))
        admin.Step(fake_admin_pb2.StepRequest(duration_ns=500_000_000))
        verdicts = look()
    assert verdicts[check] is Verdict.FAIL
    assert [name for name, verdict in verdicts.items() if verdict is Verdict.FAIL and name != "lease"] in ([check], [])


@pytest.mark.parametrize("check", COMPUTER)
def test_a_computer_that_does_not_pass(check: str, tmp_path: Path) -> None:
    verdict, ill = COMPUTER[check]
    assert verdicts_of(tmp_path, ill)[check] is verdict
    assert verdicts_of(tmp_path, {})[check] in (Verdict.OK, Verdict.SKIPPED)


def verdicts_of(folder: Path, ill: dict[str, Any]) -> dict[str, Verdict]:
    governor = ill.get("governor", "performance")
    root = files(folder, sys__devices__system__cpu__cpu0__cpufreq__scaling_governor=governor)
    config = RunConfig.model_validate({"real_time": {"cpu_affinity": ill.get("cpus", ())}})
    policy = None
    if "policy" in ill:
        policy = folder / "policy.onnx"
        policy.write_bytes(ill["policy"])
    path = note_path("192.168.50.3:443", folder)
    path.unlink(missing_ok=True)
    if "note" in ill:
        HeldNote.write(path, ill["note"]).let_go()
    checks = checks_of_computer(HandMadeHost(root, **{**HEALTHY, "notes": folder, **ill}), config, policy)
    return {check.name: make(check).verdict for check in checks}
