"""The fake robot's server: its services over TLS on one address, its admin service on another."""

from __future__ import annotations

import logging
import threading
from concurrent import futures
from dataclasses import dataclass
from typing import Self

import grpc

from fake_robot.robot.robot import Robot
from fake_robot.scenario.services_config import ServicesConfig
from fake_robot.services.admin.admin import AdminService
from fake_robot.services.admin.injection import FaultInjector
from fake_robot.services.admin.step_socket import StepSocket
from fake_robot.services.admin.stepping import Stepping
from fake_robot.services.calls.access import GatekeeperInterceptor
from fake_robot.services.identity.tokens import Credentials
from fake_robot.services.sensors.world import World
from fake_robot.services.wiring import add_services
from fake_robot.start.certificates import ServerCertificates
from fake_robot.start.listen import UNIX_PREFIX, bind, listen_target, sdk_host
from spot_model.errors import SpotRlError
from spot_protos import fake_admin_pb2_grpc

_LOGGER = logging.getLogger(__name__)

TICK_PERIOD_S = 0.05
STOP_GRACE_S = 0.5
ADMIN_THREADS = 4


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
    """Serves one robot. A context manager: leaving it stops the servers and the robot.

    Args:
        robot: Started by ``start``, stopped by ``stop``.
        config: Settings of the services.
        credentials: The user name and password that open it.
        certificates: Certificate and key of the TLS server.
        address: IP address to listen on, or ``unix:/path`` without a port.
        port: TCP port; 0 picks a free one. Ignored for a Unix socket.
        admin: gRPC target of the admin service: ``unix:/path``, or ``127.0.0.1:PORT`` (0 picks one).
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
        self._world = World(robot, config, credentials)
        self._faults = FaultInjector(self._world)
        self._credentials = credentials
        self._stop_requested = threading.Event()
        self._ticker: threading.Thread | None = None
        self._servers: list[grpc.Server] = []
        self._steps: StepSocket | None = None

    @property
    def world(self) -> World:
        """What the services share."""
        return self._world

    @property
    def faults(self) -> FaultInjector:
        """The faults that can be injected."""
        return self._faults

    def start(self) -> Endpoints:
        """Start robot and servers.

        Raises:
            BindError: An address or port cannot be listened on; nothing is left running.
        """
        try:
            robot_server, robot_target, port = self._start_robot_server()
            admin_target = self._start_admin_server()
            self._robot.start()
        except BaseException:
            self.stop()
            raise
        self._world.apply_estop()
        self._ticker = threading.Thread(target=self._tick_until_stopped, name="fake-robot-ticker", daemon=True)
        self._ticker.start()
        _LOGGER.info("serving on %s, admin on %s", robot_target, admin_target)
        del robot_server
        return Endpoints(
            robot=robot_target,
            sdk_host=sdk_host(self._address, port),
            admin=admin_target,
            host=self._address,
            port=port,
        )

    def stop(self) -> None:
        """Stop servers and robot; harmless when called again."""
        self._stop_requested.set()
        if self._ticker is not None and self._ticker is not threading.current_thread():
            self._ticker.join()
        self._world.link.end_streams()
        for stopped in [server.stop(STOP_GRACE_S) for server in self._servers]:
            stopped.wait()
        self._servers.clear()
        if self._steps is not None:
            self._steps.close()
        self._robot.stop()

    def raise_crash(self) -> None:
        """Raise what ended the simulation, if anything did.

        Raises:
            SimulationCrashError: The simulation ended by itself.
        """
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

    def _start_robot_server(self) -> tuple[grpc.Server, str, int]:
        config, world = self._config, self._world
        server = grpc.server(
            futures.ThreadPoolExecutor(max_workers=config.max_concurrent_calls, thread_name_prefix="fake-robot"),
            interceptors=[GatekeeperInterceptor(world.tokens, world.link, world.now_ns)],
            options=[
                ("grpc.so_reuseport", 0),
                ("grpc.max_receive_message_length", config.max_message_bytes),
                ("grpc.max_metadata_size", 32 * 1024),
            ],
            maximum_concurrent_rpcs=config.max_concurrent_calls,
        )
        add_services(server, world, self._credentials.username)
        key_and_certificate = (self._certificates.key_pem, self._certificates.certificate_pem)
        tls = grpc.ssl_server_credentials([key_and_certificate])
        target = listen_target(self._address, self._port)
        port = bind(target, lambda: server.add_secure_port(target, tls))
        server.start()
        self._servers.append(server)
        return server, listen_target(self._address, port), port

    def _start_admin_server(self) -> str:
        server = grpc.server(
            futures.ThreadPoolExecutor(max_workers=ADMIN_THREADS, thread_name_prefix="fake-admin"),
            options=[("grpc.so_reuseport", 0)],
        )
        stepping = Stepping(self._world, self._faults)
        self._steps = StepSocket(stepping.step) if self._robot.is_lock_step else None
        path = "" if self._steps is None else self._steps.path
        service = AdminService(self._world, self._faults, stepping, self.request_stop, step_socket=path)
        fake_admin_pb2_grpc.add_FakeAdminServicer_to_server(service, server)  # type: ignore[no-untyped-call]
        target = self._admin_target
        port = bind(target, lambda: server.add_insecure_port(target))
        server.start()
        self._servers.append(server)
        if target.startswith(UNIX_PREFIX):
            return target
        return f"{target.rpartition(':')[0]}:{port}"

    def _tick_until_stopped(self) -> None:
        while not self._stop_requested.wait(TICK_PERIOD_S):
            if self._robot.crash is not None:
                _LOGGER.error("the simulation ended: %r", self._robot.crash, exc_info=self._robot.crash)
                self.request_stop()
                return
            self._world.tick()
            self._faults.tick()
