"""Channel *policy replay*: does the program do what the policy's contract says?

Three checks: set-points recomputed from the logged action, actions recomputed from the logged observation by the
policy itself, and observations recomputed from the logged state. The first is the channel's response, rad, joint by
joint; the others are numbers beside it, since nothing but a fault of the software moves them.
Time convention: a tick's observation is that of the state whose stamp it carries, its set-point that of its key.
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
from spot_model.policy.observation import N_OBSERVATION, build_observation
from spot_model.robot import facts

FLOOR_RAD: Final = 1e-3
"""Rounding of a 32-bit action, many times over."""


class Actor(Protocol):
    """What replay needs of a policy."""

    def act(self, observation: NDArray[Any]) -> NDArray[np.float32]:
        """Observations (n, 48) to actions (n, J), the policy's order."""
        ...

    def setpoint_rad(self, action: NDArray[Any]) -> Array:
        """Set-points of actions (n, J), canonical order."""
        ...


@dataclass(frozen=True)
class ReplaySignals:
    """Signals of channel *policy replay*, one row a policy tick."""

    intended_rad: Array
    """Set-points that the action stands for, canonical order. Shape (n, J)."""
    sent_rad: Array


def replay_view(stack: Stack, policy: Actor | None = None) -> ChannelView | ChannelOff:
    """Build the channel *policy replay*.

    Args:
        stack: The recordings.
        policy: The policy that ran; without it the contract in the logs' headers gives the set-points, and actions are
            not recomputed.
    """
    intended, sent, runs, states = [], [], [], []
    measured: dict[str, float] = {}
    for number, recording in enumerate(stack.recordings):
        if not np.isfinite(recording.ticks.action).all(axis=1).any() and len(recording.ticks):
            continue  # a joint experiment runs no policy
        contract = contract_of(recording)
        scale = policy if policy is not None else contract
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
        runs.append(np.full(len(chosen), number, dtype=np.intp))
        states.append(recording.rows_at(ticks.robot_stamp_ns[chosen]))
        if policy is not None:
            error = np.abs(policy.act(ticks.observation[chosen]) - ticks.action[chosen])
            measured["action_error"] = max(measured.get("action_error", 0.0), float(np.max(error)))
        if recording.n_joints == facts.N_JOINTS and contract is not None:
            largest = observation_error(recording, contract.contract)
            measured["observation_error"] = max(measured.get("observation_error", 0.0), largest)
    if not intended:
        return ChannelOff(Channel.POLICY_REPLAY, "no log has policy ticks")
    response = np.concatenate(sent) - np.concatenate(intended)
    n_joints = response.shape[1]
    legs = np.full(n_joints, -1, dtype=np.intp)
    return ChannelView(
        name=Channel.POLICY_REPLAY,
        rows=stack.recordings[0].joint_names,
        unit="rad",
        response=response,
        usable=np.isfinite(response),
        run=np.concatenate(runs),
        state=np.concatenate(states),
        noise=np.full(n_joints, FLOOR_RAD),
        nuisance=np.zeros((*response.shape, 0)),
        row_joint=np.arange(n_joints, dtype=np.intp),
        row_leg=legs,
        leg_of_joint=legs,
        signals=ReplaySignals(np.concatenate(intended), np.concatenate(sent)),
        measured=measured,
    )


def observation_error(recording: Recording, contract: PolicyContract) -> float:
    """Largest difference of a logged observation from the one of its state, its first action's tick left out."""
    ticks = recording.ticks
    ran = np.flatnonzero(np.isfinite(ticks.observation).all(axis=1) & np.isfinite(ticks.action).all(axis=1))[1:]
    if len(ran) == 0 or ticks.observation.shape[1] != N_OBSERVATION:
        return 0.0
    row = recording.rows_at(ticks.robot_stamp_ns[ran])
    order = _policy_from_canonical(contract)
    observed = build_observation(
        world_from_body_wxyz=recording.odom_from_body_wxyz[row],
        linear_vel_of_body_in_world_m_s=recording.linear_vel_of_body_in_odom_m_s[row],
        angular_vel_of_body_in_world_rad_s=recording.angular_vel_of_body_in_odom_rad_s[row],
        velocity_command=ticks.velocity_command[ran],
        position_rad=recording.position_rad[row][:, order],
        velocity_rad_s=recording.velocity_rad_s[row][:, order],
        last_action=ticks.action[ran - 1],
        default_position_rad=np.array(contract.default_position_rad),
    )
    error = np.abs(observed - ticks.observation[ran])
    good = np.isfinite(error).all(axis=1)
    return float(np.max(error[good])) if good.any() else 0.0


@dataclass(frozen=True)
class _Contract:
    """Set-points by a contract alone."""

    contract: PolicyContract

    def setpoint_rad(self, action: NDArray[Any]) -> Array:
        policy_order = self.contract.action_scale_rad * np.asarray(action, dtype=np.float64) + np.array(
            self.contract.default_position_rad
        )
        return np.asarray(policy_order[..., np.argsort(_policy_from_canonical(self.contract))])


def contract_of(recording: Recording) -> _Contract | None:
    """The policy contract in a log's header, None where there is none that holds."""
    if not recording.policy_contract_json:
        return None
    try:
        return _Contract(PolicyContract.from_json(recording.policy_contract_json))
    except ValidationError:
        return None


def _policy_from_canonical(contract: PolicyContract) -> NDArray[np.intp]:
    index = {name: i for i, name in enumerate(facts.JOINT_NAMES)}
    return np.array([index[name] for name in contract.joint_names], dtype=np.intp)
