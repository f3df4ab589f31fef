"""What closed loops say of an effect that nobody knows."""

import pytest

from diagnosis.posterior import Posterior, after_shrink

FOUND = Posterior(none=0.0, unknown=0.6, groups=())


def test_a_closed_gap_leaves_little_for_an_unknown_effect_by_hand() -> None:
    # Odds 1.5 · (1 - 0.8) / 0.6 = 0.5.
    assert after_shrink(FOUND, 0.8, 0.6).unknown == pytest.approx(1.0 / 3.0)
    # Odds 1.5 · 0.1, however much is closed.
    assert after_shrink(FOUND, 1.2, 0.9).unknown == pytest.approx(0.15 / 1.15)


@pytest.mark.parametrize(("s", "low"), [(0.3, 0.2), (0.9, -0.1), (None, None), (-2.0, -3.0)])
def test_what_models_without_the_cause_reach_says_nothing(s: float | None, low: float | None) -> None:
    assert after_shrink(FOUND, s, low) == FOUND
