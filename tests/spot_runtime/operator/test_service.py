"""The service over gRPC: on a Unix socket, over mutual TLS, and against clients that misbehave."""

from __future__ import annotations

import contextlib
import stat
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from ipaddress import IPv4Address
from pathlib import Path

import grpc
import pytest
from cryptography import x509
from grpc_health.v1 import health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha import reflection_pb2, reflection_pb2_grpc

from proof.attacks.certificates import Authority, role
from spot_protos import operator_pb2
from spot_protos.stub import stub as stub_of
from spot_runtime.config import RunConfig
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.door import guard
from spot_runtime.operator.server.server import SERVICE_NAME, OperatorServer
from spot_runtime.operator.server.supervisor import Supervisor
from spot_tools.client import OperatorClient, RefusedError, UnreachableError

from .conftest import POLICIES, wait_until


@contextmanager
def serving(robot: str = "127.0.0.1:1", **service: object) -> Iterator[tuple[OperatorServer, Supervisor]]:
    config = RunConfig()
    config = config.model_copy(update={"service": config.service.model_copy(update={"policies": POLICIES, **service})})
    supervisor = Supervisor(robot, config, manager=ServiceManager(), tell=lambda _: None)
    server = OperatorServer(supervisor, config)
    is_over = threading.Event()

    def turn() -> None:
        while not is_over.is_set():
            supervisor.turn()

    thread = threading.Thread(target=turn)
    thread.start()
    try:
        yield server, supervisor
    finally:
        is_over.set()
        thread.join()
        supervisor.shut_down()
        server.close()


@pytest.fixture(scope="module")
def idle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[OperatorClient]:
    path = tmp_path_factory.mktemp("op") / "operator.sock"
    with serving(listen=f"unix:{path}") as (server, _), OperatorClient(server.address) as client:
        yield client


def test_idle_means_idle(idle: OperatorClient) -> None:
    status = idle.call("GetStatus", operator_pb2.GetStatusRequest())
    assert (status.state, status.run.mode, status.attendance_left_s) == ("idle", "", -1.0)
    assert status.software_version


def test_the_socket_is_for_user_and_group_alone(idle: OperatorClient) -> None:
    mode = Path(idle.address.removeprefix("unix:")).stat().st_mode
    assert stat.S_ISSOCK(mode)
    assert stat.S_IMODE(mode) == 0o660


@pytest.mark.parametrize(
    ("name", "request_", "words"),
    [
        ("Start", operator_pb2.StartRequest(), "start needs the state armed, and it is idle; allowed now: arm"),
        ("Stop", operator_pb2.StopRequest(), "it is idle"),
        ("Damp", operator_pb2.DampRequest(), "it is idle"),
        ("SetVelocity", operator_pb2.SetVelocityRequest(v_x_m_s=0.1), "velocity needs the state running"),
        ("SetVelocity", operator_pb2.SetVelocityRequest(v_x_m_s=float("nan")), "is no number"),
        ("SwitchPolicy", operator_pb2.SwitchPolicyRequest(policy="walk"), "needs the state armed"),
        ("StartLog", operator_pb2.StartLogRequest(), "needs the state armed"),
        ("LabelLog", operator_pb2.LabelLogRequest(labels={"a": "b"}), "needs the state armed or running"),
        ("LabelLog", operator_pb2.LabelLogRequest(), "no label is given"),
        ("Arm", operator_pb2.ArmRequest(policy="../walk"), "no path"),
        ("Arm", operator_pb2.ArmRequest(policy="nothing"), "there are: baseline"),
        ("Arm", operator_pb2.ArmRequest(policy="walk", sha256="1" * 64), "copy the right file"),
    ],
)
def test_refusals_say_why_and_what_to_do(idle: OperatorClient, name: str, request_: object, words: str) -> None:
    with pytest.raises(RefusedError) as refused:
        idle.call(name, request_)
    assert words in str(refused.value)


def test_modes_and_policies(idle: OperatorClient) -> None:
    modes = idle.call("ListModes", operator_pb2.ListModesRequest())
    assert [state.name for state in modes.states] == ["idle", "arming", "armed", "running", "ending"]
    assert "active" in [mode.name for mode in modes.modes]
    policies = idle.call("ListPolicies", operator_pb2.ListPoliciesRequest()).policies
    assert all(len(policy.sha256) == 64 and policy.is_allowed for policy in policies)


def test_health_and_reflection(idle: OperatorClient) -> None:
    with grpc.insecure_channel(idle.address) as channel:
        health = health_pb2_grpc.HealthStub(channel)
        answer = health.Check(health_pb2.HealthCheckRequest(service=SERVICE_NAME), timeout=10.0)
        assert answer.status == health_pb2.HealthCheckResponse.SERVING
        reflection = reflection_pb2_grpc.ServerReflectionStub(channel)
        request = reflection_pb2.ServerReflectionRequest(list_services="")
        (listed,) = reflection.ServerReflectionInfo(iter([request]), timeout=10.0)
        assert SERVICE_NAME in [service.name for service in listed.list_services_response.service]


def test_a_message_that_is_too_large_and_bytes_that_are_none(idle: OperatorClient) -> None:
    with grpc.insecure_channel(idle.address) as channel:
        stub = stub_of(channel, operator_pb2)
        with pytest.raises(grpc.RpcError) as refused:
            stub.StartLog(operator_pb2.StartLogRequest(labels={"a": "x" * 100_000}), timeout=10.0)
        assert refused.value.code() is grpc.StatusCode.RESOURCE_EXHAUSTED
        raw = channel.unary_unary(f"/{SERVICE_NAME}/Arm")
        with pytest.raises(grpc.RpcError):
            raw(b"\xff\xff\xff", timeout=10.0)
    assert idle.call("GetStatus", operator_pb2.GetStatusRequest()).state == "idle"


def test_streams_are_counted_and_given_back(idle: OperatorClient) -> None:
    with grpc.insecure_channel(idle.address) as channel:
        stub = stub_of(channel, operator_pb2)
        calls = [stub.WatchStatus(operator_pb2.WatchStatusRequest(rate_hz=10.0)) for _ in range(8)]
        for call in calls:
            assert next(call).state == "idle"
        with pytest.raises(grpc.RpcError) as refused:
            next(stub.WatchStatus(operator_pb2.WatchStatusRequest()))
        assert "8 streams are open already" in refused.value.details()
        for call in calls:
            call.cancel()
    wait_until(lambda: bool(list(take_one(idle))), "a stream that was cut is given back")


def test_whoever_holds_reflection_open_keeps_nobody_else_out(idle: OperatorClient) -> None:
    is_over = threading.Event()

    def requests() -> Iterator[reflection_pb2.ServerReflectionRequest]:
        yield reflection_pb2.ServerReflectionRequest(list_services="")
        is_over.wait()

    with grpc.insecure_channel(idle.address) as channel:
        reflection = reflection_pb2_grpc.ServerReflectionStub(channel)
        calls = [reflection.ServerReflectionInfo(requests()) for _ in range(24)]
        refused = [refusal_of(call) for call in calls]
        granted = refused.count("")
        assert 4 <= granted <= 8  # a stream of the test before may still be closing
        assert sum("ServerReflectionInfo: 8 streams are open already" in words for words in refused) >= 14
        assert idle.call("GetStatus", operator_pb2.GetStatusRequest()).state == "idle"
        for call in calls:
            call.cancel()
        is_over.set()
    wait_until(lambda: bool(list(take_one(idle))), "a stream that was cut is given back")


def refusal_of(call: grpc.Call) -> str:
    try:
        next(call)
    except grpc.RpcError as error:
        return str(error.details())
    return ""


def take_one(client: OperatorClient) -> Iterator[operator_pb2.Status]:
    with contextlib.suppress(RefusedError):
        yield next(client.stream("WatchStatus", operator_pb2.WatchStatusRequest()))


def test_calls_that_come_too_often_are_refused(tmp_path: Path) -> None:
    with (
        serving(listen=f"unix:{tmp_path}/o.sock", requests_per_s=3.0) as (server, _),
        OperatorClient(server.address) as client,
    ):

        def hammer() -> None:
            for _ in range(200):
                client.call("GetStatus", operator_pb2.GetStatusRequest())

        with pytest.raises(RefusedError, match="more than 3 calls a second; call less often"):
            hammer()
        for name, request in (("Stop", operator_pb2.StopRequest()), ("Damp", operator_pb2.DampRequest())):
            for _ in range(5):  # never too often
                with pytest.raises(RefusedError, match="needs the state"):
                    client.call(name, request)


def test_a_connection_whose_calls_come_too_often_rests(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(guard, "TOO_OFTEN_REST_S", 1e6)
    look = operator_pb2.GetStatusRequest()
    with serving(listen=f"unix:{tmp_path}/o.sock", requests_per_s=1.0) as (server, _):
        with OperatorClient(server.address) as client:
            client.call("GetStatus", look)
            with pytest.raises(RefusedError, match="call less often"):
                client.call("GetStatus", look)
            with pytest.raises(UnreachableError, match="Deadline"):
                client.call("GetStatus", look, 1.5)
        with OperatorClient(server.address) as another, pytest.raises(RefusedError, match="it is idle"):
            another.call("Stop", operator_pb2.StopRequest())


def test_arming_a_robot_that_is_not_there_is_refused_and_ends_idle(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))  # other tests lock the same address
    monkeypatch.setenv("BOSDYN_CLIENT_USERNAME", "user")
    monkeypatch.setenv("BOSDYN_CLIENT_PASSWORD", "password")
    service = serving(listen=f"unix:{tmp_path}/o.sock", arm_timeout_s=600.0)
    with service as (server, supervisor), OperatorClient(server.address) as client:
        with pytest.raises(RefusedError, match=r"arming did not succeed: no robot at 127\.0\.0\.1:1: Connection"):
            client.call("Arm", operator_pb2.ArmRequest(policy="walk"), 600.0)
        status = client.call("GetStatus", operator_pb2.GetStatusRequest())
        assert status.state == "idle"
        assert status.last.outcome
        states = [e.text for e in supervisor.events.after(0) if e.name == "service_state"]
        assert (states[0], states[-1]) == ("arming", "idle")


def test_nobody_there_is_said_in_words(tmp_path: Path) -> None:
    with OperatorClient(f"unix:{tmp_path}/none.sock") as client, pytest.raises(UnreachableError, match="spot-rl serve"):
        client.call("GetStatus", operator_pb2.GetStatusRequest())


# Mutual TLS -----------------------------------------------------------------------------------------------------------


def test_roles_over_mutual_tls(tmp_path: Path) -> None:
    authority, stranger = Authority(tmp_path, "authority"), Authority(tmp_path, "stranger")
    certificate, key = authority.sign("robot", x509.IPAddress(IPv4Address("127.0.0.1")))
    files = {"tls_certificate": certificate, "tls_key": key, "tls_client_ca": authority.file}
    with serving(listen="127.0.0.1:0", **files) as (server, _):

        def client(pair: tuple[Path, Path]) -> OperatorClient:
            return OperatorClient(server.address, ca=authority.file, certificate=pair[0], key=pair[1])

        look, start = operator_pb2.GetStatusRequest(), operator_pb2.StartRequest()
        with client(authority.sign("anna", role("operate"))) as anna:
            assert anna.call("GetStatus", look).state == "idle"
            with pytest.raises(RefusedError, match="start needs the state armed"):
                anna.call("Start", start)
        with client(authority.sign("otto", role("observe"))) as otto:
            assert otto.call("GetStatus", look).state == "idle"
            with pytest.raises(RefusedError, match="'otto' has observe"):
                otto.call("Start", start)
            # Who may look may also stop; what is refused has nothing to stop here, or is no mere stop.
            for name, request in (("Stop", operator_pb2.StopRequest()), ("Damp", operator_pb2.DampRequest())):
                with pytest.raises(RefusedError, match=f"{name.lower()} needs the state arming or armed or running"):
                    otto.call(name, request)
            with pytest.raises(RefusedError, match="'otto' has observe"):
                otto.call("Stop", operator_pb2.StopRequest(keep_standing=True))
        # A role is the URI among the alternative names; the same words as another kind of name give none.
        words = "urn:spot-rl:role:operate"
        pretenders = [authority.sign("mallory"), authority.sign("dora", x509.DNSName(words)), authority.sign(words)]
        pretenders.append(authority.sign("rita", x509.RegisteredID(x509.ObjectIdentifier("1.2.3")), role("operated")))
        for pretender in pretenders:
            with client(pretender) as stranger_within:
                for name, request in (("GetStatus", look), ("Damp", operator_pb2.DampRequest())):
                    with pytest.raises(RefusedError, match="names no role"):
                        stranger_within.call(name, request)
        with client(stranger.sign("eve", role("operate"))) as eve, pytest.raises(UnreachableError):
            eve.call("GetStatus", look, 5.0)
        with OperatorClient(server.address) as plain, pytest.raises(UnreachableError):
            plain.call("GetStatus", look, 5.0)
