"""One posterior over numbers: laws of a set's value, and what is found with it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from diagnosis.library.registry import LIBRARY
from diagnosis.selection.normal_equations import ColumnProducts, OrdinarySums, solved
from diagnosis.selection.scoring import Scored, Scorer, _occam, realistic_range
from diagnosis.selection.search import search_effects
from diagnosis.verdict.diagnose import diagnose_runs
from spot_log.format.records import RunHeader
from spot_log.read.run import Run, run_of_columns
from spot_model.effects.base import Effect
from spot_model.effects.drivetrain import TorqueGain, TorqueRipple
from spot_model.effects.joint_sensors import EncoderOffset
from spot_model.effects.torque_limits import TorqueLimit
from spot_model.io.model_file import RobotModel

from .cases import NOMINAL, drive_evidence, evidence_over
from .planted import Truth, planted_runs, walk_sequence

GAIN = LIBRARY["torque_gain"]
KNEE = np.eye(12)[2]


def test_what_a_wide_number_adds_is_a_ratio_of_marginal_likelihoods() -> None:
    """y = Zγ + xβ + noise of variance n/w, with γ of spread 1 and β of spread R: each integrated out by hand."""
    rng = np.random.default_rng(0)
    n, weight, wide = 40, np.array([3.0]), np.array([2.0, 0.7])
    z, x, y = rng.normal(size=(n, 3)), rng.normal(size=(n, 2)), rng.normal(size=n)
    known = np.column_stack([z, y])
    sums = OrdinarySums([np.arange(3)], 3, [(known.T @ known / n)[None]])

    def value(columns: np.ndarray, spread: np.ndarray) -> float:
        tried = ColumnProducts.of([columns.T @ known / n], [columns.T @ columns / n])
        far = np.full(len(spread), 100.0)
        pulls, beta, information = solved(sums, sums.total, tried, weight, -far, far, spread**-2)
        left = sums.left(sums.total, tried, pulls, beta)
        size = pulls @ pulls + np.sum((beta / spread) ** 2)
        return float(-0.5 * (weight @ left + size) - _occam(information, spread))

    scatter = np.eye(n) * n / weight + z @ z.T
    by_hand = [multivariate_normal(cov=c).logpdf(y) for c in (scatter + (x * wide**2) @ x.T, scatter)]
    assert value(x, wide) - value(x[:, :0], wide[:0]) == pytest.approx(by_hand[0] - by_hand[1])


def _weak_knee() -> Scored:
    return Scorer(drive_evidence(TorqueGain(joints=("fl_kn",), gain=0.64))[1]).scored(GAIN, {}, KNEE)


def test_twice_the_range_costs_log_two_less_what_the_number_saves(monkeypatch: pytest.MonkeyPatch) -> None:
    (wide,), first = realistic_range(GAIN), _weak_knee()
    monkeypatch.setattr(type(GAIN), "largest", {"gain": 2.0 * wide})
    second = _weak_knee()
    saved = 0.5 * 0.36**2 * (wide**-2 - (2.0 * wide) ** -2)
    assert second.value - first.value == pytest.approx(saved - np.log(2.0), abs=0.03)


def test_what_is_out_of_the_ordinary_is_not_shrunk() -> None:
    """Six published spreads."""
    assert _weak_knee().coefficients[0][0] == pytest.approx(-0.36, rel=0.05)


def test_a_number_is_found_at_its_joint_though_others_could_take_it_up() -> None:
    names = ("encoder_offset", "torque_offset", "load_sensor_gain", "torque_gain", "payload_mass", "foot_radius")
    truth = Truth((EncoderOffset(joints=("fl_kn",), offset_rad=0.049),))
    board = evidence_over(planted_runs(truth, 2, sequence=walk_sequence(3.0)))
    best = search_effects(board, {name: LIBRARY[name] for name in names}, lambda _: None).best
    ((term,), (own,)) = best.terms, best.coefficients
    assert (term.effect.name, board.robot.named(term.place > 0.0)) == ("encoder_offset", ("fl_kn",))
    assert own[0] == pytest.approx(0.049, rel=0.1)


def _diagnosed(effects: tuple[Effect, ...], *names: str) -> Any:
    runs = planted_runs(Truth(effects), 2, sequence=walk_sequence(3.0))
    library = {name: LIBRARY[name] for name in names}
    return diagnose_runs(runs, NOMINAL, None, np.random.default_rng(0), lambda _: None, library=library)


def test_joints_with_different_limits_are_terms_of_one_difference() -> None:
    limits = {"fl_kn": 30.0, "hr_hy": 12.0}
    found = _diagnosed(tuple(TorqueLimit(joints=(j,), limit_nm=v) for j, v in limits.items()), "torque_limit")
    terms = found.belief.best.terms
    assert [t.effect.name for t in terms] == ["torque_limit"] * 2
    assert not np.any(terms[0].place * terms[1].place)
    (difference,) = found.verdict.differences
    assert difference.joints == tuple(limits)
    assert {where: own["limit_nm"].value for where, own in difference.by_type.items()} == pytest.approx(
        limits, rel=0.05
    )


def test_a_number_at_its_bound_ends_in_a_verdict_that_says_so() -> None:
    ripple = TorqueRipple(joints=("hl_hy",), amplitude_nm=10.0, cycles_per_rad=12.0)
    found = _diagnosed((ripple, ripple), "torque_ripple")
    (difference,) = found.verdict.differences
    assert (difference.name, difference.joints) == ("torque_ripple", ("hl_hy",))
    assert any("10 N·m" in said for said in found.verdict.held), found.verdict.held


def _arm() -> Run:
    """Two joints that follow sines under a servo law, dry friction in the second; a state each 5 ms."""
    n, rng = 1200, np.random.default_rng(0)
    t, f, dry = np.arange(n) * 0.005, np.array([0.7, 0.9]), np.array([0.0, 1.5])
    asked = 0.6 * np.sin(2 * np.pi * f * t[:, None]) + 0.2 * np.sin(2 * np.pi * (f + 1.3) * t[:, None])
    q, v, rows = np.zeros(2), np.zeros(2), []
    for k in range(n):
        for _ in range(20):
            load = 20.0 * (asked[k] - q) - 0.5 * v - dry * np.tanh(v / 0.01)
            v = v + (load - 0.05 * v) / 0.25 * 0.00025
            q = q + v * 0.00025
        rows.append((q, v, load))
    position, velocity, load = (np.array(own) for own in zip(*rows, strict=True))
    stamps, ones = np.round(t * 1e9).astype(np.int64), np.ones((n, 2))
    states = {
        "robot_stamp_ns": stamps,
        "position_rad": position + 2e-4 * rng.normal(size=(n, 2)),
        "velocity_rad_s": velocity + 5e-3 * rng.normal(size=(n, 2)),
        "load_nm": load + 0.02 * rng.normal(size=(n, 2)),
    }
    commands = {
        "key": np.arange(n),
        "robot_stamp_ns": stamps,
        "position_rad": asked,
        "velocity_rad_s": 0.0 * ones,
        "load_nm": 0.0 * ones,
        "kp_nm_per_rad": 20.0 * ones,
        "kd_nm_s_per_rad": 0.5 * ones,
    }
    header = RunHeader("arm", 0, command_sequence="sines", joint_names=("hip", "knee"), foot_names=())
    return run_of_columns(Path("arm"), header, states=states, commands=commands, ticks={"robot_stamp_ns": stamps[:0]})


def test_kinds_of_one_joint_get_a_verdict() -> None:
    verdict = diagnose_runs([_arm()], RobotModel(), None, np.random.default_rng(0), lambda _: None).verdict
    assert verdict.where[0].joint == "knee"
    assert [(d.name, d.joints) for d in verdict.differences] == [("coulomb_friction", ("knee",))]
