"""State messages that no Spot would send."""

from __future__ import annotations

import hashlib

from bosdyn.api import robot_state_pb2


def spoil(message: bytes, kind: str) -> bytes:
    """A state message, spoilt: ``eleven_joints``, ``cut`` in the middle, ``noise`` of the same length, or ``empty``."""
    if kind == "eleven_joints":
        state = robot_state_pb2.RobotStateStreamResponse.FromString(message)
        for values in (state.joint_states.position, state.joint_states.velocity, state.joint_states.load):
            del values[11:]
        wire: bytes = state.SerializeToString()
        return wire
    if kind == "cut":
        return message[: len(message) // 2]
    if kind == "noise":
        return hashlib.shake_256(message).digest(len(message))
    return b""
