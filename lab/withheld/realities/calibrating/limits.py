"""Drives that hold less than they should, motors that lose torque as they heat, and a supply that cannot feed all."""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_model.robot.facts import Array, per_joint
from withheld.realities.fault_kind import BODY, JOINT_PLACES, Ask, FaultKind, Parameters
from withheld.simulator.robot import Motion, Robot

LARGEST_NM: Array = per_joint(42.0, 42.0, 95.0)
SMALLEST_NM: Array = per_joint(14.0, 18.0, 32.0)
SOFTNESS = 0.12
HOT_C = 88.0
WINDING_J_PER_K = 9.0
DERATE_OVER_K = 45.0


def soft_limit(robot: Robot, ask: Ask) -> Parameters:
    """A current limit with a soft knee, from just under the rated torque down to what a walk needs."""
    limit = LARGEST_NM + ask.size * (SMALLEST_NM - LARGEST_NM)

    d = robot.drive
    d.current_high_nm = np.where(ask.joints, np.minimum(d.current_high_nm, limit), d.current_high_nm)
    d.current_low_nm = np.where(ask.joints, np.maximum(d.current_low_nm, -limit), d.current_low_nm)
    d.limit_softness = np.where(ask.joints, SOFTNESS, d.limit_softness)

    chosen = limit[ask.joints]
    one = ask.size > 0.0 and float(np.ptp(chosen)) == 0.0
    return {"torque_limit.limit_nm": float(chosen[0])} if one else {}


def hot_motors(robot: Robot, ask: Ask) -> Parameters:
    """A winding that loses its heat badly: it starts near where the drive derates, and a gait takes it beyond."""
    start = HOT_C + float(ask.rng.uniform(-2.0, 0.0))

    t = robot.thermal
    t.start_c = np.where(ask.joints, start, t.start_c)
    # A larger fault is a smaller mass of copper that takes the heat.
    t.winding_j_per_k = np.where(ask.joints, WINDING_J_PER_K / ask.size, t.winding_j_per_k)
    t.winding_to_housing_k_per_w = np.where(ask.joints, 4.0, t.winding_to_housing_k_per_w)
    t.derate_from_c = np.where(ask.joints, HOT_C, t.derate_from_c)
    t.derate_over_k = np.where(ask.joints, DERATE_OVER_K, t.derate_over_k)
    return {}


LARGEST_W = 1900.0
SMALLEST_W = 420.0
WORST_OHM = 0.45
LOW_CHARGE = 0.2
MARGINAL_HIP, MARGINAL_KNEE = 0.2, 0.38
"""No-load speeds over the rated ones of drives that need all volts of a full pack."""


def bus_limit(robot: Robot, ask: Ask) -> Parameters:
    """A limiter of the bus current that turns all motors down together, as quick as its regulator."""
    power = LARGEST_W * (SMALLEST_W / LARGEST_W) ** ask.size
    copper = 0.03

    robot.motors.append(_BusLimiter(power, copper))
    return {"power_limit.power_w": power, "power_limit.copper_w_per_nm2": copper}


class _BusLimiter:
    """A PI regulator on the bus current's excess: every driving motor gets the same share of its torque."""

    FILTER_S = 1.0e-3
    INTEGRAL_PER_S = 700.0
    RELEASE_PER_S = 120.0
    LEAST = 0.1

    def __init__(self, power_w: float, copper_w_per_nm2: float) -> None:
        self._power_w, self._copper = power_w, copper_w_per_nm2
        self._share: Array = np.ones((1, 1))
        self._drawn_w: Array = np.zeros((1, 1))

    def start(self, n_runs: int) -> None:
        """Nothing is held back yet."""
        self._share, self._drawn_w = np.ones((n_runs, 1)), np.zeros((n_runs, 1))

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """The torque that the bus lets the motors have."""
        driving = torque_nm * motion.rotor_rad_s > 0.0
        out = np.where(driving, self._share * torque_nm, torque_nm)
        shaft = np.where(driving, out * motion.rotor_rad_s, 0.0)
        drawn = np.sum(shaft + self._copper * np.square(out), axis=1, keepdims=True)
        self._drawn_w = self._drawn_w + min(1.0, motion.dt_s / self.FILTER_S) * (drawn - self._drawn_w)
        excess = (self._drawn_w - self._power_w) / self._power_w
        rate = np.where(excess > 0.0, self.INTEGRAL_PER_S, self.RELEASE_PER_S)
        self._share = np.clip(self._share - motion.dt_s * rate * excess, self.LEAST, 1.0)
        return np.asarray(out)


def tired_battery(robot: Robot, ask: Ask) -> Parameters:
    """Old cells, nearly empty, and drives wound for all volts of full ones: resistance takes what fast joints need.

    The drives' own no-load speeds fall with it, so a torque-speed curve is a right answer too.
    """
    more_ohm = ask.size * WORST_OHM

    s, d = robot.supply, robot.drive
    s.resistance_ohm += more_ohm
    s.slow_resistance_ohm += 0.4 * more_ohm
    s.charge = s.charge + min(1.0, 2.0 * ask.size) * (LOW_CHARGE - s.charge)
    # Such a pack shows where motors need all of its volts.
    marginal = per_joint(MARGINAL_HIP, MARGINAL_HIP, MARGINAL_KNEE) ** ask.size
    d.no_load_high_rad_s = d.no_load_high_rad_s * marginal
    d.no_load_low_rad_s = d.no_load_low_rad_s * marginal
    return {"bus_sag.resistance_ohm": more_ohm}


KINDS: Final = (
    FaultKind("soft_current_limit", "limits", ("torque_limit",), JOINT_PLACES, soft_limit),
    FaultKind("hot_motors", "thermal", ("thermal_derating",), JOINT_PLACES, hot_motors),
    FaultKind("bus_current_limiter", "supply", ("power_limit",), BODY, bus_limit),
    FaultKind("tired_battery", "supply", ("bus_sag", "torque_speed_curve"), BODY, tired_battery),
)
