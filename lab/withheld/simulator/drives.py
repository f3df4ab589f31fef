"""Twelve drives: servo, current, voltage, friction, rotor, gear; many runs side by side.

A healthy gear is rigid: rotor and link are one body to MuJoCo, and the load cell between them feels what the motor
gives less what the rotor takes. A gear with play or a soft one has a rotor of its own behind a spring.
"""

from __future__ import annotations

import numpy as np

from spot_model.robot.facts import KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM, N_JOINTS, Array
from withheld.simulator.parameters import DriveParameters
from withheld.simulator.power import Motors
from withheld.simulator.robot import Motion, Robot

PRESLIDING_RAD = 1.5e-3
"""Bend of the bristles at which they slip."""
BRISTLE_DAMPING_S = 1e-3
"""Over their stiffness."""


class LuGre:
    """dz/dt = v − σ0·|v|·z/g(v), τ = σ0·z + σ1·dz/dt + σ2·v, with g = Fc + Fs·exp(−(v/vs)²).

    The bristles' equation is solved implicitly, so a step is stable however stiff they are, and its end is exact in
    steady sliding.
    Source: Canudas de Wit, Olsson, Åström, Lischinsky 1995.
    """

    def __init__(self, drive: DriveParameters, n_runs: int, dt_s: float) -> None:
        self._dt_s = dt_s
        self._stiction = drive.stiction_nm
        self._has_stiction = bool(np.any(drive.stiction_nm != 0.0))
        self._per_speed = 1.0 / drive.stribeck_rad_s
        self._viscous = drive.viscous_nm_s_per_rad
        self._stiffness = np.maximum(drive.coulomb_nm + drive.stiction_nm, 1e-6) / PRESLIDING_RAD
        self._steady = np.maximum(drive.coulomb_nm, 1e-6)
        self._per_level = dt_s * self._stiffness / self._steady
        self._damping = BRISTLE_DAMPING_S / dt_s
        self._bend: Array = np.zeros((n_runs, len(drive.coulomb_nm)))

    def torque_nm(self, velocity_rad_s: Array) -> Array:
        """What opposes the motion over this step, shape (n, 12)."""
        dt_s, level = self._dt_s, self._steady
        if self._has_stiction:
            level = level + self._stiction * np.exp(-np.square(velocity_rad_s * self._per_speed))
        ratio = self._per_level if not self._has_stiction else dt_s * self._stiffness / level
        bend = (self._bend + dt_s * velocity_rad_s) / (1.0 + ratio * np.abs(velocity_rad_s))
        bent = bend + self._damping * (bend - self._bend)
        self._bend = bend
        return np.asarray(self._stiffness * bent + self._viscous * velocity_rad_s)


_LEVER = np.polynomial.Polynomial.fit(KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM, 4)
"""The knee's lever arm over its angle: a smooth linkage through the published table."""
_LEVER_OFFSET, _LEVER_SCALE = (float(v) for v in _LEVER.mapparms())
_LEVER_TERMS = _LEVER.coef.tolist()
NEGLIGIBLE_RAD = 6e-4
"""An encoder ring no further off centre moves a servo's torque by less than a load cell's noise."""
_KNEES = slice(2, N_JOINTS, 3)
_SAFE_SHARE = 0.8
"""Of the bounds at a state: a torque under it surely meets none of them until the next state."""
_SAFE_SPEED_SHARE = 0.3


class Drives:
    """The drives of n runs of one robot.

    Args:
        robot: Its parameters and parts.
        n_runs: How many runs step together.
        position_rad: Where the joints start, shape (n, 12).
        dt_s: Physics step.
    """

    def __init__(self, robot: Robot, n_runs: int, position_rad: Array, dt_s: float) -> None:
        self._robot, self._dt_s = robot, dt_s
        d = robot.drive
        shape = (n_runs, N_JOINTS)
        self.motion = Motion(
            dt_s,
            position_rad.copy(),
            np.zeros(shape),
            position_rad.copy(),
            np.zeros(shape),
            np.zeros(shape),
            np.full((n_runs, 1), robot.supply.nominal_v),
        )
        self.motor_nm: Array = np.zeros(shape)
        self._current_nm: Array = np.zeros(shape)
        self.cell_nm: Array = np.zeros(shape)
        """What the load cells' amplifiers hand out."""
        self._cell_blend = float(-np.expm1(-dt_s / robot.sensing.load_filter_s))
        self._friction = LuGre(d, n_runs, dt_s)
        self.motors = Motors(robot.thermal, d, n_runs)
        self._elastic = d.is_elastic
        self._has_elastic = bool(d.is_elastic.any())
        self._inertia_per_s = d.rotor_inertia_kg_m2 / dt_s
        self._pushed: Array = np.zeros(shape)
        self._spring: Array = np.zeros(shape)
        self._rotor_rate: Array = np.zeros(shape)
        self._per_inertia = dt_s / d.rotor_inertia_kg_m2
        self._blend = -np.expm1(-dt_s / d.current_time_constant_s)
        self._half_play = 0.5 * d.play_rad
        self._has_play = bool(np.any(d.play_rad > 0.0))
        self._is_soft = bool(np.any(d.limit_softness > 0.0))
        self._safe_rad_s = _SAFE_SPEED_SHARE * np.minimum(d.no_load_high_rad_s, -d.no_load_low_rad_s)
        self._safe_nm: Array = np.zeros(shape)
        self._kp_scale, self._kd_scale = d.kp_scale, d.kd_scale
        self._gain: Array = np.ones(shape)
        s = robot.sensing
        self._offset_rad, self._eccentric = s.offset_rad, bool(s.eccentricity_rad.any())
        self._is_plain = not (s.eccentricity_rad > NEGLIGIBLE_RAD).any()
        self._parts = [*robot.motors, *robot.rotors, *robot.links]
        for part in self._parts:
            part.start(n_runs)
        self._zeros: Array = np.zeros(shape)
        self.refresh()

    def encoder_rad(self) -> Array:
        """What the motor-side encoders say, shape (n, 12)."""
        s = self._robot.sensing
        angle = self.motion.rotor_rad + self._offset_rad
        if self._eccentric:
            angle = angle + s.eccentricity_rad * np.sin(self.motion.rotor_rad + s.eccentricity_phase_rad)
        return np.asarray(angle)

    def step(self, setpoint_rad: Array, kp: Array, kd: Array) -> Array:
        """Torque on the links over the coming physics step, shape (n, 12); :meth:`follow` comes after it.

        Args:
            setpoint_rad: Position set-points in effect, (n, 12).
            kp: Gains in effect as the robot has them, N·m/rad, from :meth:`true_gains`.
            kd: N·m·s/rad.
        """
        robot, m = self._robot, self.motion
        believed = m.rotor_rad + self._offset_rad if self._is_plain else self.encoder_rad()
        asked = kp * (setpoint_rad - believed) - kd * m.rotor_rad_s
        allowed = self._limited(asked)
        self._current_nm = self._current_nm + self._blend * (allowed - self._current_nm)
        motor = self._current_nm * self._gain
        for part in robot.motors:
            motor = part.act(motor, m)
        self.motor_nm = motor
        pushed = motor - self._friction.torque_nm(m.rotor_rad_s)
        for part in robot.rotors:
            pushed = pushed + part.act(self._zeros, m)
        self._pushed = out = pushed
        if self._has_elastic:
            self._spring = self._gear_nm()
            self._rotor_rate = m.rotor_rad_s + self._per_inertia * (pushed - self._spring)
            out = np.where(self._elastic, self._spring, pushed)
        for part in robot.links:
            out = out + part.act(self._zeros, m)
        return out

    def follow(self, link_rad: Array, link_rad_s: Array) -> None:
        """Take in where the links are after the physics step that :meth:`step` gave the torque for."""
        m = self.motion
        gear = self._pushed - self._inertia_per_s * (link_rad_s - m.link_rad_s)
        if self._has_elastic:
            gear = np.where(self._elastic, self._spring, gear)
            m.rotor_rad = np.where(self._elastic, m.rotor_rad + self._dt_s * self._rotor_rate, link_rad)
            m.rotor_rad_s = np.where(self._elastic, self._rotor_rate, link_rad_s)
        else:
            m.rotor_rad, m.rotor_rad_s = link_rad, link_rad_s
        m.link_rad, m.link_rad_s, m.gear_nm = link_rad, link_rad_s, gear
        self.cell_nm = self.cell_nm + self._cell_blend * (gear - self.cell_nm)

    def true_gains(self, kp: Array, kd: Array) -> tuple[Array, Array]:
        """What the robot's servo makes of the gains that it is told."""
        return self._kp_scale * kp, self._kd_scale * kd

    def refresh(self) -> None:
        """Once a state: what changes more slowly than a physics step."""
        self._gain = self._robot.drive.torque_constant * self.motors.share
        high, low = self._bounds()
        slow = np.abs(self.motion.rotor_rad_s) < self._safe_rad_s
        self._safe_nm = np.where(slow, _SAFE_SHARE * np.minimum(high, -low), -1.0)

    def _gear_nm(self) -> Array:
        """The gear's spring and damper, with play between their sides."""
        d, m = self._robot.drive, self.motion
        twist = m.rotor_rad - m.link_rad
        rate = m.rotor_rad_s - m.link_rad_s
        if not self._has_play:
            return np.asarray(d.gear_stiffness_nm_per_rad * twist + d.gear_damping_nm_s_per_rad * rate)
        beyond = twist - np.clip(twist, -self._half_play, self._half_play)
        free = (beyond == 0.0) & (d.play_rad > 0.0)
        pushed = d.gear_stiffness_nm_per_rad * beyond + d.gear_damping_nm_s_per_rad * rate
        # A damper between teeth can push, but never pull.
        pulls = (d.play_rad > 0.0) & (pushed * beyond < 0.0)
        return np.where(free | pulls, 0.0, pushed)

    def _bounds(self) -> tuple[Array, Array]:
        """The largest and the least torque that current limit, voltage and lever leave, each (n, 12)."""
        d, m = self._robot.drive, self.motion
        relative = m.bus_v / self._robot.supply.nominal_v
        high = d.slope_high_nm_s_per_rad * (d.no_load_high_rad_s * relative - m.rotor_rad_s)
        low = d.slope_low_nm_s_per_rad * (d.no_load_low_rad_s * relative - m.rotor_rad_s)
        lever = _lever_nm(m.link_rad[:, _KNEES]) * d.lever_share[_KNEES]
        high = np.minimum(np.maximum(high, 0.0), d.current_high_nm)
        low = np.maximum(np.minimum(low, 0.0), d.current_low_nm)
        high[:, _KNEES] = np.minimum(high[:, _KNEES], lever)
        low[:, _KNEES] = np.maximum(low[:, _KNEES], -lever)
        return high, low

    def _limited(self, asked: Array) -> Array:
        """The torque that is asked for within its bounds."""
        size = np.abs(asked)
        if not self._is_soft and not (size > self._safe_nm).any():
            return asked
        high, low = self._bounds()
        hard = np.minimum(np.maximum(asked, low), high)
        if not self._is_soft:
            return hard
        # A regulator that backs off before the limit: straight up to (1 − s), then bent so as never to reach it.
        softness = self._robot.drive.limit_softness
        bound = np.where(asked > 0.0, high, -low) + 1e-9
        knee = bound * (1.0 - softness)
        rest = np.maximum(bound - knee, 1e-9)
        bent = knee + rest * np.tanh(np.maximum(size - knee, 0.0) / rest)
        return np.where((softness > 0.0) & (size > knee), np.sign(asked) * bent, hard)


def _lever_nm(knee_rad: Array) -> Array:
    """Horner's scheme on the angle scaled to -1..1."""
    x = _LEVER_OFFSET + _LEVER_SCALE * knee_rad
    out = np.full_like(x, _LEVER_TERMS[-1])
    for term in _LEVER_TERMS[-2::-1]:
        out = out * x + term
    return out
