"""Which effects are differences."""

from __future__ import annotations

from diagnosis.library.registry import LIBRARY
from diagnosis.verdict.causes import CALIBRATED, decide
from diagnosis.verdict.evidence import explain
from spot_model.effects.friction import CoulombFriction

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence


def test_residuals_decide_what_is_there() -> None:
    friction = CoulombFriction(joints=("knees",), level_nm=3.0)
    runs = planted_runs(Truth((friction,)), 3, sequence=walk_sequence(3.0))
    few = {name: LIBRARY[name] for name in ("coulomb_friction", "armature")}
    found = explain(runs, NOMINAL, None, few, lambda _: None)
    decided = decide(found, few)
    assert decided.stated == "coulomb_friction"
    assert decided.belief.there["coulomb_friction"] > 0.8
    assert set(decided.hypotheses) == {"coulomb_friction", CALIBRATED}


def test_what_is_probably_not_there_is_left_out() -> None:
    runs = planted_runs(Truth(()), 3, sequence=walk_sequence(3.0))
    decided = decide(explain(runs, NOMINAL, None, LIBRARY, lambda _: None), LIBRARY)
    assert decided.stated == CALIBRATED
    assert decided.found.selection.best.terms == ()
