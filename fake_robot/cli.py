"""Serve a fake Spot that speaks Boston Dynamics' own services."""

from __future__ import annotations

import json
import logging
import os
import shlex
import signal
import subprocess
import sys
import tempfile
import threading
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Annotated, Any, Self

import typer

from fake_robot.certificates import ensure_certificates, write_private
from fake_robot.robot import Robot
from fake_robot.scenario import Scenario, load_scenario
from fake_robot.sdk_environment import SdkEnvironment, write_sdk_folder
from fake_robot.server import BindError, Endpoints, FakeServer
from fake_robot.services.tokens import Credentials
from fake_robot.state_folder import DEFAULT_USERNAME, default_state_folder, ensure_credentials, read_password
from spot_model.errors import BadInputError

HOST_PLACEHOLDER = "HOST"
HOST_VARIABLE = "SPOT_RL_FAKE_HOST"
LOOPBACK = ("127.0.0.1:", "localhost:", "[::1]:")
ADMIN_SOCKET = "admin.sock"

app = typer.Typer(invoke_without_command=True, no_args_is_help=False, add_completion=False)


@dataclass(frozen=True)
class FakeOptions:
    """What the command line asked for."""

    scenario: str = ""
    lock_step: bool = False
    address: str = "127.0.0.1"
    port: int = 8443
    socket: Path | None = None
    admin: str = ""
    state_dir: Path | None = None
    username: str = DEFAULT_USERNAME
    password_file: Path | None = None


class RunningFake:
    """A fake that serves, and what a program must know to reach it. A context manager.

    Args:
        options: What to serve, and where.

    Raises:
        SpotRlError: The scenario, folder, password or address cannot be used.
    """

    def __init__(self, options: FakeOptions) -> None:
        self._options = options
        scenario = scenario_of(options)
        folder = options.state_dir or default_state_folder()
        credentials = _credentials(options, folder)
        host = "" if options.socket is not None else options.address
        extra_names = () if host in {"", "127.0.0.1", "localhost", "0.0.0.0"} else (host,)  # noqa: S104
        certificates = ensure_certificates(folder, addresses=extra_names)
        self.environment = SdkEnvironment(
            certificates.ca_path.absolute(),
            write_sdk_folder(folder, certificates.ca_path).absolute(),
            credentials.username,
            credentials.password,
        )
        self._temporary = tempfile.TemporaryDirectory(prefix="spot-rl-fake-")
        self.server = FakeServer(
            Robot(scenario),
            scenario.services,
            credentials,
            certificates,
            address=host or f"unix:{options.socket}",
            port=options.port,
            admin=_admin_target(options.admin, Path(self._temporary.name)),
        )
        self.endpoints: Endpoints

    def __enter__(self) -> Self:
        try:
            self.endpoints = self.server.start()
        except BaseException:
            self._temporary.cleanup()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.server.stop()
        if self._options.socket is not None:
            Path(f"{self._options.socket}:443").unlink(missing_ok=True)
        self._temporary.cleanup()

    def description(self) -> dict[str, Any]:
        """What ``--json`` prints. A password that the user brought in a file stays in that file."""
        environment = self.environment.variables(dict(os.environ))
        description: dict[str, Any] = {
            "host": self.endpoints.host,
            "port": self.endpoints.port,
            "sdk_host": self.endpoints.sdk_host,
            "ca_file": str(self.environment.ca_path),
            "sdk_folder": str(self.environment.sdk_folder),
            "username": self.environment.username,
            "admin": self.endpoints.admin,
            "pid": os.getpid(),
            "lock_step": self._options.lock_step,
        }
        if self._options.password_file is None:
            description["password"] = self.environment.password
        else:
            description["password_file"] = str(self._options.password_file.absolute())
            del environment["BOSDYN_CLIENT_PASSWORD"]
        return description | {"environment": environment}

    def text(self) -> str:
        """What is printed for a person."""
        settings = self.environment.variables({})
        password = shlex.quote(settings.pop("BOSDYN_CLIENT_PASSWORD"))
        if self._options.password_file is not None:
            password = f'"$(cat {shlex.quote(str(self._options.password_file.absolute()))})"'
        lines = [f"  export {name}={shlex.quote(value)}" for name, value in settings.items()]
        return "\n".join(
            [
                "A fake Spot serves Boston Dynamics' API; Ctrl-C ends it.",
                f"  host argument  {self.endpoints.sdk_host}",
                f"  admin service  {self.endpoints.admin}",
                f"  certificate    {self.environment.ca_path}",
                "An unmodified SDK program reaches it with this environment:",
                *lines,
                f"  export BOSDYN_CLIENT_PASSWORD={password}",
                f"  python your_program.py {shlex.quote(self.endpoints.sdk_host)}",
            ]
        )


def scenario_of(options: FakeOptions) -> Scenario:
    """The scenario, with lock-step if it was asked for."""
    scenario = load_scenario(options.scenario) if options.scenario else Scenario()
    return scenario.with_changes(time_mode="lock_step") if options.lock_step else scenario


@app.callback()
def fake_robot(
    context: typer.Context,
    scenario: Annotated[
        str, typer.Option(help="Scenario file (YAML), or the name of a shipped one; without it, the default robot.")
    ] = "",
    lock_step: Annotated[
        bool, typer.Option("--lock-step", help="Robot time passes only by the admin service.")
    ] = False,
    address: Annotated[str, typer.Option(help="IP address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="TCP port; 0 picks a free one.")] = 8443,
    socket: Annotated[Path | None, typer.Option(help="Listen on this Unix socket instead of TCP.")] = None,
    admin: Annotated[
        str,
        typer.Option(help="Where the admin service listens: unix:/PATH or 127.0.0.1:PORT; a private socket if empty."),
    ] = "",
    state_dir: Annotated[
        Path | None, typer.Option(help="Folder of certificates and password; one a user if not given.")
    ] = None,
    username: Annotated[str, typer.Option(help="User name that the robot knows.")] = DEFAULT_USERNAME,
    password_file: Annotated[
        Path | None, typer.Option(help="File with the password, mode 0600; one is made up if not given.")
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print one JSON object when ready.")] = False,
    ready_file: Annotated[Path | None, typer.Option(help="Also write that JSON object to this file.")] = None,
    until_stdin_closes: Annotated[
        bool, typer.Option("--until-stdin-closes", help="End when standard input closes, as when the parent dies.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log what the server does.")] = False,
) -> None:
    """Serve a fake Spot that speaks Boston Dynamics' own services."""
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format="%(levelname)s %(message)s")
    if socket is not None and address != "127.0.0.1":
        raise BadInputError("--socket and --address exclude each other; give one of them")
    options = FakeOptions(scenario, lock_step, address, port, socket, admin, state_dir, username, password_file)
    if context.invoked_subcommand is not None:
        context.obj = options
        return
    with _signals_end_it() as stop, RunningFake(options) as fake:
        description = json.dumps(fake.description())
        if ready_file is not None:
            _write_ready_file(ready_file, description)
        typer.echo(description if json_output else fake.text())
        sys.stdout.flush()
        if until_stdin_closes:
            threading.Thread(target=_wait_for_stdin, args=(fake.server,), daemon=True).start()
        while not fake.server.wait(0.2) and not stop.is_set():
            pass


@app.command("exec", context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def exec_program(context: typer.Context) -> None:
    """Run a program against a fake of its own: exec -- python your_program.py HOST.

    Every argument that is HOST becomes the host argument; it is also in $SPOT_RL_FAKE_HOST.
    """
    if not context.args:
        raise BadInputError("exec needs a program: spot-rl fake-robot exec -- python your_program.py HOST")
    options: FakeOptions = context.obj
    if options.port == FakeOptions.port:
        options = FakeOptions(**{**vars(options), "port": 0})
    with _signals_end_it(), RunningFake(options) as fake:
        host = fake.endpoints.sdk_host
        words = [host if word == HOST_PLACEHOLDER else word for word in context.args]
        environment = {**os.environ, **fake.environment.variables(), HOST_VARIABLE: host}
        try:
            code = _run_program(words, environment)
        except OSError as error:
            raise BadInputError(f"the program {words[0]!r} cannot be run: {error.strerror}") from error
    raise typer.Exit(code)


class _signals_end_it:  # noqa: N801 - reads as a phrase where it is used
    """Turn SIGINT and SIGTERM into an event while the block runs."""

    def __enter__(self) -> threading.Event:
        self._event = threading.Event()
        self._before = {number: signal.signal(number, self._note) for number in (signal.SIGINT, signal.SIGTERM)}
        return self._event

    def __exit__(self, *_: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._event.set()


def _run_program(words: list[str], environment: dict[str, str]) -> int:
    """Run to the end; a terminal's SIGINT reaches the program by itself. 128 + n for a program that signal n ended."""
    process = subprocess.Popen(words, env=environment)  # noqa: S603 - it is the user's own program
    code = process.wait()
    return code if code >= 0 else 128 - code


def _credentials(options: FakeOptions, folder: Path) -> Credentials:
    if options.password_file is not None:
        return Credentials(options.username, read_password(options.password_file))
    return ensure_credentials(folder, username=options.username)


def _admin_target(asked: str, temporary: Path) -> str:
    if not asked:
        return f"unix:{temporary / ADMIN_SOCKET}"
    if not asked.startswith(("unix:/", *LOOPBACK)):
        raise BindError(
            f"--admin {asked} is not allowed: the admin service needs no password; give unix:/PATH or 127.0.0.1:PORT"
        )
    return asked


def _write_ready_file(path: Path, description: str) -> None:
    try:
        write_private(path, description.encode() + b"\n")
    except OSError as error:
        raise BadInputError(f"the ready file {path} cannot be written: {error.strerror}") from error


def _wait_for_stdin(server: FakeServer) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    server.request_stop()
