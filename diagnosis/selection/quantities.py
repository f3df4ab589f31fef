"""What a residual may depend on, channel by channel: the features that trees look at, with names for people."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any, Final

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Ints
from diagnosis.channels.drive.actuator import ActuatorSignals
from diagnosis.channels.stack import Stack
from spot_model.robot.rotation import projected_gravity
from trainer.signals.recording import Recording

HEAT_S: Final = 30.0
LATEST_S: Final = 0.1
Table = tuple[tuple[str, ...], Array]
"""Names of the Q quantities, and their values (m, Q)."""


class Quantities:
    """Quantities of the samples of any row of any channel; built once for a set of logs."""

    def __init__(self, stack: Stack) -> None:
        """Take the logs."""
        self.stack = stack
        self._first = stack.starts()
        self._of_drive: dict[str, Array] | None = None

    def of(self, view: ChannelView, row: int, samples: Ints) -> Table:
        """Quantities at the samples of one row; none for channels whose samples are events or stamps."""
        joint, leg = int(view.row_joint[row]), int(view.row_leg[row])
        if view.name == Channel.SET_POINT_TO_LOAD:
            if self._of_drive is None:
                self._of_drive = _drive_signals(view.signals)
            table = {k: v[samples] if v.ndim == 1 else v[samples, row] for k, v in self._of_drive.items()}
            return tuple(table), np.stack(list(table.values()), axis=1)
        if view.name not in (
            Channel.LOAD_TO_MOTION,
            Channel.JOINT_RATES,
            Channel.BASE_WRENCH,
            Channel.STANCE_KINEMATICS,
            Channel.INERTIAL_UNIT,
        ):
            return (), np.zeros((len(samples), 0))
        at = self._first[view.run[samples]] + view.state[samples]
        table = {name: v[at, joint] for name, v in self._joint_signals.items()} if joint >= 0 else {}
        legs_joints = np.flatnonzero(view.leg_of_joint == leg) if leg >= 0 else np.zeros(0, dtype=np.intp)
        names = self.stack.recordings[0].joint_names
        for other in legs_joints[legs_joints != joint]:
            kind = names[other].rsplit("_", 1)[-1]
            table |= {f"{what} of {kind}": self._joint_signals[what][at, other] for what in ("position", "torque")}
        if joint < 0:
            table |= {name: values[at] for name, values in self._body_signals.items()}
        return tuple(table), np.stack(list(table.values()), axis=1)

    def _smooth(self, part: Callable[[Recording], Any]) -> Array:
        return self.stack.smooth(self.stack.filled(part))

    @cached_property
    def _joint_signals(self) -> dict[str, Array]:
        return {
            "position": self._smooth(lambda r: r.position_rad),
            "velocity": self._smooth(lambda r: r.velocity_rad_s),
            "torque": self._smooth(lambda r: r.load_nm),
            "acceleration": self.stack.rate(self.stack.filled(lambda r: r.velocity_rad_s)),
            "torque rate": self.stack.rate(self.stack.filled(lambda r: r.load_nm)),
        }

    @cached_property
    def _body_signals(self) -> dict[str, Array]:
        velocity = self._smooth(lambda r: r.linear_vel_of_body_in_odom_m_s)
        turn = self._smooth(lambda r: r.angular_vel_of_body_in_odom_rad_s)
        attitude = self.stack.filled(lambda r: r.odom_from_body_wxyz)
        attitude = np.where(np.abs(attitude).sum(axis=1, keepdims=True) > 0.5, attitude, [1.0, 0.0, 0.0, 0.0])
        lean = projected_gravity(attitude)
        return {
            "body speed": np.linalg.norm(velocity[:, :2], axis=1),
            "vertical velocity": velocity[:, 2],
            "turn rate": turn[:, 2],
            "roll rate": turn[:, 0],
            "pitch rate": turn[:, 1],
            "pitch": np.asarray(lean[..., 0]),
            "roll": np.asarray(lean[..., 1]),
            "total torque": np.abs(self._joint_signals["torque"]).sum(axis=1),
            "time since start": self.stack.state * self.stack.period_s,
        }


def _drive_signals(s: ActuatorSignals) -> dict[str, Array]:
    power = np.maximum(s.torque_nm * s.velocity_rad_s, 0.0).sum(axis=1)
    return {
        "position": s.position_rad[s.kept],
        "velocity": s.finish(s.velocity_rad_s),
        "torque": s.finish(s.torque_nm),
        "acceleration": s.finish_rate(s.velocity_rad_s),
        "torque rate": s.finish_rate(s.torque_nm),
        "total power": power[s.kept],
        "time since start": (s.stack.state * s.stack.period_s)[s.kept],
        "torque history": s.integrated(s.load_nm**2, HEAT_S)[s.kept],
        "time since set-point": np.minimum(s.command_age_s, LATEST_S)[s.kept],
    }
