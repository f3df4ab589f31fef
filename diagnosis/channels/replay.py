"""Channel *policy replay*: does the program make the set-points of its actions that the policy's contract says?

The response is the set-point that was sent less that of the logged action, rad, joint by joint. Time convention: a
tick's set-point is that of its key.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView
from diagnosis.channels.stack import Stack
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
