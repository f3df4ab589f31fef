"""Three simpler ways to the same answer, on the same logs; they get logs, nominal model and policy, and no truth."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from spot_log import Run
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy
from withheld.baselines.least_squares import all_at_once
from withheld.baselines.paper import paper_search
from withheld.baselines.two_sample import two_sample
from withheld.outcome import Answer

PAPER: Final = "paper"
TWO_SAMPLE: Final = "two_sample"
LEAST_SQUARES: Final = "least_squares"
TITLES: Final = {
    PAPER: "the paper's way: CMA-ES over all parameters, W1 + MMD, largest change wins",
    TWO_SAMPLE: "classifier two-sample test alone: gap and joint, no effect",
    LEAST_SQUARES: "least squares of all parameters at once, largest change wins",
}


def answers(
    runs: Sequence[Run], nominal: RobotModel, policy_path: Path, logs: Path, rng: np.random.Generator, *, search: bool
) -> dict[str, Answer]:
    """What each says; one that cannot work on these logs says that there is no gap.

    Args:
        runs: The logs.
        nominal: The model.
        policy_path: The policy's file.
        logs: Folder of the logs.
        rng: Draws.
        search: Whether the paper's search is made, which costs more than all else.
    """
    policy = load_policy(policy_path)
    ways: dict[str, Callable[[], Answer]] = {
        TWO_SAMPLE: lambda: two_sample(runs, nominal, policy, rng),
        LEAST_SQUARES: lambda: all_at_once(runs, nominal, policy),
    }
    if search:
        ways[PAPER] = lambda: paper_search(logs, nominal, policy_path, int(rng.integers(2**31)))
    found: dict[str, Answer] = {}
    for name, way in ways.items():
        before = time.process_time()
        try:
            answer = way()
        except Exception:  # noqa: BLE001 - whatever breaks a baseline, it has not found anything
            answer = Answer(has_gap=False)
        found[name] = answer.model_copy(update={"cpu_s": round(time.process_time() - before, 2)})
    return found
