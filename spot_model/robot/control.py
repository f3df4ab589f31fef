"""The joint servo's law, as the robot computes it."""

from __future__ import annotations

from spot_model.robot.arrays import namespace_of
from spot_model.robot.rotation import AnyArray


def saturate_setpoint(position_rad: AnyArray, low_rad: AnyArray, high_rad: AnyArray) -> AnyArray:
    """Position set-points as the servo takes them: held within the joint's stops.

    Args:
        position_rad: Set-points. Shape (..., 12), canonical order, rad.
        low_rad: Lower stops, broadcastable, of the same array library.
        high_rad: Upper stops.

    Returns:
        Same shape, rad; a set-point within the stops comes back bit for bit.

    Source: Boston Dynamics SDK: set-points beyond a joint's limits saturate.
    """
    xp = namespace_of(position_rad)
    return xp.minimum(xp.maximum(position_rad, low_rad), high_rad)


def pd_torque(
    *,
    position_rad: AnyArray,
    velocity_rad_s: AnyArray,
    setpoint_position_rad: AnyArray,
    setpoint_velocity_rad_s: AnyArray | float,
    feedforward_nm: AnyArray | float,
    kp_nm_per_rad: AnyArray,
    kd_nm_s_per_rad: AnyArray,
) -> AnyArray:
    """Torque that the servo asks of the motor, before any limit.

    τ = kp·(q_set − q) + kd·(q̇_set − q̇) + τ_ff, element by element.

    Args:
        position_rad: Measured joint position. Shape (..., 12), canonical order, rad.
        velocity_rad_s: Measured joint velocity. Same shape, rad/s.
        setpoint_position_rad: Position set-point. Broadcastable to the same shape, rad.
        setpoint_velocity_rad_s: Velocity set-point. Broadcastable, rad/s.
        feedforward_nm: Feed-forward torque. Broadcastable, N·m.
        kp_nm_per_rad: Stiffness. Broadcastable, N·m/rad.
        kd_nm_s_per_rad: Damping. Broadcastable, N·m·s/rad.

    Returns:
        Torque, shape (..., 12), N·m.

    Source: Boston Dynamics SDK, JointCommand; with zero velocity and feed-forward set-points, the paper's control law.
    """
    return (
        kp_nm_per_rad * (setpoint_position_rad - position_rad)
        + kd_nm_s_per_rad * (setpoint_velocity_rad_s - velocity_rad_s)
        + feedforward_nm
    )
