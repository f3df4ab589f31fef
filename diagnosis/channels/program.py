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

from diagnosis.channels import Array, Channel, ChannelOff, ChannelView, Ints, receipts
from diagnosis.channels.stack import Stack
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
DELAY_FLOOR_S: Final = 5e-4
"""Delays are read from a stream of 3 ms, and any real link varies by half a millisecond."""
WINDOW_S: Final = 0.25
"""Commands are averaged over so long: one that is lost says little, a share of them much."""
FAST_QUANTILE: Final = 0.05
"""Spread counts from the delay that this share of commands stays under."""


def timing_view(stack: Stack, effects: Sequence[Effect]) -> ChannelView | ChannelOff:
    """Build the channel *time stamps*."""
    if not all(r.has_receipts for r in stack.recordings):
        return ChannelOff(Channel.TIME_STAMPS, "the robot's receipts of commands were not recorded")
    if not all(np.any(r.commands.state_robot_stamp_ns > 0) for r in stack.recordings):
        return ChannelOff(Channel.TIME_STAMPS, "commands do not say which state they answer")
    told = receipts.read(stack.recordings, FAST_QUANTILE)
    single = np.stack([told.delay_s - nominal_delay_s(effects), told.late_s, told.lost], axis=1)
    weight = np.stack([1.0 - told.lost, 1.0 - told.lost, np.ones(len(single))], axis=1)
    state = np.concatenate(
        [
            first + recording.rows_at(recording.commands.state_robot_stamp_ns)
            for first, recording in zip(stack.starts(), stack.recordings, strict=True)
        ]
    )
    answered = np.concatenate([r.commands.state_robot_stamp_ns > 0 for r in stack.recordings])
    known = np.isfinite(told.lost) & answered
    if not known.any():
        return ChannelOff(Channel.TIME_STAMPS, "no command was received within a second")
    length = max(1, round(WINDOW_S / stack.period_s))
    response, rows = _windows(single[known], weight[known], state[known], stack.run, length)
    error = told.error * np.sqrt(len(response))
    return stack.view(
        Channel.TIME_STAMPS,
        rows,
        np.nan_to_num(response),
        rows=LINK_ROWS,
        unit="s, s, 1",
        usable=np.isfinite(response),
        # As windows are taken for independent, together they are as uncertain as the count.
        noise=np.array([DELAY_FLOOR_S, DELAY_FLOOR_S, error]),
        signals=None,
        is_robust=False,
    )


def nominal_delay_s(effects: Sequence[Effect]) -> float:
    """Constant delay of the commands by a robot model, s."""
    return sum(float(np.mean(e.delay_s)) for e in effects if isinstance(e, CommandDelay))


def _windows(single: Array, weight: Array, state: Ints, run: Ints, length: int) -> tuple[Array, Ints]:
    """Weighted means of (n, R) over windows of states, NaN without any weight; and each window's first state."""
    window = np.stack([run[state], state // length], axis=1)
    _, first, at = np.unique(window, axis=0, return_index=True, return_inverse=True)
    at = at.ravel()
    weight = np.where(np.isfinite(single), weight, 0.0)
    total = np.stack([np.bincount(at, w) for w in weight.T], axis=1)
    sums = np.stack([np.bincount(at, v) for v in (np.nan_to_num(single) * weight).T], axis=1)
    return sums / np.where(total > 1e-6, total, np.nan), state[first]
