"""One ``spot-rl diagnose``: read, prepare, diagnose, write."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from diagnosis.closed_loop.simulation import Rollouts, rollouts_under
from diagnosis.library import LibraryEffect
from diagnosis.progress import Progress
from diagnosis.read import apart_by_gains, find_policy_file, read_logs
from diagnosis.read.robot_file import SPOT, load_robot
from diagnosis.report.output import write_all
from diagnosis.report.words import headline
from diagnosis.verdict.diagnose import Diagnosis, diagnose
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import Policy, load_policy
from trainer.simulate.engine import IN_THIS_PROCESS, Place


@dataclass(frozen=True)
class Request:
    """What was asked for on the command line."""

    logs: tuple[Path, ...]
    nominal: RobotModel
    nominal_name: str
    out: Path
    library: Mapping[str, LibraryEffect]
    policy: Path | None = None
    robot: Path | None = None
    with_synthesis: bool = False
    place: Place = IN_THIS_PROCESS
    """Where closed loops are computed."""
    seed: int = 0


def run_session(request: Request, progress: Progress) -> tuple[Diagnosis, dict[str, Path]]:
    """Diagnose and write.

    Returns:
        The diagnosis, and the files by key.

    Raises:
        SpotRlError: Something that was given is wrong; nothing is written then.
    """
    robot = load_robot(request.robot) if request.robot is not None else SPOT
    progress("reading logs")
    runs, notes = read_logs(request.logs, robot, progress.at)
    file = find_policy_file(request.policy, runs)
    policy: Policy | None = None
    engine: Rollouts | None = None
    if file is not None:
        policy = load_policy(file)
        runs, at_other_gains = apart_by_gains(runs, policy)
        notes = (*notes, *at_other_gains)
        engine = rollouts_under(policy, request.place)
    for text in notes:
        progress(f"note: {text}")
    with nullcontext() if engine is None else engine:
        result = diagnose(
            runs,
            request.nominal,
            policy,
            np.random.default_rng(request.seed),
            progress,
            library=request.library,
            with_synthesis=request.with_synthesis,
            nominal_name=request.nominal_name,
            limits_rad=robot.limits_rad,
            engine=engine,
        )
    if robot is not SPOT:
        # The library's recordings are walks of Spot: what to do stays, the command that would make Spot do it goes.
        differences = tuple(d.model_copy(update={"split": None}) for d in result.verdict.differences)
        result = replace(result, verdict=result.verdict.model_copy(update={"differences": differences}))
    told = tuple(dict.fromkeys((*notes, *result.verdict.notes)))
    verdict = result.verdict.model_copy(update={"notes": told})
    result = replace(result, verdict=verdict.model_copy(update={"headline": headline(verdict)}))
    progress("writing the report")
    return result, write_all(result, request.out, request.library)
