"""A formula for what no effect explains: its terms, numbers and units come back, and its file is an effect."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from diagnosis.document import Formula, UnknownEffect
from diagnosis.library.registry import LIBRARY, chosen_library
from diagnosis.report.effect_file import effect_source, formula_text
from diagnosis.selection.evidence import Evidence
from diagnosis.selection.formula import find_formula
from diagnosis.selection.scoring import Scorer
from diagnosis.selection.search import search
from spot_model.effects.base import Motion, TorqueEffect
from spot_model.robot import facts

from .cases import drive_evidence


class _Spring(TorqueEffect):
    """A spring across a hip."""

    name = "planted_spring"
    at = "fl_hy"

    def added(self, torque, q, v):
        return -25.0 * (q - 0.8)

    def torque(self, torque_nm, motion: Motion, memory):
        mine = np.array([name == self.at for name in facts.JOINT_NAMES])
        return torque_nm + mine * self.added(torque_nm, motion.position_rad, motion.velocity_rad_s), memory

    @property
    def is_null(self) -> bool:
        return False


class _Bearing(_Spring):
    """A bearing that rubs about one angle."""

    name, at = "planted_bearing", "hr_kn"

    def added(self, torque, q, v):
        return -6.0 * np.exp(-(((q + 1.65) / 0.08) ** 2)) * np.tanh(v / 0.1)


class _Drag(_Spring):
    """Drag of oil."""

    name, at = "planted_drag", "fr_kn"

    def added(self, torque, q, v):
        return -0.25 * v * np.abs(v)


def _board(effect: TorqueEffect) -> tuple[Evidence, UnknownEffect]:
    board = drive_evidence(effect)[1]
    joints = np.array([name == effect.at for name in facts.JOINT_NAMES])
    formula = find_formula(board, Scorer(board, ()).residuals(), joints)
    return board, UnknownEffect(joints=(effect.at,), regime="", depends_on=(), formula=formula)


def _told(effect: TorqueEffect) -> tuple[Evidence, UnknownEffect, Formula]:
    board, unknown = _board(effect)
    assert unknown.formula is not None
    return board, unknown, unknown.formula


def test_a_spring_is_told_by_its_stiffness() -> None:
    _, unknown, formula = _told(_Spring())
    linear = next(t for t in formula.terms if t.code == "q")
    assert linear.value == pytest.approx(-25.0, rel=0.25)
    assert linear.unit == "N·m/rad"
    assert "N·m/rad·q" in formula_text(formula)
    assert "self.c1 * q" in (effect_source(unknown) or "")


def test_a_bearing_that_rubs_is_told_with_its_angle() -> None:
    _, _, formula = _told(_Bearing())
    rub = max((t for t in formula.terms if t.at_rad is not None), key=lambda t: abs(t.value))
    assert "smooth_sign(v)" in rub.code
    assert rub.at_rad == pytest.approx(-1.65, abs=0.05)
    assert rub.value == pytest.approx(-6.0, rel=0.3)


@pytest.mark.parametrize("effect", [_Drag(), _Bearing()], ids=["drag", "bearing"])
def test_the_file_is_an_effect_that_explains_it(
    effect: TorqueEffect, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    board, unknown, formula = _told(effect)
    module = f"unknown_{effect.name}"
    (tmp_path / f"{module}.py").write_text(effect_source(unknown) or "", encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    added = chosen_library([f"{module}:UnknownTorque"], [])["unknown_torque"]
    names = ("coulomb_friction", "viscous_friction", "torque_gain", "armature", "load_friction")
    library = {**{name: LIBRARY[name] for name in names}, "unknown_torque": added}
    best = search(board, library, lambda _: None).best
    term, sizes = next(
        (t, c) for t, c in zip(best.terms, best.coefficients, strict=True) if t.effect.name == "unknown_torque"
    )
    assert board.robot.named(board.robot.joints_of(term.effect, term.place)) == unknown.joints
    found = dict(added.values(sizes, term.shape))
    assert np.sign(found["c1"]) == np.sign(formula.terms[0].value)


def test_noise_has_no_formula() -> None:
    class Nothing(_Spring):
        """No effect at all."""

        def added(self, torque, q, v):
            return 0.0 * q

    _, unknown = _board(Nothing())
    assert unknown.formula is None
    assert effect_source(unknown) is None
