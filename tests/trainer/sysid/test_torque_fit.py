from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from spot_log import Run
from spot_model.robot import facts
from spot_model.robot.facts import PAPER_IDENTIFIED, PaperActuator
from trainer.signals.recording import record
from trainer.sysid.config import SysidConfig
from trainer.sysid.torque_fit import TorqueFit, fit_torque
from trainer.sysid.torque_model import NUISANCE_NAMES, TorqueModel, TorqueSamples, friction_direction, torque_samples
from trainer.sysid.verdict import Estimate, ParameterVerdict, is_narrow, judge_parameters

from .conftest import OTHER_PHYSICS, MakeLogs

MODEL = TorqueModel(SysidConfig().space())
NAMES = [p.parameter for p in MODEL.space.parameters]


def fitted(runs: list[Run]) -> tuple[TorqueSamples, TorqueFit]:
    samples = torque_samples([record(run) for run in runs])
    return samples, fit_torque(MODEL, samples, [MODEL.space.initial], np.random.default_rng(0))


def judged(samples: TorqueSamples, fit: TorqueFit) -> dict[str, ParameterVerdict]:
    return {v.name: v for v in judge_parameters(MODEL, samples, fit, MODEL.space.initial, None)}


@pytest.fixture(scope="module")
def strong(logs: list[Run]) -> tuple[TorqueSamples, TorqueFit]:
    return fitted(logs)


CURVE = "torque_speed_curve[knees]."


def test_planted_limits_and_friction_are_found_in_logs_of_another_simulator(
    strong: tuple[TorqueSamples, TorqueFit], strong_truth: PaperActuator
) -> None:
    verdicts = judged(*strong)
    for name in ("torque_max_nm", "torque_min_nm", "speed_min_rad_s", "intersect_min_rad_s"):
        found = verdicts[CURVE + name]
        assert found.identified, found.reason
        assert found.source == "measured torque"
        assert found.value == pytest.approx(getattr(strong_truth, name), rel=0.1)
        assert found.low <= getattr(strong_truth, name) <= found.high
    for joints, level_nm in (("hips", strong_truth.hip_friction_nm), ("knees", strong_truth.knee_friction_nm)):
        assert verdicts[f"coulomb_friction[{joints}].level_nm"].value == pytest.approx(level_nm, abs=0.04)


def test_limits_that_are_never_reached_are_named_and_not_reported(make_logs: MakeLogs) -> None:
    far = PaperActuator(0.1, 0.2, 400.0, -400.0, 150.0, -150.0, 100.0, -100.0)
    found = judged(*fitted(make_logs(far, sequences={"a": 0.0}, n_ticks=200, n_repeats=6)))
    for name in NAMES[2:]:
        verdict = found[CURVE + name]
        assert not verdict.identified
        assert verdict.source == "not identified"
        assert "reached" in verdict.reason or "only together with" in verdict.reason
    assert found["coulomb_friction[knees].level_nm"].identified


def test_what_few_samples_part_from_the_others_is_not_identified(strong: tuple[TorqueSamples, TorqueFit]) -> None:
    samples, fit = strong
    assert fit.nuisance[0] == pytest.approx(OTHER_PHYSICS.timestep_s, abs=0.0006)  # the load is of the step before
    independent = fit.errors.independent_samples.copy()
    independent[NAMES.index("torque_min_nm")] = 25.0
    few = replace(fit, errors=replace(fit.errors, independent_samples=independent))
    assert judged(samples, fit)[CURVE + "torque_min_nm"].identified
    found = judged(samples, few)[CURVE + "torque_min_nm"]
    assert not found.identified
    assert "effectively only 25 distinguish it from the others" in found.reason


def test_a_corner_that_no_sample_reaches_has_no_narrow_interval(
    strong: tuple[TorqueSamples, TorqueFit], strong_truth: PaperActuator
) -> None:
    samples, _ = strong
    before = (samples.velocity_rad_s > 1.1 * strong_truth.intersect_min_rad_s) & (samples.request_nm < 0.0)
    line = replace(samples, position_rad=np.where(before, facts.POSITION_LOW_RAD, samples.position_rad))
    # A start on the sloped line, as a search leaves it: 28 N·m up to where the line says so.
    on_line = {"torque_min_nm": -28.0, "speed_min_rad_s": -12.0, "intersect_min_rad_s": -6.4}
    start = [on_line.get(name, value) for name, value in zip(NAMES, MODEL.space.initial, strict=True)]
    found = judged(line, fit_torque(MODEL, line, [np.array(start)], np.random.default_rng(0)))
    for name in ("torque_min_nm", "intersect_min_rad_s"):
        corner = found[CURVE + name]
        assert not corner.identified, corner
        assert corner.low <= getattr(strong_truth, name) <= corner.high
    assert found[CURVE + "torque_max_nm"].identified
    assert found[CURVE + "speed_min_rad_s"].identified


def test_inertia_between_motor_and_sensor_is_found_beside_the_parameters(make_logs: MakeLogs) -> None:
    armature = replace(OTHER_PHYSICS, armature_kg_m2=(0.04, 0.04, 0.07) * 4)
    _, fit = fitted(make_logs(PAPER_IDENTIFIED, sequences={"a": 0.0}, n_ticks=200, n_repeats=3, mjcf=armature))
    found = dict(zip(NUISANCE_NAMES, fit.nuisance, strict=True))
    assert found["hip inertia"] == pytest.approx(0.04, rel=0.05)
    assert found["knee inertia"] == pytest.approx(0.07, rel=0.05)
    assert fit.values[:2] == pytest.approx([0.008, 0.18], abs=0.03)  # none of it leaks into friction


def test_the_predicted_load_worked_out_by_hand() -> None:
    one = np.ones((1, 12))
    samples = TorqueSamples(
        run=np.zeros(1, dtype=np.intp),
        state=np.zeros(1, dtype=np.intp),
        setpoint_rad=-1.4 * one,
        position_rad=-1.5 * one,
        velocity_rad_s=2.0 * one,
        acceleration_rad_s2=10.0 * one,
        jerk_rad_s3=0.0 * one,
        velocity_doubt_rad_s=0.0 * one,
        kp_nm_per_rad=60.0 * one,
        kd_nm_s_per_rad=1.5 * one,
        load_nm=0.0 * one,
    )
    values = np.array([0.1, 0.4, 100.0, -100.0, 30.0, -30.0, 10.0, -10.0])
    nuisance = np.array([0.0, 0.01, 0.02, 0.03, 0.04, 0.0, 0.0])
    load = MODEL.load_nm(samples, values, nuisance)[0]
    # Request 60 · 0.1 − 1.5 · 2 = 3; hips lose 0.1 + 0.01 · 2 + 0.03 · 10, knees 0.4 + 0.02 · 2 + 0.04 · 10.
    assert load[0] == pytest.approx(3.0 - 0.42)
    assert load[2] == pytest.approx(3.0 - 0.84)


def test_states_at_which_a_new_setpoint_has_just_arrived_are_left_out(logs: list[Run]) -> None:
    samples = torque_samples([record(logs[0])])
    n_states, n_ticks = len(logs[0].states.robot_stamp_ns), len(logs[0].ticks.action)
    assert len(samples) == pytest.approx(n_states - n_ticks, abs=12)
    assert np.all(samples.acceleration_rad_s2[10:-10].std(axis=0) > 0.0)


def test_friction_has_a_direction_only_in_steady_motion() -> None:
    velocity = np.array([0.1, 1.0, -1.0, 1.0, 10.0])
    acceleration = np.array([0.0, 0.0, 0.0, 100.0, 1000.0])
    assert friction_direction(velocity, acceleration).tolist() == [0.0, 1.0, -1.0, 0.0, 0.0]


def test_narrow_means_a_tenth_of_the_value_or_a_small_friction() -> None:
    friction, torque = MODEL.space.parameters[0], MODEL.space.parameters[2]
    assert is_narrow(torque, Estimate(100.0, 91.0, 109.0))
    assert not is_narrow(torque, Estimate(100.0, 89.0, 111.0))
    assert is_narrow(friction, Estimate(0.0, 0.0, 0.08))
    assert not is_narrow(friction, Estimate(0.1, 0.0, 0.2))
