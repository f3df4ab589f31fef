"""The door of the fake: certificates, addresses, tokens, limits, faults of the wire, and the admin service."""

from __future__ import annotations

import datetime as dt
import os
import socket
import ssl
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import grpc
import pytest
from bosdyn.api import (
    data_buffer_pb2,
    power_pb2,
    robot_command_pb2,
    robot_id_pb2,
    robot_id_service_pb2_grpc,
)
from bosdyn.client.auth import InvalidLoginError, InvalidTokenError
from bosdyn.client.exceptions import InvalidRequestError, RpcError, UnauthenticatedError
from bosdyn.client.lease import ResourceAlreadyClaimedError
from cryptography import x509

from fake_robot.services.authority import power
from fake_robot.start.certificates import CertificateError, ServerCertificates, make_certificates
from fake_robot.start.sdk_environment import SdkEnvironment, write_sdk_folder
from fake_robot.start.server import BindError, sdk_host
from fake_robot.start.state_folder import ensure_credentials, read_password
from spot_model.errors import BadInputError, SpotRlError
from spot_protos import fake_admin_pb2
from spot_protos.stub import stub as stub_of

# ---------------------------------------------------------------------------------------------------- certificates


def test_certificates_are_private_and_complete(tmp_path: Path) -> None:
    made = make_certificates(tmp_path / "state", addresses=("192.168.80.3", "spot.lan"))
    leaf = x509.load_pem_x509_certificate(made.certificate_pem)
    names = leaf.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert names.get_values_for_type(x509.DNSName) == ["*.spot.robot", "localhost", "spot.lan"]
    assert [str(address) for address in names.get_values_for_type(x509.IPAddress)] == ["127.0.0.1", "192.168.80.3"]
    for path in (tmp_path / "state").iterdir():
        assert stat.S_IMODE(path.stat().st_mode) == 0o600, path.name
    assert stat.S_IMODE((tmp_path / "state").stat().st_mode) == 0o700
    assert "PRIVATE" not in repr(made)


def test_robots_of_one_folder_are_trusted_alike_whenever_they_were_started(tmp_path: Path) -> None:
    runs, later = make_certificates(tmp_path), make_certificates(tmp_path, addresses=("192.168.80.3",))
    assert runs.ca_pem == later.ca_pem == (tmp_path / "ca.pem").read_bytes()
    assert runs.key_pem != later.key_pem
    assert _is_trusted(runs, later.ca_pem, tmp_path)
    assert _is_trusted(later, runs.ca_pem, tmp_path)


@pytest.mark.parametrize("spoil", ["ca.pem", "ca.key", "torn", "foreign", "old"])
def test_an_authority_that_no_longer_serves_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, spoil: str
) -> None:
    if spoil == "old":
        with monkeypatch.context() as patch:
            patch.setattr("fake_robot.start.certificates.VALIDITY", dt.timedelta(days=30))
            before = make_certificates(tmp_path)  # whose authority ends in 300 days
    else:
        before = make_certificates(tmp_path)
    if spoil.startswith("ca."):
        (tmp_path / spoil).unlink()
    elif spoil == "torn":
        (tmp_path / "ca.key").write_bytes(b"torn")
    elif spoil == "foreign":
        make_certificates(tmp_path / "other")
        (tmp_path / "other" / "ca.key").rename(tmp_path / "ca.key")
    made = make_certificates(tmp_path)
    assert made.ca_pem != before.ca_pem
    assert _is_trusted(made, made.ca_pem, tmp_path)
    assert not _is_trusted(made, before.ca_pem, tmp_path)
    assert make_certificates(tmp_path).ca_pem == made.ca_pem


def _is_trusted(server: ServerCertificates, ca_pem: bytes, folder: Path) -> bool:
    """Whether a TLS client that trusts ``ca_pem`` accepts this server, without a socket."""
    chain = folder / "chain.pem"
    chain.write_bytes(server.certificate_pem + server.key_pem)
    there = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    there.load_cert_chain(chain)
    here = ssl.create_default_context(cadata=ca_pem.decode())
    up, down = ssl.MemoryBIO(), ssl.MemoryBIO()
    ends = [here.wrap_bio(down, up, server_hostname="api.spot.robot"), there.wrap_bio(up, down, server_side=True)]
    try:
        for end in ends * 4:
            with suppress(ssl.SSLWantReadError):
                end.do_handshake()
    except ssl.SSLCertVerificationError:
        return False
    return ends[0].version() is not None


def test_a_folder_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(CertificateError, match=r"file/state.*--state-dir"):
        make_certificates(tmp_path / "file" / "state")


def test_passwords_come_from_private_files_only(tmp_path: Path) -> None:
    path = tmp_path / "password"
    path.write_text("open sesame\n")
    path.chmod(0o644)
    with pytest.raises(BadInputError, match=r"chmod 600") as refused:
        read_password(path)
    assert "sesame" not in str(refused.value)
    path.chmod(0o600)
    assert read_password(path) == "open sesame"
    path.write_text("\n")
    with pytest.raises(BadInputError, match="one line"):
        read_password(path)
    credentials = ensure_credentials(tmp_path / "state")
    assert ensure_credentials(tmp_path / "state") == credentials
    assert credentials.password not in repr(credentials)


# ------------------------------------------------------------------------------------------------------- addresses


def test_the_host_argument_makes_the_sdk_append_its_port_to_a_second_address() -> None:
    assert sdk_host("127.0.0.1", 8443) == "ipv4:127.0.0.1:8443,127.0.0.1"
    assert sdk_host("0.0.0.0", 8443) == "ipv4:127.0.0.1:8443,127.0.0.1"  # noqa: S104 - compared, not bound
    assert sdk_host("::1", 8443) == "ipv6:[::1]:8443,[::1]"
    assert sdk_host("127.0.0.1", 443) == "127.0.0.1"
    assert sdk_host("unix:/run/spot.sock", 0) == "unix:/run/spot.sock"


def test_over_a_unix_socket(serve_stub: Callable[..., Any], short_folder: Path) -> None:
    stub = serve_stub(address=f"unix:{short_folder}/spot.sock")
    assert stub.sdk_robot().get_id().species == "spot"
    with pytest.raises(BindError, match="another server listens"):
        serve_stub(address=f"unix:{short_folder}/spot.sock")


def test_a_socket_that_a_dead_server_left_is_replaced(serve_stub: Callable[..., Any], short_folder: Path) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(f"{short_folder}/spot.sock:443")
    stub = serve_stub(address=f"unix:{short_folder}/spot.sock")
    assert stub.sdk_robot().get_id().species == "spot"


@pytest.mark.parametrize(
    ("name", "message"), [("x" * 120, "longer than 100 bytes"), ("missing/spot.sock", "no folder"), ("f", "no socket")]
)
def test_impossible_sockets(serve_stub: Callable[..., Any], short_folder: Path, name: str, message: str) -> None:
    (short_folder / "f:443").touch()
    with pytest.raises(BindError, match=message):
        serve_stub(address=f"unix:{short_folder}/{name}")


def test_a_port_in_use_is_named(stub: Any, certificates: ServerCertificates, stub_robot_type: Any) -> None:
    from fake_robot.scenario.parts import ServicesConfig
    from fake_robot.start.server import FakeServer

    robot = stub_robot_type()
    server = FakeServer(robot, ServicesConfig(), stub.credentials, certificates, port=stub.endpoints.port)
    with pytest.raises(BindError, match=rf"127.0.0.1:{stub.endpoints.port}: it is in use"):
        server.start()
    assert "start" not in robot.calls


# ---------------------------------------------------------------------------------------------------------- tokens


def test_who_is_let_in(stub: Any) -> None:
    robot = stub.sdk_robot(is_authenticated=False)
    assert robot.get_id().species == "spot", "the identity needs no token"
    with pytest.raises(UnauthenticatedError):
        robot.list_services()
    with pytest.raises(InvalidLoginError):
        robot.authenticate("user", "wrong")
    with pytest.raises(InvalidTokenError):
        robot.authenticate_with_token("not.a.token")
    robot.authenticate("user", "correct horse")
    first = robot.user_token
    robot.authenticate_with_token(first)
    assert robot.user_token != first
    assert robot.list_services()
    stub.server.faults.inject("token_expired", {}, None)
    with pytest.raises(UnauthenticatedError):
        robot.list_services()
    with pytest.raises(InvalidTokenError):
        robot.authenticate_with_token(robot.user_token)


def test_streams_need_a_token_too(stub: Any) -> None:
    from bosdyn.client.robot_command import RobotCommandStreamingClient
    from bosdyn.client.robot_state import RobotStateStreamingClient

    robot = stub.sdk_robot(RobotStateStreamingClient, RobotCommandStreamingClient)
    states = robot.ensure_client("robot-state-streaming")
    commands = robot.ensure_client("robot-command-streaming")
    stub.server.faults.inject("token_expired", {}, None)
    for call in (lambda: next(states.get_robot_state_stream()), lambda: commands.send_joint_control_commands(iter(()))):
        with pytest.raises(grpc.RpcError) as refused:
            call()
        assert refused.value.code() is grpc.StatusCode.UNAUTHENTICATED
    assert not stub.robot.subscriptions
    assert not stub.robot.streams


@pytest.mark.filterwarnings("ignore:read_binary is deprecated:DeprecationWarning")  # of the SDK
def test_a_stranger_who_does_not_trust_the_certificate_is_not_served(stub: Any) -> None:
    from bosdyn.client.sdk import create_standard_sdk

    robot = create_standard_sdk("stranger").create_robot(stub.endpoints.sdk_host)
    with pytest.raises(RpcError):
        robot.ensure_client("robot-id").get_id(timeout=10)


# --------------------------------------------------------------------------------------------- headers and limits


def raw_channel(stub: Any) -> grpc.Channel:
    credentials = grpc.ssl_channel_credentials(stub.certificates.ca_pem)
    return grpc.secure_channel(stub.endpoints.robot, credentials, [("grpc.ssl_target_name_override", "id.spot.robot")])


def test_every_unary_answer_has_a_full_header(stub: Any) -> None:
    with raw_channel(stub) as channel:
        request = robot_id_pb2.RobotIdRequest()
        request.header.client_name = "raw"
        request.header.request_timestamp.seconds = 77
        header = robot_id_service_pb2_grpc.RobotIdServiceStub(channel).GetRobotId(request).header
    assert header.request_header == request.header
    assert header.error.code == header.error.CODE_OK
    assert header.request_received_timestamp.seconds == header.response_timestamp.seconds == 1_700_000_000


def test_too_large_a_request_is_refused(stub: Any) -> None:
    client = stub.sdk_robot().ensure_client("data-buffer")
    client.add_text_messages([data_buffer_pb2.TextMessage(message="x" * 1_000_000)])
    with pytest.raises(RpcError) as refused:
        client.add_text_messages([data_buffer_pb2.TextMessage(message="x" * 5_000_000)])
    assert refused.value.error.code() is grpc.StatusCode.RESOURCE_EXHAUSTED


# --------------------------------------------------------------------------------------------- faults of the wire


def test_a_stolen_lease(stub: Any) -> None:
    client = stub.sdk_robot().ensure_client("lease")
    lease = client.acquire()
    stub.server.faults.inject("lease_stolen", {"owner": "tablet"}, None)
    with pytest.raises(ResourceAlreadyClaimedError) as claimed:
        client.acquire()
    assert claimed.value.response.lease_owner.client_name == "tablet"
    from bosdyn.client.exceptions import LeaseUseError

    with pytest.raises(LeaseUseError):
        client.retain_lease(lease)


def test_lasting_faults_end_by_time_or_by_hand(stub: Any) -> None:
    faults = stub.server.faults
    robot = stub.sdk_robot()
    pressed = faults.inject("estop_pressed", {}, 2.0)
    assert robot.is_estopped()
    assert stub.robot.calls[-1] == "estop cut"
    stub.robot.clock.pass_s(1.9)
    faults.tick()
    assert faults.active() == {pressed: "estop_pressed"}
    stub.robot.clock.pass_s(0.2)
    faults.tick()
    assert not robot.is_estopped()
    assert stub.robot.calls[-1] == "estop none"
    unlicensed = faults.inject("license_invalid", {"state": "missing"}, None)
    weakened = faults.inject("weak_motor", {"gain": 0.5}, None)
    assert set(faults.active()) == {unlicensed, weakened}
    assert set(faults.clear()) == {unlicensed, weakened}
    assert stub.server.world.license.state == "valid"


@pytest.mark.parametrize(
    ("name", "parameters", "duration_s", "message"),
    [
        ("gremlin", {}, None, r"no fault 'gremlin'; allowed: .*estop_pressed.*weak_motor"),
        ("lease_stolen", {"thief": "x"}, None, "thief = 'x': unknown key; allowed: owner"),
        ("license_invalid", {"state": "eaten"}, None, "state = 'eaten': Input should be 'expired' or 'missing'"),
        ("estop_pressed", {}, -1.0, "duration_s = -1"),
        ("weak_motor", {"weight": 1.0}, None, "allowed: joint, gain"),
    ],
)
def test_faults_that_do_not_exist(
    stub: Any, name: str, parameters: dict[str, float | str], duration_s: float | None, message: str
) -> None:
    with pytest.raises(BadInputError, match=message):
        stub.server.faults.inject(name, parameters, duration_s)
    assert not stub.server.faults.active()


def test_a_cut_network_refuses_calls_and_comes_back(stub: Any) -> None:
    robot = stub.sdk_robot()
    stub.server.faults.inject("network_cut", {}, 600.0)
    with pytest.raises(RpcError) as refused:
        robot.get_id()
    assert refused.value.error.code() is grpc.StatusCode.UNAVAILABLE
    stub.server.world.link.restore()
    assert robot.get_id()


def test_a_reboot_forgets_every_client(serve_stub: Callable[..., Any]) -> None:
    stub = serve_stub(reboot_s=0.0)
    robot = stub.sdk_robot()
    lease = robot.ensure_client("lease").acquire()
    stub.server.faults.inject("reboot", {}, None)
    assert "power_off" in stub.robot.calls
    with pytest.raises(UnauthenticatedError):
        robot.list_services()
    robot.authenticate("user", "correct horse")
    use = stub.server.world.leases.use(lease.lease_proto)
    assert use.status == use.STATUS_WRONG_EPOCH


# ----------------------------------------------------------------------------------------------------------- admin


@pytest.fixture
def lock_step(serve_stub: Callable[..., Any], stub_robot_type: Any) -> Any:
    """A stub in lock-step."""
    return serve_stub(stub_robot_type(is_lock_step=True))


def admin_of(stub: Any) -> tuple[grpc.Channel, Any]:
    channel = grpc.insecure_channel(stub.endpoints.admin)
    return channel, stub_of(channel, fake_admin_pb2)


def test_step_lets_time_pass(lock_step: Any) -> None:
    channel, admin = admin_of(lock_step)
    with channel:
        before = admin.GetStatus(fake_admin_pb2.GetStatusRequest())
        assert before.lock_step
        step = admin.Step(fake_admin_pb2.StepRequest(duration_ns=210_000_000))
        assert step.robot_stamp_ns == before.robot_stamp_ns + 210_000_000
        step = admin.Step(fake_admin_pb2.StepRequest(state_messages=40))
        assert (step.states_sent, step.last_state_robot_stamp_ns) == (40, step.robot_stamp_ns)
        step = admin.Step(fake_admin_pb2.StepRequest(state_messages=40, max_duration_ns=48_000_000))
        assert step.states_sent == 16
        lock_step.robot.last_command_key, lock_step.robot.commands_submitted = 9, 3
        admin.Step(fake_admin_pb2.StepRequest(duration_ns=1, wait_for_command_key=9))
        with pytest.raises(grpc.RpcError) as refused:
            admin.Step(fake_admin_pb2.StepRequest(duration_ns=1, wait_for_command_key=10, wait_timeout_s=0.01))
        assert refused.value.code() is grpc.StatusCode.DEADLINE_EXCEEDED
        assert "no command with key 10" in refused.value.details()
        earlier = admin.GetStatus(fake_admin_pb2.GetStatusRequest()).commands_submitted
        late = fake_admin_pb2.StepRequest(wait_for_command_key=1, wait_timeout_s=0.01, wait_beyond_commands=earlier)
        with pytest.raises(grpc.RpcError, match="no command with key 1 or newer"):
            admin.Step(late)
        with pytest.raises(grpc.RpcError, match="not negative"):
            admin.Step(fake_admin_pb2.StepRequest(duration_ns=-1))


def test_steps_by_socket_and_the_command_that_goes_with_one(lock_step: Any) -> None:
    lock_step.robot.open_command_stream(lambda: None)
    channel, admin = admin_of(lock_step)
    with channel, socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as steps:
        status = admin.GetStatus(fake_admin_pb2.GetStatusRequest())
        steps.connect(status.step_socket)

        def step(datagram: bytes) -> fake_admin_pb2.StepResponse:
            steps.send(datagram)
            return fake_admin_pb2.StepResponse.FromString(steps.recv(65536))

        command = robot_command_pb2.JointControlStreamRequest()
        command.joint_command.user_command_key = 7
        request = fake_admin_pb2.StepRequest(duration_ns=5, command=command.SerializeToString())
        assert step(request.SerializeToString()).robot_stamp_ns == status.robot_stamp_ns + 5
        assert lock_step.robot.streams[-1].requests == [command]
        assert "not negative" in step(fake_admin_pb2.StepRequest(duration_ns=-1).SerializeToString()).refusal
        assert "JointControlStreamRequest" in step(fake_admin_pb2.StepRequest(command=b"?").SerializeToString()).refusal
        assert step(b"?").refusal
        assert step(fake_admin_pb2.StepRequest(duration_ns=1).SerializeToString()).refusal == ""


def test_a_client_that_waits_while_nobody_steps_is_told_so(lock_step: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    robot = lock_step.sdk_robot()
    lease = robot.ensure_client("lease").acquire()
    client = robot.ensure_client("power")
    command = client.power_command(power_pb2.PowerCommandRequest.REQUEST_ON_MOTORS, lease=lease.lease_proto)
    assert client.power_command_feedback(command.power_command_id) == power_pb2.STATUS_IN_PROGRESS
    monkeypatch.setattr(power, "STANDSTILL_S", 0.0)
    with pytest.raises(InvalidRequestError, match="nobody has stepped it; start the client with --lock-step"):
        client.power_command_feedback(command.power_command_id)


def test_step_needs_lock_step(stub: Any) -> None:
    channel, admin = admin_of(stub)
    with channel, pytest.raises(grpc.RpcError, match="start it with --lock-step"):
        admin.Step(fake_admin_pb2.StepRequest(duration_ns=1))


def test_a_long_step_lets_leases_expire_on_the_way(serve_stub: Callable[..., Any], stub_robot_type: Any) -> None:
    from fake_robot.network.status import MotorPower

    stub = serve_stub(stub_robot_type(is_lock_step=True), liveness_clock="robot")
    stub.sdk_robot().ensure_client("lease").acquire()
    stub.robot.set(motor_power=MotorPower.ON)
    channel, admin = admin_of(stub)
    with channel:
        admin.Step(fake_admin_pb2.StepRequest(duration_ns=7_000_000_000))
    assert stub.robot.calls.count("safe_power_off") == 1


def test_faults_truth_and_status_over_the_admin_service(stub: Any) -> None:
    channel, admin = admin_of(stub)
    with channel:
        names = [fault.name for fault in admin.ListFaults(fake_admin_pb2.ListFaultsRequest()).faults]
        assert {"estop_pressed", "weak_motor"} <= set(names)
        assert names == sorted(names)
        injected = admin.InjectFault(fake_admin_pb2.InjectFaultRequest(name="weak_motor", numbers={"gain": 0.5}))
        status = admin.GetStatus(fake_admin_pb2.GetStatusRequest())
        assert status.active_faults[0].name == "weak_motor"
        assert status.motor_power == "off"
        cleared = admin.ClearFaults(fake_admin_pb2.ClearFaultsRequest(fault_ids=[injected.fault_id]))
        assert list(cleared.cleared_fault_ids) == [injected.fault_id]
        with pytest.raises(grpc.RpcError, match="not active"):
            admin.ClearFaults(fake_admin_pb2.ClearFaultsRequest(fault_ids=[5]))
        with pytest.raises(grpc.RpcError, match="no fault 'gremlin'"):
            admin.InjectFault(fake_admin_pb2.InjectFaultRequest(name="gremlin"))
        truth = admin.GetTruth(fake_admin_pb2.GetTruthRequest())
        assert list(truth.joint_torque_nm) == list(range(12))
        assert truth.body_height_min_m == 0.4
        assert not stub.server.wait(0)
        admin.Shutdown(fake_admin_pb2.ShutdownRequest())
        assert stub.server.wait(10)


def test_stopping_twice_is_harmless_and_frees_the_port(serve_stub: Callable[..., Any]) -> None:
    first = serve_stub()
    first.server.stop()
    first.server.stop()
    with socket.socket() as probe:
        assert probe.connect_ex(("127.0.0.1", first.endpoints.port)) != 0


def test_a_simulation_that_crashes_ends_the_server_in_words(stub: Any) -> None:
    stub.server.raise_crash()
    stub.robot.crash = ZeroDivisionError("no ground")
    assert stub.server.wait(10)
    with pytest.raises(SpotRlError, match="no ground"):
        stub.server.raise_crash()


def test_stopping_ends_open_streams(stub: Any) -> None:
    from bosdyn.client.robot_state import RobotStateStreamingClient

    stream = stub.sdk_robot(RobotStateStreamingClient).ensure_client("robot-state-streaming").get_robot_state_stream()
    channel, admin = admin_of(stub)
    with channel:
        while not admin.GetStatus(fake_admin_pb2.GetStatusRequest()).state_streams:
            threading.Event().wait(0.01)
    stub.server.stop()
    with pytest.raises(grpc.RpcError):
        next(stream)


# --------------------------------------------------------------------------------------------- the environment


PROGRAM = """
import sys
import bosdyn.client
import bosdyn.client.util
robot = bosdyn.client.create_standard_sdk("program").create_robot(sys.argv[1])
bosdyn.client.util.authenticate(robot)
print(robot.get_id().nickname, len(robot.list_services()) > 5)
"""


def test_an_unmodified_program_trusts_the_fake_by_its_environment(stub: Any, tmp_path: Path) -> None:
    state = stub.certificates.ca_path.parent
    environment = SdkEnvironment(
        stub.certificates.ca_path, write_sdk_folder(tmp_path, state / "ca.pem"), "user", "correct horse"
    )
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "sitecustomize.py").write_text("print('the other one ran')")
    variables = environment.variables({"PYTHONPATH": str(tmp_path / "other")})
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM, stub.endpoints.sdk_host],
        env={**os.environ, **variables},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert ran.returncode == 0, ran.stderr
    assert ran.stdout.split("\n")[:2] == ["the other one ran", "fake True"]
