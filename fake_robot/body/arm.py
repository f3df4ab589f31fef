"""The fake robot's arm: seven joints that follow their servos, apart from the simulated body.

What the arm weighs is on the body, in its stowed pose. Its joints move neither the body nor each other, and gravity
does not move them: each is a servo that turns the part of the arm behind it, and that friction holds without power.
"""

from __future__ import annotations

import numpy as np

from fake_robot.scenario.parts import SensorConfig
from spot_model.plant.command_channel import ServoCommand
from spot_model.robot.arm import (
    ARM_HIGH_RAD,
    ARM_KD_NM_S_PER_RAD,
    ARM_KP_NM_PER_RAD,
    ARM_LOW_RAD,
    ARM_TORQUE_LIMIT_NM,
    N_ARM_JOINTS,
)
from spot_model.robot.facts import Array

INERTIA_KG_M2 = np.array([0.5, 0.3, 0.12, 0.02, 0.03, 0.01, 0.005])
"""Of the joints with their motors; plausible, not identified."""


class Arm:
    """The joints of one arm; arrays of shape (7,)."""

    def __init__(self, position_rad: Array, sensors: SensorConfig, rng: np.random.Generator) -> None:
        self.position_rad = np.array(position_rad)
        self.velocity_rad_s = np.zeros(N_ARM_JOINTS)
        self.torque_nm = np.zeros(N_ARM_JOINTS)
        self._sigma = np.array([[sensors.position_rad], [sensors.velocity_rad_s], [sensors.load_nm]])
        self._rng = rng
        self._hold_rad = self.position_rad.copy()

    def step(self, legs: ServoCommand | None, command: ServoCommand | None, dt_s: float) -> None:
        """One physics step. Where what the legs follow is damped, or None for want of power, the arm is so, too.

        ``command`` is what joint control asks of the arm, arrays of shape (1, 7); without it, it is held where it is.
        """
        if legs is None:
            self.velocity_rad_s, self.torque_nm = np.zeros(N_ARM_JOINTS), np.zeros(N_ARM_JOINTS)
            self._hold_rad = self.position_rad
            return
        is_damped = not np.any(legs.kp_nm_per_rad)
        kp, kd = ARM_KP_NM_PER_RAD * (not is_damped), ARM_KD_NM_S_PER_RAD
        push = kp * (self._hold_rad - self.position_rad)
        if command is not None:
            kp, kd = np.asarray(command.kp_nm_per_rad)[0], np.asarray(command.kd_nm_s_per_rad)[0]
            push = kp * (command.position_rad[0] - self.position_rad)
            push = push + np.asarray(kd * command.velocity_rad_s + command.load_nm)[0]
        # Implicit in position and velocity, so that no gain makes it diverge.
        velocity = (INERTIA_KG_M2 * self.velocity_rad_s + dt_s * push) / (INERTIA_KG_M2 + dt_s * kd + dt_s * dt_s * kp)
        torque = INERTIA_KG_M2 * (velocity - self.velocity_rad_s) / dt_s
        self.torque_nm = np.clip(torque, -ARM_TORQUE_LIMIT_NM, ARM_TORQUE_LIMIT_NM)
        reached = self.position_rad + dt_s * (self.velocity_rad_s + dt_s * self.torque_nm / INERTIA_KG_M2)
        before, self.position_rad = self.position_rad, np.clip(reached, ARM_LOW_RAD, ARM_HIGH_RAD)
        self.velocity_rad_s = (self.position_rad - before) / dt_s
        if command is not None or is_damped:
            self._hold_rad = self.position_rad

    def report(self) -> Array:
        """Measured positions, velocities and loads, shape (3, 7)."""
        noise = self._rng.standard_normal((3, N_ARM_JOINTS)) * self._sigma
        return np.asarray(np.array([self.position_rad, self.velocity_rad_s, self.torque_nm]) + noise)
