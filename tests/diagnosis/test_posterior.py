"""What closed loops say of an effect that nobody knows."""

import pytest

from diagnosis.posterior import Posterior, after_shrink
from diagnosis.verdict import Shrink

FOUND = Posterior(none=0.0, unknown=0.6, groups=())


def _shrink(
    s: float | None, low: float | None, high: float | None = 1.2, d0: float = 3.0, floor: float = 1.0
) -> Shrink:
    d1 = d0 - (s or 0.0) * (d0 - floor)
    return Shrink(d0=d0, d1=d1, floor=floor, s=s, s_low=low, s_high=high, held_out=("a",), placebo=None)


def test_a_closed_gap_leaves_little_for_an_unknown_effect_by_hand() -> None:
    # Odds 1.5 · (1 - 0.8) / 0.6 = 0.5.
    assert after_shrink(FOUND, _shrink(0.8, 0.6), 50.0).unknown == pytest.approx(1.0 / 3.0)
    # Odds 1.5 · 0.1, however much is closed.
    assert after_shrink(FOUND, _shrink(1.2, 0.9), 50.0).unknown == pytest.approx(0.15 / 1.15)


@pytest.mark.parametrize(("s", "low"), [(0.3, 0.2), (0.9, -0.1), (None, None), (-2.0, -3.0)])
def test_what_models_without_the_cause_reach_says_nothing(s: float | None, low: float | None) -> None:
    assert after_shrink(FOUND, _shrink(s, low), 50.0) == FOUND


def test_a_plain_gap_that_stays_as_it_was_has_another_cause() -> None:
    found = Posterior(none=0.5, unknown=0.02, groups=())
    after = after_shrink(found, _shrink(0.0, -0.6, high=0.6), 50.0)
    assert after.unknown == pytest.approx(0.8)
    assert after.none == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("shrink", "gain_nats"),
    [
        (_shrink(0.0, -0.6, high=0.8), 50.0),  # may close it
        (_shrink(0.3, -0.1, high=0.6), 50.0),  # closes some
        (_shrink(0.0, -0.6, high=0.6, d0=2.4), 50.0),  # nothing amiss leaves as much
        (_shrink(0.0, -0.6, high=0.6, floor=0.0), 50.0),  # no repeats, no unit
        (_shrink(0.0, -0.6, high=0.6), 150.0),  # what brings so much is there
    ],
)
def test_a_gap_that_is_not_plain_or_may_be_closed_says_nothing(shrink: Shrink, gain_nats: float) -> None:
    assert after_shrink(FOUND, shrink, gain_nats) == FOUND
