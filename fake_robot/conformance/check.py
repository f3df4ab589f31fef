"""A check: what is sent, what a robot must answer, and how we know."""

from __future__ import annotations

import enum
from collections.abc import Callable
from dataclasses import dataclass

import grpc

from fake_robot.conformance.server import OpenError, Server, SkippedError


class Basis(enum.Enum):
    """How we know what a robot answers."""

    DOCUMENTED = "documented"
    """The protos or the SDK's documents say it."""
    MEASURED = "measured on a robot by others"
    """Published recordings or programs that run on robots show it."""
    GUESS = "our guess"
    """Nobody says it; any of the listed answers is taken, and the fake has a switch where there are several."""


class Needs(enum.IntEnum):
    """What a check does to the robot; each includes the ones before."""

    NOTHING = 0
    LEASE = 1
    """Acquires the lease for a moment; nothing that it sends gives power, or moves a robot but that it sits down."""
    MOTION = 2
    """Sends what could give power, and in one session powers the motors, stands, walks and sits."""


class CheckOutcome(enum.Enum):
    """What became of a check."""

    PASS = "pass"  # noqa: S105 - a verdict
    FAIL = "fail"
    DIFFERS = "differs"
    """A guess of ours that this server does not share."""
    OPEN = "open"
    """It could not be judged on this server now, though it was asked for and the server offers it."""
    SKIPPED = "skipped"
    """Not asked for, or not offered by the server."""


_NO_ANSWER = {grpc.StatusCode.DEADLINE_EXCEEDED, grpc.StatusCode.UNAVAILABLE}


@dataclass(frozen=True)
class ConformanceCheck:
    """One row of the table."""

    name: str
    """Name by which it is chosen and reported."""
    rpc: str
    """Service, method and field."""
    sends: str
    expects: tuple[str, ...]
    """Names of statuses, of gRPC codes, or words; any of them is right."""
    basis: Basis
    source: str
    needs: Needs
    switch: str
    """Key of the scenario that changes the fake's answer; empty if there is none."""
    probe: Callable[[Server], str]
    """Sends it; returns the answer in the words of ``expects``."""


@dataclass(frozen=True)
class Result:
    """A check and its answer."""

    check: ConformanceCheck
    verdict: CheckOutcome
    seen: str
    gave_power: bool = False
    """Whether the motors had power after it that they had not before."""


def check(
    rpc: str,
    sends: str,
    expects: str | tuple[str, ...],
    *,
    source: str,
    basis: Basis = Basis.DOCUMENTED,
    needs: Needs = Needs.NOTHING,
    switch: str = "",
) -> Callable[[Callable[[Server], str]], ConformanceCheck]:
    """Make a check of a probe, under the probe's name."""
    accepted = (expects,) if isinstance(expects, str) else expects
    return lambda probe: ConformanceCheck(probe.__name__, rpc, sends, accepted, basis, source, needs, switch, probe)


def judge(item: ConformanceCheck, server: Server, allowed: Needs) -> Result:
    """Run one check, if what it needs is allowed."""
    if item.needs > allowed:
        return Result(item, CheckOutcome.SKIPPED, "needs --with-motion")
    try:
        seen = item.probe(server)
    except (SkippedError, OpenError) as reason:
        return Result(item, CheckOutcome.OPEN if isinstance(reason, OpenError) else CheckOutcome.SKIPPED, str(reason))
    except grpc.RpcError as error:
        seen = error.code().name
        if error.code() in _NO_ANSWER and seen not in item.expects:
            return Result(item, CheckOutcome.OPEN, f"no answer: {seen}")
    except Exception as error:  # noqa: BLE001 - a stranger's answers must not end the suite
        return Result(item, CheckOutcome.OPEN, f"the answers cannot be read: {type(error).__name__}: {error}")
    if seen in item.expects:
        return Result(item, CheckOutcome.PASS, seen)
    return Result(item, CheckOutcome.DIFFERS if item.basis is Basis.GUESS else CheckOutcome.FAIL, seen)
