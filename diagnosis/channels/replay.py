"""Channel *policy replay*: does the program make the set-points of its actions that the policy's contract says?

The response is the set-point that was sent less that of the logged action, rad, joint by joint. Time convention: a
tick's set-point is that of its key.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelOff, ChannelView
from diagnosis.channels.stack import Stack
from diagnosis.read.recording import Recording
from spot_model.policy.contract import PolicyContract
from spot_model.robot import facts

FLOOR_RAD: Final = 1e-3
"""Rounding of a 32-bit action, many times over."""


class Actor(Protocol):
    """What replay needs of a policy."""

    def setpoint_rad(self, action: NDArray[Any]) -> Array:
        """Set-points of actions (n, J), canonical order."""
        ...


@dataclass(frozen=True)
class ReplaySignals:
    """Signals of channel *policy replay*, one row a policy tick."""

    intended_rad: Array
    """Set-points that the action stands for, canonical order. Shape (n, J)."""


def replay_view(stack: Stack, policy: Actor | None = None) -> ChannelView | ChannelOff:
    """Build the channel *policy replay*; without the policy the contract in the logs' headers gives the set-points."""
    intended, sent, rows = [], [], []
    for first, recording in zip(stack.starts(), stack.recordings, strict=True):
        if not np.isfinite(recording.ticks.action).all(axis=1).any() and len(recording.ticks):
            continue  # a joint experiment runs no policy
        scale = policy if policy is not None else contract_of(recording)
        if scale is None:
            return ChannelOff(Channel.POLICY_REPLAY, f"log {recording.run_id} has no policy contract; give the policy")
        ticks = recording.ticks
        ran = np.isfinite(ticks.action).all(axis=1) & recording.in_control()
        place = {int(key): i for i, key in enumerate(recording.commands.key)}
        at = np.array([place.get(int(key), -1) for key in ticks.command_key], dtype=np.intp)
        chosen = np.flatnonzero(ran & (at >= 0))
        if len(chosen) == 0:
            return ChannelOff(Channel.POLICY_REPLAY, f"log {recording.run_id} has no policy ticks")
        intended.append(scale.setpoint_rad(ticks.action[chosen]))
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
        signals=ReplaySignals(np.concatenate(intended)),
    )


@dataclass(frozen=True)
class _Contract:
    """Set-points by a contract alone."""

    contract: PolicyContract

    def setpoint_rad(self, action: NDArray[Any]) -> Array:
        contract = self.contract
        policy_order = contract.action_scale_rad * action.astype(np.float64) + np.array(contract.default_position_rad)
        return np.asarray(policy_order[..., [contract.joint_names.index(name) for name in facts.JOINT_NAMES]])


def contract_of(recording: Recording) -> _Contract | None:
    """The policy contract in a log's header, None where there is none that holds."""
    if not recording.policy_contract_json:
        return None
    try:
        return _Contract(PolicyContract.from_json(recording.policy_contract_json))
    except ValidationError:
        return None
