"""What is fuzzed: each parser as a function of bytes, which may refuse in its own words and do nothing else.

A target returns, or raises what its parser promises; anything else is a finding.
"""

from __future__ import annotations

import contextlib
import json
import struct
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - the fastest disk there is; a private folder is made in it


@dataclass(frozen=True)
class Target:
    """A parser, and inputs from which to start."""

    run: Callable[[bytes], object]
    seeds: Callable[[], list[bytes]]


def folder() -> Path:
    """A folder in memory for parsers that want files; one a process."""
    global _folder  # noqa: PLW0603
    if _folder is None:
        where = SHARED_MEMORY if SHARED_MEMORY.is_dir() else None
        _folder = tempfile.TemporaryDirectory(prefix="spot-rl-fuzz-", dir=where)
    return Path(_folder.name)


_folder: tempfile.TemporaryDirectory[str] | None = None


def refusing(*kinds: type[BaseException]) -> contextlib.suppress:
    """Refusals in words are right answers."""
    from spot_model.errors import SpotRlError

    return contextlib.suppress(SpotRlError, *kinds)


def text_file(data: bytes, load: Callable[[Path], object]) -> None:
    """Give a parser of files a file."""
    path = folder() / "input.yaml"
    path.write_bytes(data)
    with refusing():
        load(path)


# Policies ------------------------------------------------------------------------------------------------------------


def policy(data: bytes) -> None:
    """The ONNX file with its contract."""
    from spot_model.policy import policy_from_bytes

    with refusing():
        policy_from_bytes(data, source="fuzzed")


def policy_seeds() -> list[bytes]:
    """A policy of a few kilobytes: one layer of zeros, and a contract that holds."""
    whole = (Path(__file__).parent / "seeds" / "policy.onnx").read_bytes()
    return [whole, whole[:400]]


def contract(data: bytes) -> None:
    """The contract's JSON alone."""
    from pydantic import ValidationError

    from spot_model.policy_contract import PolicyContract

    with contextlib.suppress(ValidationError):
        PolicyContract.from_json(data.decode("utf-8", errors="replace")).to_json()


def contract_seeds() -> list[bytes]:
    from spot_model.policy_contract import PolicyContract, StoredPair

    pair = StoredPair(observation=(0.0,) * 48, action=(0.0,) * 12)
    low, high = (-1.0, -0.5, -1.0), (1.5, 0.5, 1.0)
    whole = PolicyContract(name="seed", velocity_command_low=low, velocity_command_high=high, stored_pair=pair)
    return [whole.to_json().encode(), b"{}", b"[1, 2]"]


# YAML files ----------------------------------------------------------------------------------------------------------


def scenario(data: bytes) -> None:
    """The fake robot's scenario."""
    from fake_robot.scenario import load_scenario

    text_file(data, load_scenario)


def scenario_seeds() -> list[bytes]:
    files = sorted((REPOSITORY / "fake_robot" / "scenarios").glob("*.yaml"))
    return [file.read_bytes() for file in files] + [b"state_channel: {delay: {kind: csv, path: x.csv}}"]


def config(data: bytes) -> None:
    """The configuration of a run."""
    from spot_runtime.config import load_config

    text_file(data, lambda path: load_config(path).to_json())


def config_seeds() -> list[bytes]:
    import yaml

    from spot_runtime.config import RunConfig

    whole = yaml.safe_dump(json.loads(RunConfig().to_json())).encode()
    return [whole, b"safety: {tilt_rad: 0.5, state_age_damp_s: 0.03}", b"control: {end_time_ahead_s: .inf}"]


def model_file(data: bytes) -> None:
    """The robot model with its effects."""
    from spot_model.model_file import load_model

    text_file(data, lambda path: load_model(str(path)).digest())


def model_file_seeds() -> list[bytes]:
    import yaml

    from spot_model.model_file import BUILT_IN

    return [yaml.safe_dump(model.to_data()).encode() for model in BUILT_IN.values()]


def mapping(data: bytes) -> None:
    """The mapping of a foreign recording."""
    from spot_runtime.log.importing import load_mapping

    text_file(data, load_mapping)


MAPPING = b"""schema: spot-rl/import/1
time: {from: t, unit: s}
signals:
  position: {from: q, unit: rad}
  velocity: {columns: [a, b, c], unit: rad/s}
joint_names: [a, b, c]
source_joint_names: [c, b, a]
"""


def mapping_seeds() -> list[bytes]:
    return [MAPPING, b"schema: spot-rl/import/1\ntime: {rate_hz: 100}\nsignals: {position: {from: q}}\n"]


def recording(data: bytes) -> None:
    """A foreign recording, by its first byte as CSV or NPZ, through a good mapping."""
    from spot_runtime.log.importing import import_log, load_mapping

    where = folder()
    mapped, out = where / "mapping.yaml", where / "out.mcap"
    mapped.write_text("schema: spot-rl/import/1\ntime: {from: t, unit: s}\nsignals: {position: {from: q, unit: rad}}\n")
    source = where / ("input.csv" if data[:1] < b"\x40" else "input.npz")
    source.write_bytes(data[1:])
    try:
        with refusing(OSError):
            import_log(load_mapping(mapped), source, out)
    finally:
        for path in (out, out.with_name(out.name + ".active")):
            path.unlink(missing_ok=True)


def recording_seeds() -> list[bytes]:
    import io

    rows = np.linspace(0.0, 0.1, 11)
    columns = "t," + ",".join(f"q_{i}" for i in range(12)) + "\n"
    lines = "".join(",".join(f"{value:.3f}" for value in (t, *np.full(12, 0.1))) + "\n" for t in rows)
    packed = io.BytesIO()
    np.savez(packed, t=rows, q=np.zeros((11, 12)))
    return [b"\x00" + (columns + lines).encode(), b"\xff" + packed.getvalue()]


def sequence(data: bytes) -> None:
    """A sequence of velocity commands."""
    from spot_model.velocity_sequence import load_sequence

    text_file(data, lambda path: load_sequence(str(path)).at(1.0))


def sequence_seeds() -> list[bytes]:
    return [
        b"name: a\nduration_s: 2.0\nwaypoints:\n- {time_s: 0.0, v_x_m_s: 1.0}\n- {time_s: 1.0, yaw_rate_rad_s: 0.5}\n"
    ]


def credentials(data: bytes) -> None:
    """User name and password; an error must not quote them."""
    from spot_runtime.hal.credentials import find_credentials
    from spot_runtime.hal.errors import CredentialsError

    path = folder() / "credentials.yaml"
    path.write_bytes(data)
    path.chmod(0o600)
    try:
        find_credentials(path, {})
    except CredentialsError as error:
        if b"canary" in data and "canary" in str(error):
            raise AssertionError("the error quotes the file") from error


def credentials_seeds() -> list[bytes]:
    return [b"username: user\npassword: canary\n", b"username: [canary]\n", b"password: canary: canary\n"]


def delays(data: bytes) -> None:
    """A histogram of delays."""
    from spot_model.delay import read_delay_csv

    text_file(data, read_delay_csv)


def delays_seeds() -> list[bytes]:
    return [b"low_s,high_s,count\n0.0,0.001,5\n0.001,0.002,1\n", b"low_s,high_s,count\n0.0,0.0,0\n"]


# Logs ----------------------------------------------------------------------------------------------------------------


def log_reader(data: bytes) -> None:
    """The reader: whatever it is, it is read as far as it goes, or refused."""
    from spot_runtime.log.mcap_scan import scan_mcap
    from spot_runtime.log.reader import header_of, run_of

    path = Path("fuzzed.mcap")
    scan = scan_mcap(data)
    with refusing():
        run_of(path, header_of(path, scan), scan)


def log_seeds() -> list[bytes]:
    return [small_log()]


def small_log() -> bytes:
    """A log with one record of each topic."""
    from spot_model.state import Gains, JointCommand, RobotState, SlowState
    from spot_runtime.log import hand_off
    from spot_runtime.log.records import CommandRecord, EventRecord, RunHeader, Severity, TickRecord
    from spot_runtime.log.run_writer import RunWriter

    path, zeros, now_ns = folder() / "seed.mcap", np.zeros(12), 1_700_000_000_000_000_000
    path.unlink(missing_ok=True)
    writer = RunWriter(path, RunHeader("seed", now_ns), min_free_bytes=0)
    three, level, feet = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.ones(4, dtype=np.bool_)
    state = RobotState(now_ns, now_ns, zeros, zeros, zeros, three, level, three, three, feet, 1, now_ns)
    command = JointCommand(1, zeros, zeros, zeros, Gains.policy(), now_ns + 50_000_000)
    small = np.zeros(12, dtype=np.float32)
    observation = np.zeros(48, dtype=np.float32)
    tick = TickRecord(1, now_ns, now_ns, "active", observation, small, three, 0.0, 0.0, 0.0, 1, 0)
    for packed in (
        hand_off.pack_state(0, state),
        hand_off.pack_command(0, CommandRecord(command, zeros, now_ns, now_ns, now_ns)),
        hand_off.pack_tick(0, tick),
        hand_off.pack_slow_state(0, SlowState(now_ns, now_ns, True, False, 80.0, 55.0, -5.0, (30.0,), {"fl_kn": 40.0})),
        hand_off.pack_event(0, EventRecord(now_ns, now_ns, Severity.INFO, "mode", "ready → activating", {"a": 1.0})),
    ):
        message: Any = hand_off.unpack(packed).message
        writer.add(message, 0)
    writer.close({}, "completed")
    return path.read_bytes()


def log_recovery(data: bytes) -> None:
    """Recovery: a whole log comes out, or a refusal, and never half a file."""
    from spot_runtime.log import read_run, recover_log
    from spot_runtime.log.run_writer import active_path

    source, result = folder() / "damaged.mcap", folder() / "recovered.mcap"
    source.write_bytes(data)
    try:
        with refusing():
            recover_log(source, result)
            read_run(result)
        if active_path(result).exists():
            raise AssertionError("a half-written result was left")
    finally:
        result.unlink(missing_ok=True)
        active_path(result).unlink(missing_ok=True)


def datagram(data: bytes) -> None:
    """What the log's process is handed."""
    from google.protobuf.message import DecodeError

    from spot_runtime.log.hand_off import unpack

    with refusing(ValueError, struct.error, DecodeError):
        unpack(data)


def datagram_seeds() -> list[bytes]:
    head = struct.Struct("<BI")
    return [head.pack(kind, 0) + bytes(size) for kind, size in ((1, 8), (3, 676), (4, 76), (5, 4), (6, 4), (7, 0))]


# What the network brings ---------------------------------------------------------------------------------------------


def vendor_state(data: bytes) -> None:
    """A message of the state stream, as the loop and as the log decode it, and what the safety core makes of it."""
    from google.protobuf.message import DecodeError

    from spot_runtime.log.vendor_record import state_record_from_wire
    from spot_runtime.safety import StateMemory, screen_state
    from spot_runtime.safety_limits import SafetyLimits
    from spot_runtime.vendor_state import robot_state_from_wire

    with refusing(DecodeError):
        state_record_from_wire(data, 0)
    with refusing():
        state = robot_state_from_wire(data, 0)
        memory, is_usable, stop = screen_state(StateMemory(), state, state.robot_stamp_ns, SafetyLimits())
        if is_usable and memory.newest is None:
            raise AssertionError("a usable state was forgotten")
        if not is_usable and stop is None:
            raise AssertionError("a first state was refused without a reason")


def vendor_state_seeds() -> list[bytes]:
    from bosdyn.api import robot_state_pb2

    message = robot_state_pb2.RobotStateStreamResponse()
    message.joint_states.acquisition_timestamp.seconds = 1_700_000_000
    for values in (message.joint_states.position, message.joint_states.velocity, message.joint_states.load):
        values.extend([0.1] * 12)
    message.kinematic_state.odom_tform_body.rotation.w = 1.0
    message.contact_states.extend([robot_state_pb2.FootState.CONTACT_MADE] * 4)
    whole: bytes = message.SerializeToString()
    return [whole, b""]


def joint_command(data: bytes) -> None:
    """A message of the command stream, as the fake robot reads it."""
    from bosdyn.api import robot_command_pb2
    from google.protobuf.message import DecodeError

    from fake_robot.streamed_command import CommandRefusedError, StreamGrammar

    request = robot_command_pb2.JointControlStreamRequest()
    with contextlib.suppress(DecodeError, CommandRefusedError):
        request.ParseFromString(data)
        grammar = StreamGrammar()
        command = grammar.read(request)
        servo = command.servo_at(command.end_stamp_ns)
        if not np.isfinite(servo.position_rad + servo.velocity_rad_s + servo.load_nm).all():
            raise AssertionError("a command that is no number was taken")


def joint_command_seeds() -> list[bytes]:
    from spot_model.state import Gains, JointCommand
    from spot_runtime.hal.command_wire import CommandEncoder

    zeros = np.zeros(12)
    command = JointCommand(1, zeros, zeros, zeros, Gains.policy(), 1_700_000_000_050_000_000)
    return [CommandEncoder("fuzz", 40.0).encode(command, 1_700_000_000_000_000_000)]


def address(data: bytes) -> None:
    """A robot's address, labels of a log."""
    from spot_runtime.cli import parse_labels
    from spot_runtime.hal.address import parse_address

    text = data.decode("utf-8", errors="surrogateescape")
    with refusing():
        str(parse_address(text))
    with refusing():
        parse_labels(text.split("\n"))


def address_seeds() -> list[bytes]:
    return [b"192.168.80.3:443", b"[::1]:8443", b"unix:/tmp/s", b"ipv4:127.0.0.1:8443,127.0.0.1", b"a=b\nc=d"]


# RPCs of our own -----------------------------------------------------------------------------------------------------


class AbortedError(Exception):
    """The service has refused a call."""


class Context:
    """As much of a gRPC context as the services use."""

    def abort(self, code: object, details: str) -> None:
        """End the call, with words."""
        if not details:
            raise AssertionError("refused without a word")
        raise AbortedError(details)


def admin(data: bytes) -> None:
    """The fake robot's admin service: the first byte chooses the method."""
    from google.protobuf.message import DecodeError
    from google.protobuf.message_factory import GetMessageClass

    from spot_protos import fake_admin_pb2

    methods = fake_admin_pb2.DESCRIPTOR.services_by_name["FakeAdmin"].methods
    method = methods[(data[:1] or b"\0")[0] % len(methods)]
    request: Any = GetMessageClass(method.input_type)()
    service = admin_service()
    with contextlib.suppress(DecodeError, AbortedError):
        request.ParseFromString(data[1:])
        if method.name == "Step":  # an hour of robot time is a right answer, too, and a slow one
            request.wait_timeout_s = 1e-4
            request.max_duration_ns = min(request.max_duration_ns, 3_000_000)
            if request.WhichOneof("until") == "duration_ns":
                request.duration_ns = min(request.duration_ns, 3_000_000)
            elif request.state_messages:
                request.max_duration_ns = 3_000_000
        getattr(service, method.name)(request, Context()).SerializeToString()
        service.ClearFaults(fake_admin_pb2.ClearFaultsRequest(), Context())


def admin_service() -> Any:
    """The service over a robot in lock-step, in this process."""
    global _admin  # noqa: PLW0603
    if _admin is None:
        from fake_robot.robot import Robot
        from fake_robot.scenario import Scenario
        from fake_robot.services.admin import AdminService
        from fake_robot.services.fault_desk import FaultDesk
        from fake_robot.services.tokens import Credentials
        from fake_robot.services.world import World

        robot = Robot(Scenario().with_changes(time_mode="lock_step"))
        world = World(robot, robot.scenario.services, Credentials("user", "password"))
        _admin = AdminService(world, FaultDesk(world), lambda: None)
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


TARGETS = {
    "policy": Target(policy, policy_seeds),
    "contract": Target(contract, contract_seeds),
    "scenario": Target(scenario, scenario_seeds),
    "config": Target(config, config_seeds),
    "model_file": Target(model_file, model_file_seeds),
    "mapping": Target(mapping, mapping_seeds),
    "recording": Target(recording, recording_seeds),
    "sequence": Target(sequence, sequence_seeds),
    "credentials": Target(credentials, credentials_seeds),
    "delays": Target(delays, delays_seeds),
    "log_reader": Target(log_reader, log_seeds),
    "log_recovery": Target(log_recovery, log_seeds),
    "datagram": Target(datagram, datagram_seeds),
    "vendor_state": Target(vendor_state, vendor_state_seeds),
    "joint_command": Target(joint_command, joint_command_seeds),
    "address": Target(address, address_seeds),
    "admin": Target(admin, admin_seeds),
}


def changed(seeds: list[bytes], count: int, seed: int) -> Iterator[bytes]:
    """Seeds with random bytes, cuts, repetitions and words put in: the same ones for the same number."""
    rng = np.random.default_rng(seed)
    words = (b"\0", b"\xff" * 4, b"nan", b".inf", b"- - -", b"*a", b"&a ", b"{", b"[", b"1e999", b"null", b"\x80" * 9)
    for _ in range(count):
        data = bytearray(seeds[int(rng.integers(len(seeds)))])
        for _ in range(int(rng.integers(1, 6))):
            at = int(rng.integers(len(data) + 1))
            end = min(len(data), at + int(rng.integers(1, 16)))
            kind = int(rng.integers(5))
            if kind == 0:
                data[at:end] = rng.bytes(end - at)
            elif kind == 1:
                del data[at:end]
            elif kind == 2:
                data[at:at] = words[int(rng.integers(len(words)))]
            elif kind == 3:
                data[at:at] = data[at:end]
            elif len(data) > at:
                data[at] ^= 1 << int(rng.integers(8))
        yield bytes(data)


if sys.version_info < (3, 11):
    raise SystemExit("the fuzzer needs Python 3.11")
