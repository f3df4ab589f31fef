"""The units: what systemd's own tools say of them, and what they must never do."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
UNITS = ("spot-rl.service", "spot-rl-logs.service", "spot-rl-logs.timer")
SERVICES = UNITS[:2]

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed, so units cannot be verified"
)


@pytest.fixture
def units(tmp_path: Path) -> Path:
    """The units with a program that is there in the place of the installed one."""
    for name in UNITS:
        text = (DEPLOY / name).read_text(encoding="utf-8")
        (tmp_path / name).write_text(
            text.replace("/opt/spot-rl/current/venv/bin/spot-rl", "/bin/true"), encoding="utf-8"
        )
    return tmp_path


def verify(*paths: Path) -> str:
    command = ["systemd-analyze", "verify", "--man=no", *map(str, paths)]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    return told.stdout + told.stderr + ("" if told.returncode == 0 else f"exit code {told.returncode}")


@needs_systemd
def test_systemd_has_nothing_to_say_against_the_units(units: Path) -> None:
    assert verify(*(units / name for name in UNITS)) == ""


@needs_systemd
def test_it_would_speak_up(units: Path) -> None:
    path = units / "spot-rl.service"
    path.write_text(path.read_text().replace("WatchdogSec=2", "WatchdogSecs=2"))
    assert "WatchdogSecs" in verify(path)


@needs_systemd
@pytest.mark.parametrize("name", SERVICES)
def test_hardening(units: Path, name: str) -> None:
    command = ["systemd-analyze", "security", "--offline=true", "--threshold=20", str(units / name)]
    told = subprocess.run(command, capture_output=True, text=True, check=False)
    assert told.returncode == 0, told.stdout[-2000:]
    told = subprocess.run([*command[:3], "--threshold=1", command[-1]], capture_output=True, text=True, check=False)
    assert told.returncode != 0  # the tool does compare


def settings(name: str) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in (DEPLOY / name).read_text(encoding="utf-8").splitlines():
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found.setdefault(key, []).append(value)
    return found


def test_a_start_by_machine_moves_nothing() -> None:
    unit = settings("spot-rl.service")
    (command,) = unit["ExecStart"]
    # 'serve' is idle until an operator arms the robot; 'run' would move it at once.
    assert command.split()[1] == "serve"
    assert {key: [line.split()[1] for line in unit[key]] for key in unit if key.startswith("Exec")} == {
        "ExecStartPre": ["doctor"],
        "ExecStart": ["serve"],
        "ExecStopPost": ["make-safe"],  # sits and cuts power; after every end, a watchdog's and a kill's, too
    }
    assert unit["Restart"] == ["on-failure"]
    assert int(unit["StartLimitBurst"][0]) <= 5
    for other in DEPLOY.iterdir():
        if other.suffix in (".service", ".timer", ".socket", ".path", ".target"):
            assert not re.search(r"^Exec.*spot-rl (run|ctl|collect|demo)", other.read_text(), re.MULTILINE), other.name


def test_what_does_not_heal_is_not_tried_again() -> None:
    from spot_model.errors import BadInputError
    from spot_runtime.operator.listening import ListenError

    (codes,) = settings("spot-rl.service")["RestartPreventExitStatus"]
    assert codes.split() == [str(BadInputError.exit_code), str(ListenError.exit_code)]


def test_the_watchdog_ends_a_hung_loop_and_the_stop_has_time_to_sit() -> None:
    from spot_runtime.config import RobotConfig
    from spot_runtime.rescue.lease_note import WITHIN_S

    unit = settings("spot-rl.service")
    assert unit["Type"] == ["notify"]
    assert unit["NotifyAccess"] == ["all"]  # the control process feeds it while it is answerable
    assert float(unit["WatchdogSec"][0]) <= 5.0
    # A killed main process must not take the control process along: that stops in place when it gets SIGTERM.
    assert unit["KillMode"] == ["control-group"]
    # Making a robot safe whose control process died must end in time: its last try begins within WITHIN_S.
    assert float(unit["TimeoutStopSec"][0]) >= WITHIN_S + RobotConfig().power_timeout_s + 10.0
    # Soft stop and hand-back take up to 10 s, sitting and cutting power up to 20 s more by their own time-outs.
    assert float(unit["TimeoutStopSec"][0]) > 30.0


def test_the_rights_are_those_that_the_configuration_asks_for() -> None:
    from proof.attacks.target import NICENESS
    from spot_runtime.config import RunConfig, load_config

    unit = settings("spot-rl.service")
    config = load_config(DEPLOY / "run.yaml.example")
    assert unit["LimitRTPRIO"] == [str(config.real_time.fifo_priority)]
    assert config.real_time.fifo_priority == RunConfig().real_time.fifo_priority
    assert "CPUSchedulingPolicy" not in unit  # the operator's service must not run before the control loop
    assert unit["Nice"] == [str(NICENESS)]  # as it was measured
    assert unit["LimitMEMLOCK"] == ["infinity"]
    assert "RestrictRealtime" not in unit
    assert config.robot.credentials_file is None  # so that systemd's credential counts


def test_the_credential_has_the_name_that_the_runtime_looks_for() -> None:
    from spot_runtime.hal.credentials import SYSTEMD_NAME

    (credential,) = settings("spot-rl.service")["LoadCredential"]
    assert credential == f"{SYSTEMD_NAME}:/etc/spot-rl/credentials.yaml"


@pytest.mark.parametrize("name", SERVICES)
def test_a_system_call_that_the_filter_forbids_is_refused_and_kills_nobody(name: str) -> None:
    unit = settings(name)
    assert "~@privileged" in " ".join(unit["SystemCallFilter"])
    assert unit["SystemCallErrorNumber"] == ["EPERM"]


def test_pruning_loads_no_library_that_asks_for_what_its_unit_forbids() -> None:
    # OpenBLAS, which comes with NumPy, sets a memory policy while it is loaded: mbind, of @resources.
    assert "@resources" in " ".join(settings("spot-rl-logs.service")["SystemCallFilter"])
    code = (
        "import sys, spot_log.tools.retention; print(sorted({'numpy', 'mcap', 'google.protobuf'} & set(sys.modules)))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "[]"


def test_every_option_and_variable_of_the_units_is_there() -> None:
    import inspect

    from spot_log.tools.retention import prune_logs
    from spot_tools.doctor import doctor
    from spot_tools.serve import make_safe, serve

    commands = {"serve": serve, "doctor": doctor, "prune-logs": prune_logs, "make-safe": make_safe}
    variables = set(re.findall(r"^#?(SPOT_RL_\w+)=", (DEPLOY / "spot-rl.env.example").read_text(), re.MULTILINE))
    seen = set()
    for name in SERVICES:
        unit = settings(name)
        for line in (line for key in unit if key.startswith("Exec") for line in unit[key]):
            words = line.split()
            seen.add(words[1])
            parameters = {parameter.replace("_", "-") for parameter in inspect.signature(commands[words[1]]).parameters}
            assert {word[2:] for word in words if word.startswith("--")} <= parameters, line
            assert set(re.findall(r"\$\{(\w+)\}", line)) <= variables, line
    assert seen == set(commands)
