"""What every call passes before anything of it is carried out: role, rate, and a message that comes in time.

The role is checked when a call's head is there, before its message. Waiting for a message holds no thread, ends after
:data:`MESSAGE_TIMEOUT_S`, and a connection that lets too many calls wait loses the oldest.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import time
from collections import OrderedDict
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import grpc
from grpc import aio

from spot_runtime.operator.door.access import Gate, Lane
from spot_runtime.operator.door.callers import Caller, Role, caller_of
from spot_runtime.operator.door.connection import Connection
from spot_runtime.operator.door.door import Door
from spot_runtime.operator.refusal import Refusal, bad_request

MESSAGE_TIMEOUT_S: Final = 1.0
MAX_WAITING: Final = 8
"""Calls of one connection whose message has not come."""


class Rule(NamedTuple):
    """What a method asks of its callers."""

    command: str
    """What it is called in refusals: the word of ``spot-rl ctl`` for it."""
    role: Role = Role.OBSERVE
    lane: Lane = Lane.ORDINARY


class Guard(aio.ServerInterceptor):  # type: ignore[misc,unused-ignore]
    """Stands before every method of the server."""

    def __init__(self, gate: Gate, rules: Mapping[str, Rule], *, is_tls: bool) -> None:
        """Let in whom ``gate`` lets in.

        Args:
            gate: Of roles and rates.
            rules: By methods' full names; any other method is for those who observe.
            is_tls: Whether roles come from certificates.
        """
        self._gate, self._rules, self._is_tls = gate, rules, is_tls
        self._waiting: dict[str, OrderedDict[asyncio.Future[Any], None]] = {}
        self.door: Door | None = None

    async def intercept_service(
        self,
        continuation: Callable[[grpc.HandlerCallDetails], Awaitable[Any]],
        handler_call_details: grpc.HandlerCallDetails,
    ) -> Any:
        """See gRPC."""
        handler = await continuation(handler_call_details)
        if handler is None:
            return None
        path = str(handler_call_details.method)
        arguments = (self._rules.get(path, Rule(path.rpartition("/")[2])), handler)
        if handler.response_streaming:
            wrapped = partial(self._stream, *arguments)
            return grpc.stream_stream_rpc_method_handler(wrapped, None, handler.response_serializer)
        return grpc.stream_unary_rpc_method_handler(
            partial(self._answer, *arguments), None, handler.response_serializer
        )

    def caller(self, context: Any) -> Caller:
        """Who makes a call."""
        return self._find(context)[0]

    async def _answer(self, rule: Rule, handler: Any, messages: Any, context: Any) -> Any:
        del messages
        try:
            _, connection = self._let_in(rule, context)
            with _under_way(connection):
                request = await self._receive(rule, handler, context, connection)
                with _stopping(connection, rule):
                    return await handler.unary_unary(request, context)
        except Refusal as refusal:
            await context.abort(refusal.code, refusal.text)

    async def _stream(self, rule: Rule, handler: Any, messages: Any, context: Any) -> AsyncIterator[Any]:
        try:
            caller, connection = self._let_in(rule, context)
            self._open_stream(rule, caller, connection)
        except Refusal as refusal:
            await context.abort(refusal.code, refusal.text)
            return
        try:
            with _under_way(connection):
                if handler.request_streaming:
                    requests = _decoded(handler, messages)
                    answers = handler.stream_stream(requests, context)
                else:
                    request = await self._receive(rule, handler, context, connection)
                    answers = handler.unary_stream(request, context)
                if inspect.isasyncgen(answers):
                    async for answer in answers:
                        yield answer
                else:
                    await answers
        except Refusal as refusal:
            await context.abort(refusal.code, refusal.text)
        finally:
            self._gate.close_stream(caller)

    def _let_in(self, rule: Rule, context: Any) -> tuple[Caller, Connection]:
        caller, connection = self._find(context)
        door = self.door
        assert door is not None  # noqa: S101 - it is set before the server listens
        try:
            self._gate.check_role(rule.command, caller, rule.role)
        except Refusal:
            if caller.role is None:
                door.deny(connection)
            raise
        door.admit(connection, caller.identity)
        try:
            self._gate.check_rate(rule.command, caller, connection.name, rule.lane)
        except Refusal:
            door.slow_down(connection)
            raise
        return caller, connection

    def _open_stream(self, rule: Rule, caller: Caller, connection: Connection) -> None:
        try:
            self._gate.open_stream(rule.command, caller)
        except Refusal:
            connection.offended_s = time.monotonic()
            raise

    def _find(self, context: Any) -> tuple[Caller, Connection]:
        connection = None if self.door is None else self.door.find(context.peer())
        if connection is None:
            raise Refusal(grpc.StatusCode.UNAVAILABLE, "the connection has been closed")
        return caller_of(context.auth_context(), connection.peer, is_tls=self._is_tls), connection

    async def _receive(self, rule: Rule, handler: Any, context: Any, connection: Connection) -> Any:
        """The call's one message."""
        waiting = self._waiting.setdefault(connection.name, OrderedDict())
        reading = asyncio.ensure_future(context.read())
        waiting[reading] = None
        if len(waiting) > MAX_WAITING:
            waiting.popitem(last=False)[0].cancel()
        try:
            done, _ = await asyncio.wait({reading}, timeout=MESSAGE_TIMEOUT_S)
        finally:
            waiting.pop(reading, None)
            if not waiting:
                self._waiting.pop(connection.name, None)
        if (not done or reading.cancelled()) and self.door is not None:
            self.door.slow_down(connection, hold_s=0.02)  # a stop on the same connection must not wait for long
        if not done:
            reading.cancel()
            text = f"{rule.command}: no message came within {MESSAGE_TIMEOUT_S:g} s; send it with the call"
            raise Refusal(grpc.StatusCode.DEADLINE_EXCEEDED, text)
        if reading.cancelled():
            text = f"{rule.command}: more than {MAX_WAITING} calls wait for their messages; send each with its call"
            raise Refusal(grpc.StatusCode.RESOURCE_EXHAUSTED, text)
        data = reading.result()
        if data is aio.EOF:
            raise bad_request(f"{rule.command}: no message was sent; send one")
        return _decode(handler, data)


@contextlib.contextmanager
def _under_way(connection: Connection) -> Iterator[None]:
    connection.calls_open += 1
    try:
        yield
    finally:
        connection.calls_open -= 1


@contextlib.contextmanager
def _stopping(connection: Connection, rule: Rule) -> Iterator[None]:
    """While the message of a stop is here and its answer is not out."""
    count = int(rule.lane in (Lane.STOP, Lane.DAMP))
    connection.stops_open += count
    try:
        yield
    finally:
        connection.stops_open -= count


async def _decoded(handler: Any, messages: Any) -> AsyncIterator[Any]:
    async for data in messages:
        yield _decode(handler, data)


def _decode(handler: Any, data: bytes) -> Any:
    try:
        return handler.request_deserializer(data)
    except Exception as error:  # protobuf has several
        raise bad_request(f"the message cannot be read: {error}") from error
