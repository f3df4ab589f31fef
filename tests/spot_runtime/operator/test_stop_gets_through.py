"""Clients written by somebody who wants to keep a stop from the robot: raw sockets, half a call, thousands of them."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from pathlib import Path

import grpc
import pytest

from proof.attacks.attackers import ATTACKS, PATH
from proof.attacks.target import serve
from proof.attacks.trial import Listen, try_attack
from spot_protos import operator_pb2
from spot_tools.client import OperatorClient, RefusedError

CASES = [
    *((attack, "unix") for attack in ATTACKS),
    *((attack, "tls") for attack in ("heads in a storm", "half handshakes", "hanging calls", "call flood")),
    *((attack, "loopback") for attack in ("idle connections", "hanging calls")),
]


@pytest.mark.slow
@pytest.mark.parametrize(("attack", "listen"), CASES)
def test_every_stop_gets_through(attack: str, listen: Listen) -> None:
    """How soon is measured by 'spot-rl bench stop' on a machine that does nothing else."""
    trial = try_attack(attack, listen, 3)
    assert trial.refusals == []
    assert len(trial.latencies_s) == 6


@pytest.fixture
def running(tmp_path: Path) -> Iterator[str]:
    server, _ = serve(f"unix:{tmp_path}/o.sock")
    yield server.address
    server.close()


def test_hanging_calls_on_the_stops_own_connection_are_shed(running: str) -> None:
    def never() -> Iterator[bytes]:
        released.wait(60.0)
        yield b""

    released = threading.Event()
    with grpc.insecure_channel(running) as channel:
        hanging = [channel.stream_unary(f"{PATH}{name}").future(never()) for name in ("Stop", "Arm") for _ in range(12)]
        stop = channel.unary_unary(f"{PATH}Stop", response_deserializer=operator_pb2.Done.FromString)
        assert stop(b"", timeout=10.0).text == "stop"
        codes = {call.exception(timeout=20.0).code() for call in hanging}
        released.set()
    # Unavailable are those that were sent before the client knew how many it may have.
    assert codes <= {grpc.StatusCode.RESOURCE_EXHAUSTED, grpc.StatusCode.DEADLINE_EXCEEDED, grpc.StatusCode.UNAVAILABLE}


def test_a_call_without_a_message_and_one_that_is_none_are_refused_in_words(running: str) -> None:
    with grpc.insecure_channel(running) as channel:
        for messages, words in ((iter(()), "no message was sent"), (iter((b"\xff\xff",)), "cannot be read")):
            with pytest.raises(grpc.RpcError) as refused:
                channel.stream_unary(f"{PATH}Stop")(messages, timeout=10.0)
            assert refused.value.code() is grpc.StatusCode.INVALID_ARGUMENT
            assert words in refused.value.details()


def test_steering_belongs_to_who_steers_not_to_a_name(tmp_path: Path) -> None:
    """Two who call themselves alike: by their certificates they are two."""
    from proof.attacks.certificates import LOOPBACK, Authority, role
    from spot_protos import run_link_pb2

    authority = Authority(tmp_path, "authority")
    certificate, key = authority.sign("robot", LOOPBACK)
    files = {"tls_certificate": str(certificate), "tls_key": str(key), "tls_client_ca": str(authority.file)}
    server, supervisor = serve("127.0.0.1:0", **files)
    supervisor._take(run_link_pb2.FromRun(status=operator_pb2.RunStatus(mode="active")))
    request = operator_pb2.SetVelocityRequest(v_x_m_s=0.1, operator="anna")
    try:
        pairs = [authority.sign(name, role("operate")) for name in ("anna", "eve")]
        anna, eve = (
            OperatorClient(server.address, ca=authority.file, certificate=pair[0], key=pair[1]) for pair in pairs
        )
        with anna, eve:
            assert anna.call("SetVelocity", request).text == "sent to the control process"
            with pytest.raises(RefusedError, match="anna steers; wait until they stop"):
                eve.call("SetVelocity", request)
            assert anna.call("SetVelocity", request).text == "sent to the control process"
    finally:
        server.close()
