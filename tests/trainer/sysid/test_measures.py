from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from trainer.signals.distances import SequenceReference, score_of_distances


def runs(n: int, shift: float = 0.0, seed: int = 0) -> list[NDArray[np.float32]]:
    rng = np.random.default_rng(seed)
    return [(rng.standard_normal((200, 36)) + shift).astype(np.float32) for _ in range(n)]


def test_a_run_of_the_same_process_scores_one() -> None:
    reference = SequenceReference.build("a", runs(6))
    distances = np.stack([reference.distances(f) for f in runs(6, seed=1)])
    assert score_of_distances(distances, reference.scale) == pytest.approx(1.0, abs=0.05)


def test_the_score_rises_with_the_distance() -> None:
    reference = SequenceReference.build("a", runs(3))
    near, far = (reference.distances(runs(1, shift, 1)[0])[None] for shift in (0.2, 1.0))
    scores = [float(score_of_distances(d, reference.scale)) for d in (near, far)]
    assert 1.0 < scores[0] < scores[1]


def test_the_floor_is_the_mean_over_pairs_of_different_runs() -> None:
    reference = SequenceReference.build("a", runs(3))
    pairs = reference.pair_distances
    assert reference.floor == pytest.approx((pairs[0, 1] + pairs[0, 2] + pairs[1, 2]) / 3.0)
    assert np.all(pairs[np.arange(3), np.arange(3)] == 0.0)


def test_one_run_has_no_floor_but_a_scale() -> None:
    reference = SequenceReference.build("a", runs(1))
    assert reference.floor is None
    assert np.all(reference.scale > 0.0)


def test_a_run_that_is_not_finite_has_no_distance() -> None:
    reference = SequenceReference.build("a", runs(2))
    broken = runs(1)[0]
    broken[5, 3] = np.nan
    assert np.isnan(reference.distances(broken)).all()


def test_weights_choose_real_runs() -> None:
    reference = SequenceReference.build("a", runs(2))
    distances = np.array([[[1.0, 1.0], [3.0, 3.0]]])
    only_first = score_of_distances(distances, np.ones(2), np.array([1.0, 0.0]))
    assert only_first == pytest.approx(1.0)
    assert score_of_distances(distances, np.ones(2)) == pytest.approx(2.0)
    assert len(reference.real) == 2


def test_many_runs_at_once_are_as_far_as_one_by_one() -> None:
    torch = pytest.importorskip("torch")
    rng = np.random.default_rng(3)
    reference = SequenceReference.build("walk", [rng.normal(0.0, 9.0, (n, 36)).astype(np.float32) for n in (90, 80)])
    runs = rng.normal(1.0, 8.0, (3, 80, 36)).astype(np.float32)
    runs[2, 40] = np.nan
    many = reference.distances_of_many(torch.from_numpy(runs))
    np.testing.assert_allclose(many, [reference.distances(run) for run in runs], rtol=1e-4)
