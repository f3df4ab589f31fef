"""A classifier that tells real ticks from nominal ones, tested on runs that it never saw: gap or no gap, and the joint.

Source: Lopez-Paz and Oquab 2017, Revisiting Classifier Two-Sample Tests. The unit is the run.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.stats import mannwhitneyu
from sklearn.ensemble import HistGradientBoostingClassifier

from diagnosis.logs import policy_ticks, script_of
from diagnosis.simulated import SensorNoise, simulate
from spot_log import Run
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from spot_model.robot.facts import JOINT_NAMES
from trainer.sysid.distance.features import features_of_observations
from withheld.outcome import Answer

PER_SEQUENCE: Final = 2
"""Runs of each sequence that are compared."""
MAX_TICKS: Final = 200
"""Of each run, evenly thinned."""
LEVEL: Final = 0.05
TREES: Final = 40


def two_sample(runs: Sequence[Run], nominal: RobotModel, policy: Policy, rng: np.random.Generator) -> Answer:
    """Gap if runs' held-out scores differ at 5 %; the joints are those on which the classifier leans.

    Raises:
        ValueError: No run is long enough.
    """
    chosen = [r for r in runs if r.header.repeat < PER_SEQUENCE]
    scripts = [s for r in chosen if (s := script_of(r)) is not None]
    simulated = simulate(nominal, policy, scripts, rng, SensorNoise())
    tables = [(t, 1.0) for r in chosen if len(t := _table(r, policy)) > 0]
    tables += [(t, 0.0) for r in simulated if len(t := _table(r, policy)) > 0]
    x = np.concatenate([t for t, _ in tables])
    y = np.concatenate([np.full(len(t), label) for t, label in tables])
    group = np.concatenate([np.full(len(t), i) for i, (t, _) in enumerate(tables)])
    labels = np.array([label for _, label in tables])
    scores = np.full(len(tables), np.nan)
    drops = np.zeros(len(JOINT_NAMES))
    folds = rng.permutation(len(tables)) % 3
    for fold in range(3):
        test = np.isin(group, np.flatnonzero(folds == fold))
        if not test.any() or len(np.unique(y[~test])) < 2:
            continue
        model = HistGradientBoostingClassifier(max_iter=TREES, max_leaf_nodes=15, random_state=0)
        model.fit(x[~test], y[~test])
        p = model.predict_proba(x[test])[:, 1]
        for i in np.unique(group[test]):
            scores[i] = float(np.mean(p[group[test] == i]))
        right = float(np.mean(np.abs(p - y[test])))
        for j in range(len(JOINT_NAMES)):
            mixed = x[test].copy()
            columns = np.arange(j, x.shape[1], len(JOINT_NAMES))
            mixed[:, columns] = mixed[rng.permutation(len(mixed))][:, columns]
            drops[j] += float(np.mean(np.abs(model.predict_proba(mixed)[:, 1] - y[test]))) - right
    seen = np.isfinite(scores)
    p_value = float(
        mannwhitneyu(scores[seen & (labels == 1)], scores[seen & (labels == 0)], alternative="greater").pvalue
    )
    joints = tuple(n for n, d in zip(JOINT_NAMES, drops, strict=True) if d > 0.5 * drops.max() and d > 0.0)
    return Answer(has_gap=p_value <= LEVEL, joints=joints, detail={"p_value": p_value})


def _table(run: Run, policy: Policy) -> np.ndarray:
    """Position, velocity, action and load at ticks, shape (n, 48); joints in canonical order within each."""
    rows = policy_ticks(run)
    rows = rows[:: max(1, len(rows) // MAX_TICKS)]
    features = features_of_observations(run.ticks.observation[rows], run.ticks.action[rows], policy)
    at = np.clip(np.searchsorted(run.states.robot_stamp_ns, run.ticks.robot_stamp_ns[rows]), 0, len(run.states) - 1)
    return np.concatenate([features, np.nan_to_num(run.states.load_nm[at])], axis=1)
