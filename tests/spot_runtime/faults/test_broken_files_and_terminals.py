"""Files, folders and terminals that nobody expects: an error in words, or a run that goes on; never a traceback."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from spot_log import LogReadError, read_run, recover_leftovers, recover_log
from spot_log.format.records import RunHeader
from spot_log.write.run_writer import RunWriter
from spot_model.errors import SpotRlError
from spot_model.io.velocity_sequence import load_sequence
from spot_model.io.yaml_text import FileTooLargeError, read_at_most
from spot_model.policy.contract import PolicyError
from spot_model.policy.policy import load_policy
from spot_runtime.config import load_config
from spot_runtime.hal.credentials import find_credentials, read_certificates
from spot_runtime.host.instance_lock import InstanceLock, LockError
from spot_tools.client import client_from

REPOSITORY = Path(__file__).parents[3]
WALK = REPOSITORY / "policies" / "walk.onnx"


def spot_rl(*words: str, **environment: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from spot_model.console.command_line import main; main()", *words]
    surroundings = {**os.environ, "BOSDYN_CLIENT_USERNAME": "u", "BOSDYN_CLIENT_PASSWORD": "p", **environment}
    return subprocess.run(command, env=surroundings, capture_output=True, text=True, timeout=120, cwd=REPOSITORY)


def test_devices_that_never_end_are_not_read_to_their_end(tmp_path: Path) -> None:
    zero = Path("/dev/zero")
    with pytest.raises(FileTooLargeError, match="at most 10"):
        read_at_most(zero, 10)
    assert read_at_most(Path("/dev/null"), 10) == b""
    with pytest.raises(PolicyError, match="policy /dev/zero cannot be read: it has more bytes than are allowed"):
        load_policy(zero)
    with pytest.raises(Exception, match="certificate file /dev/zero cannot be read: it has more bytes"):
        read_certificates(zero)
    for read in (read_run, lambda path: recover_log(path, tmp_path / "out.mcap")):
        for odd in (zero, tmp_path):
            with pytest.raises(LogReadError, match="is not a file; give one log"):
                read(odd)


def test_a_pipe_into_which_nobody_writes_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe, 0o600)
    reads: dict[str, Callable[[Path], object]] = {
        "policy": load_policy,
        "configuration": load_config,
        "credentials file": lambda path: find_credentials(path, {}),
        "file": lambda path: client_from("127.0.0.1:1", ca=path, certificate=path, key=path),
    }
    for what, read in reads.items():
        with pytest.raises(SpotRlError, match=f"{what} {pipe} cannot be read: it is a pipe and no file"):
            read(pipe)
    for odd in ("a\0b", "x" * 5000):
        for read in (load_policy, load_config):
            with pytest.raises(SpotRlError, match=r"cannot be read: (embedded null byte|File name too long)"):
                read(Path(odd))
        with pytest.raises(SpotRlError, match="is not a file; allowed"):
            load_sequence(odd)


def test_leftovers_that_are_no_files_are_passed_by(tmp_path: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    some_log = tmp_path_factory.mktemp("logs") / "some.mcap"
    RunWriter(some_log, RunHeader("some", 1)).close({}, "completed")
    os.mkfifo(tmp_path / "a.mcap.active")
    (tmp_path / "b.mcap.active").mkdir()
    (tmp_path / "c.mcap.active").symlink_to(tmp_path / "nowhere")
    (tmp_path / "d.mcap.active").write_bytes(b"noise")
    (tmp_path / "e.mcap.active").symlink_to(some_log)
    before = sorted(path.name for path in tmp_path.iterdir())
    assert recover_leftovers(tmp_path) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_a_lock_that_cannot_be_opened(tmp_path: Path) -> None:
    with (
        pytest.raises(LockError, match="cannot be opened: No such file or directory; set XDG_RUNTIME_DIR"),
        InstanceLock("robot", tmp_path / "none"),
    ):
        pass
    first = InstanceLock("robot", tmp_path)
    first._path.symlink_to(tmp_path / "elsewhere")
    with pytest.raises(LockError, match="symbolic links"), first:
        pass
    assert not (tmp_path / "elsewhere").exists()


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("--log-dir", "/dev/null"), 1, "the folder /dev/null for logs cannot be made"),
        (("--config", "/dev/zero"), 2, "more bytes than are allowed"),
        (("--policy", "/dev/zero"), 3, "more bytes than are allowed"),
        (("--repeat", "9" * 30), 2, "equal to 999999"),
    ],
)
def test_odd_names_on_the_command_line(words: tuple[str, ...], code: int, said: str, tmp_path: Path) -> None:
    done = spot_rl("run", "--robot", "127.0.0.1:9", "--policy", str(WALK), "--log-dir", str(tmp_path), *words)
    assert done.returncode == code, done.stderr
    assert said in done.stderr
    assert "Traceback" not in done.stderr


def test_a_terminal_that_knows_only_ascii() -> None:
    code = "from spot_tools.run import _say_last; _say_last('tick 5 µs → fine')"
    surroundings = {**os.environ, "PYTHONIOENCODING": "ascii"}
    done = subprocess.run([sys.executable, "-c", code], env=surroundings, capture_output=True, timeout=60)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"tick 5 ")


def test_a_terminal_that_nobody_reads() -> None:
    code = "from spot_tools.run import _say_last; _say_last('x' * 100000); raise SystemExit(10)"
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert process.stdout is not None
    process.stdout.close()
    assert process.wait(60) == 10
