"""One check: a name, and a function that returns a finding and advice."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from enum import Enum

from spot_model.errors import SpotRlError
from spot_model.text import plain


class CheckResult(Enum):
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

    verdict: CheckResult
    found: str
    advice: str = ""
    """What to do; empty where nothing is to be done."""
    name: str = ""
    """Name of the check, once it is made."""

    def to_data(self) -> dict[str, str]:
        """Plain data for JSON."""
        return {"name": self.name, "verdict": self.verdict.value, "found": self.found, "advice": self.advice}


@dataclass(frozen=True)
class DoctorCheck:
    """Something to look at. ``look`` may raise SpotRlError, which is a failure in the error's words."""

    name: str
    look: Callable[[], Finding]

    def make(self) -> Finding:
        """Make it. A defect of the check itself is a failure too, never an end of the whole."""
        try:
            finding = self.look()
        except SpotRlError as error:
            found, _, advice = str(error).partition("; ")
            finding = fail(found, advice)
        except Exception as error:  # noqa: BLE001 - the other checks are still worth making
            finding = fail(f"the check broke: {type(error).__name__}: {error}", "report it with this line")
        return replace(finding, found=plain(finding.found), advice=plain(finding.advice), name=self.name)


def ok(found: str) -> Finding:
    """All is well."""
    return Finding(CheckResult.OK, found)


def warn(found: str, advice: str) -> Finding:
    """A run goes, but worse than it could."""
    return Finding(CheckResult.WARN, found, advice)


def fail(found: str, advice: str) -> Finding:
    """A run would not start, or would not end well."""
    return Finding(CheckResult.FAIL, found, advice)


def skipped(why: str) -> Finding:
    """Not checked."""
    return Finding(CheckResult.SKIPPED, why)


def is_fit(findings: Iterable[Finding]) -> bool:
    """Whether no check failed."""
    return all(finding.verdict is not CheckResult.FAIL for finding in findings)
