"""A boot on a lower leg beside a payload: robots of another hand, what residuals alone name."""

from __future__ import annotations

from pathlib import Path

import pytest

from diagnosis.library.registry import LIBRARY
from diagnosis.verdict.explanation import weigh
from spot_model.effects.commands import CommandDelay
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy

from .stranger import BOOT_M, SEQUENCES, Errors, Faults, Stranger

POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"
ERRORS = Errors(gain=0.03, mass=0.03, load_lag_s=(0.001, 0.002), friction_nm=(0.02, 0.1), estimator_lag_s=(0.0, 0.005))
LOWER_LEG_KG = 0.33


@pytest.mark.slow
def test_a_boot_is_named_with_its_mass_and_nothing_in_its_place() -> None:
    kg = 0.5
    policy = load_policy(POLICY)
    robot = Stranger(policy, 1028, Faults(boot_kg={"hl": kg}, payload_kg=5.0), ERRORS)
    runs = robot.walk(SEQUENCES, 1, 5.0)
    found = weigh(runs, RobotModel((CommandDelay(delay_s=0.004),)), policy, LIBRARY, lambda _: None)
    best = found.selection.best
    named = {
        t.effect.name: (found.board.robot.named(found.board.robot.joints_of(t.effect, t.place)), t, c)
        for t, c in zip(best.terms, best.coefficients, strict=True)
    }
    assert set(named) == {"leg_mass", "payload_mass"}
    joints, term, coefficients = named["leg_mass"]
    assert joints == ("hl_kn",)
    values = term.effect.values(coefficients, term.shape)
    # Nearer to the foot less mass swings alike: what is told well is its moment about the knee.
    moment_kg_m = LOWER_LEG_KG * (values["scale"] - 1.0) * values["down_m"]
    assert moment_kg_m == pytest.approx(kg * BOOT_M, rel=0.4)
