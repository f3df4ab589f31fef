"""Who relies on each signal: a doubt ends a run only where policy, hand-over or safety core read what is doubted."""

from __future__ import annotations

from collections.abc import Iterable
from enum import Enum
from typing import Final, NamedTuple

from spot_model.policy.observation import OBSERVATION
from spot_runtime.control.modes import Mode
from spot_runtime.stops import Stop


class Signal(Enum):
    """What a robot reports of itself. The values are the names of the state's fields."""

    POSITION = "position_rad"
    VELOCITY = "velocity_rad_s"
    ATTITUDE = "odom_from_body_wxyz"
    BODY_VELOCITY = "linear_vel_of_body_in_odom_m_s"
    TURN_RATE = "angular_vel_of_body_in_odom_rad_s"
    LOAD = "load_nm"
    CONTACTS = "foot_contact"
    INERTIAL_UNIT = "imu"


class Doubt(NamedTuple):
    """Something that cannot be true."""

    suspects: frozenset[Signal]
    """The signals of which at least one is wrong."""
    stop: Stop
    """What to do if any of them is relied on."""


READ_BY_CORE: Final = frozenset({Signal.POSITION, Signal.VELOCITY, Signal.ATTITUDE})
"""Joint stops and speeds, tilt and height of the body."""

READ_BY_HAND_OVER: Final = frozenset({Signal.LOAD})
"""The mean load becomes the feed-forward torque with which joint control begins."""

READ_FOR_OBSERVATION: Final = {field.name: frozenset(map(Signal, field.reads)) for field in OBSERVATION}
"""What each field of a policy's observation is made of."""


def relied_on(observation_fields: Iterable[str], mode: Mode) -> frozenset[Signal]:
    """The signals on which control relies in this mode, with a policy that observes these fields."""
    read = frozenset[Signal]().union(READ_BY_CORE, *(READ_FOR_OBSERVATION[name] for name in observation_fields))
    return read | READ_BY_HAND_OVER if mode in (Mode.READY, Mode.ACTIVATING) else read
