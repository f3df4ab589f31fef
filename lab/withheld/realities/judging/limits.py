"""Limits: current, lever, winding, heat, bus power and bus voltage."""

from __future__ import annotations

from typing import Final

import numpy as np

from spot_model.robot.facts import JOINT_NAMES, KNEE_MOTOR_TORQUE_NM, Array, per_joint
from withheld.realities.fault_kind import BODY, JOINT_PLACES, Ask, FaultKind, Parameters, at
from withheld.simulator.parameters import HIP_NO_LOAD_RAD_S
from withheld.simulator.robot import Motion, Robot

KNEES: Final = tuple(j for j in JOINT_NAMES if j.endswith("kn"))
FLEXING: Final = tuple(j for j in JOINT_NAMES if not j.endswith("hx"))
HIGHEST_NM: Final[Array] = per_joint(40.0, 40.0, 90.0)
LOWEST_NM: Final[Array] = per_joint(12.0, 16.0, 28.0)
LEVER_LOSS: Final = 0.7
SLOWEST_RAD_S: Final[Array] = per_joint(3.0, 5.0, 7.0)
WARM_C: Final = 60.0
"""From here on magnets lose flux."""
MAGNET_LOSS_PER_K: Final = 0.03
POWER_W: Final = (2000.0, 400.0)
"""Bound of the bus at size 0 and 1."""
COPPER_W_PER_NM2: Final = 0.03
CABLE_OHM: Final = 0.9


def current(robot: Robot, ask: Ask) -> Parameters:
    """A hard current limit, from just under the rated torque down to what a walk needs."""
    limit = HIGHEST_NM + ask.size * (LOWEST_NM - HIGHEST_NM)

    d = robot.drive
    d.current_high_nm = np.where(ask.joints, np.minimum(d.current_high_nm, limit), d.current_high_nm)
    d.current_low_nm = np.where(ask.joints, np.maximum(d.current_low_nm, -limit), d.current_low_nm)

    chosen = limit[ask.joints]
    return {"torque_limit.limit_nm": float(chosen[0])} if np.ptp(chosen) == 0.0 else {}


def lever(robot: Robot, ask: Ask) -> Parameters:
    """A knee's linkage that slips before the published torque."""
    share = 1.0 - ask.size * LEVER_LOSS

    robot.drive.lever_share = np.where(ask.joints, robot.drive.lever_share * share, robot.drive.lever_share)
    return {"position_torque_limit.motor_torque_nm": KNEE_MOTOR_TORQUE_NM * share}


def winding(robot: Robot, ask: Ask) -> Parameters:
    """A motor wound for more volts than it gets."""
    d = robot.drive
    for name in ("no_load_high_rad_s", "no_load_low_rad_s"):
        now = getattr(d, name)
        setattr(d, name, np.where(ask.joints, now * np.abs(SLOWEST_RAD_S / now) ** ask.size, now))

    chosen = SLOWEST_RAD_S[ask.joints]
    if np.ptp(chosen) > 0.0:
        return {}
    rated = 25.03 if ask.joints[2::3].any() else HIP_NO_LOAD_RAD_S
    speed = rated * (float(chosen[0]) / rated) ** ask.size
    return {"torque_speed_curve.speed_max_rad_s": speed, "torque_speed_curve.speed_min_rad_s": -speed}


def magnets(robot: Robot, ask: Ask) -> Parameters:
    """Magnets that lose flux as their winding, which sheds its heat badly, grows hotter."""
    t = robot.thermal
    t.start_c = np.where(ask.joints, WARM_C, t.start_c)
    t.winding_j_per_k = np.where(ask.joints, 10.0, t.winding_j_per_k)
    t.winding_to_housing_k_per_w = np.where(ask.joints, 3.0, t.winding_to_housing_k_per_w)
    t.magnet_loss_per_k = t.magnet_loss_per_k + at(ask.joints, ask.size * MAGNET_LOSS_PER_K)
    return {}


class SteppedBudget:
    """A supervisor that takes a step off every driving motor's share while the bus draws too much, then gives back."""

    PERIOD_S, DOWN, UP, LEAST = 1.0e-3, 0.02, 0.01, 0.1

    def __init__(self, power_w: float) -> None:
        self._power_w = power_w
        self._share: Array = np.ones((1, 1))
        self._energy_j: Array = np.zeros((1, 1))
        self._time_s = 0.0

    def start(self, n_runs: int) -> None:
        """Nothing is held back yet."""
        self._share, self._energy_j, self._time_s = np.ones((n_runs, 1)), np.zeros((n_runs, 1)), 0.0

    def act(self, torque_nm: Array, motion: Motion) -> Array:
        """The torque that the budget allows."""
        driving = torque_nm * motion.rotor_rad_s > 0.0
        out = np.where(driving, self._share * torque_nm, torque_nm)
        drawn = np.where(driving, out * motion.rotor_rad_s, 0.0) + COPPER_W_PER_NM2 * out**2
        self._energy_j = self._energy_j + motion.dt_s * np.sum(drawn, axis=1, keepdims=True)
        self._time_s += motion.dt_s
        if self._time_s >= self.PERIOD_S:
            is_over = self._energy_j > self._power_w * self._time_s
            self._share = np.clip(self._share + np.where(is_over, -self.DOWN, self.UP), self.LEAST, 1.0)
            self._energy_j, self._time_s = np.zeros_like(self._energy_j), 0.0
        return np.asarray(out)


def budget(robot: Robot, ask: Ask) -> Parameters:
    """A budget for the power of all motors together."""
    power = POWER_W[0] * (POWER_W[1] / POWER_W[0]) ** ask.size
    robot.motors.append(SteppedBudget(power))
    return {"power_limit.power_w": power, "power_limit.copper_w_per_nm2": COPPER_W_PER_NM2}


def cable(robot: Robot, ask: Ask) -> Parameters:
    """A corroded cable: the bus falls with the current, and with it the speed at which each drive gives out."""
    more_ohm = ask.size * CABLE_OHM

    robot.supply.resistance_ohm += more_ohm
    return {"bus_sag.resistance_ohm": more_ohm}


KINDS: Final = (
    FaultKind("current_limit", "limits", ("torque_limit",), JOINT_PLACES, current),
    FaultKind("slipping_lever", "limits", ("position_torque_limit",), ("joint", "type"), lever, KNEES),
    FaultKind("slow_winding", "limits", ("torque_speed_curve",), ("joint", "type"), winding, FLEXING),
    FaultKind("warm_magnets", "thermal", ("thermal_derating",), JOINT_PLACES, magnets),
    FaultKind("power_budget", "supply", ("power_limit",), BODY, budget),
    FaultKind("corroded_cable", "supply", ("bus_sag",), BODY, cable),
)
