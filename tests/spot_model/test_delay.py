from __future__ import annotations

import numpy as np
import pytest
from pydantic import TypeAdapter, ValidationError

from spot_model.plant.delay import ConstantDelay, Delay, EmpiricalDelay, GammaDelay, LogNormalDelay


@pytest.mark.parametrize(
    ("delay", "median_s"),
    [
        (ConstantDelay(delay_s=0.005), 0.005),
        (LogNormalDelay(floor_s=0.001, median_s=0.003, sigma=0.4), 0.004),
        (GammaDelay(shape=1.0, scale_s=0.01), 0.01 * np.log(2.0)),
        (EmpiricalDelay(edges_s=(0.0, 0.002, 0.004), counts=(1.0, 1.0)), 0.002),
    ],
    ids=lambda v: getattr(v, "kind", ""),
)
def test_the_median_is_the_distributions(delay, median_s: float):
    drawn = delay.sample(np.random.default_rng(3), 40_000)
    assert np.median(drawn) == pytest.approx(median_s, rel=0.03)
    assert drawn.min() >= 0.0


def test_the_same_generator_draws_the_same():
    delay = LogNormalDelay(median_s=0.003, sigma=0.5)
    np.testing.assert_array_equal(delay.sample(np.random.default_rng(1), 9), delay.sample(np.random.default_rng(1), 9))


def test_data_round_trip_picks_the_kind():
    adapter = TypeAdapter(Delay)
    for data in ({"kind": "constant", "delay_s": 0.1}, {"kind": "gamma", "shape": 2.0, "scale_s": 0.001}):
        assert adapter.validate_python(data).model_dump(exclude_defaults=False).items() >= data.items()
    with pytest.raises(ValidationError, match="kind"):
        adapter.validate_python({"kind": "weibull"})


def test_empirical_needs_rising_edges_and_fitting_counts():
    with pytest.raises(ValidationError, match="must rise"):
        EmpiricalDelay(edges_s=(0.0, 0.0), counts=(1.0,))
    with pytest.raises(ValidationError, match="one fewer is needed"):
        EmpiricalDelay(edges_s=(0.0, 0.1), counts=(1.0, 2.0))


def test_a_histogram_is_drawn_by_its_counts():
    drawn = EmpiricalDelay(edges_s=(0.003, 0.004, 0.006), counts=(10.0, 30.0)).sample(np.random.default_rng(0), 20_000)
    assert 0.003 <= drawn.min() < drawn.max() <= 0.006
    assert np.mean(drawn < 0.004) == pytest.approx(0.25, abs=0.01)
