"""A robot without physics for the tests of the services, and a server for it inside the test's process."""

from __future__ import annotations

import queue
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fake_robot.network.requests import CameraView, StandPose, WalkPlan
from fake_robot.network.status import (
    BehaviorFault,
    EstopLevel,
    Mode,
    MotorPower,
    Snapshot,
    StreamFailure,
    SystemFault,
)
from fake_robot.scenario.parts import ServicesConfig
from fake_robot.services.auth import Credentials
from fake_robot.start.certificates import ServerCertificates, make_certificates
from fake_robot.start.server import Endpoints, FakeServer

START_NS = 1_700_000_000_000_000_000


class StubClock:
    """A clock that tests set forward by hand."""

    def __init__(self) -> None:
        self.stamp_ns = START_NS
        self.jumped_ns = 0

    def now_ns(self) -> int:
        return self.stamp_ns

    def elapsed_ns(self) -> int:
        return self.stamp_ns - START_NS - self.jumped_ns

    def jump_s(self, seconds: float) -> None:
        """Set the clock; no time passes."""
        self.stamp_ns += round(seconds * 1e9)
        self.jumped_ns += round(seconds * 1e9)

    def pass_s(self, seconds: float) -> None:
        self.stamp_ns += round(seconds * 1e9)


class StubSubscription:
    """Gives out the messages that a test puts in."""

    def __init__(self) -> None:
        self.messages: queue.SimpleQueue[bytes] = queue.SimpleQueue()
        self._closed = threading.Event()

    def get(self, timeout_s: float) -> bytes | None:
        try:
            return self.messages.get(timeout=min(timeout_s, 0.02))
        except queue.Empty:
            return None

    @property
    def is_closed(self) -> bool:
        return self._closed.is_set()

    def close(self) -> None:
        self._closed.set()


class StubCommandStream:
    """Remembers what was submitted, and fails when a test says so."""

    def __init__(self, on_failure: Callable[[], None]) -> None:
        self.requests: list[Any] = []
        self.is_closed = False
        self._on_failure = on_failure
        self.failure: StreamFailure | None = None
        self.arrived = threading.Semaphore(0)

    def fail(self, status: int, message: str) -> None:
        self.failure = StreamFailure(status, message)
        self._on_failure()


class StubRobot:
    """Obeys at once and counts calls; a test reads ``calls`` and may replace ``state``."""

    def __init__(self, *, is_lock_step: bool = False) -> None:
        self.clock = StubClock()
        self.is_lock_step = is_lock_step
        self.calls: list[str] = []
        self.courses: list[tuple[StandPose, ...]] = []
        self.plans: list[WalkPlan] = []
        self.last_command_key = 0
        self.commands_submitted = 0
        self.last_state_stamp_ns = 0
        self.states_sent = 0
        self.subscriptions: list[StubSubscription] = []
        self.streams: list[StubCommandStream] = []
        self.injected: dict[int, str] = {}
        self.views: list[CameraView] = []
        self.crash: BaseException | None = None
        zeros = np.zeros
        self.state = Snapshot(
            robot_stamp_ns=START_NS,
            mode=Mode.LIMP,
            motor_power=MotorPower.OFF,
            estop_level=EstopLevel.NONE,
            position_rad=np.arange(12) * 0.1,
            velocity_rad_s=zeros(12),
            load_nm=zeros(12),
            position_of_body_in_odom_m=np.array([1.0, 2.0, 0.5]),
            odom_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
            position_of_body_in_vision_m=np.array([3.0, 4.0, 0.5]),
            vision_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
            linear_vel_of_body_in_odom_m_s=np.array([0.1, 0.2, 0.3]),
            angular_vel_of_body_in_odom_rad_s=zeros(3),
            linear_vel_of_body_in_vision_m_s=zeros(3),
            angular_vel_of_body_in_vision_rad_s=zeros(3),
            foot_contact=np.array([True, True, True, False]),
            foot_position_in_body_m=np.array(
                [[0.3, 0.2, -0.5], [0.3, -0.2, -0.5], [-0.3, 0.2, -0.5], [-0.3, -0.2, -0.5]]
            ),
            ground_height_in_odom_m=0.0,
            battery_charge_percent=80.0,
            battery_voltage_v=57.0,
            battery_current_a=-3.0,
            battery_temperature_c=(30.0, 31.0),
            battery_runtime_s=3600.0,
            is_battery_missing=False,
            motor_temperature_c={"fl_hx": 40.0},
        )

    def set(self, **changes: Any) -> None:
        self.state = replace(self.state, **changes)

    def __getattr__(self, name: str) -> Callable[[], None]:
        """Some calls are counted and do nothing else."""
        if name not in {"start", "stop", "stop_motion", "freeze", "selfright", "safe_power_off"}:
            raise AttributeError(name)
        return lambda: self.calls.append(name)

    def snapshot(self) -> Snapshot:
        return replace(self.state, robot_stamp_ns=self.clock.now_ns())

    def power_on(self) -> None:
        self.calls.append("power_on")
        self.set(motor_power=MotorPower.POWERING_ON)

    def power_off(self) -> None:
        self.calls.append("power_off")
        self.set(motor_power=MotorPower.OFF, mode=Mode.LIMP)

    def stand(self, course: Sequence[StandPose] = ()) -> None:
        self.courses.append(tuple(course))
        self.calls.append("stand" + "".join(f" {p.height_m:.2f} {p.roll_rad:.2f} {p.yaw_rad:.2f}" for p in course))
        self.set(mode=Mode.STANDING_UP)

    def walk(self, plan: WalkPlan) -> None:
        self.plans.append(plan)
        self.calls.append("walk")
        self.set(mode=Mode.WALKING)

    def place_feet(self, feet_in_odom_m: Any, accuracy_m: float) -> None:
        self.calls.append("place_feet")
        self.set(mode=Mode.STEPPING)

    def see(self, view: CameraView) -> None:
        self.views.append(view)

    def why_no_walk(self) -> str | None:
        return None

    def sit(self) -> None:
        self.calls.append("sit")
        self.set(mode=Mode.SITTING_DOWN)

    def enter_joint_control(self) -> None:
        self.calls.append("enter_joint_control")
        self.set(mode=Mode.JOINT_CONTROL)

    def set_estop_level(self, level: EstopLevel) -> None:
        if level is not self.state.estop_level:
            self.calls.append(f"estop {level.value}")
        self.set(estop_level=level)

    def add_behavior_fault(self, cause: str) -> None:
        faults = (*self.state.behavior_faults, BehaviorFault(len(self.state.behavior_faults) + 1, START_NS, cause))
        self.set(behavior_faults=faults)

    def clear_behavior_fault(self, fault_id: int) -> bool:
        kept = tuple(fault for fault in self.state.behavior_faults if fault.fault_id != fault_id)
        is_cleared = len(kept) < len(self.state.behavior_faults)
        self.set(behavior_faults=kept)
        return is_cleared

    def add_system_fault(self, name: str, severity: str) -> None:
        fault = SystemFault(name, START_NS, severity=severity, attributes=("power",))
        self.set(system_faults=(*self.state.system_faults, fault))

    def open_command_stream(self, on_failure: Callable[[], None]) -> StubCommandStream:
        self.streams.append(StubCommandStream(on_failure))
        return self.streams[-1]

    def submit(self, stream: StubCommandStream, request: Any) -> None:
        stream.requests.append(request)
        self.last_command_key = request.joint_command.user_command_key
        self.commands_submitted += 1
        stream.arrived.release()

    def close_stream(self, stream: StubCommandStream) -> None:
        stream.is_closed = True

    def submit_to_open_stream(self, request: Any) -> None:
        if self.streams:
            self.submit(self.streams[-1], request)

    def subscribe_state(self) -> StubSubscription:
        self.subscriptions.append(StubSubscription())
        return self.subscriptions[-1]

    def advance(self, duration_ns: int) -> None:
        self.clock.stamp_ns += duration_ns

    def advance_states(self, count: int, max_duration_ns: int | None = None) -> None:
        count = count if max_duration_ns is None else min(count, max_duration_ns // 3_000_000)
        self.clock.stamp_ns += 3_000_000 * count if max_duration_ns is None else max_duration_ns
        self.states_sent += count
        self.last_state_stamp_ns = self.clock.stamp_ns

    def wait_for_command_key(self, key: int, timeout_s: float, *, beyond: int = 0) -> bool:
        return self.last_command_key >= key and self.commands_submitted > beyond

    def inject(self, name: str, parameters: Mapping[str, float | str], duration_s: float | None) -> int:
        self.injected[len(self.injected) + 1] = name
        return len(self.injected)

    def clear_faults(self, fault_ids: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(i for i in fault_ids if self.injected.pop(i, None) is not None)

    def active_faults(self) -> Mapping[int, str]:
        return dict(self.injected)

    def truth(self, *, reset_extremes: bool = False) -> Any:
        return SimpleNamespace(
            robot_stamp_ns=self.clock.now_ns(),
            position_of_body_in_world_m=np.array([1.0, 2.0, 3.0]),
            world_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
            linear_vel_of_body_in_world_m_s=np.zeros(3),
            angular_vel_of_body_in_body_rad_s=np.zeros(3),
            body_height_m=0.5,
            joint_position_rad=np.zeros(12),
            joint_velocity_rad_s=np.zeros(12),
            joint_torque_nm=np.arange(12.0),
            foot_contact=np.ones(4, dtype=bool),
            foot_force_n=np.zeros(4),
            has_fallen=False,
            body_height_min_m=0.4,
            peak_torque_nm=11.0,
        )


@dataclass
class ServedStub:
    """A stub robot behind a real server."""

    robot: StubRobot
    server: FakeServer
    endpoints: Endpoints
    certificates: ServerCertificates
    credentials: Credentials

    def sdk(self, *clients: type) -> Any:
        """An SDK that trusts the server, with fresh default clients and ``clients``."""
        from bosdyn.client.sdk import create_standard_sdk

        return create_standard_sdk("test", list(clients), cert_resource_glob=str(self.certificates.ca_path))

    def sdk_robot(self, *clients: type, is_authenticated: bool = True) -> Any:
        """A robot object of the SDK, by default logged in."""
        robot = self.sdk(*clients).create_robot(self.endpoints.sdk_host)
        if is_authenticated:
            robot.authenticate(self.credentials.username, self.credentials.password)
        return robot


@pytest.fixture(scope="session")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> ServerCertificates:
    """Certificates for the whole session."""
    return make_certificates(tmp_path_factory.mktemp("certificates"))


@pytest.fixture
def serve_stub(certificates: ServerCertificates) -> Iterator[Callable[..., ServedStub]]:
    """Start a server around a stub robot; keywords go into its configuration."""
    servers = []

    def serve(robot: StubRobot | None = None, *, address: str = "127.0.0.1", **config: Any) -> ServedStub:
        robot = robot or StubRobot()
        credentials = Credentials("user", "correct horse")
        server = FakeServer(robot, ServicesConfig(**config), credentials, certificates, address=address)
        servers.append(server)
        return ServedStub(robot, server, server.start(), certificates, credentials)

    yield serve
    for server in servers:
        server.stop()


@pytest.fixture
def stub(serve_stub: Callable[..., ServedStub]) -> ServedStub:
    """A stub robot with the default configuration."""
    return serve_stub()


@pytest.fixture
def stub_robot_type() -> type[StubRobot]:
    """The stub's class, for tests that need one in lock-step."""
    return StubRobot


@pytest.fixture
def short_folder() -> Iterator[Path]:
    """A temporary folder whose path is short enough for a Unix socket."""
    import tempfile

    with tempfile.TemporaryDirectory(prefix="spot-rl-") as folder:
        yield Path(folder)
