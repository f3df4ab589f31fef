"""The synthesis check: the nominal simulator with the effects put in must be diagnosed with the same effects."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from diagnosis.closed_loop.simulation import SensorNoise, simulate
from diagnosis.document import Verdict
from diagnosis.library.base import LibraryEffect
from diagnosis.verdict.explain import explain
from spot_log.read.run import Run
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy
from trainer.signals.policy_ticks import scripts_of


def synthesis_check(
    runs: Sequence[Run],
    nominal: RobotModel,
    corrected: RobotModel,
    policy: Policy,
    verdict: Verdict,
    rng: np.random.Generator,
    library: Mapping[str, LibraryEffect],
) -> dict[str, Any]:
    """Diagnose the corrected model's own logs.

    Returns:
        ``passed``: every effect found comes back, itself or by a member of its group, with at least half of its
        joints; ``found``: what came back.
    """
    logs = simulate(corrected, policy, scripts_of(runs), rng, SensorNoise())
    back = explain(logs, nominal, policy, library, lambda _: None)
    terms = back.selection.best.terms if back.selection.best is not None else ()
    robot = back.board.robot
    found = {t.effect.name: robot.named(robot.joints_of(t.effect, t.place)) for t in terms}
    passed = all(
        any(m in found and 2 * len(set(found[m]) & set(e.joints)) >= len(e.joints) for m in e.group)
        for e in verdict.differences
    )
    return {"passed": bool(passed and verdict.differences), "found": {k: list(v) for k, v in found.items()}}
