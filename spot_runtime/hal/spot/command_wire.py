"""A joint command as the bytes of a vendor JointControlStreamRequest."""

from __future__ import annotations

from bosdyn.api import robot_command_pb2

from spot_model.robot.stamps import NS_PER_S
from spot_model.robot.state import Array, Gains, JointCommand


class CommandEncoder:
    """Turns commands into wire bytes, reusing one message; for one thread.

    Every message carries the full gains: they are needed in the first one and after each change, and a message that
    gets lost must not leave the robot with the gains of another.
    """

    def __init__(self, client_name: str, velocity_safety_limit_rad_s: float) -> None:
        """Fill what never changes."""
        self._message = robot_command_pb2.JointControlStreamRequest()
        self._message.header.client_name = client_name
        self._message.joint_command.velocity_safety_limit.value = velocity_safety_limit_rad_s
        # What stays the same from one command to the next is not filled in again.
        self._gains: Gains | None = None
        self._velocity: Array | None = None
        self._load: Array | None = None

    def encode(self, command: JointCommand, host_stamp_ns: int) -> bytes:
        """The wire bytes of one command.

        Args:
            command: What to send.
            host_stamp_ns: When it is sent, host clock, for the header.
        """
        stamp = self._message.header.request_timestamp
        stamp.seconds, stamp.nanos = divmod(host_stamp_ns, NS_PER_S)
        joint = self._message.joint_command
        joint.end_time.seconds, joint.end_time.nanos = divmod(command.end_robot_stamp_ns, NS_PER_S)
        joint.position[:] = command.position_rad.tolist()
        if command.velocity_rad_s is not self._velocity:
            self._velocity = command.velocity_rad_s
            joint.velocity[:] = self._velocity.tolist()
        if command.load_nm is not self._load:
            self._load = command.load_nm
            joint.load[:] = self._load.tolist()
        if command.gains is not self._gains:
            self._gains = command.gains
            joint.gains.k_q_p[:] = command.gains.kp_nm_per_rad.tolist()
            joint.gains.k_qd_p[:] = command.gains.kd_nm_s_per_rad.tolist()
        joint.user_command_key = command.key
        wire: bytes = self._message.SerializeToString()
        return wire
