"""Waiting for a descriptor of any number: ``select`` takes none from 1,024 on, which a process with many files has."""

from __future__ import annotations

import select
import socket


def is_ready(connection: socket.socket, within_s: float, *, to_send: bool = False) -> bool:
    """Whether something can be read, or sent, or is so within a time; also where the other end has gone."""
    poll = select.poll()
    poll.register(connection, select.POLLOUT if to_send else select.POLLIN)
    return bool(poll.poll(1e3 * within_s))
