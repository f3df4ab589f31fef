from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from diagnosis.closed_loop.shrink import SequenceDistances, _few, sequence_distances, shrinkage
from diagnosis.closed_loop.trials import NOMINAL, Trials, measure_shrink
from diagnosis.verdict.diagnose import _about


def _pairs(n: int, value: float) -> np.ndarray:
    return value * (1.0 - np.eye(n))


def test_share_by_hand() -> None:
    one = SequenceDistances("a", _pairs(3, 1.0), {"before": np.full((3, 3), 5.0), "after": np.full((3, 3), 2.0)})
    found = shrinkage([one], "before", "after", np.random.default_rng(0))
    assert (found.d0, found.d1, found.floor) == (5.0, 2.0, 1.0)
    assert found.s == pytest.approx(0.75)
    assert found.low == pytest.approx(0.75)
    assert found.high == pytest.approx(0.75)


@pytest.mark.parametrize(
    ("repeats", "least", "floor", "share"), [(1.0, 0.5, 1.0, 0.75), (0.5, 1.0, 1.0, 0.75), (0.5, 3.0, 3.0, 1.0)]
)
def test_a_gap_counts_from_what_is_nothing_to_anybody_if_repeats_are_nearer(
    repeats: float, least: float, floor: float, share: float
) -> None:
    models = {"before": np.full((3, 3), 5.0), "after": np.full((3, 3), 2.0)}
    found = shrinkage(
        [SequenceDistances("a", _pairs(3, repeats), models, least=least)], "before", "after", np.random.default_rng(0)
    )
    assert (found.d0, found.d1, found.floor) == (5.0, 2.0, floor)
    assert (found.s, found.low, found.high) == pytest.approx((share, share, share))


def test_a_gap_that_is_nothing_to_anybody_has_no_share() -> None:
    models = {"before": np.full((3, 3), 5.0), "after": np.full((3, 3), 2.0)}
    one = SequenceDistances("a", _pairs(3, 1.0), models, least=5.0)
    assert shrinkage([one], "before", "after", np.random.default_rng(0)).s is None


@pytest.mark.parametrize(("n_real", "whose"), [(1, "model"), (3, "robot")])
def test_whose_floor_it_is_is_kept(n_real: int, whose: str) -> None:
    models = {NOMINAL: np.full((3, n_real), 5.0), "best": np.full((3, n_real), 2.0)}
    bench: Any = None
    trials = Trials(
        bench, {name: [] for name in models}, (SequenceDistances("a", _pairs(n_real, 1.0), models),), False, ()
    )
    found = measure_shrink(trials, "best", np.random.default_rng(0))
    assert found is not None
    assert (found.floor_of, found.held_out) == (whose, ())


@pytest.mark.parametrize(
    ("runs", "is_crossed", "told"),
    [
        ({"a": 2, "b": 1}, True, []),
        ({"a": 1, "b": 1}, True, ["no command sequence has two whole runs"]),
        ({"a": 2}, False, ["one command sequence can be simulated"]),
        ({"a": 2, "b": 2}, False, ["some command sequences are too short, or at other gains"]),
    ],
)
def test_notes_say_what_was_so(runs: dict[str, int], is_crossed: bool, told: list[str]) -> None:
    bench: Any = SimpleNamespace(sequences=list(runs), real=lambda: {name: [0] * n for name, n in runs.items()})
    assert [note.partition(":")[0].partition(", to be")[0] for note in _about(bench, is_crossed)] == told


def test_a_gap_at_its_floor_has_no_share() -> None:
    one = SequenceDistances("a", _pairs(3, 1.0), {"before": np.full((3, 3), 1.0), "after": np.full((3, 3), 1.0)})
    assert shrinkage([one], "before", "after", np.random.default_rng(0)).s is None


def test_the_interval_holds_the_share_and_grows_with_scatter() -> None:
    rng = np.random.default_rng(2)
    widths = []
    for scatter in (0.1, 1.0):
        before = 5.0 + scatter * rng.standard_normal((4, 1)) + np.zeros((4, 4))
        after = 2.0 + scatter * rng.standard_normal((4, 1)) + np.zeros((4, 4))
        found = shrinkage([SequenceDistances("a", _pairs(4, 1.0), {"b": before, "a": after})], "b", "a", rng)
        assert found.low is not None
        assert found.high is not None
        assert found.low <= found.s <= found.high
        widths.append(found.high - found.low)
    assert widths[1] > 3.0 * widths[0]


def test_runs_of_the_same_law_lie_at_the_floor() -> None:
    rng = np.random.default_rng(3)

    def run(shift: float) -> np.ndarray:
        return (rng.standard_normal((400, 36)) + shift).astype(np.float32)

    real = [run(0.0) for _ in range(4)]
    found = sequence_distances("a", real, {"same": [run(0.0) for _ in range(4)], "other": [run(0.5) for _ in range(4)]})
    assert found.models["same"].mean() == pytest.approx(1.0, abs=0.15)
    assert found.models["other"].mean() > 3.0


def test_a_run_that_ends_early_is_compared_up_to_its_end() -> None:
    """The gait changes halfway; a run cut there lies at the floor, and whole ones of other gaits do not."""
    rng = np.random.default_rng(7)

    def run(n: int, shift: float = 0.0) -> np.ndarray:
        out = rng.standard_normal((400, 36)) + shift
        out[200:] += 2.0
        return out[:n].astype(np.float32)

    real = [run(400), run(400), run(200)]
    found = sequence_distances("a", real, {"same": [run(400), run(200)], "other": [run(200, 0.5)]})
    # Between runs of 200 rows distances are larger than between runs of 400, by chance alone.
    assert found.real[0, 2] < 2.0 * found.real[0, 1]
    assert found.models["same"].mean() == pytest.approx(1.0, abs=0.2)
    assert found.models["other"].mean() > 2.0


def test_models_that_stumble_do_not_widen_the_floor_of_a_robot_that_ran_once() -> None:
    rng = np.random.default_rng(4)

    def runs(scatter: float) -> list[np.ndarray]:
        return [
            (rng.standard_normal((400, 36)) + scatter * rng.standard_normal(36)).astype(np.float32) for _ in range(3)
        ]

    models = {"nominal": runs(0.1), "limited": runs(3.0), "heavier": runs(3.0)}
    real = runs(0.1)[:1]
    wide, narrow = sequence_distances("a", real, models), sequence_distances("a", real, models, steady="nominal")
    assert narrow.scale[0] < 0.3 * wide.scale[0]
    assert narrow.models["nominal"].mean() > 3.0 * wide.models["nominal"].mean()
    same = sequence_distances("a", [real[0], real[0]], models, steady="nominal")
    np.testing.assert_array_equal(same.scale, narrow.scale, "runs that are alike to the last bit are no repeats")
    assert np.isfinite(sequence_distances("a", [real[0], real[0]], {"one": real}).scale).all()
    repeated = runs(0.1)
    np.testing.assert_array_equal(
        sequence_distances("a", repeated, models).scale,
        sequence_distances("a", repeated, models, steady="nominal").scale,
    )


def test_intervals_of_few_sequences_and_runs_are_wider_by_hand() -> None:
    # Three sequences: √(3/2), and Student's 2.920 with two degrees of freedom over the normal 1.645.
    assert _few([5, 5, 5]) == pytest.approx(np.sqrt(1.5) * 2.9200 / 1.6449, rel=1e-3)
    # Ten sequences of two runs: √2, and 1.812 with ten degrees of freedom.
    assert _few([2] * 10) == pytest.approx(np.sqrt(2.0) * 1.8125 / 1.6449, rel=1e-3)
    # One sequence says nothing of others: its runs count.
    assert _few([3]) == pytest.approx(np.sqrt(1.5) * 2.9200 / 1.6449, rel=1e-3)
    assert _few([1]) == 1.0
    assert _few([200] * 200) == pytest.approx(1.0, abs=0.01)


def test_intervals_cover_the_truth_nine_times_in_ten() -> None:
    # Gaussian runs in three sequences: floor 1, before 3, after 1.4, so S = 1.6/2 = 0.8; each run has its own scatter.
    rng = np.random.default_rng(5)
    inside = []
    for _ in range(24):
        compared = []
        for name in "abc":
            real, sim = rng.normal(0.0, 0.15, 3), {"b": rng.normal(2.0, 0.15, 3), "a": rng.normal(0.4, 0.15, 3)}
            pairs = (1.0 + 0.5 * (real[:, None] + real[None, :])) * (1.0 - np.eye(3))
            models = {k: 1.0 + v[:, None] + 0.5 * real[None, :] for k, v in sim.items()}
            compared.append(SequenceDistances(name, pairs, models))
        found = shrinkage(compared, "b", "a", rng)
        assert found.low is not None
        assert found.high is not None
        inside.append(found.low <= 0.8 <= found.high)
    assert np.mean(inside) >= 0.8


def test_intervals_cover_what_other_sequences_would_say() -> None:
    # S differs from sequence to sequence, by 0.15 about 0.8; the interval of three holds the mean of all.
    rng = np.random.default_rng(6)
    inside = []
    for _ in range(16):
        compared = []
        for name in "abc":
            share = rng.normal(0.8, 0.15)
            models = {"b": np.full((3, 3), 4.0), "a": np.full((3, 3), 4.0 - 3.0 * share)}
            compared.append(SequenceDistances(name, _pairs(3, 1.0), models))
        found = shrinkage(compared, "b", "a", rng)
        inside.append(found.low <= 0.8 <= found.high)
    assert np.mean(inside) >= 0.8


def test_what_no_resample_holds_widens_the_interval_by_hand() -> None:
    one = SequenceDistances("a", _pairs(3, 1.0), {"before": np.full((3, 3), 5.0), "after": np.full((3, 3), 2.0)})
    found = shrinkage([one], "before", "after", np.random.default_rng(0), 0.3)
    # Of S = 0.75: 1.645 · 0.3 / 4.
    assert found.low == pytest.approx(0.75 - 0.1234, abs=1e-3)
    assert found.high == pytest.approx(0.75 + 0.1234, abs=1e-3)
