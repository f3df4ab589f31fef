"""A robot at rest by formulas alone: where its feet stand, what its joints carry, and what drawn sensors make of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.state import ImuPacket, RobotState
from spot_runtime.control.safety.signals.legs import foot_jacobians
from tests.spot_runtime.conftest import START_NS

GRAVITY_M_S2 = 9.81
_NOWHERE, _ALL_FEET = np.zeros(3), np.ones(facts.N_LEGS, dtype=np.bool_)


class Stand(NamedTuple):
    """A pose in which a robot stands, and the torques that hold it."""

    position_rad: Array
    """Shape (12,)."""
    load_nm: Array
    """Shape (12,)."""
    up: Array
    """The vertical in the body's frame. Shape (3,)."""


def drawn_stand(
    rng: np.random.Generator,
    *,
    slope_rad: float = 0.0,
    payload_kg: float = 0.0,
    step_m: float = 0.0,
    spread_m: float = 0.0,
) -> Stand:
    """Feet near below the hips in a plane parallel to the body, which may slope; one foot may be higher by a step.

    ``spread_m`` is how far outside of the hips the feet stand.

    The ground's forces balance weight and moments; feet press against each other with part of their friction, of 0.8.
    """
    weight_n = (facts.TOTAL_MASS_KG + payload_kg) * GRAVITY_M_S2
    hips_m, _ = foot_jacobians(np.zeros(facts.N_JOINTS))
    while True:
        heading = rng.uniform(0.0, 2.0 * np.pi)
        up = np.array([*(np.sin(slope_rad) * np.array([np.cos(heading), np.sin(heading)])), np.cos(slope_rad)])
        feet_m = hips_m + rng.uniform(-0.05, 0.05, (facts.N_LEGS, 3))
        feet_m[:, 1] += spread_m * np.sign(hips_m[:, 1])
        feet_m[:, 2] = -rng.uniform(0.42, 0.55)
        feet_m[rng.integers(facts.N_LEGS), 2] += step_m
        forces_n = _forces_n(rng, feet_m, weight_n * up)
        if forces_n is not None:
            break
    position_rad = _joints_of(feet_m)
    _, jacobians = foot_jacobians(position_rad)
    load_nm = _hanging_nm(position_rad, up) - np.einsum("lij,li->lj", jacobians, forces_n).ravel()
    return Stand(position_rad, load_nm, up)


def _joints_of(feet_m: Array) -> Array:
    """Joint positions that bring the feet there, by Newton's method from the default pose."""
    position_rad = np.array(facts.DEFAULT_POSITION_RAD)
    for _ in range(30):
        found_m, jacobians = foot_jacobians(position_rad)
        step = np.linalg.solve(jacobians, (feet_m - found_m)[..., np.newaxis])[..., 0].ravel()
        position_rad = position_rad + np.clip(step, -0.3, 0.3)
    found_m, _ = foot_jacobians(position_rad)
    assert np.allclose(found_m, feet_m, atol=1e-6)
    return position_rad


def _forces_n(rng: np.random.Generator, feet_m: Array, weight_n: Array) -> Array | None:
    """Forces of the ground on the feet, shape (4, 3), that balance the weight; None where friction holds none."""
    balance = np.zeros((6, 12))
    for leg, (x, y, z) in enumerate(feet_m):
        balance[:3, 3 * leg : 3 * leg + 3] = np.eye(3)
        balance[3:, 3 * leg : 3 * leg + 3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
    least = np.linalg.lstsq(balance, np.array([*weight_n, 0.0, 0.0, 0.0]), rcond=None)[0]
    _, _, rows = np.linalg.svd(balance)
    inner = rows[6:].T @ rng.standard_normal(6)
    across_n = np.array([0.0, 0.0, np.linalg.norm(weight_n)])
    for share in 0.8 ** np.arange(20):
        forces_n = (least + 100.0 * share * inner).reshape(facts.N_LEGS, 3)
        if _is_held(forces_n, weight_n) and _is_held(forces_n, across_n):
            return forces_n
    return None


def _is_held(forces_n: Array, weight_n: Array) -> bool:
    """Whether each foot carries something, and friction of 0.8 holds it in a plane across this direction."""
    size_n = float(np.linalg.norm(weight_n))
    upward_n = forces_n @ weight_n / size_n
    along_n = np.linalg.norm(forces_n - np.outer(upward_n, weight_n / size_n), axis=1)
    return bool((upward_n > 0.08 * size_n).all() and (along_n < 0.8 * upward_n).all())


def _hanging_nm(position_rad: Array, up: Array) -> Array:
    """What the legs' own weight asks of the joints, by central differences of its potential energy. Shape (12,)."""
    steps = 1e-6 * np.eye(facts.N_JOINTS)
    return np.array([_energy_j(position_rad + s, up) - _energy_j(position_rad - s, up) for s in steps]) / 2e-6


def _energy_j(position_rad: Array, up: Array) -> float:
    energy = 0.0
    for i, leg in enumerate(facts.LEG_NAMES):
        end, side = facts.end_sign(leg), facts.side_sign(leg)
        place, turn = np.array(facts.HX_FROM_BODY_M) * [end, side, 1.0], np.eye(3)
        offsets = (np.zeros(3), np.array(facts.HY_FROM_HX_M) * [1.0, side, 1.0], np.array(facts.KN_FROM_HY_M))
        links = (facts.HIP_FL, facts.UPPER_LEG_FL, facts.LOWER_LEG_FL)
        for joint, (offset, link) in enumerate(zip(offsets, links, strict=True)):
            place = place + turn @ offset
            turn = turn @ _about(0 if joint == 0 else 1, float(position_rad[3 * i + joint]))
            x, y, z = link.com_m
            centre = place + turn @ [x * (end if joint == 0 else 1.0), y * side, z]
            energy += link.mass_kg * GRAVITY_M_S2 * float(up @ centre)
    return energy


def _about(axis: int, angle_rad: float) -> Array:
    a, b = [(1, 2), (2, 0)][axis]
    turn = np.eye(3)
    turn[a, a] = turn[b, b] = np.cos(angle_rad)
    turn[b, a] = np.sin(angle_rad)
    turn[a, b] = -turn[b, a]
    return turn


# Sensors and estimators ----------------------------------------------------------------------------------------------

PERIOD_S = 1e-9 * facts.STATE_PERIOD_NS
CHUNK_S = 30.0


@dataclass
class QuietRobot:
    """A robot that stands and sways a little, with sensors and estimators drawn from what such hardware does.

    All of its signals fit together but for noise, steps and biases: positions are integrals of velocities, loads carry
    the body of a drawn stand, attitude and turn rate belong together.
    """

    seed: int

    def __post_init__(self) -> None:
        """Draw the robot."""
        self.rng = np.random.default_rng(self.seed)
        self.stand = drawn_stand(self.rng, payload_kg=self.rng.uniform(0.0, 10.0))
        drawn = self._log_uniform
        self.steps = drawn(1e-5, 2e-3), drawn(1e-4, 0.1), drawn(0.005, 3.0)
        """Of position (rad), velocity (rad/s) and load (N·m)."""
        self.noise = drawn(1e-6, 1e-3), drawn(1e-4, 0.1), drawn(0.01, 2.0)
        self.sway_rad, self.sway_s = drawn(1e-4, 0.01), drawn(0.3, 3.0)
        self.velocity_bias_m_s, self.turn_bias_rad_s = self.rng.normal(0.0, 0.04, 3), self.rng.normal(0.0, 0.02, 3)
        self.body_noise = drawn(1e-5, 0.05), drawn(1e-5, 0.05), drawn(1e-6, 0.003)
        """Of the body's velocity (m/s), its turn rate (rad/s) and its attitude (rad)."""
        self.force_noise_m_s2 = drawn(0.01, 0.6)
        self.holds_at_rest = bool(self.rng.random() < 0.3)
        """Whether its estimator reports a robot at rest without any motion."""

    def _log_uniform(self, least: float, largest: float) -> float:
        return float(np.exp(self.rng.uniform(np.log(least), np.log(largest))))

    def states(self, seconds: float) -> Iterator[RobotState]:
        """States of so long a time, one each 3 ms."""
        count = round(CHUNK_S / PERIOD_S)
        for begin in range(0, round(seconds / PERIOD_S), count):
            yield from self._chunk(begin, min(count, round(seconds / PERIOD_S) - begin))

    def _chunk(self, begin: int, count: int) -> Iterator[RobotState]:
        """Each begins and ends in the middle of the sway, at rest, so that they join."""
        normal = self.rng.standard_normal
        rest = np.minimum(1.0, np.minimum(np.arange(count), np.arange(count)[::-1])[:, np.newaxis] * PERIOD_S)
        sway = rest * self._wander((count, 12), self.sway_rad, self.sway_s)
        rate = np.gradient(sway, PERIOD_S, axis=0)
        position, velocity, load = (
            np.round((true + size * normal((count, 12))) / step) * step
            for true, size, step in zip(
                (self.stand.position_rad + sway, rate, self.stand.load_nm + 20.0 * sway),
                self.noise,
                self.steps,
                strict=True,
            )
        )
        lean = rest * self._wander((count, 3), 0.005, 5.0)
        turn = np.gradient(lean, PERIOD_S, axis=0)
        speed_noise, turn_noise, lean_noise = self.body_noise
        half = 0.5 * (lean + lean_noise * normal((count, 3)))
        linear = self.velocity_bias_m_s + speed_noise * normal((count, 3))
        angular = turn + self.turn_bias_rad_s + turn_noise * normal((count, 3))
        if self.holds_at_rest:
            half, linear, angular = 0.0 * half, 0.0 * linear, 0.0 * angular
        attitude = np.column_stack([np.sqrt(1.0 - (half * half).sum(axis=1)), half])
        force = np.array([0.2, -0.1, GRAVITY_M_S2 + 0.2]) + self.force_noise_m_s2 * normal((count, 3))
        for i in range(count):
            stamp_ns = START_NS + (begin + i) * facts.STATE_PERIOD_NS
            yield RobotState(
                robot_stamp_ns=stamp_ns,
                host_stamp_ns=stamp_ns,
                position_rad=position[i],
                velocity_rad_s=velocity[i],
                load_nm=load[i],
                position_of_body_in_odom_m=_NOWHERE,
                odom_from_body_wxyz=attitude[i],
                linear_vel_of_body_in_odom_m_s=linear[i],
                angular_vel_of_body_in_odom_rad_s=angular[i],
                foot_contact=_ALL_FEET,
                last_command_key=begin + i,
                last_command_robot_stamp_ns=stamp_ns,
                imu=(ImuPacket(stamp_ns, force[i], turn[i], attitude[i]),),
            )

    def _wander(self, shape: tuple[int, int], size: float, time_s: float) -> Array:
        """Smooth motion about zero: noise through two first-order lags."""
        fade = np.exp(-PERIOD_S / time_s)
        wander = lfilter([1.0], [1.0, -fade], self.rng.standard_normal(shape), axis=0) * size * np.sqrt(1.0 - fade**2)
        smooth: Array = lfilter([0.05], [1.0, -0.95], wander, axis=0)
        return smooth
