"""What every call passes before anything of it is carried out: role, rate, and a message that comes in time.

The role is checked when a call's head is there, before its message. Waiting for a message holds no thread, and ends
after :data:`MESSAGE_TIMEOUT_S`.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Mapping
from functools import partial
from typing import Any, Final, NamedTuple

import grpc
from grpc import aio

from spot_runtime.operator.door.access import Gate, Lane, Refusal, bad_request
from spot_runtime.operator.door.callers import Caller, Role
from spot_runtime.operator.door.connection import Connection
from spot_runtime.operator.door.door import DENIED_REST_S, Door

MESSAGE_TIMEOUT_S: Final = 1.0
TOO_OFTEN_REST_S: Final = 0.05


class Rule(NamedTuple):
    """What a method asks of its callers."""

    command: str
    """What it is called in refusals: the word of ``spot-rl ctl`` for it."""
    role: Role = Role.OBSERVE
    lane: Lane = Lane.ORDINARY


class Guard(aio.ServerInterceptor):  # type: ignore[misc,unused-ignore]
    """Stands before every method of the server."""

    def __init__(self, gate: Gate, rules: Mapping[str, Rule]) -> None:
        """Let in whom ``gate`` lets in, by rules of methods' full names; any other method is for those who observe."""
        self._gate, self._rules = gate, rules
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
            request = await self._receive(rule, handler, context)
            with _stopping(connection, rule):
                return await handler.unary_unary(request, context)
        except Refusal as refusal:
            await context.abort(refusal.code, refusal.text)

    async def _stream(self, rule: Rule, handler: Any, messages: Any, context: Any) -> AsyncIterator[Any]:
        try:
            caller, _ = self._let_in(rule, context)
            self._gate.open_stream(rule.command, caller)
        except Refusal as refusal:
            await context.abort(refusal.code, refusal.text)
            return
        try:
            if handler.request_streaming:
                requests = _decoded(handler, messages)
                answers = handler.stream_stream(requests, context)
            else:
                request = await self._receive(rule, handler, context)
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
        connection.seen()
        try:
            self._gate.check_role(rule.command, caller, rule.role)
        except Refusal:
            if caller.role is None:  # a connection that waits costs less than the new one after a cut
                connection.rest(DENIED_REST_S)
            raise
        door.admit(connection)
        try:
            self._gate.check_rate(rule.command, caller, connection.name, rule.lane)
        except Refusal:
            connection.rest(TOO_OFTEN_REST_S)  # a stop on it must not wait for long
            raise
        return caller, connection

    def _find(self, context: Any) -> tuple[Caller, Connection]:
        connection = None if self.door is None else self.door.find(context.peer())
        if connection is None or connection.caller is None:
            raise Refusal(grpc.StatusCode.UNAVAILABLE, "the connection has been closed")
        return connection.caller, connection

    async def _receive(self, rule: Rule, handler: Any, context: Any) -> Any:
        """The call's one message."""
        try:
            data = await asyncio.wait_for(context.read(), MESSAGE_TIMEOUT_S)
        except TimeoutError:
            text = f"{rule.command}: no message came within {MESSAGE_TIMEOUT_S:g} s; send it with the call"
            raise Refusal(grpc.StatusCode.DEADLINE_EXCEEDED, text) from None
        if data is aio.EOF:
            raise bad_request(f"{rule.command}: no message was sent; send one")
        return _decode(handler, data)


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
