"""Start a fake Spot that implements Boston Dynamics' network services."""

from __future__ import annotations

import json
import logging
import os
import signal
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from google.protobuf.message import DecodeError

from fake_robot.start.state_folder import DEFAULT_USERNAME, FakeOptions
from spot_model.errors import BadInputError
from spot_model.process.inherited import environment_as_inherited
from spot_model.process.signals import answered, run_in_foreground

if TYPE_CHECKING:
    from fake_robot.start.running import RunningFake
    from fake_robot.start.sdk_environment import SdkEnvironment
    from fake_robot.start.server import FakeServer

HOST_VARIABLE = "SPOT_RL_FAKE_HOST"
KILL_AFTER_S = 10.0

app = typer.Typer(invoke_without_command=True, no_args_is_help=False, add_completion=False)


@app.callback()
def fake_robot(
    context: typer.Context,
    scenario: Annotated[
        str, typer.Option(help="Scenario file (YAML), or the name of a built-in one; default: the default robot.")
    ] = "",
    lock_step: Annotated[
        bool, typer.Option("--lock-step", help="Robot time advances only through the admin service.")
    ] = False,
    address: Annotated[str, typer.Option(help="IP address to listen on.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="TCP port; 0 picks a free one.")] = 8443,
    socket: Annotated[Path | None, typer.Option(help="Listen on this Unix socket instead of TCP.")] = None,
    admin: Annotated[
        str, typer.Option(help="Address of the admin service: unix:/PATH or 127.0.0.1:PORT; default: a private socket.")
    ] = "",
    state_dir: Annotated[
        Path | None, typer.Option(help="Folder of certificates and password; default: one per user.")
    ] = None,
    username: Annotated[str, typer.Option(help="User name that the robot knows.")] = DEFAULT_USERNAME,
    password_file: Annotated[
        Path | None, typer.Option(help="File with the password, mode 0600; default: a random password.")
    ] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print one JSON object when ready.")] = False,
    until_stdin_closes: Annotated[
        bool, typer.Option("--until-stdin-closes", help="End when standard input closes, as when the parent dies.")
    ] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Log what the server does.")] = False,
) -> None:
    """Start a fake Spot that implements Boston Dynamics' network services."""
    logging.basicConfig(level=logging.INFO if verbose else logging.WARNING, format="%(levelname)s %(message)s")
    logging.getLogger("grpc._common").addFilter(in_one_line)
    if socket is not None and address != "127.0.0.1":
        raise BadInputError("--socket and --address exclude each other; give one of them")
    options = FakeOptions(scenario, lock_step, address, port, socket, admin, state_dir, username, password_file)
    if context.invoked_subcommand is not None:
        context.obj = options
        return
    stop = threading.Event()
    with (
        answered(lambda _: stop.set(), signal.SIGINT, signal.SIGTERM),
        _started(options, is_silent=json_output) as fake,
    ):
        typer.echo(json.dumps(fake.description()) if json_output else fake.text())
        sys.stdout.flush()
        if until_stdin_closes:
            threading.Thread(target=_wait_for_stdin, args=(fake.server,), daemon=True).start()
        while not fake.server.wait(0.1) and not stop.is_set():
            pass
        fake.server.raise_crash()


@app.command("exec", context_settings={"allow_extra_args": True, "ignore_unknown_options": True})
def exec_program(context: typer.Context) -> None:
    """Run a program against its own fake robot: exec -- python your_program.py HOST.

    Every argument that is HOST becomes the host argument; it is also in $SPOT_RL_FAKE_HOST. What lets the program
    trust the robot is put in front of PYTHONPATH, also of one among the arguments (env PYTHONPATH=lib python ...).
    Ctrl-C goes to the program; SIGTERM does, too, and 10 s later it is killed. The fake robot ends when the program
    has ended.
    """
    if not context.args:
        raise BadInputError("exec needs a program: spot-rl fake-robot exec -- python your_program.py HOST")
    options: FakeOptions = context.obj
    if options.port == FakeOptions.port:
        options = FakeOptions(**{**vars(options), "port": 0})
    with _started(options) as fake:
        host = fake.endpoints.sdk_host
        words = [_word(word, host, fake.environment) for word in context.args]
        environment = {**environment_as_inherited(os.environ), **fake.environment.variables(), HOST_VARIABLE: host}
        typer.echo(f"it serves; starting {words[0]} …", err=True)
        try:
            code = run_in_foreground(words, environment, kill_after_s=KILL_AFTER_S).code
        except OSError as error:
            raise BadInputError(f"the program {words[0]!r} cannot be run: {error.strerror}") from error
    raise typer.Exit(code)


def _word(word: str, host: str, environment: SdkEnvironment) -> str:
    """A word of a program's command line, as it is started."""
    name, is_set, value = word.partition("=")
    if is_set and name == "PYTHONPATH":
        return f"{name}={environment.in_front_of(value)}"
    return host if word == "HOST" else word


@app.command("conformance")
def conformance(
    robot: Annotated[str, typer.Option(help="Server that claims to be a Spot: HOST, HOST:PORT or unix:/path.")],
    i_stand_beside_it: Annotated[
        bool, typer.Option("--i-stand-beside-it", help="Needed for a host that may be a real robot.")
    ] = False,
    with_motion: Annotated[
        bool,
        typer.Option(
            "--with-motion", help="Also power the motors, stand, walk some 2 m and hold by joint control to its end."
        ),
    ] = False,
    ca_file: Annotated[Path | None, typer.Option(help="Certificate to trust beside the vendor's.")] = None,
    check: Annotated[list[str] | None, typer.Option(help="Name of a check to run; may repeat. All if none.")] = None,
    json_output: Annotated[bool, typer.Option("--json", help="Print the results as JSON.")] = False,
) -> None:
    """Check what a server that claims to be a Spot accepts and refuses: conformance --robot HOST."""
    from fake_robot.conformance.command import run_suite

    code = run_suite(
        robot,
        is_attended=i_stand_beside_it,
        with_motion=with_motion,
        ca_file=ca_file,
        names=tuple(check or ()),
        as_json=json_output,
    )
    raise typer.Exit(code)


def in_one_line(record: logging.LogRecord) -> bool:
    """Bytes of a client that are no message are its defect: they get a line in the log, not a traceback of ours."""
    error = record.exc_info[1] if record.exc_info else None
    if isinstance(error, DecodeError):
        record.msg, record.args, record.exc_info = "a client's request cannot be read: %s", (error,), None
    return True


def _started(options: FakeOptions, *, is_silent: bool = False) -> RunningFake:
    if not is_silent:
        typer.echo("starting a fake Spot …", err=True)  # loading gRPC and MuJoCo takes seconds on a busy computer
    from fake_robot.start.running import RunningFake

    return RunningFake(options)


def _wait_for_stdin(server: FakeServer) -> None:
    while os.read(sys.stdin.fileno(), 4096):
        pass
    server.request_stop()
