"""Logs without loads: the servo law stands in for them, and what a drive really gave shows in the motion."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from diagnosis.channels import Channel, Views
from diagnosis.channels.build import build_views
from diagnosis.channels.dynamics import wrench_of_joints
from diagnosis.channels.stack import stack
from diagnosis.library import with_stand_in
from diagnosis.library.registry import LIBRARY
from diagnosis.verdict.explanation import Explanation, explain
from spot_log.read.run import Run
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.friction import ViscousFriction
from trainer.signals.recording import record

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence

FEW = {
    name: LIBRARY[name]
    for name in ("torque_gain", "viscous_friction", "coulomb_friction", "armature", "leg_mass", "load_sensor_gain")
}
KNEES = ("fl_kn", "fr_kn", "hl_kn", "hr_kn")


def _without_loads(truth: Truth) -> list[Run]:
    runs = planted_runs(truth, 2, sequence=walk_sequence(4.0))
    return [
        dataclasses.replace(
            run, states=dataclasses.replace(run.states, load_nm=np.full_like(run.states.load_nm, np.nan))
        )
        for run in runs
    ]


@pytest.fixture(scope="module")
def views() -> Views:
    found, _ = build_views(stack([record(run) for run in _without_loads(Truth(()))]), NOMINAL)
    return found


def _explained(truth: Truth) -> Explanation:
    return explain(_without_loads(truth), NOMINAL, None, FEW, lambda _: None)


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

    on, off = build_views(stack([record(without_gains(run)) for run in _without_loads(Truth(()))]), NOMINAL)
    assert not on.keys() & {Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH}
    assert "no joint torques" in {c.name: c.reason for c in off}[Channel.BASE_WRENCH]


@pytest.mark.parametrize("joint", [0, 4, 11])
def test_a_newton_metre_at_a_joint_shows_in_the_wrench_as_inverse_dynamics_have_it(views: Views, joint: int) -> None:
    signals = views[Channel.BASE_WRENCH].signals
    more = signals.inputs.load_nm + (np.arange(12) == joint)
    base = signals.with_inputs(("one", joint), load_nm=more).base - signals.reference.base
    assert base == pytest.approx(wrench_of_joints(signals)[:, joint], rel=1e-6, abs=1e-9)
