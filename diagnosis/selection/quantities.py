"""What a residual may depend on, channel by channel: the features that trees look at, with names for people."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Ints
from diagnosis.channels.stack import Stack
from diagnosis.read.recording import Recording
from spot_model.robot.rotation import projected_gravity

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
        self._kept: dict[str, Array] = {}

    def of(self, view: ChannelView, row: int, samples: Ints) -> Table:
        """Quantities at the samples of one row; none for channels whose samples are events or stamps."""
        if view.name == Channel.SET_POINT_TO_LOAD:
            return self._actuator(view, row, samples)
        if view.name not in (
            Channel.LOAD_TO_MOTION,
            Channel.JOINT_RATES,
            Channel.BASE_WRENCH,
            Channel.STANCE_KINEMATICS,
            Channel.INERTIAL_UNIT,
        ):
            return (), np.zeros((len(samples), 0))
        at = self._first[view.run[samples]] + view.state[samples]
        joint, leg = int(view.row_joint[row]), int(view.row_leg[row])
        table: dict[str, Array] = {}
        if joint >= 0:
            for name, values in self._joint_signals().items():
                table[name] = values[at, joint]
        legs_joints = np.flatnonzero(view.leg_of_joint == leg) if leg >= 0 else np.zeros(0, dtype=np.intp)
        names = self.stack.recordings[0].joint_names
        for other in legs_joints[legs_joints != joint]:
            kind = names[other].rsplit("_", 1)[-1]
            table[f"position of {kind}"] = self._joint_signals()["position"][at, other]
            table[f"torque of {kind}"] = self._joint_signals()["torque"][at, other]
        if joint < 0:
            for name, values in self._body_signals().items():
                table[name] = values[at]
        return tuple(table), np.stack(list(table.values()), axis=1)

    def _signal(self, name: str, part: Callable[[Recording], Any]) -> Array:
        if name not in self._kept:
            self._kept[name] = self.stack.smooth(self.stack.filled(part))
        return self._kept[name]

    def _joint_signals(self) -> dict[str, Array]:
        velocity = self._signal("velocity", lambda r: r.velocity_rad_s)
        if "acceleration" not in self._kept:
            self._kept["acceleration"] = self.stack.rate(self.stack.filled(lambda r: r.velocity_rad_s))
            self._kept["torque rate"] = self.stack.rate(self.stack.filled(lambda r: r.load_nm))
        return {
            "position": self._signal("position", lambda r: r.position_rad),
            "velocity": velocity,
            "torque": self._signal("torque", lambda r: r.load_nm),
            "acceleration": self._kept["acceleration"],
            "torque rate": self._kept["torque rate"],
        }

    def _body_signals(self) -> dict[str, Array]:
        velocity = self._signal("body velocity", lambda r: r.linear_vel_of_body_in_odom_m_s)
        turn = self._signal("turn", lambda r: r.angular_vel_of_body_in_odom_rad_s)
        attitude = self.stack.filled(lambda r: r.odom_from_body_wxyz)
        attitude = np.where(np.abs(attitude).sum(axis=1, keepdims=True) > 0.5, attitude, [1.0, 0.0, 0.0, 0.0])
        lean = projected_gravity(attitude)
        torque = self._signal("torque", lambda r: r.load_nm)
        return {
            "body speed": np.linalg.norm(velocity[:, :2], axis=1),
            "vertical velocity": velocity[:, 2],
            "turn rate": turn[:, 2],
            "roll rate": turn[:, 0],
            "pitch rate": turn[:, 1],
            "pitch": np.asarray(lean[..., 0]),
            "roll": np.asarray(lean[..., 1]),
            "total torque": np.abs(torque).sum(axis=1),
            "time since start": self.stack.state * self.stack.period_s,
        }

    def _actuator(self, view: ChannelView, row: int, samples: Ints) -> Table:
        s: Any = view.signals
        kept = self._kept

        def thin(name: str, make: Callable[[], Array]) -> Array:
            if "A " + name not in kept:
                kept["A " + name] = make()
            return kept["A " + name]

        power = thin("power", lambda: np.maximum(s.torque_nm * s.velocity_rad_s, 0.0).sum(axis=1)[s.kept])
        table = {
            "position": s.position_rad[s.kept][samples, row],
            "velocity": thin("velocity", lambda: s.finish(s.velocity_rad_s))[samples, row],
            "torque": thin("torque", lambda: s.finish(s.torque_nm))[samples, row],
            "acceleration": thin("acceleration", lambda: s.finish_rate(s.velocity_rad_s))[samples, row],
            "torque rate": thin("rate", lambda: s.finish_rate(s.torque_nm))[samples, row],
            "total power": power[samples],
            "time since start": (s.stack.state * s.stack.period_s)[s.kept][samples],
            "torque history": thin("heat", lambda: s.integrated(s.load_nm**2, HEAT_S)[s.kept])[samples, row],
            "time since set-point": np.minimum(s.command_age_s, LATEST_S)[s.kept][samples],
        }
        return tuple(table), np.stack(list(table.values()), axis=1)
