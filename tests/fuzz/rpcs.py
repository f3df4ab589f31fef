"""RPCs of our own, in process: a request's bytes through checks, state machine and answer; alone and in a row."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from support import Target

# The fake robot's admin service --------------------------------------------------------------------------------------


def admin(data: bytes) -> None:
    """One request: the first byte chooses the method."""
    from spot_protos import fake_admin_pb2

    service = admin_service()
    _admin_call(service, data[:1] or b"\0", data[1:])
    service.ClearFaults(fake_admin_pb2.ClearFaultsRequest(), fake_admin_pb2.ClearFaultsResponse())


def admin_row(data: bytes) -> None:
    """Some requests, one after the other, on one robot: method, length, bytes."""
    from spot_protos import fake_admin_pb2

    service = admin_service()
    for method, body in calls_in(data):
        _admin_call(service, method, body)
    service.ClearFaults(fake_admin_pb2.ClearFaultsRequest(), fake_admin_pb2.ClearFaultsResponse())


def _admin_call(service: Any, chosen: bytes, body: bytes) -> None:
    from google.protobuf.message import DecodeError
    from google.protobuf.message_factory import GetMessageClass

    from spot_model.errors import SpotRlError
    from spot_protos import fake_admin_pb2

    methods = fake_admin_pb2.DESCRIPTOR.services_by_name["FakeAdmin"].methods
    method = methods[chosen[0] % len(methods)]
    request: Any = GetMessageClass(method.input_type)()
    try:
        request.ParseFromString(body)
    except DecodeError:
        return
    if method.name == "Step":  # an hour of robot time is a right answer, too, and a slow one
        request.wait_timeout_s = 1e-4
        request.max_duration_ns = min(request.max_duration_ns, 3_000_000)
        if request.WhichOneof("until") == "duration_ns":
            request.duration_ns = min(request.duration_ns, 3_000_000)
        elif request.state_messages:
            request.max_duration_ns = 3_000_000
    response: Any = GetMessageClass(method.output_type)()
    try:
        getattr(service, method.name)(request, response)
        response.SerializeToString()
    except SpotRlError as refusal:
        if not str(refusal):
            raise AssertionError("refused without a word") from refusal


def admin_service() -> Any:
    """The service over a robot in lock-step, in this process."""
    global _admin  # noqa: PLW0603
    if _admin is None:
        from fake_robot.faults.registry import FaultInjector
        from fake_robot.robot.robot import Robot
        from fake_robot.scenario.scenario import Scenario
        from fake_robot.services.admin import AdminService
        from fake_robot.services.auth import Credentials
        from fake_robot.services.stepping import Stepping
        from fake_robot.services.world import World

        robot = Robot(Scenario().with_changes(time_mode="lock_step"))
        world = World(robot, robot.scenario.services, Credentials("user", "password"))
        faults = FaultInjector(world)
        _admin = AdminService(world, faults, Stepping(world, faults), lambda: None)
    return _admin


_admin: Any = None


def admin_seeds() -> list[bytes]:
    from spot_protos import fake_admin_pb2 as pb

    names = [method.name for method in pb.DESCRIPTOR.services_by_name["FakeAdmin"].methods]
    requests: dict[str, list[Any]] = {
        "Step": [pb.StepRequest(duration_ns=3), pb.StepRequest(state_messages=1, with_states=True)],
        "InjectFault": [
            pb.InjectFaultRequest(name="state_delay", numbers={"delay_s": 0.01}, duration_s=1.0),
            pb.InjectFaultRequest(name="lease_stolen", texts={"owner": "x"}),
        ],
        "ClearFaults": [pb.ClearFaultsRequest(fault_ids=[1])],
        "GetTruth": [pb.GetTruthRequest(reset_extremes=True)],
    }
    return [
        bytes([number]) + request.SerializeToString()
        for number, name in enumerate(names)
        for request in requests.get(name, [pb.GetStatusRequest()])
    ]


def calls_in(data: bytes, most: int = 12) -> list[tuple[bytes, bytes]]:
    """The calls that an input means: a byte for the method, one for the length, so many bytes."""
    calls: list[tuple[bytes, bytes]] = []
    at = 0
    while at + 2 <= len(data) and len(calls) < most:
        size = data[at + 1]
        calls.append((data[at : at + 1], data[at + 2 : at + 2 + size]))
        at += 2 + size
    return calls


def in_a_row(calls: Sequence[bytes]) -> bytes:
    """The reverse: each call's first byte is its method."""
    return b"".join(call[:1] + bytes([len(call) - 1]) + call[1:] for call in calls if len(call) <= 256)


def admin_row_seeds() -> list[bytes]:
    seeds = admin_seeds()
    return [in_a_row(seeds), in_a_row([*seeds[::-1], *seeds])]


RPCS = {
    "admin": Target(admin, admin_seeds, ("fake_robot",), 128),
    "admin_row": Target(admin_row, admin_row_seeds, ("fake_robot",), 512, (), "twelve calls an input"),
}
