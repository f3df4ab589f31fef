"""Whether anything but the signals tells what is hidden: a classifier on metadata, against permuted labels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.metrics import balanced_accuracy_score
from sklearn.model_selection import StratifiedKFold, cross_val_predict

from withheld.outcome import Outcome

N_PERMUTATIONS: Final = 99
FOLDS: Final = 3
MIN_CASES: Final = 12
DESIGNED: Final = ("sprint", "short")


@dataclass(frozen=True)
class Leak:
    """One question, answered from metadata alone."""

    question: str
    accuracy: float
    """Balanced accuracy, on cases that the classifier never saw."""
    chance: float
    """Mean accuracy with permuted labels."""
    p_value: float
    cases: int


def leaks(outcomes: Sequence[Outcome], n_permutations: int = N_PERMUTATIONS) -> list[Leak]:
    """Is there a fault, and of which family; kinds whose motion or logs are given by design are left out."""
    chosen = [o for o in outcomes if o.case.kind not in DESIGNED and o.metadata]
    questions = {
        "is there a fault": [str(bool(o.truth.faults)) for o in chosen],
        "family of the first fault": [o.truth.faults[0].family if o.truth.faults else "none" for o in chosen],
    }
    names = sorted({n for o in chosen for n in o.metadata})
    x = np.array([[o.metadata.get(n, 0.0) for n in names] for o in chosen])
    made = [_leak(question, x, np.array(labels), n_permutations) for question, labels in questions.items()]
    return [leak for leak in made if leak is not None]


def _leak(question: str, x: np.ndarray, labels: np.ndarray, n_permutations: int) -> Leak | None:
    values, counts = np.unique(labels, return_counts=True)
    keep = np.isin(labels, values[counts >= FOLDS])
    x, labels = x[keep], labels[keep]
    if len(labels) < MIN_CASES or len(np.unique(labels)) < 2:
        return None
    rng = np.random.default_rng(0)
    found = _accuracy(x, labels)
    permuted = np.array([_accuracy(x, rng.permutation(labels)) for _ in range(n_permutations)])
    p_value = (1 + int(np.sum(permuted >= found))) / (1 + n_permutations)
    return Leak(question, found, float(permuted.mean()), p_value, len(labels))


def _accuracy(x: np.ndarray, labels: np.ndarray) -> float:
    trees = ExtraTreesClassifier(n_estimators=16, class_weight="balanced", random_state=0)
    folds = StratifiedKFold(FOLDS, shuffle=True, random_state=0)
    return float(balanced_accuracy_score(labels, cross_val_predict(trees, x, labels, cv=folds)))
