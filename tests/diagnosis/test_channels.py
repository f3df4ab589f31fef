"""What the body's channels compute once and use again has the bits of what is computed from nothing."""

import dataclasses
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.channels.body_model import residuals
from diagnosis.channels.build import build_views
from diagnosis.channels.dynamics import DynamicsSignals, realigned
from diagnosis.channels.kinematics import StanceSignals, standing_feet
from diagnosis.channels.stack import stacked
from diagnosis.library.drive import ViscousEntry
from diagnosis.library.rigid_body import LegMassEntry
from spot_log.read.run import CommandTable, StateTable
from spot_model.effects.drivetrain import TorqueBandwidth
from spot_model.effects.friction import Armature, ViscousFriction
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.plant.delay import ConstantDelay
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from trainer.signals.recording import record
from trainer.signals.smoothing import smooth

from .cases import NOMINAL
from .planted import Noise, Truth, planted_runs, walk_sequence

WALK_POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"


def views_of(runs, model=NOMINAL, **options):
    return build_views(stacked([record(r) for r in runs]), model, **options)


def median(view, row):
    index = view.rows.index(row)
    return float(np.median(view.response[view.usable[:, index], index]))


def robust_scale(view):
    """Median size of usable samples over the noise, as a standard deviation; shape (R,)."""
    return np.array(
        [
            1.4826 * np.median(np.abs(view.response[view.usable[:, i], i])) / view.noise[i]
            for i in range(len(view.rows))
            if view.usable[:, i].any()
        ]
    )


@pytest.fixture(scope="module")
def null_runs():
    return planted_runs(Truth(), 2, sequence=walk_sequence(3.0))


@pytest.fixture(scope="module")
def null(null_runs):
    views, off = views_of(null_runs)
    assert off == ()
    return views


def test_every_channel_is_on_and_in_order(null):
    assert tuple(null) == tuple(Channel)


@pytest.mark.parametrize(
    "name",
    [
        Channel.POLICY_REPLAY,
        Channel.TIME_STAMPS,
        Channel.SENSOR_NOISE,
        Channel.SET_POINT_TO_LOAD,
        Channel.LOAD_TO_MOTION,
        Channel.BASE_WRENCH,
        Channel.INERTIAL_UNIT,
    ],
)
def test_a_nominal_reality_leaves_noise_alone(null, name):
    assert np.max(robust_scale(null[name])) < 2.0


@pytest.mark.parametrize(
    ("step_s", "effects"),
    [
        (0.0005, ()),
        (0.0015, (Armature(inertia_kg_m2=0.04),)),
        (0.0015, (ViscousFriction(damping_nm_s_per_rad=0.3),)),
        (0.0015, (TorqueBandwidth(time_constant_s=0.006),)),
    ],
    ids=["short step", "armature", "viscous", "bandwidth"],
)
def test_channel_a_finds_the_loads_lag_whatever_else_acts(step_s, effects):
    mjcf = dataclasses.replace(Truth().mjcf, timestep_s=step_s)
    runs = planted_runs(Truth(effects=effects, mjcf=mjcf), 2, sequence=walk_sequence(1.5))
    views, _ = views_of(runs)
    assert views[Channel.SET_POINT_TO_LOAD].signals.lag_s == pytest.approx(step_s, abs=0.25e-3)


def test_channel_a_says_when_the_lag_cannot_be_found():
    truth = Truth(transport=ConstantDelay(delay_s=0.005))
    views, _ = views_of(planted_runs(truth, 1, sequence=walk_sequence(2.0)))
    assert "always come at one phase" in views[Channel.SET_POINT_TO_LOAD].notes[0]


def test_channel_t_reads_delays_from_the_robots_stamps():
    runs = planted_runs(Truth(transport=ConstantDelay(delay_s=0.0093)), 1, sequence=walk_sequence(1.0))
    view = views_of(runs)[0][Channel.TIME_STAMPS]
    assert median(view, "delay") == pytest.approx(0.0043, abs=1e-6)
    assert median(view, "lost") == 0.0


def test_channel_l_replays_set_points(null_runs):
    views, _ = views_of(null_runs)
    assert np.max(np.abs(views[Channel.POLICY_REPLAY].response)) < 1e-6


@pytest.mark.skipif(not WALK_POLICY.is_file(), reason="policies/walk.onnx is not there")
def test_a_committed_policy_replays_and_leaves_noise_alone():
    policy = load_policy(WALK_POLICY)
    runs = planted_runs(
        Truth(), 1, sequence=walk_sequence(3.0).clipped([-0.8, -0.5, -1.0], [1.5, 0.5, 1.0]), actor=lambda: policy
    )
    views, _ = views_of(runs, policy=policy)
    assert np.max(np.abs(views[Channel.POLICY_REPLAY].response)) < 1e-6
    assert np.max(robust_scale(views[Channel.SET_POINT_TO_LOAD])) < 1.5
    assert np.max(robust_scale(views[Channel.BASE_WRENCH])) < 2.0


def test_channel_q_sees_a_velocity_that_is_one_state_late(null_runs):
    states = [r.states for r in null_runs]
    late = [
        dataclasses.replace(r, states=dataclasses.replace(s, velocity_rad_s=np.roll(s.velocity_rad_s, 1, axis=0)))
        for r, s in zip(null_runs, states, strict=True)
    ]
    now, then = views_of(null_runs)[0][Channel.JOINT_RATES], views_of(late)[0][Channel.JOINT_RATES]
    signals = now.signals
    column = signals.finish_rate(signals.stack.states.velocity_rad_s)

    def age_s(view):
        good = view.usable[:, 2]
        return -float(np.sum(column[good, 2] * view.response[good, 2]) / np.sum(column[good, 2] ** 2))

    assert age_s(now) == pytest.approx(0.0, abs=0.3e-3)
    assert age_s(then) - age_s(now) == pytest.approx(0.003, rel=0.1)


def test_channels_d_and_b_find_when_the_loads_acted(null):
    # The simulator's torque acts from the start of a step of 1.5 ms, and accelerates over it.
    signals, lag_s = null[Channel.LOAD_TO_MOTION].signals, null[Channel.SET_POINT_TO_LOAD].signals.lag_s
    swinging = null[Channel.LOAD_TO_MOTION].usable[:, ::3]
    load_age_s, position_age_s, _ = realigned(signals, swinging, null[Channel.BASE_WRENCH].usable[:, 0], lag_s)
    assert load_age_s == pytest.approx(0.75e-3, abs=0.1e-3)
    assert position_age_s == pytest.approx(1.5e-3, abs=0.1e-3)


def test_channel_b_weighs_the_robot(null):
    weight_n = 31.6 * 9.81
    assert abs(median(null[Channel.BASE_WRENCH], "force_z")) < 0.005 * weight_n
    for row in ("force_x", "force_y", "moment_x", "moment_y", "moment_z"):
        assert abs(median(null[Channel.BASE_WRENCH], row)) < 0.8


def test_channel_k_standing_feet_stand(null):
    for leg in ("fl", "fr", "hl", "hr"):
        assert abs(median(null[Channel.STANCE_KINEMATICS], f"{leg}_velocity_x")) < 0.02
        assert abs(median(null[Channel.STANCE_KINEMATICS], f"{leg}_velocity_y")) < 0.015
        assert abs(median(null[Channel.STANCE_KINEMATICS], f"{leg}_height")) < 0.001


def test_channel_i_knows_gravity_and_the_age_of_packets(null, null_runs):
    assert null[Channel.BASE_WRENCH].signals.stack.imu_gravity_m_s2 == 9.81
    wrong = [
        dataclasses.replace(
            r,
            states=dataclasses.replace(
                r.states,
                imu=dataclasses.replace(r.states.imu, robot_stamp_ns=r.states.imu.robot_stamp_ns - 14_000_000),
            ),
        )
        for r in null_runs
    ]
    aged = views_of(wrong)[0][Channel.INERTIAL_UNIT]
    vertical = aged.rows.index("acceleration_z")
    assert np.std(aged.response[:, vertical]) > 2.0 * np.std(null[Channel.INERTIAL_UNIT].response[:, vertical])


def test_channel_i_takes_a_unit_without_gravity_for_what_it_is(null_runs):
    def without(run):
        imu = run.states.imu
        up = 2.0 * imu.odom_from_link_wxyz[:, :1] * 0.0 + np.array([0.0, 0.0, 9.81])
        w, xyz = imu.odom_from_link_wxyz[:, :1], -imu.odom_from_link_wxyz[:, 1:]
        in_link = up + 2.0 * np.cross(xyz, np.cross(xyz, up) + w * up)
        changed = dataclasses.replace(
            imu, acceleration_of_imu_in_link_m_s2=imu.acceleration_of_imu_in_link_m_s2 - in_link
        )
        return dataclasses.replace(run, states=dataclasses.replace(run.states, imu=changed))

    views, _ = views_of([without(r) for r in null_runs])
    assert views[Channel.BASE_WRENCH].signals.stack.imu_gravity_m_s2 == 0.0
    assert np.max(robust_scale(views[Channel.INERTIAL_UNIT])) < 1.6
    assert abs(median(views[Channel.BASE_WRENCH], "force_z")) < 2.0


def test_channel_p_recovers_the_supply():
    runs = planted_runs(Truth(noise=Noise()), 3, sequence=walk_sequence(4.0))
    supply = views_of(runs)[0][Channel.BATTERY_POWER].signals
    assert supply.open_voltage_v == pytest.approx(55.0, abs=0.1)
    assert supply.resistance_ohm == pytest.approx(0.045, rel=0.05)
    assert supply.copper_w_per_nm2 == pytest.approx(0.02, rel=0.2)


def test_channel_c_flags_change_with_the_force(null):
    for leg in ("fl", "fr", "hl", "hr"):
        assert abs(median(null[Channel.CONTACT_EVENTS], f"{leg}_flag")) < 4e-3


def test_forces_stand_in_for_contact_flags_that_a_log_lacks(null_runs, null):
    """Feet, wrench and swings are judged all the same; only what compares flags with forces is off."""

    def without_flags(run):
        none = np.zeros((len(run.states), 0), dtype=bool)
        return dataclasses.replace(run, states=dataclasses.replace(run.states, foot_contact=none))

    views, off = views_of([without_flags(run) for run in null_runs], RobotModel())
    assert "no contact flags" in {o.name: o.reason for o in off}[Channel.CONTACT_EVENTS]
    for name in (Channel.STANCE_KINEMATICS, Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH):
        assert views[name].usable.sum() > 0.7 * null[name].usable.sum()
    assert np.max(np.abs([median(views[Channel.STANCE_KINEMATICS], f"{leg}_height") for leg in facts.LEG_NAMES])) < 2e-3
    flags = null[Channel.BASE_WRENCH].signals.contact
    assert np.mean(views[Channel.BASE_WRENCH].signals.contact == flags) > 0.95


def cropped(run, joints, names):
    """The log of a robot with other joints and without a body: some columns of a Spot's."""
    keep = list(joints)
    states, commands = run.states, run.commands
    cut_states = {n: getattr(states, n)[:, keep] for n in ("position_rad", "velocity_rad_s", "load_nm")}
    size = len(states)
    nothing = {
        "position_of_body_in_odom_m": np.full((size, 3), np.nan),
        "odom_from_body_wxyz": np.full((size, 4), np.nan),
        "linear_vel_of_body_in_odom_m_s": np.full((size, 3), np.nan),
        "angular_vel_of_body_in_odom_rad_s": np.full((size, 3), np.nan),
        "foot_contact": np.zeros((size, 0), dtype=bool),
    }
    columns = {
        f.name: getattr(commands, f.name)[:, keep]
        for f in dataclasses.fields(CommandTable)
        if getattr(commands, f.name).ndim == 2
    }
    assert isinstance(states, StateTable)
    return dataclasses.replace(
        run,
        header=dataclasses.replace(run.header, joint_names=names, foot_names=(), policy_contract_json=""),
        states=dataclasses.replace(states, **cut_states, **nothing),
        commands=dataclasses.replace(commands, **columns),
    )


def test_another_robot_keeps_what_needs_no_body(null_runs):
    runs = [cropped(r, (1, 2, 5), ("shoulder", "elbow", "wrist")) for r in null_runs]
    views, off = views_of(runs, RobotModel())
    assert {Channel.SET_POINT_TO_LOAD, Channel.TIME_STAMPS, Channel.SENSOR_NOISE, Channel.JOINT_RATES} <= set(views)
    assert views[Channel.SET_POINT_TO_LOAD].rows == ("shoulder", "elbow", "wrist")
    assert np.max(robust_scale(views[Channel.SET_POINT_TO_LOAD])) < 1.6
    reasons = {o.name: o.reason for o in off}
    assert reasons[Channel.LOAD_TO_MOTION] == reasons[Channel.BASE_WRENCH] == "no body model of this robot"
    assert "no policy contract" in reasons[Channel.POLICY_REPLAY]


def test_missing_signals_switch_off_the_channels_that_need_them(null_runs):
    def without_load(run):
        return dataclasses.replace(
            run, states=dataclasses.replace(run.states, load_nm=np.full_like(run.states.load_nm, np.nan))
        )

    _, off = views_of([without_load(r) for r in null_runs])
    reasons = {o.name: o.reason for o in off}
    # The servo law stands in for the loads where the body's motion is the other side.
    assert set(reasons) == {Channel.SET_POINT_TO_LOAD, Channel.BATTERY_POWER}
    assert reasons[Channel.SET_POINT_TO_LOAD] == "no measured joint torque"


def test_logs_of_two_robots_are_refused(null_runs):
    other = cropped(null_runs[1], (1, 2, 5), ("shoulder", "elbow", "wrist"))
    with pytest.raises(BadInputError, match="diagnose logs of one robot at a time"):
        stacked([record(null_runs[0]), record(other)])


def test_long_logs_are_thinned_and_tell_what_all_rows_tell(null_runs, monkeypatch):
    monkeypatch.setattr("diagnosis.channels.MAX_SAMPLES", 10**9)
    whole, _ = views_of(null_runs)
    monkeypatch.setattr("diagnosis.channels.MAX_SAMPLES", sum(len(run.states) for run in null_runs) // 12)
    thin, _ = views_of(null_runs)
    loads = {Channel.SET_POINT_TO_LOAD: 6, Channel.JOINT_RATES: 6}
    for name, apart in (loads | {Channel.LOAD_TO_MOTION: 3, Channel.STANCE_KINEMATICS: 3}).items():
        every, some = whole[name], thin[name]
        assert some.n == pytest.approx(every.n / apart, rel=0.1)
        rows = np.flatnonzero(np.isin(every.run * 10**6 + every.state, some.run * 10**6 + some.state))
        np.testing.assert_array_equal(every.response[rows], some.response)
        np.testing.assert_array_equal(every.noise, some.noise)
    for entry, name in (
        (ViscousEntry(), Channel.SET_POINT_TO_LOAD),
        (LegMassEntry(), Channel.LOAD_TO_MOTION),
        (LegMassEntry(), Channel.BASE_WRENCH),
    ):
        every, some = whole[name], thin[name]
        rows = np.flatnonzero(np.isin(every.run * 10**6 + every.state, some.run * 10**6 + some.state))
        joints = np.arange(12) < 3
        np.testing.assert_allclose(entry.columns(some, {}, joints), entry.columns(every, {}, joints)[rows], atol=1e-9)


@pytest.fixture(scope="module")
def signals() -> tuple[DynamicsSignals, StanceSignals]:
    views, _ = build_views(
        stacked([record(run) for run in planted_runs(Truth(), 1, sequence=walk_sequence(3.0))]), NOMINAL
    )
    return views[Channel.LOAD_TO_MOTION].signals, views[Channel.STANCE_KINEMATICS].signals


@pytest.mark.parametrize("name", ["load_nm", "position_rad", "velocity_rad_s", "acceleration_rad_s2"])
def test_changed_inputs_use_what_they_leave_as_it_is(signals: tuple[DynamicsSignals, StanceSignals], name: str) -> None:
    d, _ = signals
    changes = {name: getattr(d.inputs, name) + 0.01 * (np.arange(12) == 4)}
    new, afresh = d.with_inputs(**changes), residuals(d.model, replace(d.inputs, **changes))
    for f in fields(new):
        np.testing.assert_array_equal(getattr(new, f.name), getattr(afresh, f.name))
    assert not np.array_equal(new.base, d.reference.base)


@pytest.mark.parametrize("name", ["position_rad", "velocity_rad_s", "foot_radius_m"])
def test_what_smoothed_signals_change_is_what_the_signals_change(
    signals: tuple[DynamicsSignals, StanceSignals], name: str
) -> None:
    """Where a foot stands, the channel's response to a change can be had at the kept rows alone."""
    _, k = signals
    step = 0.01 * (np.arange(getattr(k.raw, name).shape[-1]) == 2)
    raw, new = (replace(x, **{name: getattr(x, name) + step}) for x in (k.raw, k.inputs))
    afresh = smooth(standing_feet(k.raw, k.standing), k.rows) - smooth(standing_feet(raw, k.standing), k.rows)
    got = k.correction(Channel.STANCE_KINEMATICS, name, **{name: getattr(new, name)})
    stands = np.repeat(k.stack.inner(k.standing)[k.rows], 3, axis=1)
    afresh, got = afresh[:, :12][stands], got[:, :12][stands]
    assert np.abs(afresh).max() > 0.0
    np.testing.assert_allclose(got, afresh, atol=0.03 * np.abs(afresh).max())
