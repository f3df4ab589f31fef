"""The search itself: random cases, and cases near those that ended worst."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import numpy as np

from proof.faults.rig import Rig, rig
from proof.faults.search.case import Case, draw, vary
from proof.faults.search.laws import Verdict, judge_case
from spot_model.io.signals import exit_on_termination

KEPT: Final = 12
"""Of the worst so far, from which others are varied."""

VARIED_SHARE: Final = 0.5


def searched(seed: int, minutes: float, policy: Path, folder: Path, scenario: str = "default") -> Iterator[Verdict]:
    """Try cases for some minutes; a robot that a case leaves unusable is replaced by a new one."""
    rng, until_s = np.random.default_rng(seed), time.monotonic() + 60.0 * minutes
    worst: list[Verdict] = []
    number = 0
    while time.monotonic() < until_s:
        number += 1
        with exit_on_termination(), rig(folder / f"robot{number}", policy, scenario=scenario) as robot:
            is_usable = True
            while is_usable and time.monotonic() < until_s:
                verdict = judge_case(robot, _next(worst, rng))
                worst = sorted([*worst, verdict], key=lambda v: -v.badness)[:KEPT]
                is_usable = _is_usable_after(robot)
                yield verdict


def _next(worst: list[Verdict], rng: np.random.Generator) -> Case:
    if len(worst) == KEPT and rng.random() < VARIED_SHARE:
        return vary(worst[int(rng.integers(len(worst)))].case, rng)
    return draw(rng)


def _is_usable_after(robot: Rig) -> bool:
    try:
        return not robot.restore()
    except Exception:  # noqa: BLE001 - whatever it is, the next case gets another robot
        return False
