"""Bounds, calibration, and the classifier on metadata, against numbers known otherwise."""

import numpy as np
import pytest

from withheld.scoring.leak import leaks
from withheld.scoring.statistics import Average, Share, brier, reliability

from .made_up import fault, outcome


@pytest.mark.parametrize(
    ("hits", "trials", "low", "high"),
    [(0, 60, 0.0, 0.0596), (5, 10, 0.1871, 0.8129), (10, 10, 0.6915, 1.0), (90, 100, 0.8238, 0.9510)],
)
def test_clopper_pearson(hits: int, trials: int, low: float, high: float) -> None:
    """Source of the numbers: Clopper and Pearson's table, and 1 - 0.025**(1/60)."""
    share = Share(hits, trials)
    assert share.low == pytest.approx(low, abs=2e-4)
    assert share.high == pytest.approx(high, abs=2e-4)


def test_no_trial_is_no_value() -> None:
    assert Share(0, 0).value is None
    assert str(Share(0, 0)) == "no case"
    assert Average(()).value is None


def test_brier_of_certainty_and_of_doubt() -> None:
    assert brier([1.0, 0.0], [True, False]) == 0.0
    assert brier([0.5, 0.5], [True, False]) == 0.25
    assert brier([], []) is None


def test_reliability_puts_each_claim_in_its_step() -> None:
    bins = reliability([0.95, 0.92, 0.05, 1.0], [True, False, False, True])
    assert [(b.share.hits, b.share.trials) for b in bins] == [(0, 1), (2, 3)]


def _cases(telling: bool) -> list:
    rng = np.random.default_rng(3)
    made = []
    for n in range(60):
        faults = [fault("coulomb_friction")] if n % 2 else []
        size = float(rng.normal()) + (3.0 * (n % 2) if telling else 0.0)
        made.append(outcome(faults, number=n, metadata={"bytes": size, "name": float(rng.normal())}))
    return made


def test_metadata_that_tell_are_noticed() -> None:
    found = {leak.question: leak for leak in leaks(_cases(telling=True), 19)}
    assert found["is there an effect"].p_value <= 0.05
    assert found["is there an effect"].accuracy > 0.8


def test_metadata_that_do_not_tell_are_at_chance() -> None:
    found = {leak.question: leak for leak in leaks(_cases(telling=False), 19)}
    assert found["is there an effect"].p_value > 0.05
