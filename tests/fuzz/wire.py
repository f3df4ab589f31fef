"""What the network brings: states, commands, addresses."""

from __future__ import annotations

import contextlib

import numpy as np
from support import Target, refusing


def vendor_state(data: bytes) -> None:
    """A message of the state stream, as the loop and as the log decode it, and what the safety core makes of it."""
    from google.protobuf.message import DecodeError

    from spot_log.format.vendor_state import robot_state_from_wire, state_record_from_wire
    from spot_runtime.control.safety.states import StateMemory, screen_state
    from spot_runtime.safety_limits import SafetyLimits

    with refusing(DecodeError):
        state_record_from_wire(data, 0)
    with refusing():
        state = robot_state_from_wire(data, 0)
        memory, is_usable, stop = screen_state(StateMemory(), state, state.robot_stamp_ns, SafetyLimits())
        if is_usable and memory.newest is None:
            raise AssertionError("a usable state was forgotten")
        if not is_usable and stop is None and not memory.doubtful_in_row:
            raise AssertionError("a first state was refused without a reason, and without a doubt that is counted")


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

    from fake_robot.robot.streamed_command import CommandRefusedError, StreamGrammar

    request = robot_command_pb2.JointControlStreamRequest()
    with contextlib.suppress(DecodeError, CommandRefusedError):
        request.ParseFromString(data)
        grammar = StreamGrammar()
        command = grammar.read(request)
        servo = command.servo_at(command.end_stamp_ns)
        if not np.isfinite(servo.position_rad + servo.velocity_rad_s + servo.load_nm).all():
            raise AssertionError("a command that is no number was taken")


def joint_command_seeds() -> list[bytes]:
    from spot_model.robot.state import Gains, JointCommand
    from spot_runtime.hal.spot.command_stream import CommandEncoder

    zeros = np.zeros(12)
    command = JointCommand(1, zeros, zeros, zeros, Gains.policy(), 1_700_000_000_050_000_000)
    return [CommandEncoder("fuzz", 40.0).encode(command, 1_700_000_000_000_000_000)]


def address(data: bytes) -> None:
    """A robot's address, labels of a log."""
    from spot_runtime.hal.address import parse_address
    from spot_runtime.session.labels import parse_labels

    text = data.decode("utf-8", errors="surrogateescape")
    with refusing():
        str(parse_address(text))
    with refusing():
        parse_labels(text.split("\n"))


def address_seeds() -> list[bytes]:
    return [b"192.168.80.3:443", b"[::1]:8443", b"unix:/tmp/s", b"ipv4:127.0.0.1:8443,127.0.0.1", b"a=b\nc=d"]


WIRE = {
    "vendor_state": Target(vendor_state, vendor_state_seeds, ("spot_log.format", "spot_runtime"), 1024),
    "joint_command": Target(joint_command, joint_command_seeds, ("fake_robot",), 512),
    "address": Target(address, address_seeds, ("spot_runtime",), 64, (b"unix:", b"ipv4:", b"://", b"[::1]", b"\xff")),
}
