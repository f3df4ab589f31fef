"""What a robot reported over a while, streamed and polled side by side, as arrays."""

from __future__ import annotations

import functools
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Self

import numpy as np
from bosdyn.api import robot_state_pb2, robot_state_service_pb2_grpc
from bosdyn.client.frame_helpers import get_a_tform_b

from fake_robot.conformance.server import OpenError, Server, header, stamp_ns
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.state import Array

NAMES = tuple(name.replace("_", ".") for name in JOINT_NAMES)
FRAMES = ("odom", "vision")
POLL_S = 0.02
_STREAM_S = 120.0
_REST_STATES = 200
_REST_S = 5.0


@dataclass(frozen=True)
class Pose:
    """The body in one frame, each shape (n, ...): position m, rotation scalar first, and its velocities in that frame."""

    position_m: Array
    wxyz: Array
    linear_m_s: Array
    angular_rad_s: Array


@dataclass(frozen=True)
class Motion:
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


@dataclass(frozen=True)
class Recording:
    """States of the stream and polled states of one while; ``None`` in place of what a message lacks is never met."""

    states: Sequence[robot_state_pb2.RobotStateStreamResponse]
    polls: Sequence[robot_state_pb2.RobotState]
    arrived_ns: Sequence[int] = ()
    """When each state and each poll arrived, nanoseconds of this computer's clock."""
    polled_ns: Sequence[int] = ()

    @functools.cached_property
    def streamed(self) -> Motion:
        """The states' motion; joints in the SDK's order, arms left out."""
        joints = [s.joint_states for s in self.states]
        kinematics = [s.kinematic_state for s in self.states]
        rows = {name: np.array([getattr(j, name)[:12] for j in joints]) for name in ("position", "velocity", "load")}
        body = {
            frame: _pose([getattr(k, f"{frame}_tform_body") for k in kinematics], kinematics, frame) for frame in FRAMES
        }
        contacts = np.array([s.contact_states[:4] for s in self.states])
        return Motion("streamed", _stamps(joints), rows["position"], rows["velocity"], rows["load"], contacts, body)

    @functools.cached_property
    def polled(self) -> Motion:
        """The polled motion; joints by their names.

        Raises:
            OpenError: A joint, a foot or a frame is missing; a check of its own finds that.
        """
        kinematics = [p.kinematic_state for p in self.polls]
        rows: dict[str, list[list[float]]] = {"position": [], "velocity": [], "load": []}
        for k in kinematics:
            by_name = {joint.name: joint for joint in k.joint_states}
            if missing := [name for name in NAMES if name not in by_name]:
                raise OpenError(f"polled joints are missing: {', '.join(missing)}")
            for key, values in rows.items():
                values.append([getattr(by_name[name], key).value for name in NAMES])
        contacts = [[foot.contact for foot in p.foot_state] for p in self.polls]
        if {len(row) for row in contacts} != {4}:
            raise OpenError("polled feet are missing")
        body = {frame: _pose([_in(k, frame) for k in kinematics], kinematics, frame) for frame in FRAMES}
        position, velocity, load = (np.array(rows[key]) for key in ("position", "velocity", "load"))
        return Motion("polled", _stamps(kinematics), position, velocity, load, np.array(contacts), body)

    @property
    def motions(self) -> tuple[Motion, Motion]:
        """Both."""
        return self.streamed, self.polled

    @functools.cached_property
    def feet_in_body_m(self) -> Array:
        """Of the polled states, shape (n, 4, 3), m."""
        return np.array([[_xyz(foot.foot_position_rt_body) for foot in p.foot_state] for p in self.polls])

    @functools.cached_property
    def packets(self) -> list[Any]:
        """The inertial unit's."""
        return [packet for state in self.states for packet in state.inertial_state.packets]


@dataclass
class Recorder:
    """Listens to the stream and polls the state for as long as it is entered."""

    server: Server
    states: list[Any] = field(default_factory=list)
    polls: list[Any] = field(default_factory=list)
    arrived_ns: list[int] = field(default_factory=list)
    polled_ns: list[int] = field(default_factory=list)

    def __enter__(self) -> Self:
        stub = self.server.stub(robot_state_service_pb2_grpc.RobotStateStreamingServiceStub, "robot-state-streaming")
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
        """Where the recording is now.

        Raises:
            grpc.RpcError: The stream or a poll failed.
        """
        if self._error is not None:
            raise self._error
        return len(self.states), len(self.polls)

    def since(self, start: tuple[int, int]) -> Recording:
        """What came since a mark."""
        states, polls = self.mark()
        one, other = slice(start[0], states), slice(start[1], polls)
        return Recording(self.states[one], self.polls[other], self.arrived_ns[one], self.polled_ns[other])

    def _read(self) -> None:
        for state in self._call:
            self.arrived_ns.append(time.time_ns())
            self.states.append(state)

    def _poll(self) -> None:
        while not self._is_over.wait(POLL_S):
            state = self.server.state()
            self.polled_ns.append(time.time_ns())
            self.polls.append(state)

    def _guard(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:  # noqa: BLE001 - the caller's thread raises it
            if not self._is_over.is_set():
                self._error = error


def record_rest(server: Server) -> Recording:
    """200 states and more of a robot that nobody moves.

    Raises:
        OpenError: Not so many come.
        grpc.RpcError: The stream or a poll failed.
    """
    with Recorder(server) as recorder:
        deadline_s = time.monotonic() + _REST_S
        while min(len(recorder.states), 20 * len(recorder.polls)) < _REST_STATES:
            recorder.mark()
            if time.monotonic() > deadline_s:
                states, polls = recorder.mark()
                raise OpenError(f"within {_REST_S:g} s came {states} streamed and {polls} polled states")
            time.sleep(POLL_S)
        return recorder.since((0, 0))


def _pose(poses: Sequence[Any], kinematics: Sequence[Any], frame: str) -> Pose:
    velocities = [getattr(k, f"velocity_of_body_in_{frame}") for k in kinematics]
    return Pose(
        np.array([_xyz(pose.position) for pose in poses]),
        np.array([wxyz_of(pose.rotation) for pose in poses]),
        np.array([_xyz(v.linear) for v in velocities]),
        np.array([_xyz(v.angular) for v in velocities]),
    )


def _in(kinematics: Any, frame: str) -> Any:
    pose = get_a_tform_b(kinematics.transforms_snapshot, frame, "body")
    if pose is None:
        raise OpenError(f"no frame {frame} is polled")
    return pose.to_proto()


def _stamps(messages: Sequence[Any]) -> Array:
    return np.array([stamp_ns(m.acquisition_timestamp) for m in messages]) * 1e-9


def wxyz_of(rotation: Any) -> tuple[float, float, float, float]:
    """A quaternion, scalar first."""
    return rotation.w, rotation.x, rotation.y, rotation.z


def _xyz(vector: Any) -> tuple[float, float, float]:
    return vector.x, vector.y, vector.z
