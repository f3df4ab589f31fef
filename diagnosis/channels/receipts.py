"""Which commands were lost, and how long the others took: counted from the receipts that states name.

A state names the newest command only. One that no state names was lost, or it arrived between the same two states as a
later one: earlier by itself, or, since a stream keeps its order, at once with the later one that it held up. How likely
each is follows from when it was sent, from the receipt after it and the state before that, and from the delays of this
robot. The share that is lost and the distribution of delays are found together, by expectation and maximisation. A
command's delay is its own, as if no earlier one had held it up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import repeat
from typing import Final

import numpy as np
from scipy.ndimage import median_filter

from diagnosis.channels import Array, Ints
from spot_log.tools.measures import NEVER_NS
from trainer.signals.recording import Recording

AGAIN: Final = 0.3
"""Chances to begin with that a command is lost, after one that arrived and after one that was lost."""
CLEAR_NATS: Final = 10.0
"""Losses must make the stamps likelier than none by so much; links without any rarely reach 5."""
MOST_HIDDEN: Final = 0.22
"""Where more commands than this hide behind others, losses do not show: long waits, and a command with every state."""
BIN_SHARE: Final = 0.05
"""Width of the bins of delays, over the states' period."""
TAIL: Final = 0.97
"""Delays fall off exponentially beyond this quantile of those that hide nothing: the latest are the ones hidden."""
WANDER: Final = 31
"""A link's delay wanders slowly; the median of so many commands follows it."""
LONGEST_NS: Final = 1_000_000_000
"""A command that takes longer belongs to a pause, not to the link."""
HIDDEN_ERROR: Final = 0.05
"""Share by which the number of hidden ones may be off: neighbours' delays are alike, and tails are extrapolated."""


@dataclass(frozen=True)
class Receipts:
    """What stamps say of all recordings' commands, end to end, shape (n,); NaN where they say nothing."""

    lost: Array
    """Chance that the command never arrived."""
    delay_s: Array
    """From the stamp of the state that it answers to its arrival, as expected from all stamps."""
    late_s: Array
    """Its delay beyond that of a fast command, less what the link wanders."""
    error: float
    """Standard deviation of the mean of ``lost``: of a count, and of what is hidden."""


@dataclass(frozen=True)
class _Places:
    """Delays among the bins."""

    bin: Ints
    part: Array
    """Of the bin, up to the delay."""

    @classmethod
    def of(cls, bins: Array) -> _Places:
        """Of delays in units of a bin's width."""
        whole = np.maximum(bins, 0.0).astype(np.intp)
        return cls(whole, np.maximum(bins, 0.0) - whole)

    def up_to(self, f: Array) -> Array:
        """Chance of a delay up to each."""
        return np.asarray((np.cumsum(f) - f)[self.bin] + self.part * f[self.bin])

    def spread(self, weight: Array, n: int) -> Array:
        """Weight that a bin has from all delays at or beyond it, shape (n,); the share of it in a delay's own bin."""
        whole = np.bincount(self.bin, weight, n)
        return np.asarray(np.cumsum(whole[::-1])[::-1] - whole + np.bincount(self.bin, weight * self.part, n))


def read(recordings: Sequence[Recording], fast_quantile: float) -> Receipts:
    """Tell lost commands of one robot from hidden ones; a fast command is at ``fast_quantile`` of the delays."""
    answered = np.concatenate([r.commands.state_robot_stamp_ns for r in recordings])
    sent = np.concatenate([_sent_ns(r) for r in recordings])
    starts = np.cumsum([0, *(len(r.commands) for r in recordings)])
    named, received, before, unseen = np.concatenate(
        [_named(r, start) for r, start in zip(recordings, starts, strict=False)], axis=1
    )
    order = np.argsort(-unseen, kind="stable")
    order = order[(received - sent[named - unseen])[order] < LONGEST_NS]
    named, received, before, unseen = named[order], received[order], before[order], unseen[order]
    lost, bins = np.full(len(sent), np.nan), np.full(len(sent), np.nan)
    if not len(named):
        return Receipts(lost, bins, bins, 1.0)
    # The commands before a receipt that nothing named, one after the other, the receipt's own last.
    rows = [named[:m] - unseen[:m] + k for k in range(unseen.max()) if (m := int(np.sum(unseen > k)))]
    width = BIN_SHARE * 1e9 * recordings[0].period_s
    least = np.min(received - sent[named])
    until = [_Places.of((received[: len(r)] - sent[r] - least) / width) for r in (*rows, named)]
    since = [_Places.of((before[: len(r)] - sent[r] - least) / width) for r in rows]
    without, some = _likeliest(until, since, 0.0), _likeliest(until, since, 0.01)
    n, n_unseen = int(np.sum(unseen + 1)), int(unseen.sum())
    is_clear = some[-1] > without[-1] + CLEAR_NATS and n_unseen - sum(x.sum() for x in some[1]) < MOST_HIDDEN * n
    f, lost_of, bins_of, _ = some if is_clear else without
    for r, one, other in zip((*rows, named), lost_of, bins_of, strict=True):
        lost[r], bins[r] = one, other
    with np.errstate(invalid="ignore", divide="ignore"):
        own_s = (bins / (1.0 - lost) * width + least) * 1e-9
    fast_s = (float(np.searchsorted(np.cumsum(f), fast_quantile)) * width + least) * 1e-9
    error = float(np.hypot(np.sqrt(n_unseen + 1.0), HIDDEN_ERROR * (n_unseen - np.nansum(lost))) / n)
    return Receipts(lost, own_s + (sent - answered) * 1e-9, own_s - fast_s, error)


def _sent_ns(recording: Recording) -> Ints:
    """When each command was sent, by the robot's clock, and how much later than usual the link is then."""
    commands, received = recording.commands, recording.command_ns
    sent = np.where(commands.robot_stamp_ns > 0, commands.robot_stamp_ns, commands.state_robot_stamp_ns)
    # One that says neither counts as sent with the one before.
    sent = np.maximum.accumulate(sent)
    seen = np.flatnonzero(received < NEVER_NS)
    delay = (received - sent)[seen]
    wander = median_filter(delay, WANDER, mode="nearest") - np.median(delay)
    return np.asarray(sent + np.round(np.interp(np.arange(len(sent)), seen, wander)).astype(np.int64))


def _named(recording: Recording, start: int) -> Ints:
    """Commands that states name, their receipts, the stamp of the state before, and how many before them none names."""
    named = np.flatnonzero(recording.command_ns < NEVER_NS)
    received = recording.command_ns[named]
    stamps = recording.stamp_ns[recording.present]
    before = stamps[np.maximum(np.searchsorted(stamps, received) - 1, 0)]
    return np.stack([named + start, received, before, np.diff(named, prepend=named[0] - 1) - 1])


def _likeliest(until: list[_Places], since: list[_Places], p: float) -> tuple[Array, list[Array], list[Array], float]:
    """Start from a share lost, and find the likeliest; none stays none.

    ``until`` holds the delays with which commands would have arrived with the receipt after them, those of the receipts
    themselves last; ``since`` those with which they would have with the state before it.

    Returns:
        The distribution of delays by bin; of each command the chance that it is lost, and the chance that it is not
        times its mean bin; and the logarithm of the likelihood.
    """
    own, n = until[-1], sum(len(place.bin) for place in until)
    size = max(int(place.bin.max()) for place in until) + 2
    again, has_unseen = AGAIN, np.arange(len(own.bin)) < (len(until[0].bin) if since else 0)
    f = np.bincount(own.bin[~has_unseen], minlength=size) + 1.0 / size
    f, middle, nats = f / f.sum(), np.arange(size) + 0.5, -np.inf
    tail = int(np.sum(np.cumsum(f) < TAIL))
    lost: list[Array] = []
    bins: list[Array] = []
    for _ in range(60):
        # Forwards: chance that none has arrived, that the latest arrives before the receipt, and with it.
        state, steps, q = np.zeros((3, len(own.bin))), [], 1.0 - p
        state[0] = 1.0
        for miss, a, s in zip((p, *repeat(again, len(since))), until, since, strict=False):
            none, some, held = past = state[:, : len(a.bin)].copy()
            at, to, window = f[a.bin], a.up_to(f), np.maximum(a.up_to(f) - s.up_to(f), 0.0)
            steps.append((miss, past, at, to, window))
            state[:, : len(a.bin)] = (
                miss * none,
                some * (p + q * to) + none * (1.0 - miss) * window,
                held * (p + q * to) + (none * (1.0 - miss) + some * q) * at,
            )
        at, to = f[own.bin], own.up_to(f)
        comes = np.where(has_unseen, 1.0 - again, q)
        chance = (state[0] * comes + state[1] * q) * at + state[2] * q * to + 1e-300
        nats = float(np.sum(np.log(chance)))
        free, held = (state[0] * comes + state[1] * q) * at / chance, state[2] * q / chance
        exact, spread = np.bincount(own.bin, free, size), own.spread(held, size)
        lost, bins = [np.zeros(len(own.bin))], [free * (own.bin + own.part) + held * own.up_to(f * middle)]
        # Backwards: what follows a command, whatever becomes of it.
        after, after_lost, in_a_row = np.stack([comes * at, q * at, q * to]) / chance, 0.0, 0.0
        for a, s, (miss, past, at, to, window) in zip(until[-2::-1], since[::-1], steps[::-1], strict=True):
            none, some, held = after[:, : len(a.bin)].copy()
            no_other = miss * past[0] * none
            later = past[1] * some + past[2] * held
            lost.insert(0, no_other + p * later)
            after_lost, in_a_row = in_a_row, in_a_row + float(no_other.sum())
            first, later = (1.0 - miss) * past[0] * some, q * later
            with_it = ((1.0 - miss) * past[0] + q * past[1]) * at * held
            exact += np.bincount(a.bin, with_it, size)
            spread += a.spread(first + later, size) - s.spread(first, size)
            moment = f * middle
            bins.insert(0, (first + later) * a.up_to(moment) - first * s.up_to(moment) + with_it * (a.bin + a.part))
            after[:, : len(a.bin)] = (
                miss * none + (1.0 - miss) * (window * some + at * held),
                (p + q * to) * some + q * at * held,
                (p + q * to) * held,
            )
        # What was lost in a row was followed by a command each; the last round of the loop was the first in its row.
        again = after_lost / max(in_a_row, 1e-9)
        p = (sum(float(x.sum()) for x in lost) - after_lost) / (n - in_a_row)
        f = _with_tail(exact + f * np.maximum(spread, 0.0), tail)
    return f, lost, bins, nats


def _with_tail(f: Array, first: int) -> Array:
    """The same weights as shares, falling off geometrically from a bin on."""
    steps = np.arange(len(f) - first)
    mean = float(f[first:] @ steps / f[first:].sum())
    fall = (mean / (1.0 + mean)) ** steps
    return np.asarray(np.concatenate([f[:first], f[first:].sum() * fall / fall.sum()]) / f.sum())
