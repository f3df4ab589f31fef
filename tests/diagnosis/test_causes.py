"""Which effects are causes where closed loops cannot be run."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from diagnosis.library.registry import LIBRARY
from diagnosis.verdict import causes
from diagnosis.verdict.explain import explain
from spot_model.effects.drive.coulomb_friction import CoulombFriction

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence


def test_a_set_that_cannot_be_simulated_is_judged_by_the_residuals_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    friction = CoulombFriction(joints=("knees",), level_nm=3.0)
    runs = planted_runs(Truth((friction,)), 3, sequence=walk_sequence(3.0))
    few = {name: LIBRARY[name] for name in ("coulomb_friction", "armature")}
    found = explain(runs, NOMINAL, None, few, lambda _: None)
    assert found.effects == ("coulomb_friction",)

    def tried(*_: Any) -> causes.Tried:
        return causes.Tried({"nominal": 3.0, causes.CALIBRATED: 2.9}, ("coulomb_friction cannot be simulated: bounds",))

    monkeypatch.setattr(causes, "try_out", tried)
    bench: Any = object()
    decided = causes.decide(found, NOMINAL, bench, few, np.random.default_rng(0))
    assert decided.belief.there["coulomb_friction"] > 0.8
    assert not decided.belief.nearer
    assert "cannot be simulated" in decided.notes[0]
