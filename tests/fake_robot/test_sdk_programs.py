"""Programs written against bosdyn-client alone, run unmodified, each as a process, against the fake robot.

They know nothing of this project: only the host argument and their environment lead them to the fake.
"""

from __future__ import annotations

import ast
import json
import logging
import os
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from google.protobuf.message import DecodeError

from fake_robot.pytest_plugin import FakeSpot, running_fake_spot
from fake_robot.start.commands import app, in_one_line
from fake_robot.start.process import FakeProcessError
from spot_model.errors import SpotRlError

pytestmark = pytest.mark.slow

PROGRAMS = Path(__file__).parent / "sdk_programs"
QUICK_START = {"power": {"power_on_s": 0.4}, "motion": {"stand_s": 0.8, "sit_s": 0.8}}
"""The default robot, but quicker to its feet: programs wait for it in real time."""
OWN_PACKAGES = {"spot_protos", "spot_model", "spot_runtime", "fake_robot", "trainer", "diagnosis", "withheld"}


@pytest.fixture(scope="module")
def sitting_spot(fake_spot_state_folder: Path) -> Iterator[FakeSpot]:
    """One fake for all programs that leave it as they found it: sitting, motors off, nobody's lease."""
    with running_fake_spot(scenario=QUICK_START, state_folder=fake_spot_state_folder) as spot:
        yield spot


def run(spot: FakeSpot, *words: str, codes: tuple[int, ...] = (0,)) -> str:
    ran = spot.run_program([sys.executable, *words])
    assert ran.returncode in codes, f"{ran.stdout}\n{ran.stderr}"
    assert "Traceback" not in ran.stderr, ran.stderr
    return ran.stdout


@pytest.mark.parametrize("path", sorted(PROGRAMS.glob("*.py")), ids=lambda path: path.name)
def test_programs_use_the_sdk_alone(path: Path) -> None:
    tree = ast.parse(path.read_text())
    imported = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert not {name.partition(".")[0] for name in imported} & OWN_PACKAGES


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["state_stream.py", "HOST"], "periods [3000000]"),
        (["async_monitor.py", "HOST"], "stop level 4"),
        (["low_power.py", "HOST"], "has arm: False"),
        (["hello_spot.py", "HOST"], "image True True"),
        (["lease_takeover.py", "HOST"], "refused with STATUS_OLDER"),
        (["sublease.py", "HOST"], "then refused with STATUS_OLDER"),
        (["inspector.py", "HOST"], "skew sign -"),
        (["stream_errors.py", "HOST"], "already over: STATUS_EXPIRED"),
        (["joint_control.py", "HOST", "stream-first"], "verdict STATUS_OK"),
        (["joint_control.py", "HOST", "activate-first"], "verdict STATUS_OK"),
    ],
    ids=lambda value: "-".join(value) if isinstance(value, list) else None,
)
def test_program(sitting_spot: FakeSpot, words: list[str], said: str) -> None:
    output = run(sitting_spot, str(PROGRAMS / words[0]), *words[1:])
    assert said in output
    assert output.rstrip().endswith("done")


def test_estop_program(fake_spot_factory: Callable[..., FakeSpot]) -> None:
    output = run(fake_spot_factory(scenario=QUICK_START), str(PROGRAMS / "estop_program.py"), "HOST")
    assert output.split("\n")[:3] == ["refused while stopped", "settled, then cut", "cut"]


def test_two_buttons_of_one_configuration(fake_spot_factory: Callable[..., FakeSpot]) -> None:
    output = run(fake_spot_factory(scenario=QUICK_START), str(PROGRAMS / "two_buttons.py"), "HOST")
    assert "one button alone: stopped" in output
    assert output.rstrip().endswith("done")


SDK_COMMANDS = [
    (["id"], "spot-FAKE"),
    (["dir", "list"], "robot-state-streaming"),
    (["dir", "get", "lease"], "bosdyn.api.LeaseService"),
    (["state", "full"], "motor_power_state: STATE_OFF"),
    (["state", "metrics"], "distance"),
    (["state", "hardware"], "fl.hip"),
    (["time-sync"], "Local time to robot time: -"),
    (["lease", "list"], "mobility"),
    (["estop", "status"], "ESTOP_LEVEL_NONE"),
    (["estop", "config"], "PDB_rooted"),
    (["license", "--feature-codes", "joint_control"], "joint_control"),
    (["payload", "list"], ""),
    (["fault", "show"], ""),
    (["image", "list-sources"], "frontleft_fisheye_image"),
    (["local_grid", "types"], ""),
    (["log", "comment", "hello"], ""),
    (["log", "textmsg", "hello"], ""),
    (["keepalive", "status"], ""),
    (["log-status", "active"], ""),
    (["power", "fan"], ""),
]
PLAY = """
import contextlib, io, json, runpy, sys
answers = []
for words in json.load(sys.stdin):
    sys.argv = ["bosdyn.client", *words]
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            runpy.run_module("bosdyn.client", run_name="__main__")
            code = 0
        except SystemExit as end:
            code = int(end.code or 0)
    answers.append((said.getvalue(), code))
print(json.dumps(answers))
"""
"""Runs the SDK's own command line many times in one process, which imports it once."""


@pytest.fixture(scope="module")
def answers(sitting_spot: FakeSpot) -> dict[tuple[str, ...], tuple[str, int]]:
    lines = [[sitting_spot.host, *words] for words, _ in SDK_COMMANDS]
    ran = subprocess.run(
        [sys.executable, "-c", PLAY],
        env={**os.environ, **sitting_spot.environment},
        input=json.dumps(lines),
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 0, ran.stderr
    return {tuple(line[1:]): tuple(answer) for line, answer in zip(lines, json.loads(ran.stdout), strict=True)}


@pytest.mark.parametrize(
    ("words", "said"), SDK_COMMANDS, ids=lambda value: "-".join(value) if isinstance(value, list) else None
)
def test_the_sdks_own_command_line(
    answers: dict[tuple[str, ...], tuple[str, int]], words: list[str], said: str
) -> None:
    output, code = answers[tuple(words)]
    assert said in output
    assert "Traceback" not in output
    # Its estop commands always end with 1: they return None where True is meant.
    assert code == (1 if words[0] == "estop" else 0), output


# ------------------------------------------------------------------------------------------------ plug-in and command


def test_plugin_gives_a_robot_and_truth(fake_spot: FakeSpot) -> None:
    from spot_protos import fake_admin_pb2

    robot = fake_spot.sdk_robot()
    assert not robot.is_powered_on()
    assert fake_spot.password not in repr(fake_spot)
    with fake_spot.admin() as admin:
        truth = admin.GetTruth(fake_admin_pb2.GetTruthRequest())
        assert len(truth.joint_position_rad) == 12
        assert 0.0 < truth.body_height_m < 0.4
        assert not admin.GetStatus(fake_admin_pb2.GetStatusRequest()).lock_step


def test_plugin_says_why_a_robot_did_not_come_up(fake_spot_factory: Callable[..., FakeSpot]) -> None:
    with pytest.raises(FakeProcessError, match=r"(?s)exit code 2\); it said: .*gravity"):
        fake_spot_factory(scenario={"gravity": 9.81})


def test_lock_step_stands_without_waiting(fake_spot_factory: Callable[..., FakeSpot]) -> None:
    from bosdyn.client.robot_command import RobotCommandBuilder

    from spot_protos import fake_admin_pb2

    spot = fake_spot_factory(lock_step=True)
    robot = spot.sdk_robot()
    robot.time_sync.wait_for_sync(timeout_sec=20)
    robot.ensure_client("lease").acquire()
    power, commands = robot.ensure_client("power"), robot.ensure_client("robot-command")
    with spot.admin() as admin:

        def pass_s(seconds: float) -> Any:
            return admin.Step(fake_admin_pb2.StepRequest(duration_ns=round(seconds * 1e9)))

        power.power_command(2)
        before = pass_s(0.001)
        assert pass_s(3.0).robot_stamp_ns - before.robot_stamp_ns == 3_000_000_000
        assert robot.is_powered_on()
        commands.robot_command(RobotCommandBuilder.synchro_stand_command())
        pass_s(4.0)
        stand = commands.robot_command_feedback().feedback.synchronized_feedback.mobility_command_feedback
        assert stand.stand_feedback.status == stand.stand_feedback.STATUS_IS_STANDING
        assert admin.GetTruth(fake_admin_pb2.GetTruthRequest()).body_height_m > 0.4
    robot.stop_time_sync()


def command(*words: str) -> list[str]:
    return [sys.executable, "-m", "spot_model", "fake-robot", *words]


def test_exec_runs_a_program_and_passes_its_code_on(fake_spot_state_folder: Path) -> None:
    program = "import os, sys; print(sys.argv[1] == os.environ['SPOT_RL_FAKE_HOST'], sys.argv[1]); sys.exit(7)"
    words = command("--state-dir", str(fake_spot_state_folder), "exec", "--", sys.executable, "-c", program, "HOST")
    ran = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert ran.returncode == 7, ran.stderr
    assert ran.stdout.startswith("True ipv4:127.0.0.1:")


def test_what_it_prints_for_a_person_works_in_a_shell(fake_spot_state_folder: Path) -> None:
    words = command("--state-dir", str(fake_spot_state_folder), "--port", "0")
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        lines: list[str] = []
        for line in process.stdout:
            lines.append(line.strip())
            if "your_program.py" in line:
                break
        exports = [line for line in lines if line.startswith("export ")]
        program = "import bosdyn.client as c, bosdyn.client.util as u, sys; r = c.create_standard_sdk('x')"
        program += ".create_robot(sys.argv[1]); u.authenticate(r); print(len(r.list_services()) > 5)"
        run_program = lines[-1].replace("python your_program.py", f'{sys.executable} -c "{program}"')
        ran = subprocess.run(["/bin/sh", "-euc", "\n".join([*exports, run_program])], capture_output=True, text=True)
        process.terminate()
    assert ran.stdout == "True\n", ran.stderr


def test_a_signal_to_exec_ends_the_program_too(fake_spot_state_folder: Path) -> None:
    program = "import time; print('up', flush=True); time.sleep(600)"
    words = command("--state-dir", str(fake_spot_state_folder), "exec", "--", sys.executable, "-c", program)
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=30)
    assert process.returncode == 128 + signal.SIGTERM


@pytest.mark.parametrize(("answer", "code"), [("lambda *_: sys.exit(7)", 7), ("signal.SIG_IGN", 137)])
def test_a_program_that_answers_a_signal_by_itself_is_ended_too(
    fake_spot_state_folder: Path, answer: str, code: int
) -> None:
    program = f"import signal, sys, time; signal.signal(signal.SIGTERM, {answer})"
    program += "; print('up', flush=True); time.sleep(600)"
    words = command("--state-dir", str(fake_spot_state_folder), "exec", "--", sys.executable, "-c", program)
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "up\n"
        process.send_signal(signal.SIGTERM)
        process.communicate()
    assert process.returncode == code


TRUSTS = """
import sys, bosdyn.client, bosdyn.client.util, beside
robot = bosdyn.client.create_standard_sdk("x").create_robot(sys.argv[1])
bosdyn.client.util.authenticate(robot)
print(len(robot.list_services()) > 5)
"""


@pytest.mark.parametrize("is_word", [False, True])
def test_exec_adds_to_the_programs_own_pythonpath(
    fake_spot_state_folder: Path, tmp_path: Path, is_word: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "beside.py").write_text("")
    monkeypatch.setenv("PYTHONPATH", "" if is_word else str(tmp_path))
    words = ["env", f"PYTHONPATH={tmp_path}"] if is_word else []
    words = command("--state-dir", str(fake_spot_state_folder), "exec", "--", *words, sys.executable, "-c", TRUSTS)
    ran = subprocess.run([*words, "HOST"], capture_output=True, text=True, check=False)
    assert ran.stdout == "True\n", ran.stderr


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--admin", "0.0.0.0:9000"], "the admin service needs no password"),
        (["--scenario", "no-such-file.yaml"], "no-such-file.yaml"),
        (["--socket", "/no/such/folder/s"], "no folder"),
        (["--socket", "s", "--address", "::1"], "exclude each other"),
        (["exec"], "exec needs a program"),
        (["exec", "--", "/no/such/program"], "cannot be run"),
    ],
    ids=["admin", "scenario", "socket", "both", "nothing", "no-program"],
)
def test_bad_words_are_an_error_of_ours(fake_spot_state_folder: Path, words: list[str], message: str) -> None:
    command_line = typer.main.get_command(app)
    with pytest.raises(SpotRlError, match=message):
        command_line.main(["--state-dir", str(fake_spot_state_folder), *words], standalone_mode=False)


def test_a_clients_broken_bytes_are_one_line_in_the_log() -> None:
    for error, told in (
        (DecodeError("cut short"), "a client's request cannot be read: cut short"),
        (ValueError("a defect of the fake"), "Exception deserializing message!"),
    ):
        record = logging.makeLogRecord({"msg": "Exception deserializing message!", "exc_info": (None, error, None)})
        assert in_one_line(record)
        assert record.getMessage() == told
        assert bool(record.exc_info) is isinstance(error, ValueError)


def test_a_port_in_use_endsin_one_line(fake_spot_state_folder: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        words = command("--state-dir", str(fake_spot_state_folder), "--port", str(port))
        ran = subprocess.run(words, capture_output=True, text=True, timeout=60)
    assert ran.returncode == 1
    assert f"cannot listen on 127.0.0.1:{port}: it is in use" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_a_signal_ends_it_cleanly_and_a_password_of_ones_own_is_never_printed(short_folder: Path) -> None:
    secret = short_folder / "secret"
    secret.write_text("canary-4711\n")
    secret.chmod(0o600)
    words = command("--json", "--verbose", "--state-dir", str(short_folder / "state"), "--password-file", str(secret))
    words += ["--socket", str(short_folder / "spot.sock"), "--admin", f"unix:{short_folder}/admin.sock"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = json.loads(process.stdout.readline())
        assert told["sdk_host"] == f"unix:{short_folder}/spot.sock"
        assert told["password_file"] == str(secret)
        program = "import bosdyn.client as c, sys; r = c.create_standard_sdk('x').create_robot(sys.argv[1]); "
        program += "r.authenticate('user', 'canary-4711'); print(r.get_id().species)"
        ran = subprocess.run(
            [sys.executable, "-c", program, told["sdk_host"]],
            env={**os.environ, **told["environment"]},
            capture_output=True,
            text=True,
            timeout=60,
        )
        assert ran.stdout.strip() == "spot", ran.stderr
        process.send_signal(signal.SIGTERM)
        rest, errors = process.communicate(timeout=30)
    assert process.returncode == 0, errors
    assert "canary-4711" not in json.dumps(told) + rest + errors
    assert not (short_folder / "spot.sock:443").exists()
    assert not (short_folder / "admin.sock").exists()
