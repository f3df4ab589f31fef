"""Columns that an entry does not write are its effect's own formula; each against the formula by hand."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from diagnosis.channels import Array, Channel, ChannelView
from diagnosis.channels.actuator import ActuatorSignals, actuator_view
from diagnosis.channels.stack import stacked
from diagnosis.library import acts_last, effect_columns
from diagnosis.library.limits import added_by_sag_nm
from diagnosis.library.registry import LIBRARY, library_entry
from spot_model.effects.base import ModelEffect, ModelFields, TorqueEffect, parameter
from spot_model.effects.friction import smooth_sign
from spot_model.effects.power import BusSag
from spot_model.effects.torque_limits import TorqueSpeedCurve
from spot_model.io.model_file import RobotModel, paper_model
from spot_model.robot.facts import PAPER_IDENTIFIED
from spot_model.robot.joints import select_joints
from trainer.signals.recording import record

from .cases import CASES
from .planted import Truth, planted_runs, walk_sequence

ALL = np.ones(12, dtype=bool)


@pytest.fixture(scope="module")
def runs():
    return planted_runs(Truth(), 2, sequence=walk_sequence(2.0))


@pytest.fixture(scope="module")
def view(runs) -> ChannelView:
    found = actuator_view(stacked([record(r) for r in runs]), ())
    assert isinstance(found, ChannelView)
    return found


def _clipped(s: ActuatorSignals) -> Array:
    return s.finish(np.clip(s.torque_nm, -30.0, 30.0) - s.torque_nm)


@pytest.mark.parametrize(
    ("name", "shape", "by_hand"),
    [
        ("viscous_friction", {}, lambda s: s.finish(-s.velocity_rad_s)),
        ("armature", {}, lambda s: s.finish_rate(-s.inertial_velocity_rad_s)),
        ("torque_gain", {}, lambda s: s.finish(s.torque_nm)),
        ("load_friction", {}, lambda s: s.finish(-np.abs(s.load_nm) * smooth_sign(s.velocity_rad_s))),
        ("torque_limit", {"limit_nm": 30.0}, _clipped),
        ("torque_ripple", {"cycles_per_rad": 60.0}, lambda s: s.finish(np.sin(60.0 * s.position_rad))),
    ],
)
def test_a_column_is_the_effects_own_formula(name, shape, by_hand, view):
    s: ActuatorSignals = view.signals
    used = s.stack.used[s.kept]
    column = LIBRARY[name].columns(view, shape, ALL)[used, :, 0]
    np.testing.assert_allclose(column, by_hand(s)[used], atol=1e-9 * np.max(np.abs(column)) + 1e-9)


@pytest.mark.parametrize("resistance_ohm", [0.0, 0.05, 0.6])
def test_a_voltage_in_rounds_is_that_of_the_effect_step_by_step(resistance_ohm, view):
    s: ActuatorSignals = view.signals
    numbers = {"back_emf_v_s_per_rad": 2.0, "stall_nm_per_v": 1.0, "copper_w_per_nm2": 0.02}
    sag = BusSag(joints=("all",), resistance_ohm=resistance_ohm, **numbers)
    by_step = s.added_nm(sag)
    assert np.abs(by_step).max() > 1.0
    np.testing.assert_allclose(added_by_sag_nm(s, sag), by_step, atol=1e-3)


@pytest.mark.parametrize("name", ["torque_bandwidth", "torque_delay"])
def test_a_faster_formula_is_that_of_the_effect(name, view):
    case = next(c for c in CASES if c.effect == name)
    entry = LIBRARY[name]
    shape = dict(case.values)
    own, effects = entry.columns(view, shape, ALL), effect_columns(entry, view.signals, shape)
    usable = view.usable
    assert np.std((own - effects)[usable]) < 0.2 * np.std(effects[usable])


def test_a_lower_voltage_takes_torque_of_joints_that_the_nominal_model_bounds_by_speed(runs, view):
    knees = next(e for e in paper_model(PAPER_IDENTIFIED).effects if isinstance(e, TorqueSpeedCurve))
    bounded = actuator_view(stacked([record(r) for r in runs]), (knees,))
    assert isinstance(bounded, ChannelView)
    entry, is_knee = LIBRARY["bus_sag"], select_joints(("kn",))
    shape = entry.shapes({Channel.SET_POINT_TO_LOAD: bounded}, ALL)[-1]
    # The curve at full voltage: 25.03 rad/s without load, falling by 97 N·m over 25.03 − 9.48 rad/s.
    assert shape["open_voltage_v"] / shape["back_emf_v_s_per_rad"] == pytest.approx(0.5 * 25.03)
    assert shape["stall_nm_per_v"] * shape["open_voltage_v"] == pytest.approx(0.7 * 97.0 * 25.03 / (25.03 - 9.48))
    weak = {**shape, "stall_nm_per_v": 0.1}
    for about, cut in ((bounded, is_knee), (view, ALL)):
        touched = entry.columns(about, weak, ALL)[:, :, 0].any(axis=0)
        np.testing.assert_array_equal(touched, cut)
    drawn_w = np.maximum(view.signals.load_nm * view.signals.velocity_rad_s, 0.0).sum(axis=1)[view.signals.stack.used]
    too_low_v = 2.0 * float(np.sqrt(weak["resistance_ohm"] * np.quantile(drawn_w, 0.9)))
    assert not entry.columns(view, {**weak, "open_voltage_v": too_low_v}, ALL).any()
    model = RobotModel(effects=(knees,))
    assert entry.add_to(model, weak, ("all",)).effects[-1].mask.tolist() == is_knee.tolist()
    assert entry.add_to(RobotModel(), weak, ("all",)).effects[-1].mask.all()
    # A bound by speed that is a cause beside it is no part of the nominal model.
    assert not acts_last(entry)
    assert acts_last(LIBRARY["torque_speed_curve"])


@pytest.mark.parametrize(
    ("told_ohm", "tried_ohm"), [(0.3, {0.3}), (0.03, {0.03, 0.2, 0.6, 1.2}), (0.0, {0.05, 0.2, 0.6, 1.2})]
)
def test_a_supply_has_what_its_battery_told_or_far_more(view, told_ohm, tried_ohm):
    battery = SimpleNamespace(open_voltage_v=50.0, resistance_ohm=told_ohm, copper_w_per_nm2=0.0)
    views = {Channel.SET_POINT_TO_LOAD: view, Channel.BATTERY_POWER: SimpleNamespace(signals=battery)}
    assert {shape["resistance_ohm"] for shape in LIBRARY["bus_sag"].shapes(views, ALL)} == tried_ohm


@dataclass(frozen=True, kw_only=True)
class Grease(ModelEffect):
    """Somebody's own, which says no more than what it edits."""

    name: ClassVar[str] = "grease"
    drag_nm_s_per_rad: Any = parameter(null=0.0, low=0.0, high=5.0, unit="N·m·s/rad", source="made up")

    def edit(self, fields: ModelFields) -> None:
        fields["dof_damping"][:, fields.joint_dofs] += self.drag_nm_s_per_rad * self.mask


def test_a_persons_effect_in_a_nominal_model_predicts_what_it_takes(runs, view):
    with_it = actuator_view(stacked([record(r) for r in runs]), (Grease(joints=("kn",), drag_nm_s_per_rad=0.3),))
    assert isinstance(with_it, ChannelView)
    taken = with_it.response - view.response
    expected = view.signals.finish(0.3 * view.signals.velocity_rad_s) * select_joints(("kn",))
    np.testing.assert_allclose(taken, expected, atol=1e-9)


def test_an_edit_of_damping_is_a_candidate_by_itself(view):
    entry = library_entry(Grease)
    assert [c.name for c in entry.coefficients] == ["drag_nm_s_per_rad"]
    assert (entry.name, entry.channels) == ("grease", (Channel.SET_POINT_TO_LOAD,))
    np.testing.assert_allclose(entry.columns(view, {}, ALL), LIBRARY["viscous_friction"].columns(view, {}, ALL))


@dataclass(frozen=True, kw_only=True)
class Rub(TorqueEffect):
    """A bearing that rubs about one angle."""

    name: ClassVar[str] = "rub"
    level_nm: Any = parameter(null=0.0, low=0.0, high=20.0, unit="N·m", source="made up")
    at_rad: Any = parameter(null=-1.4, low=-2.8, high=0.0, unit="rad", source="made up")
    width_rad: Any = parameter(null=0.2, low=0.02, high=0.5, unit="rad", source="made up")

    def torque(self, torque_nm, motion, memory):
        near = np.exp(-(((motion.position_rad - self.at_rad) / self.width_rad) ** 2))
        return torque_nm - self.level_nm * near * smooth_sign(motion.velocity_rad_s), memory


def test_what_has_no_size_of_its_own_is_searched():
    entry = library_entry(Rub)
    assert [c.name for c in entry.coefficients] == ["level_nm"]
    shapes = entry.shapes({}, ALL)
    assert {tuple(s) for s in shapes} == {("at_rad", "width_rad")}
    assert len(shapes) == 25
    assert {s["at_rad"] for s in entry.refined(shapes[0])} <= {-2.8, -2.8 + 2.8 / 8, -2.8 + 2.8 / 24, -2.8 + 2.8 / 72}


@pytest.mark.parametrize("n_joints", [1, 3, 14])
def test_robots_with_fewer_or_more_joints_have_the_same_columns(n_joints, view):
    wide = np.tile(np.arange(12), 2)[:n_joints]
    narrow = {
        f.name: getattr(view.signals, f.name)[:, wide]
        for f in dataclasses.fields(view.signals)
        if getattr(getattr(view.signals, f.name), "shape", ())[1:] == (12,)
    }
    signals = dataclasses.replace(view.signals, **narrow, cache={})
    for name in ("viscous_friction", "armature", "torque_gain", "thermal_derating"):
        entry = LIBRARY[name]
        every = effect_columns(entry, view.signals, {})[:, wide]
        np.testing.assert_allclose(effect_columns(entry, signals, {}), every, atol=1e-9)
