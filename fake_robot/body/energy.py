"""Battery and motors: where the power goes, what it does to voltage and temperature. First-order, plausible."""

from __future__ import annotations

import math

import numpy as np

from fake_robot.body.fault_effects import FaultEffects
from fake_robot.scenario.parts import BatteryConfig, MotorConfig
from spot_model.robot import facts
from spot_model.robot.facts import Array

_J_PER_WH = 3600.0
_AVERAGE_S = 0.05
"""Voltage and current are reported as running means over about this time."""


class Energy:
    """Charge, voltage, current and twelve motor temperatures, moved on once a state message."""

    def __init__(self, battery: BatteryConfig, motors: MotorConfig) -> None:
        self._battery, self._motors = battery, motors
        self._loss = facts.per_joint(motors.hip_loss_w_per_nm2, motors.hip_loss_w_per_nm2, motors.knee_loss_w_per_nm2)
        self.energy_j = battery.charge_percent / 100.0 * battery.energy_wh * _J_PER_WH
        self.current_a = 0.0
        """Drawn from the battery, positive while it discharges."""
        self.voltage_v = self._open_voltage_v()
        self.motor_temperature_c: Array = np.full(facts.N_JOINTS, motors.start_temperature_c)
        self.power_w = 0.0
        self._squares: Array = np.zeros(facts.N_JOINTS)
        self._n_steps = 0

    def step(self, torque_nm: Array, velocity_rad_s: Array, dt_s: float, *, is_powered: bool) -> None:
        """Let ``dt_s`` pass at these motor torques and joint velocities, each of shape (12,)."""
        battery, motors = self._battery, self._motors
        power = battery.idle_power_w
        if is_powered:
            squares = torque_nm * torque_nm
            shaft = float(torque_nm @ velocity_rad_s)
            mechanical = shaft if shaft > 0.0 else motors.regeneration_efficiency * shaft
            power += battery.motors_on_power_w + mechanical + float(self._loss @ squares)
            self._squares += squares
        self._n_steps += 1
        if self._n_steps == 32:
            self._heat(dt_s)
        self.power_w = power
        self._discharge(power, dt_s)

    @property
    def charge_percent(self) -> float:
        """State of charge, 0 to 100."""
        return 100.0 * self.energy_j / (self._battery.energy_wh * _J_PER_WH)

    def shown_percent(self, effects: FaultEffects) -> float:
        """State of charge as reported, faults included."""
        return self.charge_percent if effects.battery_percent is None else effects.battery_percent

    def shown_temperatures_c(self, effects: FaultEffects) -> dict[str, float]:
        """Motor temperatures by joint as reported, faults included."""
        shown = dict(zip(facts.JOINT_NAMES, self.motor_temperature_c.tolist(), strict=True))
        return {**shown, **effects.motor_temperature_c}

    def runtime_s(self) -> float:
        """How long the charge lasts at the present power."""
        return self.energy_j / max(self.power_w, 1.0)

    def _open_voltage_v(self) -> float:
        share = min(max(self.charge_percent / 100.0, 0.0), 1.0)
        battery = self._battery
        return battery.empty_voltage_v + share * (battery.full_voltage_v - battery.empty_voltage_v)

    def _heat(self, dt_s: float) -> None:
        """Warm the motors by the losses of the last steps; they change far more slowly than a step."""
        motors, n = self._motors, self._n_steps
        loss_w = self._loss * self._squares / n
        cooling_w = (self.motor_temperature_c - motors.ambient_c) / motors.thermal_resistance_k_per_w
        self.motor_temperature_c = self.motor_temperature_c + (
            n * dt_s / motors.heat_capacity_j_per_k * (loss_w - cooling_w)
        )
        self._squares[:] = 0.0
        self._n_steps = 0

    def _discharge(self, power_w: float, dt_s: float) -> None:
        """Current from P = (V0 − R·I)·I; at more than the pack can give, the current of greatest power."""
        open_v, r = self._open_voltage_v(), self._battery.resistance_ohm
        if r > 0.0:
            root = open_v * open_v - 4.0 * r * power_w
            current = (open_v - math.sqrt(root)) / (2.0 * r) if root > 0.0 else open_v / (2.0 * r)
        else:
            current = power_w / open_v
        share = min(1.0, dt_s / _AVERAGE_S)
        self.current_a += share * (current - self.current_a)
        self.voltage_v = open_v - r * self.current_a
        full_j = self._battery.energy_wh * _J_PER_WH
        self.energy_j = min(max(self.energy_j - open_v * current * dt_s, 0.0), full_j)
