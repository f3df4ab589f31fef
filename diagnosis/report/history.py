"""A folder of dated diagnoses of one robot: which are there, and where the next one goes.

A diagnosis lies in a folder named by the day of its logs, ``2026-11-19``, or with words behind it,
``2026-11-19-new-knee``; names put them in order.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import date, datetime, timezone
from pathlib import Path
from typing import Final

from pydantic import ValidationError

from diagnosis.document import Verdict, load_verdict
from diagnosis.report.output import NAMES
from spot_log import Run, open_run
from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.model_file import RobotModel, load_model
from spot_model.io.settings import explain
from trainer.signals.log_files import log_files

DATED: Final = re.compile(r"(\d{4}-\d{2}-\d{2})(-[\w.-]+)?")
"""Names of the folders."""
FIRST_YEAR: Final = 2015
"""A log that is older was stamped by a clock that nobody had set."""


@dataclass(frozen=True)
class Dated:
    """One diagnosis of a history."""

    folder: Path
    verdict: Verdict
    model: RobotModel
    """The corrected model."""

    @property
    def name(self) -> str:
        """The folder's: a date, with words behind it or without."""
        return self.folder.name

    @property
    def day(self) -> date:
        """The date alone."""
        return day_of(self.name)


@dataclass(frozen=True)
class Filing:
    """Where a diagnosis goes, and what it starts from."""

    out: Path
    nominal: str
    since: str = ""
    """Name of the diagnosis whose corrected model is the nominal one; empty where a model was given."""
    others: tuple[Dated, ...] = ()
    """The other diagnoses of the history."""

    def check_robot(self, robot: str) -> None:
        """Raise ``BadInputError`` if the history is of a robot other than the logs'; either may be without a name."""
        other = next((d for d in reversed(self.others) if robot and d.verdict.robot not in ("", robot)), None)
        if other is not None:
            raise BadInputError(
                f"these logs are of robot {robot}; {other.folder} is of {other.verdict.robot}; keep a history of its "
                "own for each robot"
            )


def day_of(name: str) -> date:
    """The date at the beginning of a folder's name. Raises BadInputError: there is none."""
    found = DATED.fullmatch(name)
    try:
        return date.fromisoformat(found[1] if found else "")
    except ValueError:
        told = "a date such as 2026-11-19, with words behind it if need be (2026-11-19-new-knee)"
        raise BadInputError(f"{name!r} is no date of a history; allowed: {told}") from None


def read_history(folder: Path) -> tuple[Dated, ...]:
    """The diagnoses of a history, oldest first; none where the folder is not there yet.

    Raises:
        BadInputError: One of them is not whole, or its folder has no date for a name.
    """
    return tuple(_dated(own) for own in sorted(folder.iterdir()) if _is_one(own)) if folder.is_dir() else ()


def _is_one(own: Path) -> bool:
    return own.is_dir() and (DATED.fullmatch(own.name) is not None or (own / NAMES["verdict"]).exists())


def _dated(own: Path) -> Dated:
    day_of(own.name)
    try:
        return Dated(own, load_verdict(own / NAMES["verdict"]), load_model(str(own / NAMES["model"])))
    except OSError as error:
        why = f"{error.filename}: {error.strerror}"
    except ValidationError as error:
        why = f"{NAMES['verdict']}: {explain(error)}"
    except BadInputError as error:
        why = str(error)
    raise BadInputError(f"{own} holds no whole diagnosis ({why}); move it away, and diagnose its logs again")


def file_next(history: Path, logs: Sequence[Path], nominal: str | None, out: Path | None) -> Filing:
    """Decide where the diagnosis of logs goes in a history, and which model it starts from.

    Args:
        history: The folder.
        logs: Files, or folders of them.
        nominal: The model that was asked for; by default the corrected model of the newest date before.
        out: The dated folder that was asked for; by default the day of the last log, UTC.

    Raises:
        BadInputError: That date is there already, the logs tell no date, or there is neither an earlier diagnosis nor a
            model.
    """
    earlier = read_history(history)
    place = history / _date_of(logs, history) if out is None else out
    day_of(place.name)
    if place.absolute().parent != history.absolute():
        raise BadInputError(f"--out {place} is not in the history; give {history / place.name}, or leave it out")
    if place.exists():
        told = f"for another one of that day, give --out {place}-2; nothing is overwritten"
        raise BadInputError(f"{place} exists: the history has a diagnosis of that date; {told}")
    before = [d for d in earlier if d.name < place.name]
    if nominal is not None:
        return Filing(place, nominal, "", earlier)
    if not before:
        told = "give your simulator's model with --nominal; later dates start from the corrected model of the last"
        raise BadInputError(f"{history} has no diagnosis before {place.name}; {told}")
    return Filing(place, str(before[-1].folder / NAMES["model"]), before[-1].name, earlier)


def _date_of(logs: Sequence[Path], history: Path) -> str:
    """The day of the last log, UTC, as the names of log files have it; only headers are read."""
    runs: list[Run] = []
    for file in log_files(logs):
        with suppress(SpotRlError, OSError):
            runs.append(open_run(file))
    if not runs:
        raise BadInputError(f"{logs[0]} holds no log that can be read; give files written by spot-rl (*.mcap)")
    last = max(runs, key=lambda run: run.header.started_host_stamp_ns)
    began = datetime.fromtimestamp(last.header.started_host_stamp_ns * 1e-9, timezone.utc)
    if began.year < FIRST_YEAR:
        told = f"name it, as --out {history / '2026-11-19'}"
        raise BadInputError(f"log {last.path} tells no date (it began at {began:%Y-%m-%d}); {told}")
    return f"{began:%Y-%m-%d}"
