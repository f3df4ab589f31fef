"""What a process has from its parent: blocked and ignored signals, closed streams, a folder full of other modules."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from collections.abc import Set as AbstractSet
from functools import cache
from pathlib import Path

import pytest

from spot_model.process.child_process import HEARD, ChildProcess, module_command, without_secrets
from spot_model.process.signals import STOP_SIGNALS, exit_on_termination

SPOT_RL = str(Path(sys.executable).with_name("spot-rl"))
SAYS_SIGNALS = """
import signal, sys
sys.argv = ["spot-rl", "--version"]
from spot_model.__main__ import main
try:
    main()
except SystemExit:
    print(sorted(signal.pthread_sigmask(signal.SIG_BLOCK, ())))
"""
BLOCKS = """
import os, signal, sys
signal.pthread_sigmask(signal.SIG_BLOCK, range(1, signal.NSIG))
for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
    signal.signal(number, signal.SIG_IGN)
os.execv(sys.argv[1], sys.argv[1:])
"""
DEAF = (sys.executable, "-I", "-c", BLOCKS)
"""Words before a command that is to start with every signal blocked, and those ignored that end a run."""


def planted(folder: Path, but: AbstractSet[str] = frozenset()) -> Path:
    """A folder with a module for each of Python's and of those that a run needs; one that is imported leaves a mark."""
    others = {"numpy", "grpc", "google", "bosdyn", "pydantic", "yaml", "mcap", "typer", "rich", "onnxruntime", "mujoco"}
    ours = {"spot_model", "spot_log", "spot_runtime", "spot_tools", "fake_robot", "spot_protos"}
    folder.mkdir()
    for name in {*sys.stdlib_module_names, *others, *ours, "not_there"} - but:
        (folder / f"{name}.py").write_text(f"open({str(folder / 'mark')!r}, 'a').write({name!r} + ' ')\n")
    return folder


@cache
def loaded_first() -> frozenset[str]:
    """What Python itself, and the console script, import before our first line."""
    shows = "import re, sys, spot_model.__main__; print(*{name.partition('.')[0] for name in sys.modules})"
    told = subprocess.run([sys.executable, "-c", shows], cwd="/", capture_output=True, text=True, check=True)
    return frozenset({*told.stdout.split(), "nt", "_winapi"})  # these two pathlib tries to import


def marks(folder: Path) -> str:
    mark = folder / "mark"
    return mark.read_text() if mark.exists() else ""


ROOT = Path(__file__).parents[2]
PRODUCT = ("spot_log", "spot_model", "spot_rl", "spot_runtime", "spot_tools", "fake_robot", "proof", "trainer")
SOURCES = {file.relative_to(ROOT): file.read_text() for folder in PRODUCT for file in (ROOT / folder).rglob("*.py")}
PROGRAMS = [file for file, text in SOURCES.items() if '__name__ == "__main__"' in text and file.name != "launch.py"]
MODULES = [".".join(file.with_suffix("").parts).removesuffix(".__main__") for file in sorted(PROGRAMS)]


def test_python_m_starts_nothing() -> None:
    assert "spot_runtime.rescue.guardian" in MODULES
    for file, text in SOURCES.items():
        assert not re.search(r'sys\.executable, "-[mc]"', text), f"{file} finds modules in the current folder"


@pytest.mark.parametrize("module", MODULES)
def test_no_module_comes_from_the_current_folder(module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(planted(tmp_path / "here"))
    monkeypatch.setenv("PYTHONPATH", f"{os.pathsep}/nowhere")  # an empty entry is the current folder
    process = ChildProcess.start(module, "--help", told=b"", output=HEARD, errors=subprocess.STDOUT)
    _, said = process.hear_out(60.0)
    process.end()
    assert marks(tmp_path / "here") == "", said.decode()


@pytest.mark.parametrize("words", [[SPOT_RL], [sys.executable, "-m", "spot_model"], module_command("spot_model")])
def test_the_command_line_neither(words: list[str], tmp_path: Path) -> None:
    folder = planted(tmp_path / "here")
    if "-m" in words:  # what Python itself loads before any line of ours
        for name in ("keyword", "operator", "reprlib", "functools", "collections", "types", "warnings", "contextlib"):
            (folder / f"{name}.py").unlink()
        for name in ("spot_model", "runpy", "importlib", "enum", "linecache", "pkgutil", "weakref", "typing"):
            (folder / f"{name}.py").unlink()
    done = subprocess.run([*words, "doctor", "--help"], cwd=folder, capture_output=True, text=True, check=False)
    assert (done.returncode, marks(folder)) == (0, ""), done.stderr


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (":/nowhere", ["run"]),
        ("/nowhere:", ["serve"]),
        (".", ["ctl"]),
        ("../here:/nowhere", ["fake-robot"]),
        (".::", ["--debug", "run"]),
    ],
)
def test_nor_does_any_relative_entry_of_pythonpath_lead_there(value: str, words: list[str], tmp_path: Path) -> None:
    folder = planted(tmp_path / "here", but=loaded_first())
    environment = {**os.environ, "PYTHONPATH": value}
    done = subprocess.run(
        [SPOT_RL, *words, "--help"], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, marks(folder)) == (0, ""), done.stderr
    is_named = value.startswith(".")
    assert ("is left out; write it in full" in done.stderr) == is_named
    assert str(folder) in done.stderr or not is_named


def test_nor_where_a_module_is_started_with_an_environment_of_its_own(tmp_path: Path) -> None:
    folder = planted(tmp_path / "here", but=loaded_first())
    words = module_command("spot_log.write.logger_child", "--help")
    environment = {**os.environ, "PYTHONPATH": f".{os.pathsep}"}
    done = subprocess.run(words, cwd=folder, env=environment, input=b"", capture_output=True, check=False)
    assert marks(folder) == "", done.stderr


LOOKS = """
import os, sys
from spot_model.process.python_path import leave_out_relative_entries
left = leave_out_relative_entries(sys.argv[1])
print(left, os.environ["PYTHONPATH"], [p for p in sys.path if p.startswith(os.getcwd())], sys.path[-1] == os.getcwd())
"""


@pytest.mark.parametrize(
    ("command", "value", "told"),
    [
        ("run", "{here}", "{{}} {here} ['{here}'] False"),
        ("run", ":/a:{here}:.", "{{'.': '{here}'}} /a:{here} ['{here}'] False"),
        ("run", ":/a::b:", "{{'b': '{here}/b'}} /a [] False"),
        ("train", ":/a:b", "{{}} /a:b ['{here}/b'] False"),
        ("train", ".:/a", "{{}} /a:. ['{here}'] True"),
    ],
)
def test_what_is_left_of_pythonpath(command: str, value: str, told: str, tmp_path: Path) -> None:
    environment = {**os.environ, "PYTHONSAFEPATH": "1", "PYTHONPATH": value.format(here=tmp_path)}
    words = [sys.executable, "-c", LOOKS, command]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == told.format(here=tmp_path)


def test_a_process_of_ours_is_told_no_secret(monkeypatch: pytest.MonkeyPatch) -> None:
    secrets = ("BOSDYN_CLIENT_PASSWORD", "GITHUB_TOKEN", "AWS_SECRET_ACCESS_KEY", "PGPASSWD", "API_KEY", "CREDENTIAL_X")
    for name in secrets:
        monkeypatch.setenv(name, "s3cr3t")
    shows = "import os; print(open('/proc/self/environ').read(), os.environ)"
    assert "s3cr3t" in subprocess.run([sys.executable, "-c", shows], capture_output=True, text=True, check=True).stdout
    process = ChildProcess.start("fake_robot.start.process", "0", "", "--help")
    # The kernel fills this in a moment after the program has replaced the fork: it is empty until then.
    while not (environment := Path(f"/proc/{process.pid}/environ").read_text()):
        assert process.exit_code is None
    process.end(60.0)
    assert "PATH" in environment
    assert "s3cr3t" not in environment
    assert without_secrets({"PYTHONPATH": ":/a:.:/b:c", "PYTHONINSPECT": "1"}) == {"PYTHONPATH": "/a:/b"}


@pytest.mark.parametrize("words", [[SPOT_RL], module_command("spot_model")])
def test_blocked_signals_are_unblocked(words: list[str]) -> None:
    says = [sys.executable, "-c", SAYS_SIGNALS]
    done = subprocess.run([*DEAF, *says], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    # The same program, as it is started, dies of a signal that its parent blocked.
    with subprocess.Popen([*DEAF, *words, "fake-robot", "--port", "0"], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline()
        process.send_signal(signal.SIGTERM)
        process.communicate(timeout=60.0)
        assert process.returncode in (0, -signal.SIGTERM)


@pytest.mark.parametrize("number", STOP_SIGNALS)
def test_a_block_that_is_to_end_ends_also_by_a_signal_that_was_ignored(number: signal.Signals) -> None:
    before = signal.signal(number, signal.SIG_IGN)
    try:
        with pytest.raises((SystemExit, KeyboardInterrupt)), exit_on_termination():
            signal.raise_signal(number)
        assert signal.getsignal(number) is signal.SIG_IGN
    finally:
        signal.signal(number, before)


@pytest.mark.parametrize("closed", ["2>&-", "<&- >&- 2>&-"])
def test_closed_streams(closed: str, tmp_path: Path) -> None:
    words = f"'{SPOT_RL}' run --robot 127.0.0.1:9 --policy policies/walk.onnx --log-dir '{tmp_path}' {closed}"
    login = {"BOSDYN_CLIENT_USERNAME": "u", "BOSDYN_CLIENT_PASSWORD": "p"}
    done = subprocess.run(["sh", "-c", words], cwd=ROOT, env={**os.environ, **login}, capture_output=True, check=False)
    assert done.returncode == 81, done.stderr
    assert b"internal error" not in done.stdout + done.stderr


@pytest.mark.parametrize(
    ("variables", "code"),
    [
        ({"PYTHONWARNINGS": "error", "PYTHONIOENCODING": "ascii", "LC_ALL": "C", "PYTHONOPTIMIZE": "1"}, 0),
        ({"PYTHONOPTIMIZE": "2"}, 2),
        ({"PYTHONINSPECT": "1"}, 0),
    ],
)
def test_variables_of_python(variables: dict[str, str], code: int) -> None:
    done = subprocess.run(
        [SPOT_RL, "run", "--help"], env={**os.environ, **variables}, capture_output=True, text=True, check=False
    )
    assert done.returncode == code, done.stderr
    assert "Traceback" not in done.stderr
    assert "internal error" not in done.stderr
