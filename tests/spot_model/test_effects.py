from __future__ import annotations

import dataclasses
import math
from typing import ClassVar

import numpy as np
import pytest

from spot_model.effects.base import (
    BodyEstimate,
    CommandEffect,
    Effect,
    EstimateEffect,
    Hook,
    JointReading,
    Motion,
    Outside,
    OutsideEffect,
    SensorEffect,
    SoftwareEffect,
    TorqueEffect,
)
from spot_model.effects.bodies import (
    BodyInertia,
    ComOffset,
    FootRadius,
    GroundCompliance,
    GroundFriction,
    LegMass,
    PayloadMass,
    StowedArm,
)
from spot_model.effects.commands import ActionScale, CommandDelay, CommandDrop, CommandJitter, DefaultPose, JointSwap
from spot_model.effects.drivetrain import Backlash, TorqueBandwidth, TorqueDelay, TorqueGain, TorqueOffset, TorqueRipple
from spot_model.effects.estimator import ContactDelay, ImuTilt, VelocityEstimate
from spot_model.effects.friction import Armature, CoulombFriction, LoadFriction, StribeckFriction, ViscousFriction
from spot_model.effects.ground import FootDrag, GroundSlope
from spot_model.effects.joint_sensors import (
    EncoderOffset,
    JointCompliance,
    LoadFilter,
    LoadSensorGain,
    SensorNoise,
    VelocityFilter,
)
from spot_model.effects.leg_odometry import LegOdometry
from spot_model.effects.power import BusSag, PowerLimit, ThermalDerating, scale_to_power
from spot_model.effects.registry import BUILT_IN, effect_class, make_effect
from spot_model.effects.torque_limits import PositionTorqueLimit, TorqueLimit, TorqueSpeedCurve
from spot_model.errors import BadInputError
from spot_model.robot import facts
from spot_model.robot.facts import KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM

PAPER_CURVE = TorqueSpeedCurve(
    torque_max_nm=97.00,
    torque_min_nm=-108.79,
    speed_max_rad_s=25.03,
    speed_min_rad_s=-22.22,
    intersect_max_rad_s=9.48,
    intersect_min_rad_s=-8.32,
)


N_STEPS = 3


def random_joints(n: int = 64) -> tuple[np.ndarray, Motion]:
    rng = np.random.default_rng(7)
    torque = rng.normal(0.0, 80.0, (n, 12))
    position = rng.uniform(facts.POSITION_LOW_RAD - 0.1, facts.POSITION_HIGH_RAD + 0.1, (n, 12))
    return torque, Motion(position, rng.normal(0.0, 15.0, (n, 12)), 0.005)


class Fields(dict):
    """A model of three simulations with the fields that effects edit; links and geoms by name."""

    joint_dofs = np.arange(6, 18)
    names: ClassVar = [
        "world",
        "body",
        *(f"{leg}_{link}" for leg in facts.LEG_NAMES for link in ("hip", "uleg", "lleg")),
    ]
    geoms: ClassVar = [f"{leg}_foot" for leg in facts.LEG_NAMES]

    def __init__(self):
        rng = np.random.default_rng(11)
        shapes = {
            **dict.fromkeys(("dof_frictionloss", "dof_armature", "dof_damping"), (3, 18)),
            "body_mass": (3, 14),
            **dict.fromkeys(("body_ipos", "body_inertia"), (3, 14, 3)),
            **dict.fromkeys(("geom_size", "geom_friction"), (3, 4, 3)),
            "geom_solref": (3, 4, 2),
        }
        super().__init__({name: rng.uniform(0.5, 1.0, shape) for name, shape in shapes.items()})

    def body_id(self, name: str) -> int:
        return self.names.index(name)

    def geom_id(self, name: str) -> int:
        return self.geoms.index(name)

    def flat(self) -> np.ndarray:
        return np.concatenate([self[k].ravel() for k in sorted(self)])


def outcome(effect: Effect) -> np.ndarray:
    """What an effect makes of a fixed input, by its hook, through its own formula, over a few steps."""
    if isinstance(effect, TorqueEffect):
        torque, motion = random_joints()
        effect = effect.arrays_like(torque)
        memory, outs = effect.start(torque), []
        for _ in range(N_STEPS):
            out, memory = effect.apply(torque, motion, memory, effect.mask)
            outs.append(out)
        return np.concatenate(outs)
    if effect.hook is Hook.MODEL:
        fields = Fields()
        effect.edit(fields)
        return fields.flat()
    if isinstance(effect, OutsideEffect):
        around = surroundings()
        effect.arrays_like(around.qpos).surround(around)
        return np.hstack([around.gravity_m_s2, around.foot_force_n.reshape(4, -1)])
    if isinstance(effect, CommandEffect):
        return effect.arrival_s(np.linspace(0.0, 1.0, 50), np.random.default_rng(5))
    if isinstance(effect, SoftwareEffect):
        return effect.setpoint_rad(random_joints()[1].position_rad)
    if isinstance(effect, SensorEffect):
        return read_over_steps(effect)
    assert isinstance(effect, EstimateEffect)
    return estimate_over_steps(effect)


def surroundings() -> Outside:
    """Four robots that move in different ways, at different times."""
    rng = np.random.default_rng(6)
    qpos, qvel = rng.normal(0.0, 0.3, (4, 19)), rng.normal(0.0, 1.0, (4, 18))
    qpos[:, 3] = 1.0
    qpos[:, 3:7] /= np.linalg.norm(qpos[:, 3:7], axis=1, keepdims=True)
    gravity = np.tile([0.0, 0.0, -9.81], (4, 1))
    return Outside(gravity, np.zeros((4, 4, 3)), qpos, qvel, np.array([[0.0], [0.7], [2.0], [9.0]]))


def readings() -> list[JointReading]:
    rng = np.random.default_rng(3)
    return [JointReading(*(rng.normal(0.0, scale, (4, 12)) for scale in (1.0, 5.0, 30.0))) for _ in range(30)]


def estimates() -> list[BodyEstimate]:
    rng = np.random.default_rng(4)
    out = []
    for _ in range(30):
        attitude = rng.normal(size=(4, 4))
        attitude /= np.linalg.norm(attitude, axis=1, keepdims=True)
        out.append(
            BodyEstimate(
                rng.normal(size=(4, 3)), rng.normal(size=(4, 3)), attitude, np.float64(rng.random((4, 4)) < 0.8)
            )
        )
    return out


def stacked(records: list) -> np.ndarray:
    values = [getattr(r, f.name) for r in records for f in dataclasses.fields(r)]
    return np.concatenate([v.ravel() for v in values if v is not None])


def read_over_steps(effect: SensorEffect) -> np.ndarray:
    truth, rng, out = readings(), np.random.default_rng(5), []
    effect = effect.arrays_like(truth[0].position_rad)
    memory = effect.start(truth[0])
    for reading in truth:
        reported, memory = effect.read(reading, 0.005, memory, rng)
        out.append(reported)
    return stacked(out)


def estimate_over_steps(effect: EstimateEffect) -> np.ndarray:
    truth, rng, out = estimates(), np.random.default_rng(5), []
    effect = effect.arrays_like(truth[0].world_from_body_wxyz)
    memory = effect.start(truth[0])
    for estimate, joints in zip(truth, readings(), strict=True):
        reported, memory = effect.estimate(estimate, joints, 0.005, memory, rng)
        out.append(reported)
    return stacked(out)


NULL_INPUT = {
    Hook.TORQUE: lambda: np.concatenate([random_joints()[0]] * N_STEPS),
    Hook.MODEL: lambda: Fields().flat(),
    Hook.COMMAND: lambda: np.linspace(0.0, 1.0, 50),
    Hook.SOFTWARE: lambda: random_joints()[1].position_rad,
    Hook.SENSOR: lambda: stacked(readings()),
    Hook.ESTIMATE: lambda: stacked(estimates()),
    Hook.OUTSIDE: lambda: np.hstack([surroundings().gravity_m_s2, np.zeros((4, 12))]),
}

ACTIVE = (
    PAPER_CURVE,
    CoulombFriction(level_nm=0.2),
    TorqueLimit(limit_nm=45.0),
    PositionTorqueLimit(motor_torque_nm=1.5),
    CommandDelay(delay_s=0.005),
    ViscousFriction(damping_nm_s_per_rad=0.1),
    StribeckFriction(level_nm=0.5, speed_rad_s=0.5),
    LoadFriction(share=0.1),
    TorqueGain(gain=0.9),
    Armature(inertia_kg_m2=0.04),
    TorqueDelay(delay_s=0.01),
    TorqueBandwidth(time_constant_s=0.01),
    ThermalDerating(loss_per_k=0.004, heating_k_per_nm2_s=0.5, cooling_time_s=2.0),
    TorqueOffset(offset_nm=0.5),
    TorqueRipple(amplitude_nm=0.5, cycles_per_rad=50.0, phase_rad=0.5, second_nm=0.2, second_phase_rad=-0.4),
    PowerLimit(power_w=1500.0, copper_w_per_nm2=0.01),
    BusSag(
        resistance_ohm=0.05,
        open_voltage_v=55.0,
        back_emf_v_s_per_rad=2.0,
        stall_nm_per_v=2.0,
        copper_w_per_nm2=0.1,
        smoothing_s=0.01,
    ),
    Backlash(gap_rad=0.01, rotor_inertia_kg_m2=0.04),
    PayloadMass(mass_kg=3.0, x_m=0.1, y_m=0.05, z_m=0.1),
    StowedArm(mass_kg=7.467),
    ComOffset(x_m=0.02, y_m=0.01, z_m=0.01),
    BodyInertia(scale=1.2),
    LegMass(scale=1.2, down_m=0.25),
    FootRadius(change_m=0.003),
    GroundFriction(scale=0.5),
    GroundCompliance(time_constant_s=0.01, damping_ratio=0.3),
    CommandJitter(mean_s=0.002),
    CommandDrop(probability=0.3),
    EncoderOffset(offset_rad=0.02),
    JointCompliance(compliance_rad_per_nm=0.001),
    SensorNoise(position_rad=0.001, velocity_rad_s=0.05, load_nm=0.5),
    VelocityFilter(time_constant_s=0.005, unfiltered_share=0.5),
    LoadSensorGain(gain=0.95, bias_nm=0.5),
    LoadFilter(time_constant_s=0.004),
    LegOdometry(time_s=0.05),
    VelocityEstimate(scale=0.95, bias_x_m_s=0.05, bias_y_m_s=0.02, lag_s=0.02),
    ImuTilt(roll_rad=0.02, pitch_rad=0.03),
    ContactDelay(delay_s=0.02),
    GroundSlope(rise_x_rad=0.06, rise_y_rad=0.03, from_s=1.0, until_s=2.4),
    FootDrag(drag_n_s_per_m=8.0, height_m=0.15),
    ActionScale(scale=1.25),
    DefaultPose(offset_rad=0.1),
    JointSwap(share=1.0),
)


@pytest.mark.parametrize("cls", BUILT_IN.values(), ids=BUILT_IN)
def test_a_null_effect_changes_no_bit(cls: type[Effect]):
    assert cls().is_null
    np.testing.assert_array_equal(outcome(cls()), NULL_INPUT[cls.hook]())


@pytest.mark.parametrize(
    ("effect", "parameter"),
    [(effect, p.name) for effect in ACTIVE for p in effect.parameters()],
    ids=lambda v: v if isinstance(v, str) else v.name,
)
def test_every_parameter_changes_something(effect: Effect, parameter: str):
    smaller = dataclasses.replace(effect, **{parameter: 0.8 * getattr(effect, parameter)})
    assert not np.array_equal(outcome(effect), outcome(smaller))


def test_every_effect_has_an_active_example():
    assert sorted(effect.name for effect in ACTIVE) == sorted(BUILT_IN)


@pytest.mark.parametrize("cls", BUILT_IN.values(), ids=BUILT_IN)
def test_every_parameter_says_its_bounds_unit_and_source(cls: type[Effect]):
    for p in cls.parameters():
        assert p.low < p.high
        assert p.unit
        assert p.source


def test_an_effect_acts_on_its_joints_only():
    torque, _ = random_joints()
    out = outcome(TorqueLimit(joints=("hl", "fr_kn"), limit_nm=20.0))[: len(torque)]
    touched = TorqueLimit(joints=("hl", "fr_kn"), limit_nm=20.0).mask
    np.testing.assert_array_equal(out[:, ~touched], torque[:, ~touched])
    np.testing.assert_array_equal(out[:, touched], np.clip(torque[:, touched], -20.0, 20.0))


@pytest.mark.parametrize(
    ("velocity", "high", "low"),
    [
        (0.0, 97.00, -108.79),
        (9.48, 97.00, -108.79),
        ((9.48 + 25.03) / 2, 48.50, -108.79),
        (25.03, 0.0, -108.79),
        (30.0, 0.0, -108.79),
        (-8.32, 97.00, -108.79),
        ((-8.32 - 22.22) / 2, 97.00, -54.395),
        (-40.0, 97.00, 0.0),
    ],
)
def test_torque_speed_curve_by_hand(velocity: float, high: float, low: float):
    v = np.full((1, 12), velocity)
    effect, motion = PAPER_CURVE.arrays_like(v), Motion(v * 0, v, 0.005)
    for asked, bound in ((1e6, high), (-1e6, low)):
        torque = np.full((1, 12), asked)
        np.testing.assert_allclose(effect.torque(torque, motion, effect.start(torque))[0], bound, atol=1e-9)


def test_one_value_a_simulation():
    torque = np.full((3, 12), 100.0)
    effect = TorqueLimit(limit_nm=np.array([[10.0], [20.0], [30.0]])).arrays_like(torque)
    out, _ = effect.torque(torque, Motion(torque * 0, torque * 0, 0.005), None)
    np.testing.assert_array_equal(out[:, 0], [10.0, 20.0, 30.0])


def test_position_limit_follows_the_table_between_and_beyond_its_rows():
    position = np.concatenate(
        [
            KNEE_TABLE_POSITION_RAD,
            [-3.0, 0.0],
            0.5 * (KNEE_TABLE_POSITION_RAD[1:] + KNEE_TABLE_POSITION_RAD[:-1]),
        ]
    )
    position = np.resize(position, (17, 12))
    torque = np.full_like(position, 1e3)
    effect = PositionTorqueLimit(motor_torque_nm=1.5).arrays_like(torque)
    out, _ = effect.torque(torque, Motion(position, position * 0, 0.005), effect.start(torque))
    np.testing.assert_allclose(out, np.interp(position, KNEE_TABLE_POSITION_RAD, KNEE_TABLE_TORQUE_NM), rtol=1e-12)


@pytest.mark.parametrize("effect", [e for e in ACTIVE if isinstance(e, TorqueEffect)], ids=lambda e: e.name)
def test_torch_gives_what_numpy_gives(effect: TorqueEffect):
    torch = pytest.importorskip("torch")
    torque, motion = random_joints()
    like = torch.as_tensor(torque)
    on_torch = effect.arrays_like(like)
    same = Motion(torch.as_tensor(motion.position_rad), torch.as_tensor(motion.velocity_rad_s), motion.dt_s)
    memory, outs = on_torch.start(like), []
    for _ in range(N_STEPS):
        out, memory = on_torch.apply(like, same, memory, torch.as_tensor(effect.mask))
        outs.append(out.numpy())
    np.testing.assert_allclose(np.concatenate(outs), outcome(effect), rtol=1e-11, atol=1e-11)


def test_a_servo_may_damp_the_velocity_before_the_filter():
    effect = VelocityFilter(time_constant_s=0.01, unfiltered_share=0.75).arrays_like(np.zeros((1, 12)))
    still, fast = (JointReading(np.zeros((1, 12)), np.full((1, 12), v), np.zeros((1, 12))) for v in (0.0, 8.0))
    reported, _ = effect.read(fast, 0.001, effect.start(still), np.random.default_rng(0))
    # 8 · (1 - exp(-0.1)) = 0.7613 is reported; a quarter of it and three quarters of 8 are damped.
    np.testing.assert_allclose(reported.velocity_rad_s, 0.7613, atol=1e-4)
    np.testing.assert_allclose(reported.servo_velocity_rad_s, 6.1903, atol=1e-4)


def test_a_flag_comes_late_by_the_delay():
    touch = [
        BodyEstimate(np.zeros((1, 3)), np.zeros((1, 3)), np.eye(4)[:1], np.full((1, 4), float(k >= 10)))
        for k in range(30)
    ]
    effect = ContactDelay(delay_s=0.02).arrays_like(np.zeros((1, 12)))
    memory, flags = effect.start(touch[0]), []
    for estimate in touch:
        reported, memory = effect.estimate(estimate, readings()[0], 0.005, memory, np.random.default_rng(0))
        flags.append(reported.foot_contact[0, 0])
    # Made at the tenth instant of 5 ms, reported 20 ms later.
    assert flags.index(1.0) == 14


def test_a_payload_moves_the_centre_of_mass_by_hand():
    fields = Fields()
    fields["body_mass"][:, 1], fields["body_ipos"][:, 1], fields["body_inertia"][:, 1] = 6.0, 0.0, 1.0
    PayloadMass(mass_kg=2.0, x_m=0.4).edit(fields)
    # Together 8 kg; the centre moves by 0.4 · 2/8; the reduced mass 6 · 2/8 = 1.5 kg adds 1.5 · 0.16 about y and z.
    np.testing.assert_allclose(fields["body_mass"][0, 1], 8.0)
    np.testing.assert_allclose(fields["body_ipos"][0, 1], [0.1, 0.0, 0.0])
    np.testing.assert_allclose(fields["body_inertia"][0, 1], [1.0, 1.24, 1.24])


def test_power_is_scaled_to_the_limit_for_all_driving_joints():
    torque = np.zeros((1, 12))
    velocity = np.zeros((1, 12))
    torque[0, :3], velocity[0, :3] = [30.0, -20.0, 10.0], [10.0, -10.0, -5.0]
    effect = PowerLimit(power_w=250.0).arrays_like(torque)
    out, _ = effect.torque(torque, Motion(velocity * 0.0, velocity, 0.005), None)
    # Driving: 300 + 200 W of which half is granted; the braking joint keeps its torque.
    np.testing.assert_allclose(out[0, :3], [15.0, -10.0, 10.0])


def test_copper_loss_falls_with_the_square_of_the_scale_by_hand():
    torque, velocity = np.zeros((1, 12)), np.zeros((1, 12))
    torque[0, :2], velocity[0, :2] = [20.0, 10.0], [10.0, -5.0]
    # Shaft 200 W, copper 200 W, and 50 W of the braking joint: 200 s² + 200 s + 50 = 200 at s = 0.5.
    scale = scale_to_power(torque, velocity, 200.0, 0.5)
    np.testing.assert_allclose(scale, [[0.5]])
    out = np.where(torque * velocity > 0.0, scale * torque, torque)
    drawn = np.sum(np.maximum(out * velocity, 0.0)) + 0.5 * np.sum(out**2)
    np.testing.assert_allclose(drawn, 200.0)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("power_w", "scale"), [(np.inf, 1.0), (450.0, 1.0), (40.0, 0.0)])
def test_a_power_limit_far_off_and_one_that_brakes_use_up(power_w: float, scale: float):
    torque, velocity = np.array([[20.0, 10.0]]), np.array([[10.0, -5.0]])
    np.testing.assert_allclose(scale_to_power(torque, velocity, power_w, 0.5), [[scale]])
    np.testing.assert_allclose(scale_to_power(0.0 * torque, velocity, power_w, 0.5), [[1.0]])


def test_a_gear_passes_on_less_of_what_drives_it_and_holds_more_of_what_drives_it_back():
    torque, velocity = np.zeros((1, 12)), np.zeros((1, 12))
    torque[0, :3], velocity[0, :3] = [30.0, -30.0, 30.0], [10.0, -10.0, -10.0]
    out, _ = LoadFriction(share=0.25).torque(torque, Motion(velocity * 0.0, velocity, 0.005), None)
    # 24 N·m and a quarter of them are 30; driven back, 40 N·m less a quarter are.
    np.testing.assert_allclose(out[0, :3], [24.0, -24.0, 40.0], rtol=1e-6)


def test_the_bus_falls_to_where_the_source_gives_what_the_motors_draw():
    torque, velocity = np.zeros((1, 12)), np.zeros((1, 12))
    torque[0, :3], velocity[0, :3] = [50.0, -20.0, 10.0], [10.0, 5.0, 0.0]
    sag = BusSag(
        resistance_ohm=0.8, open_voltage_v=50.0, back_emf_v_s_per_rad=2.0, stall_nm_per_v=4.0, copper_w_per_nm2=0.1
    )
    # One joint drives with 500 W, and windings take 0.1 · (2500 + 400 + 100) = 300 W.
    np.testing.assert_allclose(sag.power_w(torque, velocity), [[800.0]])
    # At 700 W the source gives 50 V − 0.8 Ω · 21.17 A = 33.06 V, and 33.06 V · 21.17 A = 700 W.
    volts, amperes = sag.bound_nm(np.array([[700.0]]), np.zeros((1, 1)))[0, 0] / 4.0, 700.0 / 33.0623
    np.testing.assert_allclose(volts, 50.0 - 0.8 * amperes, rtol=1e-4)
    np.testing.assert_allclose(volts, 33.0623, rtol=1e-4)
    # A joint at 10 rad/s has 20 V less; a source that cannot give the power keeps half of its voltage.
    np.testing.assert_allclose(sag.bound_nm(np.array([[700.0]]), np.array([[-10.0]])), [[4.0 * 13.0623]], rtol=1e-4)
    np.testing.assert_allclose(sag.bound_nm(np.array([[1e4]]), np.array([[0.0]])), [[4.0 * 25.0]])


def test_backlash_holds_the_torque_back_for_the_time_the_rotor_needs():
    effect = Backlash(gap_rad=0.01, rotor_inertia_kg_m2=0.04)
    like = np.zeros((1, 12))
    effect, push, dt_s = effect.arrays_like(like), np.full((1, 12), 8.0), 1e-4
    motion, memory, held = Motion(like, like, dt_s), effect.start(like), 0
    while True:
        out, memory = effect.torque(push, motion, memory)
        if out[0, 0] != 0.0:
            break
        held += 1
    # From the middle, 5 mrad at 8 / 0.04 = 200 rad/s²: sqrt(2 · 0.005 / 200) = 7.07 ms.
    assert held * dt_s == pytest.approx(0.00707, abs=2e-4)
    assert out[0, 0] == 8.0


def test_delay_shifts_the_arrival():
    np.testing.assert_array_equal(
        CommandDelay(delay_s=0.005).arrival_s(np.array([0.0, 0.02]), np.random.default_rng(0)), [0.005, 0.025]
    )


@pytest.mark.parametrize(
    ("name", "fields", "message"),
    [
        (
            "torque_limit",
            {"limit_nm": -3},
            r"torque_limit.limit_nm = -3; allowed: 1 to 500 N·m or inf for none",
        ),
        ("torque_limit", {"limit": 3}, r"unknown key 'limit'; allowed: joints, limit_nm"),
        ("torque_limit", {"limit_nm": "4"}, r"limit_nm = '4' is no number"),
        ("torque_limit", {"limit_nm": math.nan}, r"limit_nm is not a number"),
        ("torque_limit", {"limit_nm": 40, "joints": ["fl_foot"]}, r"'fl_foot' is no joint"),
        ("torque_speed_curve", {"speed_max_rad_s": 20}, r"set without torque_max_nm"),
        (
            "torque_speed_curve",
            {"torque_max_nm": 90, "speed_max_rad_s": 20, "intersect_max_rad_s": 21},
            r"intersect_max_rad_s = 21.0 lies beyond speed_max_rad_s = 20.0",
        ),
        ("torque_lmit", {}, r"'torque_lmit' is unknown; allowed: .*torque_limit"),
        ("json:dumps", {}, r"a subclass of"),
        ("no.such.module:Thing", {}, r"cannot be loaded"),
    ],
)
def test_bad_effects_are_refused_in_words(name: str, fields: dict, message: str):
    with pytest.raises(BadInputError, match=message):
        make_effect(name, fields)


def test_an_effect_of_ones_own_is_found_by_module_and_class():
    assert effect_class("spot_model.effects.torque_limits:TorqueLimit") is TorqueLimit
