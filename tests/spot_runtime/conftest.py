"""A robot written by hand, a tiny policy, and a source: what the loop's tests drive."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import grpc
import numpy as np
import onnx
import pytest
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_model.policy.contract import METADATA_KEY, PolicyContract, StoredPair
from spot_model.policy.policy import Policy, policy_from_bytes
from spot_model.robot import facts
from spot_model.robot.state import JointCommand, RobotState, SlowState
from spot_protos import fake_admin_pb2
from spot_protos.stub import stub
from spot_runtime.hal.base import JointControl, RobotInfo
from spot_runtime.stops import Stop

START_NS = 1_700_000_000_000_000_000
PERIOD_NS = facts.STATE_PERIOD_NS


STAND_LOAD_NM = np.array([-19.0, 0.5, 16.0, 19.0, 0.5, 16.0] * 2)
"""What carries the body of a robot that stands."""


def make_state(stamp_ns: int = START_NS, **changes: object) -> RobotState:
    """A robot that stands in the default pose."""
    index = stamp_ns // PERIOD_NS
    state = RobotState(
        robot_stamp_ns=stamp_ns,
        host_stamp_ns=stamp_ns,
        position_rad=facts.DEFAULT_POSITION_RAD + 1e-6 * (index % 7),
        velocity_rad_s=np.zeros(12),
        load_nm=STAND_LOAD_NM.copy(),
        position_of_body_in_odom_m=np.zeros(3),
        odom_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        linear_vel_of_body_in_odom_m_s=np.zeros(3),
        angular_vel_of_body_in_odom_rad_s=np.zeros(3),
        foot_contact=np.ones(4, dtype=np.bool_),
        last_command_key=0,
        last_command_robot_stamp_ns=0,
    )
    return replace(state, **changes)  # type: ignore[arg-type]


def make_slow(stamp_ns: int = START_NS, **changes: object) -> SlowState:
    """A healthy robot."""
    slow = SlowState(stamp_ns, stamp_ns, True, False, 80.0, 55.0, -5.0, (30.0,), {"fl_kn": 40.0})
    return replace(slow, **changes)  # type: ignore[arg-type]


@dataclass
class HandMadeRobot:
    """Keeps the Hal protocol with scripted states: one each 3 ms, changed by ``mutate`` before it is delivered."""

    mutate: Callable[[RobotState], list[RobotState]] = lambda state: [state]
    now_ns: int = START_NS
    slow: SlowState | None = field(default_factory=make_slow)
    activates: bool = True
    echoes: bool = True
    takes_back: bool = True
    sent: list[JointCommand] = field(default_factory=list)
    sent_at_ns: list[int] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    waiting: deque[Stop] = field(default_factory=deque)
    control: JointControl = JointControl.OFF
    slow_lag_ns: int = 0
    clock_age_s: float = 0.0

    def connect(self) -> RobotInfo:
        self.calls.append("connect")
        return RobotInfo("hand-made", "by hand", 0.0, 0.0)

    def stand(self) -> None:
        self.calls.append("stand")

    def receive(self, until_robot_ns: int, timeout_s: float) -> list[RobotState]:
        self.now_ns += PERIOD_NS
        key = self.sent[-1].key if self.sent and self.echoes else 0
        return self.mutate(make_state(self.now_ns, last_command_key=key))

    def go_on(self, until_robot_ns: int, timeout_s: float) -> None:
        """Its time passes in receive."""

    def robot_now_ns(self) -> int:
        return self.now_ns

    def host_now_ns(self) -> int:
        return self.now_ns

    def begin_joint_control(self, first: JointCommand) -> None:
        self.calls.append("begin_joint_control")
        self._keep(first)
        self.control = JointControl.ACTIVE if self.activates else JointControl.PENDING

    def end_joint_control(self) -> None:
        self.calls.append("end_joint_control")
        self.control = JointControl.OFF if self.takes_back else JointControl.LEAVING

    @property
    def joint_control(self) -> JointControl:
        return self.control

    def send(self, command: JointCommand) -> None:
        self._keep(command)

    def departures(self) -> Sequence[tuple[int, int]]:
        return [(self.sent[-1].key, self.now_ns)] if self.sent else []

    def estop(self) -> None:
        self.calls.append("estop")

    def release(self) -> None:
        self.calls.append("release")
        self.control = JointControl.OFF

    @property
    def slow_state(self) -> SlowState | None:
        return None if self.slow is None else replace(self.slow, host_stamp_ns=self.now_ns + self.slow_lag_ns)

    def problems(self) -> Sequence[Stop]:
        found = list(self.waiting)
        self.waiting.clear()
        return found

    def power_off(self) -> None:
        self.calls.append("power_off")

    def close(self) -> None:
        self.calls.append("close")

    def _keep(self, command: JointCommand) -> None:
        self.sent.append(command)
        self.sent_at_ns.append(self.now_ns)


def policy_bytes(
    bias: NDArray[np.float64] | None = None, weight: NDArray[np.float64] | None = None, **contract: object
) -> bytes:
    """An ONNX policy whose action is ``observation @ weight + bias``; zeros unless told otherwise."""
    bias = np.zeros(12) if bias is None else bias
    weight = np.zeros((48, 12)) if weight is None else weight
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["observation", "W", "b"], ["action"])],
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", 48])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", 12])],
        [
            numpy_helper.from_array(weight.astype(np.float32), "W"),
            numpy_helper.from_array(bias.astype(np.float32), "b"),
        ],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    observation = np.linspace(-1.0, 1.0, 48)
    action = observation.astype(np.float32) @ weight.astype(np.float32) + bias.astype(np.float32)
    fields: dict[str, object] = {
        "name": "test",
        "velocity_command_low": (-1.0, -0.5, -1.0),
        "velocity_command_high": (1.5, 0.5, 1.0),
        "stored_pair": StoredPair(observation=tuple(observation.tolist()), action=tuple(action.tolist())),
        **contract,
    }
    entry = model.metadata_props.add()
    entry.key, entry.value = METADATA_KEY, PolicyContract.model_validate(fields).to_json()
    data: bytes = model.SerializeToString()
    assert onnx.load_model_from_string(data) is not None
    return data


@pytest.fixture
def zero_policy() -> Policy:
    """A policy that asks for the default pose, whatever it sees."""
    return policy_from_bytes(policy_bytes(), source="test policy")


@pytest.fixture(name="make_state")
def make_state_fixture() -> Callable[..., RobotState]:
    """Makes states of a robot that stands."""
    return make_state


@pytest.fixture(name="make_slow")
def make_slow_fixture() -> Callable[..., SlowState]:
    """Makes slow states of a healthy robot."""
    return make_slow


@pytest.fixture(name="make_policy")
def make_policy_fixture() -> Callable[..., Policy]:
    """Makes small policies."""

    def make(**changes: object) -> Policy:
        return policy_from_bytes(policy_bytes(**changes), source="test policy")  # type: ignore[arg-type]

    return make


@pytest.fixture
def robot() -> HandMadeRobot:
    """A hand-made robot that behaves."""
    return HandMadeRobot()


@pytest.fixture(name="make_policy_bytes")
def make_policy_bytes_fixture() -> Callable[..., bytes]:
    """Makes small policy files."""
    return policy_bytes


BRISK = "power: {power_on_s: 0.4, power_off_s: 0.1}\nmotion: {stand_s: 0.8, sit_s: 0.8}\n"
"""The default fake robot, but quicker to its feet: tests are about what lies between."""


@pytest.fixture(scope="module")
def fake(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[FakeAddress]:
    """One fake robot for all tests of a module, each of which leaves it at rest, and its lease with nobody.

    The module may add keys to its scenario as SCENARIO, and ask for real time in place of lock-step as IS_LOCK_STEP; a
    test may do so as the fixture's parameter.
    """
    folder = tmp_path_factory.mktemp("state")
    (folder / "scenario.yaml").write_text(BRISK + getattr(request.module, "SCENARIO", ""))
    is_lock_step = getattr(request, "param", getattr(request.module, "IS_LOCK_STEP", True))
    with FakeProcess(is_lock_step=is_lock_step, scenario=str(folder / "scenario.yaml"), state_dir=folder) as process:
        yield process.address


@pytest.fixture(scope="module")
def admin(fake: FakeAddress) -> Iterator[Any]:
    """That robot's admin service."""
    with grpc.insecure_channel(fake.admin) as channel:
        yield stub(channel, fake_admin_pb2)
