"""What a simulated robot is made of, as numbers: drives, supply, heat, sensors, estimator, link; and its steps.

Arrays have shape (12,) in canonical joint order where nothing else is said.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from spot_model.robot import facts
from spot_model.robot.facts import STATE_PERIOD_NS, Array, per_joint

GRAVITY_M_S2: Final = 9.81


@dataclass(frozen=True)
class Settings:
    """Numbers of the simulation that are no property of the robot.

    The nominal plant steps 5 ms (in the diagnosis 1.5 ms) by Euler's method, the fake robot 1.5 ms by ``implicitfast``,
    both with spherical feet and contacts given by a time constant.
    """

    steps_per_state: int = 6
    """Physics steps in the 3 ms between two states."""
    integrator: str = "implicit"
    impratio: float = 2.0
    """Stiffness of friction over that of the normal force."""
    contact_stiffness_per_s2: float = 5200.0
    contact_damping_per_s: float = 148.0
    """MuJoCo's direct form of a contact: acceleration by depth and by speed."""
    settle_s: float = 0.9
    """Standing before the log begins."""
    ramp_s: float = 1.0
    """From the stand to the policy, in the log."""
    tail_s: float = 0.1

    @property
    def step_s(self) -> float:
        """Length of a physics step."""
        return STATE_PERIOD_NS * 1e-9 / self.steps_per_state


N: Final = facts.N_JOINTS
_PAPER: Final = facts.PAPER_IDENTIFIED
HIP_NO_LOAD_RAD_S: Final = 40.0
"""The nominal model bounds no hip by speed; a motor has a bound, beyond what a gait reaches."""
HIP_SLOPE_NM_S_PER_RAD: Final = 6.0


def _knees(knee: float, hip: float) -> Array:
    return per_joint(hip, hip, knee)


@dataclass
class DriveParameters:
    """Twelve drives, seen at the joint; arrays of shape (12,)."""

    kp_scale: Array = field(default_factory=lambda: np.ones(N))
    kd_scale: Array = field(default_factory=lambda: np.ones(N))
    """What the robot's servo makes of the gains that it is told."""
    rotor_inertia_kg_m2: Array = field(
        default_factory=lambda: _knees(facts.KNEE_ARMATURE_KG_M2, facts.HIP_ARMATURE_KG_M2)
    )
    is_elastic: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(N, dtype=np.bool_))
    """Gears behind which the rotor is a body of its own; the others are rigid."""
    gear_stiffness_nm_per_rad: Array = field(default_factory=lambda: _knees(16000.0, 20000.0))
    """Of elastic gears; a stiffer one asks for shorter steps than half a millisecond."""
    gear_damping_nm_s_per_rad: Array = field(default_factory=lambda: _knees(9.0, 14.0))
    play_rad: Array = field(default_factory=lambda: np.zeros(N))
    torque_constant: Array = field(default_factory=lambda: np.ones(N))
    """Over the nominal one."""
    current_high_nm: Array = field(default_factory=lambda: _knees(_PAPER.torque_max_nm, facts.HIP_TORQUE_LIMIT_NM))
    current_low_nm: Array = field(default_factory=lambda: _knees(_PAPER.torque_min_nm, -facts.HIP_TORQUE_LIMIT_NM))
    """Current limits, as torque at the nominal motor constant."""
    lever_share: Array = field(default_factory=lambda: np.ones(N))
    """Of the torque that the knee's linkage can pass on."""
    limit_softness: Array = field(default_factory=lambda: np.zeros(N))
    """Share of the limit over which the current bends towards it; 0 for a hard limit."""
    no_load_high_rad_s: Array = field(default_factory=lambda: _knees(_PAPER.speed_max_rad_s, HIP_NO_LOAD_RAD_S))
    no_load_low_rad_s: Array = field(default_factory=lambda: _knees(_PAPER.speed_min_rad_s, -HIP_NO_LOAD_RAD_S))
    """Speeds at which back-EMF eats the nominal bus voltage."""
    slope_high_nm_s_per_rad: Array = field(
        default_factory=lambda: _knees(
            _PAPER.torque_max_nm / (_PAPER.speed_max_rad_s - _PAPER.intersect_max_rad_s), HIP_SLOPE_NM_S_PER_RAD
        )
    )
    slope_low_nm_s_per_rad: Array = field(
        default_factory=lambda: _knees(
            _PAPER.torque_min_nm / (_PAPER.speed_min_rad_s - _PAPER.intersect_min_rad_s), HIP_SLOPE_NM_S_PER_RAD
        )
    )
    """Torque a rad/s short of the no-load speed: the winding's resistance."""
    current_time_constant_s: Array = field(default_factory=lambda: np.full(N, 1.5e-4))
    coulomb_nm: Array = field(default_factory=lambda: _knees(_PAPER.knee_friction_nm, _PAPER.hip_friction_nm))
    stiction_nm: Array = field(default_factory=lambda: np.zeros(N))
    """Static friction over the Coulomb level."""
    stribeck_rad_s: Array = field(default_factory=lambda: np.full(N, 0.3))
    viscous_nm_s_per_rad: Array = field(default_factory=lambda: np.zeros(N))
    copper_w_per_nm2: Array = field(default_factory=lambda: _knees(0.022, 0.04))


@dataclass
class SupplyParameters:
    """Battery and bus."""

    cell_volts_full: float = 4.15
    cell_volts_empty: float = 3.05
    n_cells: int = 14
    charge: float = 0.85
    capacity_wh: float = 600.0
    resistance_ohm: float = 0.035
    slow_resistance_ohm: float = 0.015
    slow_time_s: float = 8.0
    """The part of the resistance that builds up with time: polarisation of the cells."""
    idle_w: float = 165.0
    regeneration: float = 0.7
    nominal_v: float = 55.0
    """Voltage at which the drives' no-load speeds hold."""


@dataclass
class ThermalParameters:
    """Winding and housing of each motor, (12,) where an array."""

    winding_j_per_k: Array = field(default_factory=lambda: np.full(N, 55.0))
    housing_j_per_k: Array = field(default_factory=lambda: np.full(N, 420.0))
    winding_to_housing_k_per_w: Array = field(default_factory=lambda: np.full(N, 0.7))
    housing_to_air_k_per_w: Array = field(default_factory=lambda: np.full(N, 1.4))
    start_c: Array = field(default_factory=lambda: np.full(N, 34.0))
    air_c: float = 22.0
    magnet_loss_per_k: Array = field(default_factory=lambda: np.zeros(N))
    """Torque constant lost a kelvin of winding above 60 °C; 0: the drives make up for it, as the nominal model says."""
    derate_from_c: Array = field(default_factory=lambda: np.full(N, 130.0))
    derate_over_k: Array = field(default_factory=lambda: np.full(N, 40.0))
    """Torque falls in a straight line to 0.3 over this range of winding temperature."""


@dataclass
class SensingParameters:
    """Joint sensors, contact detector and inertial unit."""

    offset_rad: Array = field(default_factory=lambda: np.zeros(N))
    eccentricity_rad: Array = field(default_factory=lambda: np.zeros(N))
    eccentricity_phase_rad: Array = field(default_factory=lambda: np.zeros(N))
    position_noise_rad: Array = field(default_factory=lambda: np.full(N, 2.2e-4))
    velocity_noise_rad_s: Array = field(default_factory=lambda: np.full(N, 0.025))
    load_noise_nm: Array = field(default_factory=lambda: np.full(N, 0.3))
    position_quantum_rad: float = 1.9e-4
    velocity_quantum_rad_s: float = 5e-3
    load_quantum_nm: float = 0.06
    load_filter_s: float = 1e-4
    """Time constant of the load cells' amplifiers."""
    load_gain: Array = field(default_factory=lambda: np.ones(N))
    load_bias_nm: Array = field(default_factory=lambda: np.zeros(N))
    contact_on_n: float = 22.0
    contact_off_n: float = 14.0
    contact_filter_s: float = 0.002
    contact_hold_states: Array = field(default_factory=lambda: np.zeros(facts.N_LEGS))
    """States for which the force must have changed before the flag follows; fractions are rounded up."""
    imu_tilt_rpy_rad: Array = field(default_factory=lambda: np.zeros(3))
    gyro_noise_rad_s: float = 0.008
    gyro_bias_rad_s: Array = field(default_factory=lambda: np.zeros(3))
    acceleration_noise_m_s2: float = 0.15
    acceleration_bias_m_s2: Array = field(default_factory=lambda: np.zeros(3))


@dataclass
class EstimatorParameters:
    """The robot's own state estimator."""

    odometry_time_s: float = 0.05
    """How quickly legs pull the integrated velocity."""
    tilt_rate_per_s: float = 0.03
    odometry_scale: float = 1.0
    """Of what the legs say: wrong lengths in the estimator's own model."""
    odometry_bias_m_s: Array = field(default_factory=lambda: np.zeros(2))
    output_lag_s: float = 0.0
    position_noise_m: float = 1e-4
    velocity_noise_m_s: float = 0.008


@dataclass
class LinkParameters:
    """The way from a state message to the program and back to the servos, and when the program runs its policy.

    State to command received has a median of 4 ms and a 95 % quantile of 6 ms in published recordings of a real Spot.
    """

    up_floor_s: float = 1.1e-3
    """State to host: a floor and a gamma distribution of shape 3."""
    up_scale_s: float = 0.6e-4
    compute_s: float = 2.6e-4
    down_floor_s: float = 1.4e-3
    """Host to servo: a floor and a gamma distribution of shape 1.7."""
    down_scale_s: float = 7.0e-4
    schedule: Literal["timer", "divider"] = "timer"
    """``timer``: 50 Hz by the clock, a command with every state. ``divider``: every sixth state, as in the vendor's
    example (55.6 Hz), a command with every tick."""
    slipped_share: float = 0.005
    """Ticks that come one state late. 1.6 % in a recording of the vendor's example."""
