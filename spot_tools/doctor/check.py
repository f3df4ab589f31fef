"""One check: a name, and a function that returns a finding and advice."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from enum import Enum

from spot_model.errors import SpotRlError
from spot_model.text import plain


class Verdict(Enum):
    """How a check ended."""

    OK = "ok"
    WARN = "warn"
    """A run goes, but worse than it could."""
    FAIL = "fail"
    """A run would not start, or would not end well."""
    SKIPPED = "skipped"
    """Not checked; the finding says why."""


@dataclass(frozen=True)
class Finding:
    """What a check found."""

    verdict: Verdict
    found: str
    advice: str = ""
    """What to do; empty where nothing is to be done."""


@dataclass(frozen=True)
class Check:
    """Something to look at. ``look`` may raise SpotRlError, which is a failure in the error's words."""

    name: str
    look: Callable[[], Finding]


@dataclass(frozen=True)
class Result:
    """A check that was made."""

    name: str
    verdict: Verdict
    found: str
    advice: str

    def to_data(self) -> dict[str, str]:
        """Plain data for JSON."""
        return {**asdict(self), "verdict": self.verdict.value}


def ok(found: str) -> Finding:
    """All is well."""
    return Finding(Verdict.OK, found)


def warn(found: str, advice: str) -> Finding:
    """A run goes, but worse than it could."""
    return Finding(Verdict.WARN, found, advice)


def fail(found: str, advice: str) -> Finding:
    """A run would not start, or would not end well."""
    return Finding(Verdict.FAIL, found, advice)


def skipped(why: str) -> Finding:
    """Not checked."""
    return Finding(Verdict.SKIPPED, why)


def make(check: Check) -> Result:
    """Make a check. A defect of the check itself is a failure too, never an end of the whole."""
    try:
        finding = check.look()
    except SpotRlError as error:
        found, _, advice = str(error).partition("; ")
        finding = fail(found, advice)
    except Exception as error:  # noqa: BLE001 - the other checks are still worth making
        finding = fail(f"the check broke: {type(error).__name__}: {error}", "report it with this line")
    return Result(check.name, finding.verdict, plain(finding.found), plain(finding.advice))


def is_fit(results: Iterable[Result]) -> bool:
    """Whether no check failed."""
    return all(result.verdict is not Verdict.FAIL for result in results)
