"""Whether a log may be compared with a prediction: a run of its commands and its policy, made after it, and whole."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from typing import Final

import numpy as np

from diagnosis.next.predict.prediction import Prediction, recorded
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from trainer.signals.policy_ticks import policy_ticks

SLACK_S: Final = 5.0 / facts.POLICY_RATE_HZ
"""A run begins and ends with a tick, and may skip some: five of them."""
ROUNDING: Final = 1e-6
"""m/s and rad/s: what is lost where a log keeps commands in single precision."""


def check_prediction(made: Prediction, path: Path, wanted: VelocitySequence, policy: Policy, posterior: str) -> None:
    """Refuse a prediction that is there and is of something else than is asked for.

    Raises:
        BadInputError: It is of another command, policy or diagnosis (``posterior`` is the digest of the one asked).
    """
    parts = {
        f"other commands of sequence {made.sequence.name}": made.sequence == wanted,
        f"the policy with SHA-256 {made.policy_sha256[:12]}…": made.policy_sha256 == policy.sha256,
        "another diagnosis": made.posterior_sha256 == posterior,
    }
    differ = [what for what, is_same in parts.items() if not is_same]
    if differ:
        raise BadInputError(
            f"{path} holds a prediction of {' and '.join(differ)}, which stays as it is; give --out FILE for another"
        )


def check_log(made: Prediction, run: Run, policy: Policy) -> None:
    """Refuse a log that cannot say whether a prediction held.

    Raises:
        BadInputError: The log was used in the diagnosis, began before the prediction was made (by the clocks of the two
            computers), is of another policy or of other commands, or is not of the whole sequence.
    """
    path, header = run.path, run.header
    if recorded(run) in made.logs:
        raise BadInputError(f"log {path} was used in the diagnosis, so it proves nothing; give a run made since then")
    if header.started_host_stamp_ns <= made.made_host_stamp_ns:
        raise BadInputError(
            f"log {path} began at {_utc(header.started_host_stamp_ns)}, before the prediction was made at "
            f"{_utc(made.made_host_stamp_ns)}; give a run made since then (if the clock of the computer that recorded "
            "it was wrong, set it and run again)"
        )
    if header.policy_sha256 not in ("", policy.sha256):
        raise BadInputError(
            f"log {path} is of {header.policy_name or 'a policy'} with SHA-256 {header.policy_sha256[:12]}…; predicted "
            f"was {policy.contract.name} with {policy.sha256[:12]}…; give a run of that policy"
        )
    _check_commands(made.sequence, run)


def _check_commands(sequence: VelocitySequence, run: Run) -> None:
    rows = policy_ticks(run)
    stamps = run.ticks.robot_stamp_ns[rows]
    time_s = (stamps - stamps[0]) * 1e-9 if len(rows) else np.zeros(1)
    told, path = run.ticks.velocity_command[rows], run.path
    for at_s, command in zip(time_s, told, strict=False):
        near = np.array([sequence.at(max(0.0, t)) for t in np.linspace(at_s - SLACK_S, at_s + SLACK_S, 11)])
        if not ((command >= near.min(axis=0) - ROUNDING) & (command <= near.max(axis=0) + ROUNDING)).all():
            raise BadInputError(
                f"log {path} (sequence {run.header.command_sequence or 'unnamed'}) is of other commands than "
                f"{sequence.name}: after {at_s:.2f} s it was told {_words(command)}, predicted was "
                f"{_words(sequence.at(at_s))}; give a run of the predicted sequence"
            )
    if abs(time_s[-1] - sequence.duration_s) > SLACK_S:
        raise BadInputError(
            f"log {path} has {time_s[-1]:.1f} s under the policy (outcome: {run.outcome}); predicted were "
            f"{sequence.duration_s:g} s of {sequence.name}; give a whole run"
        )


def _words(command: np.ndarray) -> str:
    return ", ".join(f"{v:.2f}" for v in command) + " (m/s, m/s, rad/s)"


def _utc(stamp_ns: int) -> str:
    return datetime.fromtimestamp(stamp_ns * 1e-9, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
