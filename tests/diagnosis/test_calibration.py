"""The robot's own numbers, and the gaps that they close without a closed loop: planted, and of another hand."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.decision_constants import NAMED, ODD
from diagnosis.document import CalibratedNumber, GapChange
from diagnosis.library import JointGroups
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.robot_models import corrected_model, model_by_joint, with_kind
from diagnosis.selection.scoring import Placed, Scorer, crossed, null_of, posterior_covariance, without_effect
from diagnosis.verdict.calibration import by_type, calibrated_numbers, parameter_numbers
from diagnosis.verdict.explanation import evidence_of
from diagnosis.verdict.measured import gap_changes
from spot_log.read.run import Run
from spot_model.effects.base import Effect
from spot_model.effects.bodies import LegMass, PayloadMass
from spot_model.effects.commands import CommandDelay
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.friction import Armature, CoulombFriction, LoadFriction, ViscousFriction
from spot_model.io.model_file import RobotModel, model_from_data
from spot_model.policy.policy import load_policy
from spot_model.robot.facts import BODY, JOINT_NAMES

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence
from .stranger import Faults, Stranger, thinned, uneven

TYPES = ("hx", "hy", "kn")
POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"
SPOT = JointGroups(JOINT_NAMES, np.repeat(np.arange(4), 3))
Numbers = Mapping[tuple[str, str], CalibratedNumber]


def _board(runs: list[Run], nominal: RobotModel = NOMINAL) -> Evidence:
    return evidence_of(runs, nominal, None, LIBRARY)[3]


def _numbers(board: Evidence, nominal: RobotModel = NOMINAL) -> Numbers:
    return {
        (n.effect, n.where): n
        for n in calibrated_numbers(board, null_of(board), nominal)
        if (n.effect, n.parameter) != ("load_sensor_gain", "bias_nm")
    }


def _gap(board: Evidence, which: str) -> GapChange:
    return next(g for g in gap_changes(board, None, crossed(board, null_of(board))) if g.gap == which)


@cache
def _ordinary_robot(seed: int) -> tuple[Mapping[tuple[str, str], float], Evidence]:
    """Every number of a joint type off by 1.5 of its published standard deviations, as drawn; and its logs."""
    rng = np.random.default_rng(seed)
    truth: dict[tuple[str, str], float] = {}
    effects: list[Effect] = []
    for t in TYPES:
        gain, level, damping, inertia, share, scale = 1.5 * rng.standard_normal(6)
        made: tuple[tuple[Effect, str], ...] = (
            (TorqueGain(joints=(t,), gain=1.0 + 0.06 * gain), "gain"),
            (CoulombFriction(joints=(t,), level_nm=0.15 * abs(level)), "level_nm"),
            (ViscousFriction(joints=(t,), damping_nm_s_per_rad=0.03 * abs(damping)), "damping_nm_s_per_rad"),
            (Armature(joints=(t,), inertia_kg_m2=0.006 * abs(inertia)), "inertia_kg_m2"),
            (LoadFriction(joints=(t,), share=0.02 * abs(share)), "share"),
            (LegMass(joints=(t,), scale=1.0 + 0.02 * scale), "scale"),
        )
        effects += [e for e, _ in made]
        truth |= {(e.name, t): float(getattr(e, name)) for e, name in made}
    return truth, _board(planted_runs(Truth(tuple(effects)), 2, sequence=walk_sequence(4.0), seed=seed))


def _asked(seeds: range) -> list[tuple[float, CalibratedNumber]]:
    found = []
    for seed in seeds:
        truth, board = _ordinary_robot(seed)
        numbers = _numbers(board)
        found += [(value, numbers[key]) for key, value in truth.items() if key in numbers]
    return found


def test_nine_of_ten_intervals_hold_the_truth() -> None:
    asked = _asked(range(30, 33))
    assert len(asked) >= 40
    # Of 40 to 54 intervals of 90 %, at least 80 % hold it with probability 0.97 or more.
    assert np.mean([n.low <= value <= n.high for value, n in asked]) >= 0.8
    assert np.mean([n.stands_out and abs(value - n.nominal) < n.spread for value, n in asked]) == 0.0


def test_what_a_signal_shows_clearly_is_found_within_a_fifth() -> None:
    # Truths that are several half widths of their interval away from the nominal number.
    clear = [(v, n) for v, n in _asked(range(30, 33)) if abs(v - n.nominal) > 2.0 * (n.high - n.low)]
    assert len(clear) >= 8
    wrong = [(v, n) for v, n in clear if abs(n.value - v) > 0.2 * abs(v - n.nominal)]
    assert len(wrong) <= 0.1 * len(clear), wrong


def test_numbers_come_farthest_first_and_what_is_not_shown_is_left_out() -> None:
    _, board = _ordinary_robot(30)
    found = calibrated_numbers(board, null_of(board), NOMINAL)
    far = [abs(n.value - n.nominal) / n.spread for n in found]
    assert far == sorted(far, reverse=True)
    assert all(n.low <= n.value <= n.high for n in found)
    assert not {"ground_friction", "ground_compliance", "sensor_noise"} & {n.effect for n in found}
    # Each zero is its own joint's.
    assert {n.where for n in found if n.effect == "encoder_offset"} <= set(JOINT_NAMES)


def test_a_number_is_counted_from_the_nominal_model() -> None:
    truth = Truth((CoulombFriction(joints=("kn",), level_nm=0.3), TorqueGain(joints=("kn",), gain=0.81)))
    nominal = RobotModel(
        (*NOMINAL.effects, CoulombFriction(joints=("kn",), level_nm=0.6), TorqueGain(joints=("kn",), gain=0.9))
    )
    runs = planted_runs(truth, 2, sequence=walk_sequence(3.0))
    board = _board(runs, nominal)
    numbers = _numbers(board, nominal)
    friction, gain = numbers["coulomb_friction", "kn"], numbers["torque_gain", "kn"]
    assert (friction.nominal, gain.nominal) == (0.6, 0.9)
    assert friction.value == pytest.approx(0.3, abs=0.12)
    assert friction.low < 0.3 < friction.high
    assert gain.value == pytest.approx(0.81, abs=0.02)
    # The file has less friction than the nominal model, and not more: its own effect is lowered.
    file = corrected_model(nominal, board, null_of(board))
    level = _total(file, CoulombFriction, "level_nm")[2::3]
    assert np.mean(level) == pytest.approx(friction.value, abs=0.05)
    read = model_from_data(model_by_joint(file, JOINT_NAMES).to_data())
    assert _total(read, CoulombFriction, "level_nm")[2::3] == pytest.approx(level)


def _total(model: RobotModel, kind: type[Effect], parameter: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    own = [np.broadcast_to(getattr(e, parameter), (1, 12))[0] * e.mask for e in model.effects if isinstance(e, kind)]
    return np.asarray(np.sum(own, axis=0))


def test_a_difference_at_all_joints_has_its_numbers_by_type_and_so_has_the_model() -> None:
    """Public estimates for Spot: 0.040 kg·m² at the hips, 0.073 at the knees."""
    truth = Truth((Armature(joints=("hips",), inertia_kg_m2=0.0403), Armature(joints=("knees",), inertia_kg_m2=0.0731)))
    board = _board(planted_runs(truth, 2, sequence=walk_sequence(4.0)))
    scorer = Scorer(board)
    scored = scorer.scored(LIBRARY["armature"], {}, np.ones(12))
    found = by_type(scorer, scored)
    own = {t: found[t]["inertia_kg_m2"] for t in TYPES}
    for t, value in (("hx", 0.0403), ("hy", 0.0403), ("kn", 0.0731)):
        assert own[t].value == pytest.approx(value, rel=0.1)
        assert own[t].low < value < own[t].high
    model = corrected_model(NOMINAL, board, scored)
    assert _total(model, Armature, "inertia_kg_m2") == pytest.approx(np.tile([0.0403, 0.0403, 0.0731], 4), rel=0.15)
    numbers = {n.where: n for n in calibrated_numbers(board, scored, NOMINAL) if n.effect == "armature"}
    assert numbers["kn"].value == pytest.approx(own["kn"].value, rel=1e-6)
    assert numbers["kn"].stands_out


def test_a_model_without_a_difference_has_nothing_left_of_what_its_types_share() -> None:
    _, board = _ordinary_robot(30)
    scored = crossed(board, Scorer(board).scored(LIBRARY["torque_gain"], {}, np.ones(12)))
    less = without_effect(board, scored, "torque_gain")
    assert less.terms == ()
    assert less.coefficients == ()
    assert less.spread.shape == (2, 0)
    gain = _total(corrected_model(NOMINAL, board, less), TorqueGain, "gain")
    own = gain[gain > 0.0]
    assert np.abs(own - 1.0).max(initial=0.0) < 0.03
    # Other errors stay as they are beside it.
    kept = np.array(board.ordinary.names) != "torque_gain"
    assert np.array_equal(less.pulls[kept], scored.pulls[kept])
    assert without_effect(board, scored, "armature").terms == scored.terms


def test_one_number_serves_where_types_do_not_differ() -> None:
    board = _board(planted_runs(Truth((Armature(inertia_kg_m2=0.04),)), 2, sequence=walk_sequence(4.0)))
    scorer = Scorer(board)
    assert by_type(scorer, scorer.scored(LIBRARY["armature"], {}, np.ones(12))) == {}
    # A limit has no ordinary errors.
    limit = LIBRARY["torque_limit"]
    assert by_type(scorer, scorer.scored(limit, {"limit_nm": 30.0}, np.ones(12))) == {}


def test_the_interval_of_a_shape_reaches_as_far_as_shapes_are_as_good() -> None:
    """A limit that is never met could lie anywhere above."""
    board = _board(planted_runs(Truth(), 2, sequence=walk_sequence(3.0)))
    scorer = Scorer(board)
    found = parameter_numbers(scorer, scorer.scored(LIBRARY["torque_limit"], {"limit_nm": 200.0}, np.ones(12)))
    assert found["limit_nm"].high > 1.4 * 200.0


def test_a_joint_with_a_difference_of_its_own_is_left_out_of_its_type() -> None:
    board = _board(planted_runs(Truth((TorqueGain(joints=("hl_kn",), gain=0.7),)), 2, sequence=walk_sequence(3.0)))
    place = np.array([name == "hl_kn" for name in JOINT_NAMES], dtype=np.float64)
    scored = Scorer(board).scored(LIBRARY["torque_gain"], {}, place)
    knees = next(n for n in calibrated_numbers(board, scored, NOMINAL) if (n.effect, n.where) == ("torque_gain", "kn"))
    assert knees.value == pytest.approx(1.0, abs=0.03)


def test_joints_without_a_difference_that_most_of_their_type_have_are_no_type() -> None:
    board = _board(planted_runs(Truth((TorqueGain(joints=("kn",), gain=0.8),)), 2, sequence=walk_sequence(3.0)))
    place = np.array([name in ("fl_kn", "hl_kn", "hr_kn") for name in JOINT_NAMES], dtype=np.float64)
    scored = Scorer(board).scored(LIBRARY["torque_gain"], {}, place)
    knees = next(n for n in calibrated_numbers(board, scored, NOMINAL) if (n.effect, n.where) == ("torque_gain", "kn"))
    assert knees.value == pytest.approx(0.8, abs=0.03)


def test_the_variance_of_a_sum_is_not_the_sum_of_variances() -> None:
    """What a type's joints have in common may be their own or the type's; their sum is told far better."""
    _, board = _ordinary_robot(31)
    covariance = posterior_covariance(board, null_of(board))
    kind = next(k for k in board.ordinary.kinds if k.effect.name == "torque_gain")
    knees = SPOT.types()["kn"]
    row = np.zeros(board.ordinary.size)
    columns = kind.columns(0)
    row[columns] = [(s & knees).sum() / 4.0 for s in kind.sets] * board.ordinary.scale[columns]
    assert row @ covariance @ row < 0.5 * (row**2 @ np.diag(covariance))


def test_terms_and_errors_share_one_covariance() -> None:
    _, board = _ordinary_robot(31)
    scored = Scorer(board).scored(LIBRARY["torque_gain"], {}, np.ones(12))
    covariance = posterior_covariance(board, scored)
    assert covariance.shape == (board.ordinary.size + 1,) * 2
    assert covariance == pytest.approx(covariance.T, abs=1e-9)
    assert np.linalg.eigvalsh(covariance).min() > -1e-9
    # A coefficient at its bound is known.
    none = dataclasses.replace(
        scored,
        terms=(Placed(LIBRARY["armature"], {}, np.ones(12)),),
        coefficients=(np.zeros(1),),
    )
    assert not posterior_covariance(board, none)[-1].any()


def _kind(name: str) -> Any:
    return SimpleNamespace(effect=LIBRARY[name], at={})


def test_errors_go_into_a_model_as_far_as_bodies_allow() -> None:
    nominal = RobotModel((CoulombFriction(joints=("kn",), level_nm=0.2), Armature(joints=("all",), inertia_kg_m2=0.01)))
    change = np.zeros((12, 1))
    change[2::3, 0] = [-0.05, -0.5, 0.4, 0.0]
    model = with_kind(nominal, SPOT, _kind("coulomb_friction"), change)
    assert _total(model, CoulombFriction, "level_nm")[2::3] == pytest.approx([0.15, 0.0, 0.6, 0.2])
    less = np.full((12, 1), -0.004)
    model = with_kind(nominal, SPOT, _kind("armature"), less)
    assert _total(model, Armature, "inertia_kg_m2") == pytest.approx(0.006)
    # Far beyond what is ordinary, and still a gain that a drive can have.
    weak = with_kind(RobotModel(), SPOT, _kind("torque_gain"), np.full((12, 1), -0.4))
    assert _total(weak, TorqueGain, "gain") == pytest.approx(0.6)
    absurd = with_kind(RobotModel(), SPOT, _kind("torque_gain"), np.full((12, 1), -3.0))
    assert _total(absurd, TorqueGain, "gain") == pytest.approx(0.1)


# ---- a robot of another hand: a slow walk, one run at some 55 Hz, loads, no policy, contacts or receipts

SLOW = {"slow": ((0, 0, 0, 0), (0.1, 0.25, 0, 0), (1, 0.3, 0, 0))}
WEAK = Faults(gain={"kn": 0.85, "hx": 0.95, "hy": 0.93}, load_share={"kn": 0.06, "hx": 0.04, "hy": 0.04})
"""Gains well below 1, alike for each joint type, and some per cent of friction that grows with load."""


@cache
def _slow_walk(seed: int) -> tuple[Stranger, Evidence]:
    robot = Stranger(load_policy(POLICY), seed, WEAK)
    run = robot.walk(SLOW, 1, 8.0)[0]
    coarse = thinned(run, uneven(len(run.states), np.random.default_rng(seed)))
    return robot, _board([coarse], RobotModel((CommandDelay(delay_s=0.004),)))


@pytest.mark.parametrize("seed", [3, 4])
def test_a_slow_walk_of_another_hand_tells_gains_by_type(seed: int) -> None:
    robot, board = _slow_walk(seed)
    numbers, held = _numbers(board), []
    for t, joints in board.robot.types().items():
        truth, found = float(robot.gain[joints].mean()), numbers["torque_gain", t]
        assert found.value == pytest.approx(truth, abs=max(0.2 * abs(1.0 - truth), 0.035))
        held.append(found.low < truth < found.high)
    # One in ten may miss.
    assert sum(held) >= 2
    assert numbers["load_friction", "kn"].value == pytest.approx(0.06, rel=0.2)
    # Three published spreads: far more probable to be odd than before anything was seen, and still no finding.
    assert ODD < numbers["load_friction", "kn"].probability < NAMED


@pytest.mark.parametrize("seed", [3, 4])
def test_the_torque_gap_closes_as_far_as_a_direct_fit_closes_it(seed: int) -> None:
    _, board = _slow_walk(seed)
    torque = _gap(board, "torque")
    assert torque.unit == "N·m"
    assert torque.share is not None
    assert torque.low is not None
    before, after = _directly(board)
    assert torque.before == pytest.approx(before, rel=0.1)
    assert torque.share == pytest.approx((before - after) / (before - torque.floor), abs=0.1)
    assert torque.low > 0.8


def _directly(board: Evidence) -> tuple[float, float]:
    """Mispredicted load, and what a gain, a zero and friction of each joint leave by plain least squares, N·m."""
    view = board.views[Channel.SET_POINT_TO_LOAD]
    signals: Any = view.signals
    torque, velocity = signals.finish(signals.torque_nm), signals.finish(signals.velocity_rad_s)
    before, after = [], []
    for j in range(12):
        rows = view.usable[:, j]
        y = view.response[rows, j]
        sign, size = np.tanh(velocity[rows, j] / 0.05), np.abs(torque[rows, j])
        x = np.stack([torque[rows, j], sign, sign * size, np.ones(rows.sum())], axis=1)
        before.append(np.mean(y**2))
        after.append(np.mean((y - x @ np.linalg.lstsq(x, y, rcond=None)[0]) ** 2))
    return float(np.sqrt(np.mean(before))), float(np.sqrt(np.mean(after)))


def test_what_a_log_cannot_show_is_no_gap() -> None:
    _, board = _slow_walk(3)
    found = {g.gap: g for g in gap_changes(board, None, crossed(board, null_of(board)))}
    # A state every 18 ms says too little of accelerations: joint rates stand for the joints' motion.
    assert found["joint velocity"].unit == "rad/s"
    assert found.keys() & {"body force", "body acceleration", "body velocity"} == set()


def test_the_body_s_gap_closes_with_its_mass() -> None:
    board = _board(planted_runs(Truth((PayloadMass(mass_kg=4.0),)), 2, sequence=walk_sequence(3.0)))
    scored = Scorer(board).scored(LIBRARY["payload_mass"], {}, np.ones(1))
    gaps = {g.gap: g for g in gap_changes(board, None, crossed(board, scored))}
    assert gaps["body force"].unit == "N"
    assert gaps["body force"].before == pytest.approx(4.0 * 9.81 / np.sqrt(3.0), rel=0.15)
    assert (gaps["body force"].share or 0.0) > 0.9
    assert (gaps["torque"].share or 0.0) < 0.2
    # Against itself nothing closes.
    assert all((g.share or 0.0) == 0.0 for g in gap_changes(board, crossed(board, scored), crossed(board, scored)))


def test_the_corrected_model_predicts_runs_that_it_was_not_fitted_to() -> None:
    """A fit of two runs to pure noise must not close a gap: it is tested on the other run."""
    _, board = _ordinary_robot(32)
    right = crossed(board, null_of(board))
    wrong = dataclasses.replace(right, fold_pulls=-right.fold_pulls)
    torque = {g.gap: g for g in gap_changes(board, right, wrong)}["torque"]
    assert torque.after > torque.before
    assert torque.share is None or torque.share < 0.0


def test_the_centre_of_mass_is_that_of_the_body_with_the_nominal_model_s_payload() -> None:
    payload = PayloadMass(mass_kg=4.0, x_m=0.1, z_m=0.12)
    nominal = NOMINAL.with_effects(payload)
    board = _board(planted_runs(Truth(effects=(payload,)), 2, sequence=walk_sequence(3.0)), nominal)
    found = {n.parameter: n for n in calibrated_numbers(board, null_of(board), nominal) if n.effect == "com_offset"}
    expected = {
        axis: 4.0 * (at - com) / (BODY.mass_kg + 4.0)
        for axis, at, com in zip("xz", (0.1, 0.12), BODY.com_m[::2], strict=True)
    }
    for axis, shift_m in expected.items():
        assert found[f"{axis}_m"].nominal == pytest.approx(shift_m)
        assert found[f"{axis}_m"].value == pytest.approx(shift_m, abs=0.004)
