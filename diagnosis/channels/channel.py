"""The channels: ways to look at a log in which the nominal model predicts zero up to noise."""

from __future__ import annotations

import enum
from collections.abc import Mapping
from typing import Final


class Channel(enum.StrEnum):
    """Channels in the order in which they are looked at; the value is the name in files."""

    POLICY_REPLAY = "policy_replay"
    TIME_STAMPS = "time_stamps"
    SENSOR_NOISE = "sensor_noise"
    JOINT_RATES = "joint_rates"
    SET_POINT_TO_LOAD = "set_point_to_load"
    LOAD_TO_MOTION = "load_to_motion"
    BASE_WRENCH = "base_wrench"
    CONTACT_EVENTS = "contact_events"
    STANCE_KINEMATICS = "stance_kinematics"
    INERTIAL_UNIT = "inertial_unit"
    BATTERY_POWER = "battery_power"


CHANNEL_TITLES: Final[Mapping[str, str]] = {
    Channel.POLICY_REPLAY: "policy replay",
    Channel.TIME_STAMPS: "time stamps of commands",
    Channel.SENSOR_NOISE: "noise of the joint sensors",
    Channel.JOINT_RATES: "joint velocities against positions",
    Channel.SET_POINT_TO_LOAD: "set-point to load",
    Channel.LOAD_TO_MOTION: "load to motion of swinging legs",
    Channel.BASE_WRENCH: "base motion against the loads of all legs",
    Channel.CONTACT_EVENTS: "contact flags and slips against the legs' forces",
    Channel.STANCE_KINEMATICS: "kinematics of standing feet",
    Channel.INERTIAL_UNIT: "inertial unit against the estimator",
    Channel.BATTERY_POWER: "battery power and voltage",
}
"""For a person; by the name that a file holds."""
