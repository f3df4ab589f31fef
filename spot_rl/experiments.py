"""What to run next on a diagnosed robot, and what it will do."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from diagnosis.next.prediction import Prediction
from diagnosis.next.session import Session
from diagnosis.session import INPUTS
from spot_model.errors import BadInputError
from spot_model.policy.policy import Policy
from spot_rl.checks import AnyPath, a_file, existing, new_file, to_path, whole, with_our_errors
from spot_rl.inputs import policy_file


@with_our_errors
def next_experiment(diagnosis: AnyPath, *, policy: AnyPath | Policy | None = None, seed: int = 0) -> dict[str, Any]:
    """Rank the experiments that would tell most about the cause of a gap, as ``spot-rl diagnose next`` does.

    Takes four to ten minutes on two cores. Writes next.html, ranking.json and a file for each experiment into the
    folder ``next`` (``next-2``, … if it is there) of the diagnosis.

    Args:
        diagnosis: The folder that :func:`diagnose` or ``spot-rl diagnose`` wrote.
        policy: Policy for walks; by default the policy of the logs.
        seed: Random seed.

    Returns:
        ``page`` (path of next.html), ``causes`` (probability of each possible cause) and ``experiments``, the most
        telling first. Each has its ``name``, its information (``bits``), ``robot_s``, ``decides``, ``loads`` and
        ``needs``. The reasons against it are in ``refused``, and ``command`` runs it.

    Raises:
        SpotRlError: The folder holds no diagnosis, or the policy is not valid.
    """
    session = _opened(diagnosis, policy, seed)
    session.rank()
    page = session.page
    assert page is not None  # noqa: S101 - the ranking wrote it
    ranking = json.loads((page.parent / "ranking.json").read_text(encoding="utf-8"))
    return {"page": page, "causes": ranking["causes"], "experiments": ranking["experiments"]}


@with_our_errors
def predict(
    diagnosis: AnyPath,
    sequence: AnyPath,
    *,
    log: AnyPath | None = None,
    policy: AnyPath | Policy | None = None,
    out: AnyPath | None = None,
    seed: int = 0,
) -> Prediction:
    """Predict a run of a command sequence on a diagnosed robot; after the run, compare its log with the prediction.

    Args:
        diagnosis: The folder that :func:`diagnose` or ``spot-rl diagnose`` wrote.
        sequence: A built-in sequence (``forward``, ``six_directions``, ``random``, ``standing``) or a YAML file.
        log: Log of the run, made after the prediction.
        policy: The policy that will run; by default the policy of the logs.
        out: The prediction's file; by default ``prediction_SEQUENCE.json`` in the diagnosis' folder. A prediction that
            is there is read, not made again.
        seed: Random seed.

    Returns:
        The prediction: ``forecasts`` (``name``, ``value``, ``low``, ``high``, ``unit``; with a log, ``measured``),
        ``fell`` (share of simulated robots that fell), ``notes``; ``lines()`` says all in words.

    Raises:
        SpotRlError: The folder holds no diagnosis, the sequence is beyond the policy, or the log is of something else.
    """
    wanted = os.fspath(to_path(sequence, "sequence"))
    run = None if log is None else a_file(log, "log")
    file = None if out is None else to_path(out, "out")
    if file is not None and not file.is_file():
        new_file(file, "out")
    return _opened(diagnosis, policy, seed).prediction(wanted, run, file)[0]


def _opened(diagnosis: AnyPath, policy: AnyPath | Policy | None, seed: int) -> Session:
    folder: Path = existing(diagnosis, "diagnosis")
    if not (folder / INPUTS).is_file():
        raise BadInputError(
            f"diagnosis {folder} holds no {INPUTS}; give the folder that spot_rl.diagnose or spot-rl diagnose wrote"
        )
    file = None if policy is None else policy_file(policy)
    return Session.opened(folder, [], None, file, whole(seed, "seed"))
