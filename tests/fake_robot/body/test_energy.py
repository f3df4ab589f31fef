"""Battery and motors, by hand."""

from __future__ import annotations

import numpy as np
import pytest

from fake_robot.body.energy import Energy
from fake_robot.body.fault_effects import FaultEffects
from fake_robot.scenario.parts import BatteryConfig, MotorConfig

REST = np.zeros(12)


def run(energy: Energy, torque: np.ndarray, velocity: np.ndarray, seconds: float, dt_s: float = 0.003) -> None:
    for _ in range(round(seconds / dt_s)):
        energy.step(torque, velocity, dt_s, is_powered=True)


def test_idle_power_drains_what_it_takes():
    battery = BatteryConfig(charge_percent=50.0, energy_wh=100.0, idle_power_w=90.0, resistance_ohm=0.0)
    energy = Energy(battery, MotorConfig())
    for _ in range(1000):
        energy.step(REST, REST, 0.1, is_powered=False)
    # 90 W for 100 s of 100 Wh = 360 kJ: 2.5 %.
    assert energy.charge_percent == pytest.approx(47.5)


def test_power_is_shaft_and_copper_and_idle():
    motors = MotorConfig(hip_loss_w_per_nm2=0.05, knee_loss_w_per_nm2=0.02, regeneration_efficiency=0.5)
    battery = BatteryConfig(idle_power_w=100.0, motors_on_power_w=50.0)
    energy = Energy(battery, motors)
    torque, velocity = REST.copy(), REST.copy()
    torque[0], torque[2], velocity[0] = 10.0, 20.0, 3.0
    energy.step(torque, velocity, 0.003, is_powered=True)
    # 100 + 50 + 10·3 + 0.05·10² + 0.02·20²
    assert energy.power_w == pytest.approx(100 + 50 + 30 + 5 + 8)
    energy.step(torque, -velocity, 0.003, is_powered=True)
    assert energy.power_w == pytest.approx(100 + 50 - 15 + 5 + 8)


def test_voltage_sags_by_resistance_times_current():
    battery = BatteryConfig(charge_percent=100.0, resistance_ohm=0.1, idle_power_w=580.0, full_voltage_v=58.8)
    energy = Energy(battery, MotorConfig())
    for _ in range(400):
        energy.step(REST, REST, 0.003, is_powered=False)
    # I solves (V0 - R·I)·I = 580 W with V0 close to 58.8 V: 10.04 A.
    assert energy.current_a == pytest.approx(10.04, abs=0.02)
    assert energy.voltage_v == pytest.approx(58.8 - 0.1 * energy.current_a, abs=0.02)


def test_more_than_the_pack_can_give_is_a_finite_current():
    energy = Energy(BatteryConfig(resistance_ohm=2.0, idle_power_w=1000.0), MotorConfig())
    for _ in range(400):
        energy.step(REST, REST, 0.003, is_powered=False)
    assert 0.0 < energy.voltage_v < 30.0
    assert np.isfinite(energy.current_a)


def test_a_loaded_motor_warms_to_its_balance_and_the_others_cool():
    motors = MotorConfig(
        knee_loss_w_per_nm2=0.02,
        heat_capacity_j_per_k=10.0,
        thermal_resistance_k_per_w=1.0,
        ambient_c=20.0,
        start_temperature_c=30.0,
    )
    energy = Energy(BatteryConfig(), motors)
    torque = REST.copy()
    torque[2] = 30.0
    run(energy, torque, REST, 10.0, dt_s=0.01)
    # First order with 10 s: after 10 s 1 - 1/e of the way from 30 to 20 + 0.02·30²·1 = 38 °C, or to 20 °C.
    assert energy.motor_temperature_c[2] == pytest.approx(38 - 8 * np.exp(-1.0), abs=0.15)
    assert energy.motor_temperature_c[0] == pytest.approx(20 + 10 * np.exp(-1.0), abs=0.15)


def test_faults_change_what_is_shown_and_nothing_else():
    energy = Energy(BatteryConfig(charge_percent=80.0), MotorConfig())
    effects = FaultEffects(battery_percent=3.0, motor_temperature_c={"fl_kn": 120.0})
    assert energy.shown_percent(effects) == 3.0
    assert energy.charge_percent == pytest.approx(80.0)
    assert energy.shown_temperatures_c(effects)["fl_kn"] == 120.0
    assert energy.shown_temperatures_c(FaultEffects())["fl_kn"] == 30.0
