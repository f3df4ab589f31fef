"""What a robot reported over a while, streamed and polled side by side, as arrays."""

from __future__ import annotations

import contextlib
import functools
import math
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from bosdyn.api import lease_pb2, robot_state_pb2, robot_state_service_pb2_grpc
from bosdyn.client.frame_helpers import ValidateFrameTreeError, get_a_tform_b

from fake_robot.conformance.server import OpenError, Server, header, stamp_ns
from spot_model.robot.facts import JOINT_NAMES, TOTAL_MASS_KG, Array
from spot_model.robot.leg_kinematics import foot_position_and_jacobian

NAMES = tuple(name.replace("_", ".") for name in JOINT_NAMES)
FRAMES = ("odom", "vision")
AT_REST = "at rest"
G_M_S2 = 9.81
POLL_S, _RETAIN_S = 0.02, 1.0
_STREAM_S = 120.0
_REST_STATES, _FEWEST = 200, 10
_REST_S = 5.0
_UNIT = 1e-3
_ROWS = ("position", "velocity", "load")


@dataclass(frozen=True)
class Pose:
    """The body in one frame, and its velocities there; each of shape (n, 3) or, the rotation, (n, 4)."""

    position_m: Array
    wxyz: Array
    linear_m_s: Array
    angular_rad_s: Array


@dataclass(frozen=True)
class ReportedMotion:
    """Joints, feet and body as one of the two reports tells them, one row for each message. SI units, rad."""

    source: str
    stamps_s: Array
    position_rad: Array
    velocity_rad_s: Array
    load_nm: Array
    contacts: Array
    """Shape (n, 4), as of the vendor's enumeration."""
    body: dict[str, Pose]
    """By the name of the frame."""

    def leg_forces_n(self) -> Array:
        """The upward force of the ground on each foot that balances the loads of its leg, shape (n, 4), in the body."""
        _, jacobian = foot_position_and_jacobian(self.position_rad)
        load_nm = self.load_nm.reshape(-1, 4, 3, 1)
        return np.asarray(-np.linalg.solve(np.swapaxes(jacobian, -1, -2), load_nm)[..., 2, 0])

    def share_of_weight(self) -> float:
        """Of the robot's weight, what its legs carry by their mean loads."""
        return float(self.leg_forces_n().mean(axis=0).sum()) / (TOTAL_MASS_KG * G_M_S2)


@dataclass(frozen=True)
class RecordedPart:
    """States of the stream and polled states of one part of a motion, by its name."""

    part: str
    states: Sequence[robot_state_pb2.RobotStateStreamResponse]
    polls: Sequence[robot_state_pb2.RobotState]
    arrived_ns: Sequence[int]
    """When each state and each poll arrived, nanoseconds of this computer's clock."""
    polled_ns: Sequence[int]

    @functools.cached_property
    def streamed(self) -> ReportedMotion:
        """The states' motion; joints in the SDK's order, arms left out. Raises OpenError if something is missing."""
        joints, kinematics = [s.joint_states for s in self.states], [s.kinematic_state for s in self.states]
        rows = [[list(getattr(j, key)[:12]) for j in joints] for key in _ROWS]
        poses = {frame: [getattr(k, f"{frame}_tform_body") for k in kinematics] for frame in FRAMES}
        return _motion("streamed", joints, rows, [list(s.contact_states) for s in self.states], poses, kinematics)

    @functools.cached_property
    def polled(self) -> ReportedMotion:
        """The polled motion; joints by their names. Raises OpenError if something is missing."""
        kinematics = [p.kinematic_state for p in self.polls]
        named = [{joint.name: joint for joint in k.joint_states} for k in kinematics]
        rows = [
            [[getattr(joints[name], key).value for name in NAMES if name in joints] for joints in named]
            for key in _ROWS
        ]
        contacts = [[foot.contact for foot in p.foot_state] for p in self.polls]
        poses = {frame: [_in(k, frame) for k in kinematics] for frame in FRAMES}
        return _motion("polled", kinematics, rows, contacts, poses, kinematics)

    @property
    def motions(self) -> list[ReportedMotion]:
        """Both, or the one that is complete. Raises OpenError if none is."""
        found = []
        with contextlib.suppress(OpenError):
            found.append(self.streamed)
        with contextlib.suppress(OpenError):
            found.append(self.polled)
        return found or [self.polled]

    @functools.cached_property
    def feet_in_body_m(self) -> Array:
        """Feet of the polled states, shape (n, 4, 3), m."""
        return np.array([[axes(foot.foot_position_rt_body) for foot in p.foot_state] for p in self.polls])

    @functools.cached_property
    def packets(self) -> list[Any]:
        """The inertial unit's."""
        return [packet for state in self.states for packet in state.inertial_state.packets]

    @functools.cached_property
    def packet_stamps_s(self) -> Array:
        """The packets', shape (n,), s."""
        return np.array([stamp_ns(packet.timestamp) for packet in self.packets]) * 1e-9

    @functools.cached_property
    def imu_wxyz(self) -> Array:
        """The packets' rotations, shape (n, 4). Raises OpenError if they are none."""
        return _rotations("odom_rot_link", [packet.odom_rot_link for packet in self.packets])


@dataclass
class Recorder:
    """Listens to the stream, polls the state and retains a lease for as long as it is entered."""

    server: Server
    lease: lease_pb2.Lease | None = None
    states: list[Any] = field(default_factory=list)
    polls: list[Any] = field(default_factory=list)
    arrived_ns: list[int] = field(default_factory=list)
    polled_ns: list[int] = field(default_factory=list)

    def __enter__(self) -> Self:
        stub = robot_state_service_pb2_grpc.RobotStateStreamingServiceStub(self.server.channel("robot-state-streaming"))
        request = robot_state_pb2.RobotStateStreamRequest(header=header())
        self._call = stub.GetRobotStateStream(request, timeout=_STREAM_S)
        self._is_over = threading.Event()
        self._error: Exception | None = None
        self._threads = [threading.Thread(target=self._guard, args=(f,), daemon=True) for f in (self._read, self._poll)]
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._is_over.set()
        self._call.cancel()
        for thread in self._threads:
            thread.join()

    def mark(self) -> tuple[int, int]:
        """Where the recording is now. Raises grpc.RpcError: the stream or a poll failed."""
        if self._error is not None:
            raise self._error
        return len(self.states), len(self.polls)

    def since(self, start: tuple[int, int], part: str) -> RecordedPart:
        """What came since a mark, as a part of a motion."""
        states, polls = self.mark()
        one, other = slice(start[0], states), slice(start[1], polls)
        return RecordedPart(part, self.states[one], self.polls[other], self.arrived_ns[one], self.polled_ns[other])

    def _read(self) -> None:
        for state in self._call:
            self.arrived_ns.append(time.time_ns())
            self.states.append(state)

    def _poll(self) -> None:
        retained_s = time.monotonic()
        while not self._is_over.wait(POLL_S):
            if self.lease is not None and time.monotonic() > retained_s + _RETAIN_S:
                retained_s = time.monotonic()
                self.server.ask("lease", "RetainLease", lease=self.lease)
            state = self.server.state()
            self.polled_ns.append(time.time_ns())
            self.polls.append(state)

    def _guard(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001 - the caller's thread raises it
            if not self._is_over.is_set():
                self._error = error


def record_rest(server: Server) -> RecordedPart:
    """200 states and more of a robot that nobody moves, or those of some seconds.

    Raises:
        OpenError: Next to none come.
        grpc.RpcError: The stream or a poll failed.
    """
    with Recorder(server) as recorder:
        deadline_s = time.monotonic() + _REST_S
        while min(len(recorder.states), 20 * len(recorder.polls)) < _REST_STATES:
            states, polls = recorder.mark()
            if time.monotonic() > deadline_s:
                if min(states, polls) < _FEWEST:
                    raise OpenError(f"within {_REST_S:g} s came {states} streamed and {polls} polled states")
                break
            time.sleep(POLL_S)
        return recorder.since((0, 0), AT_REST)


def _motion(
    source: str, stamped: Any, rows: Any, contacts: Any, poses: dict[str, Any], kinematics: Sequence[Any]
) -> ReportedMotion:
    if {len(row) for rowed in rows for row in rowed} != {12} or {len(row) for row in contacts} != {4}:
        raise OpenError(f"{source}: joints or feet are missing")
    body = {}
    for frame, told in poses.items():
        velocities = [getattr(k, f"velocity_of_body_in_{frame}") for k in kinematics]
        parts = (
            [axes(pose.position) for pose in told],
            _rotations(f"{source}, in {frame}", [pose.rotation for pose in told]),
            [axes(v.linear) for v in velocities],
            [axes(v.angular) for v in velocities],
        )
        body[frame] = Pose(*map(np.array, parts))
    stamps_s = np.array([stamp_ns(m.acquisition_timestamp) for m in stamped]) * 1e-9
    position, velocity, load = (np.array(rowed) for rowed in rows)
    told_values = [position, velocity, load, *(value for pose in body.values() for value in vars(pose).values())]
    if not all(np.isfinite(values).all() for values in told_values):
        raise OpenError(f"{source}: a value is not a number")
    return ReportedMotion(source, stamps_s, position, velocity, load, np.array(contacts), body)


def pose_in(snapshot: Any, frame: str, other: str) -> Any:
    """The pose of a frame in another, by a tree of frames; nothing where they do not hang together in one tree."""
    try:
        pose = get_a_tform_b(snapshot, frame, other)
    except ValidateFrameTreeError:
        return None
    return None if pose is None else pose.to_proto()


def _in(kinematics: Any, frame: str) -> Any:
    pose = pose_in(kinematics.transforms_snapshot, frame, "body")
    if pose is None:
        raise OpenError(f"no frame {frame} is polled that hangs together with the body")
    return pose


def is_unit(q: Any) -> bool:
    """Whether a quaternion's length is 1."""
    return abs(math.hypot(q.w, q.x, q.y, q.z) - 1.0) < _UNIT


def _rotations(what: str, rotations: Sequence[Any]) -> Array:
    """Rotations of length 1, also where the message's are of another: that has a check of its own."""
    wxyz = np.array([(q.w, q.x, q.y, q.z) for q in rotations]).reshape(-1, 4)
    length = np.linalg.norm(wxyz, axis=1, keepdims=True)
    if not length.min(initial=1.0) > _UNIT:
        raise OpenError(f"{what}: a rotation is missing")
    return np.asarray(wxyz / length)


def axes(vector: Any) -> tuple[float, float, float]:
    """A vector's three parts."""
    return vector.x, vector.y, vector.z
