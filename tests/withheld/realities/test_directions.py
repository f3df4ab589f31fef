"""Each fault moves the log in the direction that its physics says."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import pytest

from spot_model.robot.facts import Array
from spot_model.robot.rotation import matrix_from_wxyz
from tests.withheld.realities.quick import QUICK, faulty, healthy, policy, request
from withheld.plan import Fault
from withheld.realities.calibrating.catalogue import CATALOGUE
from withheld.realities.reality import make
from withheld.simulator.recording.run_arrays import RunArrays
from withheld.simulator.recording.transport import NEVER_NS

FIRST: Final = round((QUICK.ramp_s + 0.03) / 0.003)
"""State from which the policy alone walks."""


def asked_nm(run: RunArrays) -> Array:
    """The servo law by what the log says, (m, 12)."""
    gains = policy().gains()
    setpoint = run.setpoint_rad[np.maximum(run.echoed, 0)]
    return gains.kp_nm_per_rad * (setpoint - run.position_rad) - gains.kd_nm_s_per_rad * run.velocity_rad_s


def drag_nm(run: RunArrays) -> float:
    """What is lost against the direction of motion, on average over joints that move."""
    lost = (asked_nm(run) - run.load_nm)[FIRST:] * np.sign(run.velocity_rad_s[FIRST:])
    return float(np.mean(lost[np.abs(run.velocity_rad_s[FIRST:]) > 0.3]))


def gain(run: RunArrays) -> float:
    """Load over what is asked, least squares."""
    asked, load = asked_nm(run)[FIRST:], run.load_nm[FIRST:]
    return float(np.sum(asked * load) / np.sum(asked * asked))


def inertia(run: RunArrays) -> float:
    """What is lost to acceleration, kg·m²."""
    rate = np.gradient(run.velocity_rad_s, 0.003, axis=0)[FIRST:]
    return float(np.sum((asked_nm(run) - run.load_nm)[FIRST:] * rate) / np.sum(rate * rate))


def lag(run: RunArrays) -> float:
    """How much less the motors give while more is asked of them."""
    rate = np.gradient(asked_nm(run), 0.003, axis=0)[FIRST:]
    return float(np.sum((asked_nm(run) - run.motor_nm)[FIRST:] * rate) / np.sum(rate * rate))


def delays_s(run: RunArrays) -> Array:
    arrived = run.arrival_ns < NEVER_NS
    return np.asarray((run.arrival_ns - 3_000_000 * np.arange(len(run.arrival_ns)))[arrived] * 1e-9)


def jaggedness(values: Array) -> float:
    return float(np.median(np.abs(np.diff(values[FIRST:], n=4, axis=0))))


def upright(run: RunArrays) -> Array:
    """Vertical in the body's frame by the estimator, mean, shape (3,)."""
    return np.asarray(np.mean(matrix_from_wxyz(run.odom_from_body_wxyz)[:60, 2, :], axis=0))


def rates_lag(run: RunArrays) -> float:
    """Correlation of the reported rate's error with the acceleration: minus the delay."""
    true = np.gradient(run.true_position_rad, 0.003, axis=0)
    rate = np.gradient(true, 0.003, axis=0)[FIRST:]
    return float(-np.sum((run.velocity_rad_s - true)[FIRST:] * rate) / np.sum(rate * rate))


def stance_load(run: RunArrays) -> float:
    """Mean size of the knees' load in the first moments of the stand."""
    return float(np.mean(np.abs(run.load_nm[:60, 2::3])))


def fore_aft(run: RunArrays) -> float:
    """Load of the front legs' knees over the hind ones'."""
    knees = np.abs(run.load_nm[:60, 2::3]).mean(axis=0)
    return float(np.sum(knees[:2]) / np.sum(knees[2:]))


def most_nm(run: RunArrays, kind: int) -> float:
    return float(np.quantile(np.abs(run.motor_nm[FIRST:, kind::3]), 0.995))


def wind_up(run: RunArrays) -> float:
    """How far encoders are from links, beyond offsets."""
    return float(np.mean(np.std(run.position_rad - run.true_position_rad, axis=0)))


def idle(run: RunArrays) -> float:
    """Share of time in which a gear carries next to nothing."""
    return float(np.mean(np.abs(run.load_nm[FIRST:]) < 0.3))


def behind(run: RunArrays) -> float:
    """How far positions are reported behind, in the direction of motion."""
    off = (run.position_rad - run.true_position_rad)[FIRST:]
    return float(-np.mean(off * np.sign(run.velocity_rad_s[FIRST:])))


def off_by(run: RunArrays) -> float:
    """Largest constant error of a reported position."""
    return float(np.max(np.abs(np.median(run.position_rad - run.true_position_rad, axis=0))))


def mean_delay_s(run: RunArrays) -> float:
    return float(np.mean(delays_s(run)))


def way(run: RunArrays) -> Array:
    """Mean velocity, ahead and to the left."""
    return np.asarray(np.mean(run.true_velocity_m_s[FIRST:], axis=0))


def asked_change(run: RunArrays) -> Array:
    """Sent less what the policy meant, at ticks after the ramp."""
    active = run.is_active
    return np.asarray(run.requested_rad[active] - policy().setpoint_rad(run.action[active]))


@dataclass(frozen=True)
class Compared:
    """A run with a fault beside the healthy one."""

    run: RunArrays
    healthy: RunArrays
    fault: Fault

    def more(self, what: Callable[[RunArrays], float]) -> float:
        """How much more of something the faulty run has."""
        return float(what(self.run)) - float(what(self.healthy))

    def times(self, what: Callable[[RunArrays], float]) -> float:
        """How many times as much."""
        return float(what(self.run)) / float(what(self.healthy))

    def stated(self, name: str) -> float:
        return self.fault.parameters[name]


DIRECTIONS: Final[dict[str, Callable[[Compared], Any]]] = {
    "lugre_friction": lambda c: 0.6 < c.more(drag_nm) / c.stated("coulomb_friction.level_nm") < 1.4,
    "shear_thinning_grease": lambda c: c.more(drag_nm) > 0.2,
    "gear_loss": lambda c: c.more(drag_nm) > 0.5,
    "bent_shaft": lambda c: c.more(drag_nm) > 0.2,
    "sticky_bearing": lambda c: c.more(drag_nm) > 0.1,
    "servo_damping": lambda c: c.more(drag_nm) > 0.3,
    "lopsided_motor": lambda c: c.more(drag_nm) > 0.3,
    "flux_change": lambda c: abs(c.times(gain) - c.stated("torque_gain.gain")) < 0.05,
    "servo_gains": lambda c: abs(c.times(gain) - c.stated("torque_gain.gain")) < 0.05,
    "reversal_sag": lambda c: c.times(gain) < 0.97,
    "bus_current_limiter": lambda c: c.times(gain) < 0.996,
    "few_volts": lambda c: c.times(gain) < 0.999,
    "tired_battery": lambda c: c.more(lambda run: run.battery_v.min()) < -3.0 and c.times(gain) < 0.99,
    "hot_motors": lambda c: c.more(lambda run: run.winding_c.max()) > 40.0,
    "heavy_rotor": lambda c: c.more(inertia) > 0.02,
    "slow_current_loop": lambda c: c.more(lag) > 0.004,
    "soft_gear": lambda c: c.times(wind_up) > 3.0,
    "loose_teeth": lambda c: c.times(idle) > 1.5,
    "soft_current_limit": lambda c: most_nm(c.run, 1) < 18.7 and most_nm(c.run, 2) < 33.5,
    "slow_queue": lambda c: abs(c.more(mean_delay_s) - c.stated("command_delay.delay_s")) < 1e-3,
    "stuttering_link": lambda c: c.times(lambda run: float(np.std(delays_s(run)))) > 3.0,
    "lossy_link": lambda c: c.more(lambda run: np.sum(run.arrival_ns == NEVER_NS)) > 0,
    "encoder_offset": lambda c: abs(off_by(c.run) - abs(c.stated("encoder_offset.offset_rad"))) < 0.006,
    "noisy_sensors": lambda c: c.times(lambda run: jaggedness(run.load_nm)) > 2.0,
    "filtered_rates": lambda c: c.more(rates_lag) > 0.003,
    "slow_encoder": lambda c: c.more(behind) > 5e-4,
    "late_contacts": lambda c: not np.array_equal(c.run.foot_contact[:100], c.healthy.foot_contact[:100]),
    "crooked_imu": lambda c: np.linalg.norm(upright(c.run) - upright(c.healthy)) > 0.03,
    "box_on_the_back": lambda c: c.times(stance_load) > 1.2,
    "moved_ballast": lambda c: c.more(fore_aft) * c.stated("com_offset.x_m") > 0.0,
    "wrong_action_scale": lambda c: np.abs(asked_change(c.run)).max() > 0.02,
    "wrong_pose": lambda c: np.abs(asked_change(c.run)).max()
    == pytest.approx(abs(c.stated("default_pose.offset_rad"))),
    "mixed_sides": lambda c: np.abs(asked_change(c.run)).max() > 0.02,
    "headwind": lambda c: np.linalg.norm(way(c.run) - way(c.healthy)) > 0.05,
}


@pytest.mark.parametrize("name", DIRECTIONS)
def test_a_fault_moves_the_log_as_its_physics_says(name: str) -> None:
    (fault,) = make([request(name)], 5).truth.faults
    assert DIRECTIONS[name](Compared(faulty(name), healthy(), fault))


def test_every_direction_is_of_a_fault_that_there_is() -> None:
    assert set(DIRECTIONS) <= set(CATALOGUE)
