"""Blocks laid end to end are the same problem as block by block."""

from __future__ import annotations

import numpy as np
import pytest

from diagnosis.selection.normal_equations import OrdinarySums, solved, tried_by_fold

SIZE = 6
NUMBERS = (np.array([4, 0, 2]), np.array([], dtype=np.intp), np.array([5, 1, 2, 3]))
WEIGHTS = np.array([0.5, 3.0, 1.5])
N_FOLDS, N_TRIED = 2, 2


def _columns() -> list[np.ndarray]:
    """By block [ordinary errors, two columns that are tried, y], shape (folds, samples, q + 3)."""
    rng = np.random.default_rng(0)
    return [rng.normal(size=(N_FOLDS, 30, len(n) + N_TRIED + 1)) for n in NUMBERS]


def _parts(columns: list[np.ndarray]) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray]]:
    base, ours, both = [], [], []
    for x in columns:
        gram = np.swapaxes(x, 1, 2) @ x
        q = gram.shape[1] - N_TRIED - 1
        known, tried = [*range(q), q + N_TRIED], list(range(q, q + N_TRIED))
        base.append(gram[:, known][:, :, known])
        ours.append(gram[:, tried][:, :, known])
        both.append(gram[:, tried][:, :, tried])
    return base, ours, both


def test_one_weighted_problem_is_solved() -> None:
    columns = _columns()
    base, ours, both = _parts(columns)
    sums = OrdinarySums(NUMBERS, SIZE, base)
    tried, by_fold = tried_by_fold(ours, both)
    for part, own, folds in (
        (sums.total, tried, [0, 1]),
        (sums.folds[0], by_fold[0], [0]),
        (sums.others[0], tried - by_fold[0], [1]),
    ):
        # One least-squares problem over all columns of all blocks, with a prior on each ordinary error.
        rows, right = [np.eye(SIZE, SIZE + N_TRIED)], [np.zeros(SIZE)]
        for at, x, weight in zip(NUMBERS, columns, WEIGHTS, strict=True):
            for fold in folds:
                wide = np.zeros((x.shape[1], SIZE + N_TRIED))
                wide[:, at] = x[fold][:, : len(at)]
                wide[:, SIZE:] = x[fold][:, len(at) : -1]
                rows.append(np.sqrt(weight) * wide)
                right.append(np.sqrt(weight) * x[fold][:, -1])
        wanted = np.linalg.lstsq(np.concatenate(rows), np.concatenate(right), rcond=None)[0]
        far = np.full(N_TRIED, 100.0)
        pulls, beta = solved(sums, part, own, WEIGHTS, -far, far)
        assert np.concatenate([pulls, beta]) == pytest.approx(wanted, rel=1e-7)
        left, explained = sums.squares(part, own, pulls, beta)
        for number, (at, x) in enumerate(zip(NUMBERS, columns, strict=True)):
            said = np.concatenate([x[f][:, : len(at)] @ pulls[at] + x[f][:, len(at) : -1] @ beta for f in folds])
            y = np.concatenate([x[f][:, -1] for f in folds])
            assert explained[number] == pytest.approx(np.sum(said**2))
            assert left[number] == pytest.approx(np.sum((y - said) ** 2))


def test_nothing_tried_leaves_the_ordinary_errors() -> None:
    base, _, _ = _parts(_columns())
    sums = OrdinarySums(NUMBERS, SIZE, base)
    none = [np.zeros((N_FOLDS, 0, b.shape[1])) for b in base]
    tried, _ = tried_by_fold(none, [np.zeros((N_FOLDS, 0, 0))] * len(base))
    pulls, beta = solved(sums, sums.total, tried, WEIGHTS, np.zeros(0), np.zeros(0))
    assert beta.shape == (0,)
    left, _ = sums.squares(sums.total, tried, pulls, beta)
    # Fitting shortens what is left of the whole, prior and all.
    assert WEIGHTS @ left + pulls @ pulls < WEIGHTS @ sums.total.yy
