"""The fake robot's server: its services over TLS on one address, its admin service on another."""

from __future__ import annotations

import logging
import socket
import threading
from collections.abc import Callable
from concurrent import futures
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import grpc

from fake_robot.faults.registry import FaultInjector
from fake_robot.robot.robot import Robot
from fake_robot.scenario.parts import ServicesConfig
from fake_robot.services.admin import AdminService
from fake_robot.services.auth import Credentials
from fake_robot.services.calls import UnaryCalls
from fake_robot.services.gate import GatekeeperInterceptor
from fake_robot.services.stepping import Stepping, StepSocket
from fake_robot.services.wiring import add_services
from fake_robot.services.world import World
from fake_robot.start.certificates import ServerCertificates
from spot_model.errors import SpotRlError

UNIX_PREFIX = "unix:"
SDK_PORT = 443
"""The port that the SDK appends to every host argument; a Unix socket's path ends in it too."""


class BindError(SpotRlError):
    """The server cannot listen where it was told to."""


def listen_target(address: str, port: int) -> str:
    """The gRPC target of the robot's server for an IP address, or for ``unix:/path``."""
    if address.startswith(UNIX_PREFIX):
        return f"{address}:{SDK_PORT}"
    return f"[{address}]:{port}" if ":" in address else f"{address}:{port}"


def sdk_host(address: str, port: int) -> str:
    """What an SDK program must be given as host name. The SDK appends ``:443`` to it, whatever it is.

    For TCP this makes a list of two addresses, of which the first is ours; on port 443 the plain address will do. [sdk]
    """
    if address.startswith(UNIX_PREFIX):
        return address
    family = "ipv6" if ":" in address else "ipv4"
    reachable = {"0.0.0.0": "127.0.0.1", "::": "::1"}.get(address, address)  # noqa: S104 - compared, not bound
    bracketed = f"[{reachable}]" if family == "ipv6" else reachable
    if port == SDK_PORT:
        return bracketed
    return f"{family}:{bracketed}:{port},{bracketed}"


def bind(target: str, add_port: Callable[[], int]) -> int:
    """Add a port to a server; returns its number. Raises BindError: ``target`` cannot be listened on."""
    if target.startswith(UNIX_PREFIX):
        _prepare_socket(Path(target.removeprefix(UNIX_PREFIX)))
    try:
        port = add_port()
    except RuntimeError:
        port = 0
    if not port:
        raise BindError(
            f"cannot listen on {target}: it is in use, or not an address of this machine; "
            "choose another (port 0 picks a free one)"
        )
    return port


def _prepare_socket(path: Path) -> None:
    """Refuse a socket that somebody listens on or whose path is too long; remove one that a dead server left."""
    if len(str(path).encode()) > 100:
        raise BindError(f"the path of the Unix socket {path} is longer than 100 bytes; choose a shorter one")
    if not path.parent.is_dir():
        raise BindError(f"there is no folder {path.parent} for the Unix socket {path.name}; make it first")
    if not path.is_socket():
        if path.exists():
            raise BindError(f"{path} exists and is no socket; choose another path")
        return
    with socket.socket(socket.AF_UNIX) as probe:
        try:
            probe.connect(str(path))
        except OSError:
            path.unlink()
            return
    raise BindError(f"another server listens on {path}; stop it, or choose another path")


_LOGGER = logging.getLogger(__name__)


class SimulationCrashError(SpotRlError):
    """The robot's simulation ended by itself; a defect of the fake, or a scenario beyond what it can compute."""

    exit_code = 70


@dataclass(frozen=True)
class Endpoints:
    """Where a running fake listens.

    ``robot`` and ``admin`` are gRPC targets; ``sdk_host`` is what an SDK program takes as the robot's host name.
    """

    robot: str
    sdk_host: str
    admin: str
    host: str
    port: int


class FakeServer:
    """Serves one robot, which it starts and stops. A context manager: leaving it stops the servers and the robot.

    ``address`` is an IP address to listen on, at a TCP port (0 picks a free one), or ``unix:/path``; ``admin`` is the
    gRPC target of the admin service: ``unix:/path``, or ``127.0.0.1:PORT`` (0 picks one).
    """

    def __init__(
        self,
        robot: Robot,
        config: ServicesConfig,
        credentials: Credentials,
        certificates: ServerCertificates,
        *,
        address: str = "127.0.0.1",
        port: int = 0,
        admin: str = "127.0.0.1:0",
    ) -> None:
        self._robot = robot
        self._config = config
        self._certificates = certificates
        self._address, self._port, self._admin_target = address, port, admin
        self.world = World(robot, config, credentials)
        """What the services share."""
        self.faults = FaultInjector(self.world)
        """The faults that can be injected."""
        self._stop_requested = threading.Event()
        self._ticker: threading.Thread | None = None
        self._servers: list[grpc.Server] = []
        self._steps: StepSocket | None = None

    def start(self) -> Endpoints:
        """Start robot and servers. Raises BindError."""
        try:
            port = self._start_robot_server()
            admin_target = self._start_admin_server()
            self._robot.start()
        except BaseException:
            self.stop()
            raise
        self.world.estop.apply()
        self._ticker = threading.Thread(target=self._tick_until_stopped, name="fake-robot-ticker", daemon=True)
        self._ticker.start()
        target = listen_target(self._address, port)
        _LOGGER.info("serving on %s, admin on %s", target, admin_target)
        return Endpoints(target, sdk_host(self._address, port), admin_target, self._address, port)

    def stop(self) -> None:
        """Stop servers and robot; harmless when called again."""
        self._stop_requested.set()
        if self._ticker is not None and self._ticker is not threading.current_thread():
            self._ticker.join()
        self.world.link.end_streams()
        for stopped in [server.stop(0.5) for server in self._servers]:
            stopped.wait()
        self._servers.clear()
        if self._steps is not None:
            self._steps.close()
        self._robot.stop()

    def raise_crash(self) -> None:
        """Raise what ended the simulation, if anything did. Raises SimulationCrashError."""
        if self._robot.crash is not None:
            raise SimulationCrashError(f"the simulation ended by itself: {self._robot.crash!r}") from self._robot.crash

    def request_stop(self) -> None:
        """Have ``wait`` return."""
        self._stop_requested.set()

    def wait(self, timeout_s: float | None = None) -> bool:
        """Wait until somebody asks the server to stop; False after ``timeout_s`` without."""
        return self._stop_requested.wait(timeout_s)

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _start_robot_server(self) -> int:
        """Serve the robot; returns the port."""
        config, world = self._config, self.world
        server = grpc.server(
            futures.ThreadPoolExecutor(max_workers=config.max_concurrent_calls, thread_name_prefix="fake-robot"),
            interceptors=[GatekeeperInterceptor(world.auth, world.link)],
            options=[
                ("grpc.so_reuseport", 0),
                ("grpc.max_receive_message_length", config.max_message_bytes),
                ("grpc.max_metadata_size", 32 * 1024),
            ],
            maximum_concurrent_rpcs=config.max_concurrent_calls,
        )
        add_services(server, world)
        tls = grpc.ssl_server_credentials([(self._certificates.key_pem, self._certificates.certificate_pem)])
        target = listen_target(self._address, self._port)
        port = bind(target, lambda: server.add_secure_port(target, tls))
        server.start()
        self._servers.append(server)
        return port

    def _start_admin_server(self) -> str:
        server = grpc.server(
            futures.ThreadPoolExecutor(max_workers=4, thread_name_prefix="fake-admin"),
            options=[("grpc.so_reuseport", 0)],
        )
        stepping = Stepping(self.world, self.faults)
        self._steps = StepSocket(stepping.step) if self._robot.is_lock_step else None
        path = "" if self._steps is None else self._steps.path
        service = AdminService(self.world, self.faults, stepping, self.request_stop, step_socket=path)
        server.add_generic_rpc_handlers((UnaryCalls([service]),))
        target = self._admin_target
        port = bind(target, lambda: server.add_insecure_port(target))
        server.start()
        self._servers.append(server)
        if target.startswith(UNIX_PREFIX):
            return target
        return f"{target.rpartition(':')[0]}:{port}"

    def _tick_until_stopped(self) -> None:
        while not self._stop_requested.wait(0.05):
            if self._robot.crash is not None:
                _LOGGER.error("the simulation ended: %r", self._robot.crash, exc_info=self._robot.crash)
                self.request_stop()
                return
            self.world.tick()
            self.faults.tick()
