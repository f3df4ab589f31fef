"""The control process's end of the link to the operator's service: a socket that never makes it wait.

What does not fit into the socket is dropped and counted; what comes is taken a few messages at a time, so that neither
a stalled service nor one that floods can hold up the loop.
"""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from google.protobuf.message import DecodeError

from spot_model.errors import SpotRlError
from spot_protos import operator_pb2, run_link_pb2
from spot_runtime.stops import StopReason

if TYPE_CHECKING:
    from spot_log.format.records import EventRecord


def is_ready(connection: socket.socket, within_s: float, *, to_send: bool = False) -> bool:
    """Whether something can be read, or sent, or is so within a time; also where the other end has gone."""
    poll = select.poll()
    poll.register(connection, select.POLLOUT if to_send else select.POLLIN)
    return bool(poll.poll(1e3 * within_s))


MAX_DATAGRAM_BYTES: Final = 16_384
LAST_WORD_S: Final = 1.0
"""How long the word of the end waits for room; the robot is at rest by then."""

MAX_TAKEN: Final = 8
"""Messages taken at once; what more there is waits for the next cycle, 3 ms later."""


class LinkError(SpotRlError):
    """The service and its control process cannot talk to each other."""

    exit_code = StopReason.SERVICE_LOST.exit_code


class Received(NamedTuple):
    """What lay in a socket."""

    messages: Sequence[Any]
    is_end: bool
    """Whether the other end has gone, and nothing more will come."""


def receive(connection: socket.socket, kind: Any, most: int) -> Received:
    """Take messages of a kind, oldest first, without waiting; ``most`` datagrams at most."""
    messages: list[Any] = []
    for _ in range(most):
        try:
            data = connection.recv(MAX_DATAGRAM_BYTES)
        except (BlockingIOError, InterruptedError):
            break
        except ConnectionResetError:
            # It closed with a word of ours unread. That is told once, before what it had said itself.
            continue
        except OSError:
            data = b""
        if not data:
            return Received(messages, is_end=True)
        with contextlib.suppress(DecodeError):  # what cannot be read is as good as lost
            messages.append(kind.FromString(data))
    return Received(messages, is_end=False)


class RunLink:
    """Commands in, status and events out."""

    def __init__(self, connection: socket.socket) -> None:
        self._socket = connection
        self._socket.setblocking(False)
        self.is_lost = False
        """Whether the service has gone."""
        self._has_ended = False
        self.untold = 0
        """Messages that were dropped because the service did not take them."""

    def begin(self) -> None:
        """Say the first word, before any robot is touched: a process of which none is heard has touched none.

        Raises:
            LinkError: It cannot be said.
        """
        if not self._tell(run_link_pb2.FromRun(state="arming")):
            raise LinkError("the operator's service does not hear its control process; see its journal, then arm again")

    def take(self) -> Sequence[run_link_pb2.ToRun]:
        """What has come since the last call, oldest first; at most :data:`MAX_TAKEN`. Never waits."""
        if self.is_lost:
            return ()
        received = receive(self._socket, run_link_pb2.ToRun, MAX_TAKEN)
        self.is_lost = received.is_end
        return received.messages

    def answer(self, request_id: int, *, is_done: bool, text: str) -> None:
        """Answer a request; number 0 needs no answer."""
        if request_id:
            answer = run_link_pb2.Answer(request_id=request_id, is_done=is_done, text=text)
            self._tell(run_link_pb2.FromRun(answer=answer))

    def state(self, state: str) -> None:
        """Tell the service's state as this process sees it."""
        self._tell(run_link_pb2.FromRun(state=state))

    def status(self, status: operator_pb2.RunStatus) -> None:
        """Tell how the run goes."""
        status.untold = self.untold
        self._tell(run_link_pb2.FromRun(status=status))

    def event(self, record: EventRecord) -> None:
        """Tell of an event."""
        from spot_log.format import codec

        self._tell(run_link_pb2.FromRun(event=codec.event_to_proto(record)))

    def ended(self, outcome: operator_pb2.Outcome) -> None:
        """Tell how the run ended, once: the last word waits a moment for room, and is cut where it is too long."""
        if self._has_ended:
            return
        self._has_ended = True
        message = run_link_pb2.FromRun(ended=outcome)
        if message.ByteSize() > MAX_DATAGRAM_BYTES:
            message.ended.sentence = f"{outcome.sentence[:2_000]} … (cut; see the journal)"
            del message.ended.log_paths[:-10]
        untold, deadline_s = self.untold, time.monotonic() + LAST_WORD_S
        while not self._tell(message) and not self.is_lost and time.monotonic() < deadline_s:
            self.untold = untold
            is_ready(self._socket, 0.05, to_send=True)

    def close(self) -> None:
        """Give the socket back."""
        self.is_lost = True
        self._socket.close()

    def _tell(self, message: run_link_pb2.FromRun) -> bool:
        if self.is_lost:
            return False
        data = message.SerializeToString()
        if len(data) > MAX_DATAGRAM_BYTES:
            self.untold += 1
            return False
        try:
            self._socket.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)
        except ConnectionError:
            self.is_lost = True
        except OSError:  # there is no room, or no memory: the next one may get through
            self.untold += 1
        else:
            return True
        return False
