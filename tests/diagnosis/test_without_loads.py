"""Logs without loads: the servo law stands in for them, and what a drive really gave shows in the motion."""

from __future__ import annotations

import dataclasses
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.channels import Channel, Views
from diagnosis.channels.build import build_views
from diagnosis.channels.dynamics import wrench_of_joints
from diagnosis.channels.stack import stacked
from diagnosis.decision_constants import NAMED
from diagnosis.library import lacks_loads, with_stand_in
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.faultless import FAULTLESS
from diagnosis.selection.scoring import crossed
from diagnosis.verdict import belief
from diagnosis.verdict.assemble import verdict_status
from diagnosis.verdict.belief import Belief, decide, most_of_motion
from diagnosis.verdict.calibration import calibrated_numbers
from diagnosis.verdict.explanation import Explanation, weigh
from diagnosis.verdict.measured import Measurements, measured_by_prediction
from spot_log.read.run import Run
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.friction import CoulombFriction, ViscousFriction
from trainer.signals.recording import record

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence

FEW = {
    name: LIBRARY[name]
    for name in ("torque_gain", "viscous_friction", "coulomb_friction", "armature", "leg_mass", "load_sensor_gain")
}
KNEES = ("fl_kn", "fr_kn", "hl_kn", "hr_kn")


def _without_loads(truth: Truth) -> list[Run]:
    return [_blind(run) for run in planted_runs(truth, 2, sequence=walk_sequence(4.0))]


def _blind(run: Run) -> Run:
    unknown = np.full_like(run.states.load_nm, np.nan)
    return dataclasses.replace(run, states=dataclasses.replace(run.states, load_nm=unknown))


@pytest.fixture(scope="module")
def views() -> Views:
    found, _ = build_views(stacked([record(run) for run in _without_loads(Truth(()))]), NOMINAL)
    return found


def _explained(truth: Truth) -> Explanation:
    return weigh(_without_loads(truth), NOMINAL, None, FEW, lambda _: None)


def _joints(found: Explanation) -> dict[str, tuple[str, ...]]:
    best = found.selection.best
    robot = found.board.robot
    return {t.effect.name: robot.named(robot.joints_of(t.effect, t.place)) for t in best.terms}


@pytest.mark.parametrize(
    "fault", [TorqueGain(joints=("knees",), gain=0.8), ViscousFriction(joints=("knees",), damping_nm_s_per_rad=0.6)]
)
def test_what_the_drive_gives_less_is_found_in_the_motion(fault: TorqueGain | ViscousFriction) -> None:
    found = _explained(Truth((fault,)))
    assert _joints(found) == {fault.name: KNEES}
    (coefficient,) = found.selection.best.coefficients[0]
    expected = fault.gain - 1.0 if isinstance(fault, TorqueGain) else fault.damping_nm_s_per_rad
    assert coefficient == pytest.approx(expected, rel=0.25)


def _decided(runs: list[Run]) -> tuple[Belief, Measurements]:
    few = {"coulomb_friction": LIBRARY["coulomb_friction"]}
    found = weigh(runs, NOMINAL, None, few, lambda _: None)
    decided = decide(found, few)
    return decided, measured_by_prediction(found.board, crossed(found.board, decided.best))


def test_the_same_walk_says_less_without_its_loads() -> None:
    """Friction: found with the loads; without them possible, and nothing stands out."""
    fault = CoulombFriction(joints=("knees",), level_nm=3.0)
    runs = planted_runs(Truth((fault,)), 2, sequence=walk_sequence(2.0))
    decided, measured = _decided(runs)
    assert decided.there["coulomb_friction"] > 0.8
    assert {g.gap: g.unit for g in measured.whole.gaps} == {
        "torque": "N·m", "swing-leg torque": "N·m", "body force": "N",
    }  # fmt: skip
    assert verdict_status(decided, measured, 0.0, is_simulated=False) in ("explained", "partly_explained")
    decided, measured = _decided([_blind(run) for run in runs])
    assert decided.found.effects == ("coulomb_friction",)
    assert decided.there == {"coulomb_friction": NAMED}
    assert {g.gap: g.unit for g in measured.whole.gaps} == {"swing-leg torque": "N·m", "body force": "N"}
    assert all(g.high is None or g.high <= 1.0 for g in measured.whole.gaps)
    assert verdict_status(decided, measured, 0.0, is_simulated=False) == "cannot_tell"
    numbers = calibrated_numbers(decided.found.board, decided.best, NOMINAL)
    assert not any(n.stands_out for n in numbers if lacks_loads(LIBRARY[n.effect], decided.found.board.views))
    assert decided.sets[decided.stated][1] <= NAMED


def test_a_drive_lacks_loads_and_a_mass_or_what_other_channels_show_does_not(views: Views) -> None:
    stand_in = with_stand_in(views)
    assert lacks_loads(LIBRARY["torque_gain"], stand_in)
    assert lacks_loads(LIBRARY["armature"], stand_in)
    assert not lacks_loads(LIBRARY["leg_mass"], stand_in)
    assert not lacks_loads(LIBRARY["encoder_offset"], stand_in)
    measured, _ = build_views(stacked([record(run) for run in planted_runs(Truth(()), 1)]), NOMINAL)
    assert not lacks_loads(LIBRARY["torque_gain"], with_stand_in(measured))


@pytest.mark.parametrize(("elsewhere", "most"), [(0.0, 0.0), (2.0, 0.0), (20.0, 20.0)])
def test_only_what_channels_beside_the_motion_add_raises_the_odds(
    monkeypatch: pytest.MonkeyPatch, elsewhere: float, most: float
) -> None:
    entry, channels = LIBRARY["backlash"], {Channel.LOAD_TO_MOTION: 900.0, Channel.SENSOR_NOISE: elsewhere}
    terms = [SimpleNamespace(effect=entry)]
    selection = SimpleNamespace(best=SimpleNamespace(terms=terms), channels={"backlash": channels})
    found: Any = SimpleNamespace(selection=selection, board=SimpleNamespace(views={}))
    assert most_of_motion(found, "backlash") == np.inf
    monkeypatch.setattr(belief, "lacks_loads", lambda *_: True)
    price = FAULTLESS.price("backlash")
    assert most_of_motion(found, "backlash") == pytest.approx(max(most - price, 0.0))


def test_a_right_drive_is_not_blamed() -> None:
    assert _joints(_explained(Truth(()))) == {}


def test_a_load_cell_that_nobody_reads_cannot_be_wrong(views: Views) -> None:
    with_drive = with_stand_in(views)
    assert Channel.SET_POINT_TO_LOAD not in views
    assert not with_drive[Channel.SET_POINT_TO_LOAD].is_measured
    assert LIBRARY["load_sensor_gain"].show(with_drive) == ()
    assert LIBRARY["load_filter"].show(with_drive) == ()
    assert LIBRARY["torque_gain"].show(with_drive)


def test_commands_without_gains_are_no_servo_law() -> None:
    def without_gains(run: Run) -> Run:
        unknown = np.full_like(run.commands.kp_nm_per_rad, np.nan)
        return dataclasses.replace(
            run, commands=dataclasses.replace(run.commands, kp_nm_per_rad=unknown, kd_nm_s_per_rad=unknown)
        )

    on, off = build_views(stacked([record(without_gains(run)) for run in _without_loads(Truth(()))]), NOMINAL)
    assert not on.keys() & {Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH}
    assert "no joint torques" in {c.name: c.reason for c in off}[Channel.BASE_WRENCH]


@pytest.mark.parametrize("joint", [0, 4, 11])
def test_a_newton_metre_at_a_joint_shows_in_the_wrench_as_inverse_dynamics_have_it(views: Views, joint: int) -> None:
    signals = views[Channel.BASE_WRENCH].signals
    more = signals.inputs.load_nm + (np.arange(12) == joint)
    base = signals.with_inputs(load_nm=more).base - signals.reference.base
    assert base == pytest.approx(wrench_of_joints(signals)[:, joint], rel=1e-6, abs=1e-9)
