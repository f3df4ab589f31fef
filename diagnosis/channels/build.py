"""All channels that a set of logs can feed."""

from __future__ import annotations

import numpy as np

from diagnosis.channels import Array, Channel, ChannelOff, ChannelView, thinned_views
from diagnosis.channels.actuator import ActuatorSignals, actuator_view, stand_in_view
from diagnosis.channels.contact_events import contact_view
from diagnosis.channels.dynamics import dynamics_signals, missing_for_dynamics, motion_views
from diagnosis.channels.kinematics import inertial_view, stance_view
from diagnosis.channels.program import Actor, replay_view, timing_view
from diagnosis.channels.sensors import noise_view, power_view, rate_view
from diagnosis.channels.stack import Stack
from spot_model.io.model_file import RobotModel
from spot_model.robot import facts


def build_views(
    stack: Stack, model: RobotModel, *, policy: Actor | None = None, limits_rad: tuple[Array, Array] | None = None
) -> tuple[dict[Channel, ChannelView], tuple[ChannelOff, ...]]:
    """Build every channel.

    Args:
        stack: The recordings.
        model: The nominal model.
        policy: The policy that ran, for its set-points; without it the logs' contracts give them.
        limits_rad: Joint stops of a robot other than Spot, low and high; Spot's are known.

    Returns:
        The channels that are on, by name in the order of ``Channel``, and those that are off with their reasons.
    """
    effects = model.effects
    if limits_rad is None and stack.joint_names == facts.JOINT_NAMES:
        limits_rad = (facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
    actuator = actuator_view(stack, effects, limits_rad)
    drive: ActuatorSignals | None = actuator.signals if isinstance(actuator, ChannelView) else None
    lag_s = drive.lag_s if drive else 0.0
    found: list[ChannelView | ChannelOff] = [
        replay_view(stack, policy),
        timing_view(stack, effects),
        noise_view(stack, drive),
        rate_view(stack, 0.5 * lag_s),
        actuator,
        inertial_view(stack),
        power_view(stack),
    ]
    missing = missing_for_dynamics(stack)
    dynamics = None
    if not missing:
        has_loads = stack.has("load_nm")
        has_gains = all(np.isfinite(r.commands.kp_nm_per_rad).any() for r in stack.recordings)
        if has_loads or has_gains:
            dynamics = dynamics_signals(stack, effects, None if has_loads else stand_in_view(stack, effects))
        else:
            missing = "no joint torques, nor commands with gains from which the servo law has them"
    stance = stance_view(stack, effects, dynamics)
    found.append(stance)
    if dynamics is None:
        found += [
            ChannelOff(name, missing) for name in (Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH, Channel.CONTACT_EVENTS)
        ]
    else:
        found += motion_views(dynamics, lag_s)
        if isinstance(stance, ChannelView):
            found.append(contact_view(dynamics, stance.signals))
        else:
            found.append(ChannelOff(Channel.CONTACT_EVENTS, f"{Channel.STANCE_KINEMATICS} is off"))
    by_name = {view.name: view for view in found}
    on = {name: view for name in Channel if isinstance(view := by_name[name], ChannelView)}
    off = tuple(view for name in Channel if isinstance(view := by_name[name], ChannelOff))
    return thinned_views(on, stack.n), off
