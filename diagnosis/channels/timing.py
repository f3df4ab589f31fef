"""Channel *time stamps*: how long commands take, how evenly they come, and which are lost; by the robot's stamps.

A sample is the mean of a window's commands. Time convention: a command's delay runs from the stamp of the state that
it answers to the robot's stamp of its receipt, both on the robot's clock. The nominal model's constant delay is taken
off.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from scipy.stats import norm as normal

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView, Ints
from diagnosis.channels.stack import Stack
from spot_log.tools.measures import NEVER_NS
from spot_model.effects.base import Effect
from spot_model.effects.command.command_delay import CommandDelay

ROWS: Final = ("delay", "spread", "lost")
FLOOR: Final = np.array([5e-4, 5e-4, 0.02])
"""Delays are read from a stream of 3 ms, and any real link varies by half a millisecond."""
WINDOW_S: Final = 0.25
"""Commands are averaged over so long: one that is lost says little, a share of them much."""
FAST_QUANTILE: Final = 0.05
"""Spread counts from the delay that this share of commands stays under."""
NARROW_SHARE: Final = 0.25
"""Of the states' period: a wider spread of delays is a jitter's."""
LONGEST_S: Final = 1.0
"""A command that takes longer belongs to a pause, not to the link."""


def timing_view(stack: Stack, effects: Sequence[Effect]) -> ChannelView | ChannelOff:
    """Build the channel *time stamps*."""
    if not all(r.has_receipts for r in stack.recordings):
        return ChannelOff(Channel.TIME_STAMPS, "the robot's receipts of commands were not recorded")
    if not all(np.any(r.commands.state_robot_stamp_ns > 0) for r in stack.recordings):
        return ChannelOff(Channel.TIME_STAMPS, "commands do not say which state they answer")
    nominal_s = nominal_delay_s(effects)
    length = max(1, round(WINDOW_S / stack.period_s))
    parts, rows = [], []
    for first, recording in zip(stack.starts(), stack.recordings, strict=True):
        commands = recording.commands
        answered = commands.state_robot_stamp_ns
        last = recording.command_ns[recording.command_ns < NEVER_NS].max(initial=0)
        # The newest commands may still be under way when the log ends.
        known = (answered > 0) & (answered < last)
        arrived = recording.command_ns < NEVER_NS
        delay = np.where(arrived, (recording.command_ns - answered) * 1e-9, np.nan)[known]
        delay = np.where(delay < LONGEST_S, delay, np.nan)
        good = delay[np.isfinite(delay)]
        fastest = float(np.quantile(good, FAST_QUANTILE)) if len(good) else np.nan
        lost = (~arrived)[known] - hidden_share(delay, recording.period_s)
        single = np.stack([delay - nominal_s, delay - fastest, lost], axis=1)
        means, state = _windows(single, recording.rows_at(answered[known]), length)
        parts.append(means)
        rows.append(first + state)
    response = np.concatenate(parts)
    response[:, 2] = np.maximum(response[:, 2], 0.0)
    return stack.view(
        Channel.TIME_STAMPS,
        np.concatenate(rows),
        np.nan_to_num(response),
        rows=ROWS,
        unit="s, s, 1",
        usable=np.isfinite(response),
        noise=FLOOR,
        signals=_period_s(stack),
        is_robust=False,
    )


def nominal_delay_s(effects: Sequence[Effect]) -> float:
    """Constant delay of the commands by a robot model, s."""
    return sum(float(np.mean(e.delay_s)) for e in effects if isinstance(e, CommandDelay))


def hidden_share(delay_s: Array, period_s: float) -> float:
    """Share of commands that no state shows, though they arrived: two fell between the same two states.

    It happens where commands usually arrive just before or just after a state. The spread is read from the early half,
    since those that are late are the ones that are missing; a wide one is no matter of a moment, and counts as none.
    ``delay_s`` is that of one run's commands, not a number where none was seen; ``period_s`` is the states'.
    """
    seen = delay_s[np.isfinite(delay_s)]
    if len(seen) == 0:
        return 0.0
    median = float(np.median(seen))
    spread = max(median - float(np.quantile(seen, 0.1)), 1e-6) / float(normal.ppf(0.9))
    if spread > NARROW_SHARE * period_s:
        return 0.0
    since = median % period_s
    aside = float(normal.sf(since / spread) + normal.sf((period_s - since) / spread))
    # One that comes on the far side of a state, and the next that does not.
    return aside * (1.0 - aside)


def _period_s(stack: Stack) -> float:
    """Between two commands, as a rule."""
    gaps = [np.diff(np.sort(r.commands.robot_stamp_ns)) for r in stack.recordings]
    every = np.concatenate([g[g > 0] for g in gaps])
    return float(np.median(every)) * 1e-9 if len(every) else stack.period_s


def _windows(single: Array, state: Ints, length: int) -> tuple[Array, Ints]:
    """Means of (n, R) over windows of states, leaving out what is not a number; and each window's first state."""
    names, first, at = np.unique(state // length, return_index=True, return_inverse=True)
    good = np.isfinite(single)
    count = np.stack([np.bincount(at, g, len(names)) for g in good.T], axis=1)
    total = np.stack([np.bincount(at, v, len(names)) for v in np.nan_to_num(single).T], axis=1)
    with np.errstate(invalid="ignore"):
        return total / np.where(count > 0, count, np.nan), state[first]
