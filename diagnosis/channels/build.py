"""All channels that a set of logs can feed."""

from __future__ import annotations

from collections.abc import Container, Sequence

import numpy as np

from diagnosis.channels import Channel, ChannelOff, ChannelView, thinned_views
from diagnosis.channels.actuator import ActuatorSignals, actuator_view, stand_in_view
from diagnosis.channels.body_model import BodyModel
from diagnosis.channels.contact_events import contact_view
from diagnosis.channels.dynamics import dynamics_signals, motion_views
from diagnosis.channels.kinematics import inertial_view, stance_view
from diagnosis.channels.program import Actor, replay_view, timing_view
from diagnosis.channels.sensors import noise_view, power_view, rate_view
from diagnosis.channels.stack import Stack
from diagnosis.read.robot_file import SPOT, RobotFile
from spot_model.effects.base import Effect
from spot_model.io.model_file import RobotModel
from spot_model.robot import facts
from trainer.signals.smoothing import too_coarse


def build_views(
    stack: Stack, model: RobotModel, *, policy: Actor | None = None, robot: RobotFile = SPOT
) -> tuple[dict[Channel, ChannelView], tuple[ChannelOff, ...]]:
    """Build every channel.

    Args:
        stack: The recordings.
        model: The nominal model.
        policy: The policy that ran, for its set-points; without it the logs' contracts give them.
        robot: That the recordings are of, for its joint stops.

    Returns:
        The channels that are on, by name in the order of ``Channel``, and those that are off with their reasons.
    """
    effects, lacks = model.effects, lacking(stack)
    limits_rad = robot.limits_rad if robot.joint_names == stack.joint_names else None
    found: list[ChannelView | ChannelOff] = [ChannelOff(name, reason) for name, reason in lacks.items()]
    drive: ActuatorSignals | None = None
    if Channel.SET_POINT_TO_LOAD not in lacks:
        actuator = actuator_view(stack, effects, limits_rad)
        drive = actuator.signals
        found.append(actuator)
    lag_s = drive.lag_s if drive else 0.0
    found += [replay_view(stack, policy), timing_view(stack, effects)]
    if Channel.SENSOR_NOISE not in lacks:
        found.append(noise_view(stack, drive))
    if Channel.JOINT_RATES not in lacks:
        found.append(rate_view(stack, 0.5 * lag_s))
    if Channel.INERTIAL_UNIT not in lacks:
        found.append(inertial_view(stack))
    if Channel.BATTERY_POWER not in lacks:
        found.append(power_view(stack))
    if stack.joint_names == facts.JOINT_NAMES:
        found += _body_views(stack, effects, lacks, lag_s)
    by_name = {view.name: view for view in found}
    on = {name: view for name in Channel if isinstance(view := by_name[name], ChannelView)}
    off = tuple(view for name in Channel if isinstance(view := by_name[name], ChannelOff))
    return thinned_views(on, stack.n), off


def _body_views(
    stack: Stack, effects: Sequence[Effect], lacks: Container[Channel], lag_s: float
) -> list[ChannelView | ChannelOff]:
    """Channels of Spot's body and feet; ``lag_s`` is the load's."""
    found: list[ChannelView | ChannelOff] = []
    dynamics, model = None, BodyModel(effects)
    if Channel.BASE_WRENCH not in lacks:
        dynamics = dynamics_signals(stack, model, None if stack.has("load_nm") else stand_in_view(stack, effects))
        found += motion_views(dynamics, lag_s)
    if Channel.STANCE_KINEMATICS not in lacks:
        stance = stance_view(stack, model, dynamics)
        found.append(stance)
        if dynamics and Channel.CONTACT_EVENTS not in lacks:
            found.append(contact_view(dynamics, stance))
    return found


def lacking(stack: Stack) -> dict[Channel, str]:
    """Channels that signals are missing for, and what is missing; of others the signals may still say too little."""
    no_model = "" if stack.joint_names == facts.JOINT_NAMES else "no body model of this robot"
    coarse, no_torque = too_coarse(stack.period_s), "no joint torques or velocities"
    joints = {"position_rad": "no joint positions", "velocity_rad_s": "no joint velocities"}
    attitude, velocity = {"odom_from_body_wxyz": "no attitude"}, {"linear_vel_of_body_in_odom_m_s": "no body velocity"}
    turn, flags = {"angular_vel_of_body_in_odom_rad_s": "no turn rate"}, {"foot_contact": "no contact flags"}
    body = no_model or coarse or stack.missing({**joints, **attitude, **turn})
    if not body and stack.missing(velocity) and not stack.has("imu.acceleration_m_s2"):
        body = "neither the body's velocity nor an inertial unit"
    if not body and not stack.has("load_nm"):
        has_gains = all(np.isfinite(r.commands.kp_nm_per_rad).any() for r in stack.recordings)
        body = "" if has_gains else "no joint torques, nor commands with gains from which the servo law has them"
    # Without flags, the feet's forces say which stand.
    stance = no_model or stack.missing({**joints, **(flags if body else {}), **attitude, **velocity, **turn})
    drive = {"load_nm": "torque", "position_rad": "position", "velocity_rad_s": "velocity"}
    measured = {signal: f"no measured joint {name}" for signal, name in drive.items()}
    rates = {"position_rad": "no measured joint positions", "velocity_rad_s": "no measured joint velocities"}
    has_commands = all(len(r.commands) for r in stack.recordings)
    has_battery = all(len(r.slow_states) for r in stack.recordings)
    told = {
        Channel.SENSOR_NOISE: stack.missing({"position_rad": rates["position_rad"]}),
        Channel.JOINT_RATES: stack.missing(rates),
        Channel.SET_POINT_TO_LOAD: stack.missing(measured) or ("" if has_commands else "no commands"),
        Channel.LOAD_TO_MOTION: body,
        Channel.BASE_WRENCH: body,
        Channel.CONTACT_EVENTS: body or (f"{Channel.STANCE_KINEMATICS} is off" if stance else stack.missing(flags)),
        Channel.STANCE_KINEMATICS: stance,
        Channel.INERTIAL_UNIT: coarse
        or stack.missing({"imu.acceleration_m_s2": "no inertial unit", **attitude, **velocity}),
        Channel.BATTERY_POWER: stack.missing({"load_nm": no_torque, "velocity_rad_s": no_torque})
        if has_battery
        else "no battery record",
    }
    return {name: why for name, why in told.items() if why}
