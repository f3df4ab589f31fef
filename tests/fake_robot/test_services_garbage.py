"""Whatever bytes arrive: each RPC of the fake answers or refuses in words, and the server lives."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import grpc
import numpy as np
import pytest
from google.protobuf import descriptor_pool
from google.protobuf.descriptor import FieldDescriptor, MethodDescriptor
from google.protobuf.message import Message
from google.protobuf.message_factory import GetMessageClass

from fake_robot.services.directory import OWN_SERVICES
from spot_protos import fake_admin_pb2

MESSAGES_A_METHOD = 12
REFUSALS = {
    grpc.StatusCode.INVALID_ARGUMENT,
    grpc.StatusCode.DEADLINE_EXCEEDED,
    grpc.StatusCode.RESOURCE_EXHAUSTED,
    grpc.StatusCode.UNIMPLEMENTED,
}
STRINGS = ("", "body", "x" * 300, "\x00", "PDB_rooted", "reboot", "💥")
NUMBERS = (0, 1, -1, 2**31 - 1, -(2**31), 7)
FLOATS = (0.0, -1.0, float("nan"), float("inf"), 1e300)


def methods() -> list[MethodDescriptor]:
    return [
        method
        for kind in sorted({kind for kind, _ in OWN_SERVICES.values()})
        for method in descriptor_pool.Default().FindServiceByName(kind).methods
        if not method.client_streaming and not method.server_streaming
    ]


def fill(message: Message, rng: np.random.Generator, depth: int = 0) -> None:
    """Give some fields of a message values that nobody sensible would."""
    for field in message.DESCRIPTOR.fields:
        if rng.random() < 0.4 or depth > 4:
            continue
        if field.message_type is not None and field.message_type.GetOptions().map_entry:
            continue
        if field.message_type is not None:
            inner = getattr(message, field.name)
            fill(inner.add() if field.is_repeated else inner, rng, depth + 1)
            continue
        value = scalar(field, rng)
        if field.is_repeated:
            getattr(message, field.name).extend([value] * int(rng.integers(1, 4)))
        else:
            setattr(message, field.name, value)


def scalar(field: FieldDescriptor, rng: np.random.Generator) -> Any:
    if field.cpp_type == FieldDescriptor.CPPTYPE_STRING:
        text = STRINGS[rng.integers(len(STRINGS))]
        return text.encode() if field.type == FieldDescriptor.TYPE_BYTES else text
    if field.cpp_type in {FieldDescriptor.CPPTYPE_DOUBLE, FieldDescriptor.CPPTYPE_FLOAT}:
        return FLOATS[rng.integers(len(FLOATS))]
    if field.cpp_type == FieldDescriptor.CPPTYPE_BOOL:
        return bool(rng.integers(2))
    number = NUMBERS[rng.integers(len(NUMBERS))]
    is_unsigned = field.cpp_type in {FieldDescriptor.CPPTYPE_UINT32, FieldDescriptor.CPPTYPE_UINT64}
    return abs(number) if is_unsigned else number


def answer_in_order(call: Callable[[bytes], bytes], wire: bytes) -> bytes | None:
    """The answer; None if the service or the gRPC library refused. A call that broke the service raises."""
    try:
        return call(wire)
    except grpc.RpcError as error:
        if error.code() in REFUSALS or "deserializing request" in error.details():
            return None
        raise


@pytest.mark.parametrize("method", methods(), ids=lambda method: method.full_name.removeprefix("bosdyn.api."))
def test_no_request_breaks_a_service(garbage_stub: Any, method: MethodDescriptor) -> None:
    rng = np.random.default_rng(7)
    request_class, response_class = GetMessageClass(method.input_type), GetMessageClass(method.output_type)
    call = garbage_stub.call(f"/{method.containing_service.full_name}/{method.name}")
    for index in range(MESSAGES_A_METHOD):
        if index < 3:
            wire = rng.bytes(int(rng.integers(0, 60)))
        else:
            request = request_class()
            fill(request, rng)
            wire = request.SerializeToString()
        answer = answer_in_order(call, wire)
        if answer is not None:
            response_class.FromString(answer)
    assert garbage_stub.is_alive()


def test_no_request_breaks_the_admin_service(garbage_stub: Any) -> None:
    rng = np.random.default_rng(8)
    with grpc.insecure_channel(garbage_stub.stub.endpoints.admin) as channel:
        for method in fake_admin_pb2.DESCRIPTOR.services_by_name["FakeAdmin"].methods:
            call = channel.unary_unary(f"/spot_rl.fake.v1.FakeAdmin/{method.name}")
            for _ in range(30):
                request = GetMessageClass(method.input_type)()
                fill(request, rng)
                if method.name == "InjectFault" and rng.random() < 0.5:
                    request.name = "weak_motor"
                answer_in_order(call, request.SerializeToString())
    assert garbage_stub.is_alive()


class GarbageStub:
    """A served stub, and raw calls to it with a valid token."""

    def __init__(self, stub: Any) -> None:
        self.stub = stub
        credentials = grpc.ssl_channel_credentials(stub.certificates.ca_pem)
        options = [("grpc.ssl_target_name_override", "api.spot.robot")]
        self.channel = grpc.secure_channel(stub.endpoints.robot, credentials, options)

    def call(self, path: str) -> Callable[[bytes], bytes]:
        method = self.channel.unary_unary(path)
        token = self.stub.server.world.auth.mint("user")
        return lambda wire: method(wire, metadata=(("authorization", f"Bearer {token}"),), timeout=20)

    def is_alive(self) -> bool:
        self.stub.server.world.link.restore()
        return bool(self.call("/bosdyn.api.RobotIdService/GetRobotId")(b""))


@pytest.fixture
def garbage_stub(serve_stub: Callable[..., Any]) -> Any:
    garbage = GarbageStub(serve_stub(reboot_s=0.0))
    yield garbage
    garbage.channel.close()
