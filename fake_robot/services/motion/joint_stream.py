"""RobotCommandStreamingService: joint set-points in, one verdict out, at the end."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import grpc
from bosdyn.api import robot_command_pb2, robot_command_service_pb2_grpc

from fake_robot.network.status import StreamFailure
from fake_robot.robot.joint_control import Stream
from fake_robot.services.calls import fill_header
from fake_robot.services.world import World

Response = robot_command_pb2.JointControlStreamResponse
Request = robot_command_pb2.JointControlStreamRequest
RATE_WINDOW_S = 1.0


class RobotCommandStreamingService(
    robot_command_service_pb2_grpc.RobotCommandStreamingServiceServicer  # type: ignore[misc]
):
    """Hands joint commands to the robot, in order, as they arrive.

    The call ends when the client half-closes (OK), when the robot finds fault with it (its status and why), or when the
    link is cut. A second stream is refused, or ends the first, as the scenario says.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._lock = threading.Lock()
        self._current: OpenStream | None = None

    def JointControlStream(  # noqa: N802
        self, request_iterator: Iterator[robot_command_pb2.JointControlStreamRequest], context: grpc.ServicerContext
    ) -> robot_command_pb2.JointControlStreamResponse:
        """Take commands until the stream has to end."""
        world = self._world
        received_ns = world.now_ns()
        mine = OpenStream(world)
        refusal = self._admit(mine)
        if refusal is not None:
            response = Response(status=refusal.status, message=refusal.message)
            fill_header(response.header, Request().header, received_ns, world.now_ns())
            return response
        forget = world.link.listen("command", mine.ended.set)
        if not context.add_callback(mine.ended.set):
            mine.ended.set()
        reader = threading.Thread(target=mine.read, args=(request_iterator,), name="joint-control", daemon=True)
        reader.start()
        try:
            mine.ended.wait()
        finally:
            forget()
            self._release(mine)
        down = world.link.why_down()
        if down is not None:
            context.abort(grpc.StatusCode.UNAVAILABLE, down)
        failure = mine.failure()
        response = Response(status=Response.STATUS_OK)
        if failure is not None:
            response.status, response.message = failure.status, failure.message
        fill_header(response.header, mine.last_header, received_ns, world.now_ns())
        return response

    def _admit(self, stream: OpenStream) -> StreamFailure | None:
        with self._lock:
            other = self._current
            if other is not None and not other.ended.is_set():
                if self._world.config.second_command_stream == "refuse":
                    return StreamFailure(
                        Response.STATUS_INVALID_REQUEST, "another joint-control stream is open; end that one first"
                    )
                other.end(StreamFailure(Response.STATUS_INACTIVE, "another joint-control stream took over"))
                self._world.robot.close_stream(other.stream)
            stream.open()
            self._current = stream
            return None

    def _release(self, stream: OpenStream) -> None:
        with self._lock:
            self._world.robot.close_stream(stream.stream)
            if self._current is stream:
                self._current = None


class OpenStream:
    """One stream on its way: who reads it, and why it ended."""

    stream: Stream

    def __init__(self, world: World) -> None:
        self._world = world
        self._own_failure: StreamFailure | None = None
        self.ended = threading.Event()
        self.last_header = Request().header

    def open(self) -> None:
        """Open the robot's side."""
        self.stream = self._world.robot.open_command_stream(self.ended.set)

    def end(self, failure: StreamFailure) -> None:
        """End the stream for a reason that the robot does not know."""
        self._own_failure = failure
        self.ended.set()

    def failure(self) -> StreamFailure | None:
        """Why it ended; None if the client ended it in good order."""
        return self._own_failure or self.stream.failure

    def read(self, requests: Iterator[robot_command_pb2.JointControlStreamRequest]) -> None:
        """Pass on what arrives until the client stops, the call ends, or the robot finds fault."""
        max_count = round(self._world.config.max_command_rate_hz * RATE_WINDOW_S)
        is_limited = not self._world.robot.is_lock_step
        window_start_s, count = time.monotonic(), 0
        try:
            for request in requests:
                if self.ended.is_set():
                    return
                self.last_header = request.header
                self._world.robot.submit(self.stream, request)
                count += 1
                if is_limited and count > max_count:
                    now_s = time.monotonic()
                    if now_s - window_start_s < RATE_WINDOW_S:
                        told = f"more than {max_count} joint commands in {RATE_WINDOW_S:g} s"
                        self.end(StreamFailure(Response.STATUS_INVALID_REQUEST, told))
                        return
                    window_start_s, count = now_s, 0
        except grpc.RpcError:
            pass  # the client is gone
        except Exception as error:  # noqa: BLE001 - the call must end, whatever a client managed to send
            self.end(StreamFailure(Response.STATUS_INVALID_REQUEST, f"the command cannot be taken: {error}"))
        finally:
            self.ended.set()
