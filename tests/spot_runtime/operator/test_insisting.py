"""The client insists on stop, damp and attend, and takes the service's own answers for what they are."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import grpc
import pytest

from spot_protos import operator_pb2
from spot_tools import client as module
from spot_tools.client import VERDICTS, OperatorClient, RefusedError, UnreachableError

TRANSIENT = [code for code in grpc.StatusCode if code not in (*VERDICTS, grpc.StatusCode.OK)]


class Flaky(grpc.GenericRpcHandler):
    """Answers each call with the next code; with OK once there is none left."""

    def __init__(self) -> None:
        self.codes: list[grpc.StatusCode] = []
        self.peers: list[str] = []

    def service(self, handler_call_details: Any) -> grpc.RpcMethodHandler[Any, Any]:
        return grpc.unary_unary_rpc_method_handler(
            self._answer, response_serializer=operator_pb2.Done.SerializeToString
        )

    def _answer(self, request: bytes, context: grpc.ServicerContext) -> operator_pb2.Done:
        self.peers.append(context.peer())
        if self.codes:
            context.abort(self.codes.pop(0), "")
        return operator_pb2.Done(text="done")


@pytest.fixture(scope="module")
def service() -> Iterator[tuple[Flaky, str]]:
    flaky = Flaky()
    server = grpc.server(ThreadPoolExecutor(2), handlers=(flaky,))
    port = server.add_insecure_port("127.0.0.1:0")
    server.start()
    yield flaky, f"127.0.0.1:{port}"
    server.stop(None)


@pytest.fixture
def flaky(service: tuple[Flaky, str]) -> Iterator[tuple[Flaky, OperatorClient]]:
    service[0].codes.clear()
    service[0].peers.clear()
    with OperatorClient(service[1]) as client:
        yield service[0], client


@pytest.mark.parametrize("name", ["Stop", "Damp", "Attend"])
@pytest.mark.parametrize("code", TRANSIENT)
def test_what_may_not_have_arrived_is_tried_again_on_another_connection(
    flaky: tuple[Flaky, OperatorClient], name: str, code: grpc.StatusCode
) -> None:
    server, client = flaky
    server.codes += [code, code]
    request = getattr(operator_pb2, f"{name}Request")()
    assert client.call(name, request, 60.0).text == "done"
    assert len(set(server.peers)) == 3


@pytest.mark.parametrize("code", VERDICTS)
def test_an_answer_of_the_service_counts(flaky: tuple[Flaky, OperatorClient], code: grpc.StatusCode) -> None:
    server, client = flaky
    server.codes.append(code)
    with pytest.raises(RefusedError):
        client.call("Stop", operator_pb2.StopRequest(), 60.0)
    assert len(server.peers) == 1


@pytest.mark.parametrize("name", ["Start", "Arm", "SetVelocity"])
def test_what_moves_the_robot_is_asked_once(flaky: tuple[Flaky, OperatorClient], name: str) -> None:
    server, client = flaky
    server.codes.append(grpc.StatusCode.CANCELLED)
    with pytest.raises(UnreachableError):
        client.call(name, getattr(operator_pb2, f"{name}Request")(), 60.0)
    assert len(server.peers) == 1


def test_it_insists_no_longer_than_it_is_given(flaky: tuple[Flaky, OperatorClient]) -> None:
    server, client = flaky
    server.codes += [grpc.StatusCode.CANCELLED] * 10_000
    with pytest.raises(UnreachableError, match="no service answers"):
        client.call("Stop", operator_pb2.StopRequest(), 0.3)
    assert len(server.peers) > 1
    server.codes.clear()


def test_a_try_that_gets_no_answer_gives_way_to_another(monkeypatch: pytest.MonkeyPatch, tmp_path: Any) -> None:
    """A service that takes connections and says nothing on the first."""
    import socket

    monkeypatch.setattr(module, "TRY_S", 0.2)
    with socket.socket(socket.AF_UNIX) as silent:
        silent.bind(str(tmp_path / "s"))
        silent.listen()
        silent.settimeout(60.0)
        with OperatorClient(f"unix:{tmp_path}/s") as client:
            with pytest.raises(UnreachableError):
                client.call("Damp", operator_pb2.DampRequest(), 1.5)
            with silent.accept()[0], silent.accept()[0]:  # a second connection was there
                pass
