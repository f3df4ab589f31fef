"""The best possible answer in the corner: right where the numbers are clear, and in doubt where they are not."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spot_model.robot.facts import JOINT_TYPES
from tests.withheld.simulator.quick import QUICK
from withheld.cases.protocol import CORNER_KINDS
from withheld.measuring.attainable import Corner, learn
from withheld.measuring.summaries import N_SUMMARIES
from withheld.realities.reality import make
from withheld.scoring.corner import ATTAINABLE, corner_rows

from .made_up import fault, outcome, said


def corner(spread: float) -> Corner:
    """Each kind at each joint type pushes one summary of its own."""
    directions = {
        (kind, place): 5.0 * np.eye(N_SUMMARIES)[i * len(JOINT_TYPES) + j]
        for i, kind in enumerate(CORNER_KINDS)
        for j, place in enumerate(JOINT_TYPES)
    }
    own = np.eye(N_SUMMARIES)
    return Corner(np.zeros(N_SUMMARIES), 0.01 * own, spread**2 * own, directions)


def test_a_clear_push_is_named_and_none_is_none() -> None:
    made = corner(0.02)
    for i, kind in enumerate(CORNER_KINDS):
        push = 3.0 * np.eye(N_SUMMARIES)[3 * i]
        assert made.posterior(push)[kind] > 0.99
    assert made.posterior(np.zeros(N_SUMMARIES))[""] > 0.99


def test_errors_as_large_as_the_push_leave_doubt() -> None:
    said_of = corner(3.0).posterior(3.0 * np.eye(N_SUMMARIES)[0])
    assert max(said_of.values()) < 0.6
    assert sum(said_of.values()) == pytest.approx(1.0)


def test_both_answers_stand_side_by_side(tmp_path: Path) -> None:
    hidden = fault("torque_gain").model_copy(update={"kind": "amplifier_gain"})
    some = [
        outcome([hidden], [said("torque_gain")], number=0, kind="corner"),
        outcome((), [said("armature")], number=1, kind="corner"),
        outcome([hidden], number=2, kind="corner", moved=(0.1,)),
        outcome([hidden], number=3, kind="single"),
    ]
    file = tmp_path / ATTAINABLE
    file.write_text(json.dumps({"0": {"": 0.1, "amplifier_gain": 0.9}, "1": {"": 0.8, "amplifier_gain": 0.2}}))
    ours, best = corner_rows(some, [file])
    assert (ours.value.value, best.value.value) == (0.5, 1.0)


@pytest.mark.slow
def test_a_corner_is_learned_from_simulated_robots(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("withheld.measuring.attainable.N_PAIRS", 1)
    monkeypatch.setattr("withheld.measuring.attainable.CORNER_KINDS", ("amplifier_gain",))
    monkeypatch.setattr("withheld.measuring.attainable.make", lambda *a, **k: replace(make(*a, **k), settings=QUICK))
    monkeypatch.setattr("withheld.measuring.attainable.SECONDS", 1.0)
    made = learn(Path("policies/walk.onnx"), 3, n_faultless=N_SUMMARIES // 2 + 2)
    assert np.linalg.eigvalsh(made.errors).min() > 0.0
    # Less torque than asked, a share of it, at the knees: the regression on the asked torque sees it.
    gain = made.effects["amplifier_gain", "kn"].reshape(3, 6)
    assert np.argmax(np.abs(gain[:, 4])) == 2
