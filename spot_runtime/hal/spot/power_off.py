"""Bringing the robot to rest whatever is in the way for a moment: a refusal, or a lease that somebody took."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from spot_runtime.hal.errors import HalError, LeaseHeldError
from spot_runtime.hal.spot.motions import Motions, Wait
from spot_runtime.hal.spot.pace import Pace
from spot_runtime.hal.spot.session import RobotCalls

RETRY_S: Final = 0.5
"""Robot time between two attempts."""

TAKEN_OVER_S: Final = 3.0
"""Robot time after which somebody who took the lease is said to have the robot: some take it for a moment."""


def power_off(
    session: RobotCalls,
    motions: Callable[[], Motions],
    pause: Wait,
    pace: Pace,
    *,
    timeout_s: float,
    even_if_off: bool,
    on_taken_up: Callable[[], None],
) -> None:
    """Sit and cut power; returns when it is cut. A robot that refuses is asked again for ``timeout_s``.

    ``motions`` makes the vendor's motions anew for each attempt; ``pause`` lets robot time pass, and raises where the
    lease is lost; ``on_taken_up`` is told where nobody had a lost lease any more, and it was taken again.

    Raises:
        LeaseHeldError: Somebody has taken the lease and keeps it, or who has it is not known.
        HalError: The robot refuses.
    """
    until_s = pace.chore_now_s() + TAKEN_OVER_S
    while True:
        try:
            if not session.has_lease:
                _take_up_lease(session)
                on_taken_up()
            return _try(motions, pause, pace, pace.chore_now_s() + timeout_s, even_if_off=even_if_off)
        except LeaseHeldError:
            session.has_lease = False
            if pace.chore_now_s() >= until_s:
                raise
        pace.pause(RETRY_S)


def _take_up_lease(session: RobotCalls) -> None:
    """Take the lease that was lost, unless somebody has it."""
    try:
        session.acquire_lease()
    except LeaseHeldError as error:
        raise LeaseHeldError(f"{error}; whoever commands the robot is answerable for it; IT MAY HAVE POWER") from error
    except HalError as error:
        raise LeaseHeldError(f"the lease is gone, and THE ROBOT MAY HAVE POWER, see to it: {error}") from error


def _try(motions: Callable[[], Motions], pause: Wait, pace: Pace, until_s: float, *, even_if_off: bool) -> None:
    """Try again, also where the robot refuses: what is in the way for a moment must not leave it standing."""
    while True:
        try:
            return motions().power_off(even_if_off=even_if_off)
        except LeaseHeldError:
            raise
        except HalError as error:
            if pace.chore_now_s() >= until_s:
                raise
            # A robot that refuses has seen the newer lease, too.
            even_if_off &= type(error) is HalError
        pause(RETRY_S)
