"""A model that was corrected is corrected again: numbers add up, what is gone goes, and the model does not grow."""

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import stacked
from diagnosis.decision_constants import ERROR_SCALES
from diagnosis.document import Difference, Number
from diagnosis.library import JointGroups
from diagnosis.library.registry import LIBRARY
from diagnosis.library.repairs import with_repairs
from diagnosis.report import words
from diagnosis.selection.evidence import lay_out
from diagnosis.selection.robot_models import effects_merged, model_by_joint
from diagnosis.selection.search import search_effects
from spot_model.effects.base import Effect
from spot_model.effects.drivetrain import TorqueGain
from spot_model.effects.friction import CoulombFriction
from spot_model.effects.joint_sensors import EncoderOffset
from spot_model.effects.torque_limits import TorqueLimit
from spot_model.io.model_file import RobotModel, model_from_data
from spot_model.robot.facts import JOINT_NAMES
from trainer.signals.recording import record

from .cases import NOMINAL
from .planted import Truth, planted_runs

WORN = CoulombFriction(joints=("fr_kn",), level_nm=2.0)
FRICTION = LIBRARY["coulomb_friction"]


def found_with(truth: tuple[Effect, ...], nominal: RobotModel) -> list[tuple[str, tuple[str, ...], float]]:
    """Friction and torque gains that planted loads show beside a nominal model: name, joints, value."""
    logs = stacked([record(run) for run in planted_runs(Truth(effects=truth), 2)])
    view = build_views(logs, nominal)[0][Channel.SET_POINT_TO_LOAD]
    robot = JointGroups(logs.joint_names, logs.legs)
    board = lay_out({view.name: view}, robot, range(2), ["0", "1"], library=LIBRARY, scales=ERROR_SCALES)
    library = with_repairs({name: LIBRARY[name] for name in ("coulomb_friction", "torque_gain")}, nominal)
    best = search_effects(board, library, lambda _: None).best
    return [
        (
            t.effect.name,
            robot.named(robot.joints_of(t.effect, t.place)),
            next(iter(t.effect.values(c, t.shape).values())),
        )
        for t, c in zip(best.terms, best.coefficients, strict=True)
    ]


def test_friction_that_is_gone_is_found_as_less_of_it() -> None:
    ((name, joints, level_nm),) = found_with((), NOMINAL.with_effects(WORN))
    assert (name, joints) == ("coulomb_friction", ("fr_kn",))
    assert level_nm == pytest.approx(-2.0, abs=0.2)


def test_a_gain_that_falls_again_is_found_as_the_ratio() -> None:
    before = TorqueGain(joints=("fr_kn",), gain=0.9)
    ((name, joints, gain),) = found_with(
        (before, TorqueGain(joints=("fr_kn",), gain=0.7)), NOMINAL.with_effects(before)
    )
    assert (name, joints) == ("torque_gain", ("fr_kn",))
    assert gain == pytest.approx(0.7, abs=0.03)


def test_nothing_is_found_against_a_model_that_holds_it() -> None:
    assert found_with((WORN,), NOMINAL.with_effects(WORN)) == []


def test_less_of_an_effect_lowers_the_models_own() -> None:
    model = RobotModel((CoulombFriction(joints=("kn",), level_nm=0.2), WORN))
    (entry,) = with_repairs({"coulomb_friction": FRICTION}, model).values()
    assert entry.coefficients[0].low == pytest.approx(-2.2)
    assert FRICTION.coefficients[0].low == 0.0
    values = entry.values(np.array([-1.9]), {})
    less = entry.add_to(model, values, ("fr_kn",))
    total = sum(np.where(e.mask, e.level_nm, 0.0) for e in less.effects)
    assert dict(zip(JOINT_NAMES, total, strict=True))["fr_kn"] == pytest.approx(0.3)
    assert dict(zip(JOINT_NAMES, total, strict=True))["fl_kn"] == pytest.approx(0.2)
    assert entry.add_to(model, {"level_nm": 0.5}, ("fl_kn",)).effects[-1].level_nm == 0.5


def test_an_ordinary_nominal_friction_is_none_to_be_repaired() -> None:
    model = RobotModel((CoulombFriction(joints=("kn",), level_nm=0.2),))
    assert with_repairs({"coulomb_friction": FRICTION}, model)["coulomb_friction"] is FRICTION


def test_less_is_said() -> None:
    d = Difference(
        name="coulomb_friction",
        title="dry friction",
        probability=0.8,
        group=("coulomb_friction",),
        joints=("fr_kn",),
        split_by="",
        parameters={"level_nm": Number(value=-1.9, low=-2.1, high=-1.7, unit="N·m")},
    )
    assert words.found(d) == "less dry friction at fr_kn"
    more = d.model_copy(update={"parameters": {"level_nm": Number(value=1.9, low=1.7, high=2.1, unit="N·m")}})
    assert words.found(more) == "dry friction at fr_kn"


def test_two_effects_of_a_kind_become_one_with_the_same_numbers() -> None:
    model = RobotModel(
        (
            TorqueGain(joints=("kn",), gain=0.9),
            EncoderOffset(joints=("fl_kn",), offset_rad=0.01),
            TorqueGain(joints=("fr_kn",), gain=0.8),
            EncoderOffset(joints=("fl",), offset_rad=0.002),
        )
    )
    one = effects_merged(model)
    assert [e.name for e in one.effects] == ["torque_gain", "encoder_offset"]
    plain = model_by_joint(one, JOINT_NAMES)
    assert model_from_data(plain.to_data()).digest() == plain.digest()
    gains = {j: e.gain for e in plain.effects if isinstance(e, TorqueGain) for j in e.joints}
    assert gains == pytest.approx({"fl_kn": 0.9, "fr_kn": 0.72, "hl_kn": 0.9, "hr_kn": 0.9})
    offsets = {j: e.offset_rad for e in plain.effects if isinstance(e, EncoderOffset) for j in e.joints}
    assert offsets == pytest.approx({"fl_kn": 0.012, "fl_hx": 0.002, "fl_hy": 0.002})


def test_a_limit_between_two_gains_keeps_them_apart() -> None:
    gain = TorqueGain(joints=("kn",), gain=0.9)
    model = RobotModel((gain, TorqueLimit(joints=("kn",), limit_nm=50.0), gain))
    assert effects_merged(model) == model


def test_a_delay_may_be_shorter_than_the_nominal_one() -> None:
    delay = LIBRARY["command_delay"]
    assert delay.add_to(NOMINAL, {"delay_s": -0.001}, ("all",)).effects[-1].delay_s == pytest.approx(0.004)


def test_an_effect_with_an_error_of_its_own_has_no_second_column() -> None:
    logs = stacked([record(run) for run in planted_runs(Truth(), 1)])
    for effect, columns in ((replace(WORN, level_nm=0.5), 1), (TorqueGain(joints=("kn",), gain=0.9), 0)):
        view = build_views(logs, NOMINAL.with_effects(effect))[0][Channel.SET_POINT_TO_LOAD]
        robot = JointGroups(logs.joint_names, logs.legs)
        board = lay_out({view.name: view}, robot, [0], ["0"], library=LIBRARY, scales=ERROR_SCALES)
        assert board.ordinary.names.count("nominal") == columns
