"""Channels of the program and its link to the servos.

Channel *policy replay*: does the program make the set-points of its actions that the policy's contract says?

The response is the set-point that was sent less that of the logged action, rad, joint by joint. Time convention: a
tick's set-point is that of its key.

Channel *time stamps*: how long commands take, how evenly they come, and which are lost; by the robot's stamps.

A sample is the mean of a window's commands. Time convention: a command's delay runs from the stamp of the state that it
answers to the robot's stamp of its receipt, both on the robot's clock. The nominal model's constant delay is taken off.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError
from scipy.stats import norm as normal

from diagnosis.channels import Array, Channel, ChannelOff, ChannelView, Ints
from diagnosis.channels.stack import Stack
from spot_log.tools.measures import NEVER_NS
from spot_model.effects.base import Effect
from spot_model.effects.commands import CommandDelay
from spot_model.policy.contract import PolicyContract
from spot_model.robot import facts
from trainer.signals.recording import Recording

FLOOR_RAD: Final = 1e-3
"""Rounding of a 32-bit action, many times over."""


class Actor(Protocol):
    """What replay needs of a policy."""

    def setpoint_rad(self, action: NDArray[Any]) -> Array:
        """Set-points of actions (n, J), canonical order."""
        ...


def replay_view(stack: Stack, policy: Actor | None = None) -> ChannelView | ChannelOff:
    """Build the channel *policy replay*; without the policy the contract in the logs' headers gives the set-points."""
    intended, sent, rows = [], [], []
    for first, recording in zip(stack.starts(), stack.recordings, strict=True):
        if not np.isfinite(recording.ticks.action).all(axis=1).any() and len(recording.ticks):
            continue  # a joint experiment runs no policy
        setpoint_rad = policy.setpoint_rad if policy is not None else _by_contract(recording)
        if setpoint_rad is None:
            return ChannelOff(Channel.POLICY_REPLAY, f"log {recording.run_id} has no policy contract; give the policy")
        ticks = recording.ticks
        ran = np.isfinite(ticks.action).all(axis=1) & recording.in_control()
        place = {int(key): i for i, key in enumerate(recording.commands.key)}
        at = np.array([place.get(int(key), -1) for key in ticks.command_key], dtype=np.intp)
        chosen = np.flatnonzero(ran & (at >= 0))
        if len(chosen) == 0:
            return ChannelOff(Channel.POLICY_REPLAY, f"log {recording.run_id} has no policy ticks")
        intended.append(setpoint_rad(ticks.action[chosen]))
        sent.append(recording.commands.requested_position_rad[at[chosen]])
        rows.append(first + recording.rows_at(ticks.robot_stamp_ns[chosen]))
    if not intended:
        return ChannelOff(Channel.POLICY_REPLAY, "no log has policy ticks")
    response = np.concatenate(sent) - np.concatenate(intended)
    n_joints = response.shape[1]
    return stack.joint_view(
        Channel.POLICY_REPLAY,
        np.concatenate(rows),
        response,
        np.full(n_joints, -1),
        unit="rad",
        usable=np.isfinite(response),
        noise=np.full(n_joints, FLOOR_RAD),
        signals=np.concatenate(intended),  # canonical order, shape (n, J)
    )


def _by_contract(recording: Recording) -> Callable[[NDArray[Any]], Array] | None:
    """Set-points of actions by the contract in a log's header, None where there is none that holds."""
    try:
        contract = PolicyContract.from_json(recording.policy_contract_json)
    except ValidationError:
        return None
    canonical_from_policy = [contract.joint_names.index(name) for name in facts.JOINT_NAMES]

    def setpoint_rad(action: NDArray[Any]) -> Array:
        policy_order = contract.action_scale_rad * action.astype(np.float64) + np.array(contract.default_position_rad)
        return np.asarray(policy_order[..., canonical_from_policy])

    return setpoint_rad


LINK_ROWS: Final = ("delay", "spread", "lost")
LINK_FLOOR: Final = np.array([5e-4, 5e-4, 0.02])
"""Delays are read from a stream of 3 ms, and any real link varies by half a millisecond."""
WINDOW_S: Final = 0.25
"""Commands are averaged over so long: one that is lost says little, a share of them much."""
FAST_QUANTILE: Final = 0.05
"""Spread counts from the delay that this share of commands stays under."""
NARROW_SHARE: Final = 0.25
"""Share of the states' period; a wider spread of delays comes from jitter."""
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
        rows=LINK_ROWS,
        unit="s, s, 1",
        usable=np.isfinite(response),
        noise=LINK_FLOOR,
        signals=_command_period_s(stack),
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


def _command_period_s(stack: Stack) -> float:
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
