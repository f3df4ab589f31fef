"""The fits of ``calibrate_diagnosis.py``: logistic regressions of several forms, judged on robots not fitted."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import log_loss
from sklearn.model_selection import GroupKFold, cross_val_predict

from diagnosis.decision_constants import LEFT_SHARE
from diagnosis.verdict.causes import CALIBRATED
from diagnosis.verdict.probability import is_odd, ordinary_gap
from withheld.scoring.statistics import calibration_error

Array = NDArray[np.float64]
NOTHING: Final = 0.5
"""A fault that moves its robot by fewer floors is left out of no library, and not asked for as something unknown."""
EXPLAINED: Final = -1.0
"""No smaller excess says anything: a program that is replayed to the bit leaves next to nothing."""
LEAST_SPREAD: Final = 0.25
"""Of the excess of robots without a fault."""
FOLDS: Final = 10
SMALLEST_NATS: Final = 0.1


def fit(given: Namespace) -> None:
    """Print the numbers."""
    rows = [json.loads(path.read_text()) for path in sorted(given.folder.glob("*.json"))]
    clean = [r["whole"] for r in rows if not r["faults"]]
    if len(clean) < FOLDS or len(rows) < 2 * len(clean):
        raise SystemExit(f"{len(clean)} faultless of {len(rows)} robots are too few; make more of them")
    print(f"{len(rows)} robots, {len(clean)} of them faultless")
    usual = {}
    for channel in sorted({c for own in clean for c in own["excess"]}):
        over = np.maximum([own["excess"][channel] for own in clean if channel in own["excess"]], EXPLAINED)
        usual[channel] = (float(np.median(over)), max(float(np.std(over)), LEAST_SPREAD))
        print(f"ORDINARY_EXCESS {channel}: median {usual[channel][0]:.2f}, deviation {usual[channel][1]:.2f}")
    most = {}
    for channel in sorted({c for own in clean for c in own["left_nats"]}):
        left = [own["left_nats"].get(channel, 0.0) for own in clean]
        most[channel] = float(np.quantile(left, 0.95))
        print(f"USUAL_LEFT {channel}: 50 and 95 %: {np.median(left):.1f}, {most[channel]:.1f} nats")
    there(rows)
    unknown(rows, usual, most)


def _explanations(row: Mapping[str, Any]) -> list[dict[str, Any]]:
    return [row[library] for library in ("whole", "less") if library in row]


def odd(over: Mapping[str, float], usual: Mapping[str, tuple[float, float]]) -> float:
    """The largest excess in deviations above the median of robots without a fault, at least -3."""
    z = [(max(e, EXPLAINED) - usual[c][0]) / usual[c][1] for c, e in over.items() if c in usual]
    return float(max(z, default=-3.0))


def there(rows: Sequence[Mapping[str, Any]]) -> None:
    """Whether an effect of the best set is there, by forms of its evidence; a group that holds the truth counts."""
    told, right, groups = [], [], []
    for row in rows:
        for own in _explanations(row):
            for effect in own["effects"]:
                told.append(
                    {
                        "log nats": np.log(max(effect["nats"], SMALLEST_NATS)),
                        "log own nats": np.log(max(effect["own_nats"], SMALLEST_NATS)),
                        "log runs": np.log(row["n_runs"]),
                        "log joints": np.log(len(effect["joints"])),
                    }
                )
                right.append(effect["is_in_group"])
                groups.append(row["number"])
    forms = (
        ("log nats",),
        ("log own nats",),
        ("log own nats", "log runs"),
        ("log own nats", "log joints"),
    )
    print(f"\nTHERE: {len(told)} effects, {sum(right)} there")
    _print_forms(told, np.array(right), np.array(groups), forms)


def unknown(
    rows: Sequence[Mapping[str, Any]], usual: Mapping[str, tuple[float, float]], most: Mapping[str, float]
) -> None:
    """Whether something is there that the library lacks, by what the best set leaves.

    Where it moves the robot by less than :data:`NOTHING` floors the robot is left out.
    """
    told, right, groups = [], [], []
    for row in rows:
        for own in _explanations(row):
            lacking = [f["moved"] for f in row["faults"] if not {*f["names"]} & {*own["library"]}]
            if lacking and max(m or 0.0 for m in lacking) < NOTHING:
                continue
            beyond = sum(max(0.0, nats - most.get(c, 0.0)) for c, nats in own["left_nats"].items())
            told.append(
                {
                    "excess": odd(own["excess"], usual),
                    "log beyond": np.log1p(beyond),
                    "log left nats": np.log1p(sum(own["left_nats"].values())),
                    "gap": _gap(own),
                }
            )
            right.append(bool(lacking))
            groups.append(row["number"])
    forms = (
        ("log beyond",),
        ("log left nats",),
        ("excess", "log beyond"),
        ("gap",),
        ("gap", "log beyond"),
        ("gap", "log left nats"),
        ("gap", "log beyond", "excess"),
    )
    print(f"\nUNKNOWN: {len(told)} explanations, {sum(right)} lack something that moves the robot")
    _print_forms(told, np.array(right), np.array(groups), forms)


def _gap(own: Mapping[str, Any]) -> float:
    """Logarithm of the distance that is left over the ordinary one; NaN where nothing was simulated."""
    closed = own["closed"]
    if not {"stated", "nominal", CALIBRATED} <= closed.keys():
        return float("nan")
    ordinary = ordinary_gap(closed["scatter_nm"], own["errors"], is_odd(own["excess"]), closed["model_scatter"])
    explained = max(min(closed["nominal"], closed[CALIBRATED]) - closed["stated"], 0.0)
    return float(np.log(max(closed["stated"], 1e-3) / (ordinary + LEFT_SHARE * explained)))


def _print_forms(
    told: Sequence[Mapping[str, float]],
    right: NDArray[np.bool_],
    groups: NDArray[np.intp],
    forms: Sequence[tuple[str, ...]],
) -> None:
    """Coefficients, and log loss and calibration error on folds of other robots, of rows whose numbers are all known.

    Args:
        told: Numbers of each row by name; NaN for unknown.
        right: Whether it was so, by row.
        groups: Number of the robot, by row: a robot's rows are in one fold.
        forms: Names of the numbers that each regression takes.
    """
    for form in forms:
        x = np.array([[row[name] for name in form] for row in told])
        has = np.isfinite(x).all(axis=1)
        x, y, own = x[has], right[has], groups[has]
        if len(set(own)) < FOLDS or len(set(y)) < 2:
            print(f"  {', '.join(form)}: too few")
            continue
        model = LogisticRegression(C=100.0)
        p = cross_val_predict(model, x, y, groups=own, cv=GroupKFold(FOLDS), method="predict_proba")[:, 1]
        model.fit(x, y)
        numbers = ", ".join(f"{v:.2f}" for v in (*model.intercept_, *model.coef_[0]))
        print(f"  1, {', '.join(form)}: ({numbers}); {len(y)} rows: {_losses(p, y)}")


def _losses(p: Array, y: NDArray[np.bool_]) -> str:
    error = calibration_error(np.stack([p, y.astype(np.float64)], axis=1))
    return f"log loss {log_loss(y, p, labels=[False, True]):.3f}, calibration error {error:.3f}"
