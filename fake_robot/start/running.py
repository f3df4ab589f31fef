"""A fake robot put together from what the user asked for, and what a program must know to reach it."""

from __future__ import annotations

import contextlib
import os
import shlex
import tempfile
from pathlib import Path
from typing import Any, Self

from fake_robot.robot.robot import Robot
from fake_robot.scenario.scenario import Scenario, load_scenario
from fake_robot.services.auth import Credentials
from fake_robot.start.certificates import make_certificates
from fake_robot.start.sdk_environment import SdkEnvironment, write_sdk_folder
from fake_robot.start.server import SDK_PORT, BindError, Endpoints, FakeServer
from fake_robot.start.state_folder import FakeOptions, default_state_folder, ensure_credentials, read_password

LOOPBACK = ("127.0.0.1:", "localhost:", "[::1]:")


class RunningFake:
    """A fake that serves, and what a program must know to reach it. A context manager.

    Raises:
        SpotRlError: The scenario, folder, password or address cannot be used.
    """

    def __init__(self, options: FakeOptions) -> None:
        self._options = options
        self._scenario = scenario_of(options)
        _check_admin(options.admin)
        folder = options.state_dir or default_state_folder()
        self._credentials = _credentials(options, folder)
        self._host = "" if options.socket is not None else options.address
        extra_names = () if self._host in {"", "127.0.0.1", "localhost", "0.0.0.0"} else (self._host,)  # noqa: S104
        self._certificates = make_certificates(folder, addresses=extra_names)
        self.environment = SdkEnvironment(
            self._certificates.ca_path.absolute(),
            write_sdk_folder(folder, self._certificates.ca_path).absolute(),
            self._credentials.username,
            self._credentials.password,
        )
        self._stack = contextlib.ExitStack()
        self.server: FakeServer
        self.endpoints: Endpoints

    def __enter__(self) -> Self:
        with contextlib.ExitStack() as stack:
            private = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="spot-rl-fake-")))
            self.server = FakeServer(
                Robot(self._scenario),
                self._scenario.services,
                self._credentials,
                self._certificates,
                address=self._host or f"unix:{self._options.socket}",
                port=self._options.port,
                admin=self._options.admin or f"unix:{private / 'admin.sock'}",
            )
            self.endpoints = self.server.start()
            if self._options.socket is not None:
                stack.callback(Path(f"{self._options.socket}:{SDK_PORT}").unlink, missing_ok=True)
            stack.callback(self.server.stop)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

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
        folder = shlex.quote(settings.pop("PYTHONPATH"))
        lines = [f"  export PYTHONPATH={folder}${{PYTHONPATH:+:$PYTHONPATH}}"]
        lines += [f"  export {name}={shlex.quote(value)}" for name, value in settings.items()]
        return "\n".join(
            [
                "A fake Spot serves Boston Dynamics' API; Ctrl-C ends it.",
                f"  spot-rl        --robot {self.endpoints.robot}",
                f"  host argument  {self.endpoints.sdk_host} (of SDK programs)",
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


def _credentials(options: FakeOptions, folder: Path) -> Credentials:
    if options.password_file is not None:
        return Credentials(options.username, read_password(options.password_file))
    return ensure_credentials(folder, username=options.username)


def _check_admin(asked: str) -> None:
    if asked and not asked.startswith(("unix:/", *LOOPBACK)):
        raise BindError(
            f"--admin {asked} is not allowed: the admin service needs no password; give unix:/PATH or 127.0.0.1:PORT"
        )
