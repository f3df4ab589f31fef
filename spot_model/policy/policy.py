"""A policy loaded from an ONNX file, refused unless its contract holds."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from spot_model.io.yaml_text import FileTooLargeError, read_at_most
from spot_model.policy.contract import (
    INPUT_NAME,
    MAX_POLICY_BYTES,
    METADATA_KEY,
    OUTPUT_NAME,
    PolicyContract,
    PolicyError,
    contract_text,
    read_contract,
    sha256_hex,
)
from spot_model.policy.observation import (
    N_OBSERVATION,
    OBSERVATION,
    Sensed,
    build_observation,
    observation_of_one,
    observed,
)
from spot_model.policy.onnx_session import check_shapes, open_session, words_for
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.rotation import LEVEL_WXYZ, AnyArray
from spot_model.robot.state import Gains, RobotState

_NO_ACTION: Final[NDArray[np.float32]] = np.zeros(facts.N_JOINTS, dtype=np.float32)
_NO_ACTION.flags.writeable = False


class TickMemory(NamedTuple):
    """What one tick leaves for the next."""

    last_action: NDArray[np.float32] = _NO_ACTION
    """The network's previous output, shape (12,), policy order."""
    window: NDArray[np.float32] | None = None
    """What the network saw, for one that sees several ticks; None before the first."""


class TickResult(NamedTuple):
    """What one tick gave."""

    observation: NDArray[np.float32]
    """Observation as the network saw it: shape (48,), or a multiple if it sees several ticks, the newest first."""
    action: NDArray[np.float32]
    """Shape (12,), policy order, unscaled."""
    setpoint_rad: Array
    """Shape (12,), canonical order."""


class _OneRow:
    """A network for one observation at a time, in arrays that are bound once.

    At the pace of a run, when caches are cold, passing new ones costs a third of the whole. The result is the same.
    """

    def __init__(self, session: Any, width: int) -> None:
        self._run, self._binding, self._lock = session.run_with_iobinding, session.io_binding(), threading.Lock()
        self._input = np.zeros((1, width), dtype=np.float32)
        self._output = np.zeros((1, facts.N_JOINTS), dtype=np.float32)
        into, out = self._input, self._output
        self._binding.bind_input(INPUT_NAME, "cpu", 0, np.float32, into.shape, into.ctypes.data)
        self._binding.bind_output(OUTPUT_NAME, "cpu", 0, np.float32, out.shape, out.ctypes.data)

    def __call__(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        with self._lock:
            self._input[0] = observation
            self._run(self._binding)
            action: NDArray[np.float32] = self._output[0].copy()
        return action


@dataclass(frozen=True)
class Policy:
    """A network with its contract.

    Observations and actions are in the contract's joint order, set-points in the canonical one of all logs
    (fl_hx, fl_hy, fl_kn, fr_hx, …).
    """

    contract: PolicyContract
    """Rate, gains, joint order, command range and training; below."""
    sha256: str
    """Digest of the file, hexadecimal."""
    session: Any
    """ONNX Runtime's session."""
    policy_from_canonical: NDArray[np.intp]
    """``x[policy_from_canonical]`` reorders canonical joints into the policy's order. Shape (12,)."""
    canonical_from_policy: NDArray[np.intp]
    """The way back. Shape (12,)."""
    default_position_rad: Array
    """Policy order, shape (12,)."""
    path: Path | None = field(default=None, kw_only=True)
    """The file that it was loaded from."""
    file_bytes: bytes = field(default=b"", kw_only=True, repr=False)
    """The file's content; empty for what is no network."""

    @cached_property
    def _act_on_one(self) -> _OneRow:
        return _OneRow(self.session, self.width)

    @property
    def command_low(self) -> tuple[float, ...]:
        """Smallest velocity command that it was trained on: V_x, V_y (m/s), ω_z (rad/s)."""
        return self.contract.velocity_command_low

    @property
    def command_high(self) -> tuple[float, ...]:
        """The largest one."""
        return self.contract.velocity_command_high

    @property
    def setpoint_speed_rad_s(self) -> float:
        """Largest speed of its set-points, rad/s: infinite, so only the runtime limits it."""
        return float("inf")

    @property
    def width(self) -> int:
        """Length of the network's input: 48 for each tick of its history."""
        return self.contract.observation_history * N_OBSERVATION

    @cached_property
    def _takes_one_row(self) -> bool:
        return bool(self.session.get_inputs()[0].shape[0] == 1)

    def tick(self, memory: TickMemory, state: RobotState, velocity_command: Array) -> tuple[TickMemory, TickResult]:
        """One step: the same input gives the same output, and nothing else changes.

        Args:
            memory: From the tick before.
            state: The snapshot that this tick sees.
            velocity_command: V_x, V_y (m/s), ω_z (rad/s), shape (3,).
        """
        seen = self.observe(state, velocity_command, memory.last_action).astype(np.float32)
        observation = self.window(seen, memory.window)
        action = self.act(observation)
        return TickMemory(action, observation), TickResult(observation, action, self.setpoint_rad(action))

    def warm_up(self, ticks: int = 20) -> None:
        """Run some ticks and discard the results, because the first ticks load modules, which takes 0.1 s."""
        still, joints = np.zeros(3), np.zeros(facts.N_JOINTS)
        asked, feet = np.zeros(len(self.command_low)), np.ones(facts.N_LEGS, dtype=np.bool_)
        state = RobotState(
            facts.DEFAULT_POSITION_RAD, joints, joints, still, LEVEL_WXYZ, still, still, feet, 0, 0, 0, 0
        )
        memory = TickMemory()
        for _ in range(ticks):
            memory, _ = self.tick(memory, state, asked)

    def observe(self, state: RobotState, velocity_command: Array, last_action: NDArray[np.float32]) -> Array:
        """The observation for one state.

        Args:
            state: The robot's state.
            velocity_command: V_x, V_y (m/s), ω_z (rad/s), shape (3,).
            last_action: The network's previous output, shape (12,), policy order; zeros at first.

        Returns:
            Shape (48,), float64; a state that is not finite gives an observation that is not finite.
        """
        order = self.policy_from_canonical
        return observation_of_one(
            world_from_body_wxyz=state.odom_from_body_wxyz,
            linear_vel_of_body_in_world_m_s=state.linear_vel_of_body_in_odom_m_s,
            angular_vel_of_body_in_world_rad_s=state.angular_vel_of_body_in_odom_rad_s,
            velocity_command=velocity_command,
            position_rad=state.position_rad[order],
            velocity_rad_s=state.velocity_rad_s[order],
            last_action=last_action,
            default_position_rad=self.default_position_rad,
        )

    def observe_many(self, sensed: Sensed, velocity_command: Array, last_action: NDArray[Any]) -> Array:
        """Observations of many robots, shape (n, 48), float64; commands (n, 3), last actions (n, 12), policy order."""
        order, rest = self.policy_from_canonical, self.default_position_rad
        return np.asarray(observations(sensed, velocity_command, last_action, order, rest))

    def window(self, observation: NDArray[Any], before: NDArray[Any] | None) -> NDArray[Any]:
        """The network's input: the last observations, the newest first. Shape (width,), or (n, width).

        Args:
            observation: This tick's, shape (48,), or (n, 48).
            before: The window of the previous tick; None at the first tick, whose observation is then repeated.
        """
        if self.width == N_OBSERVATION:
            return observation
        if before is None:
            return np.tile(observation, self.contract.observation_history)
        return np.concatenate([observation, before[..., :-N_OBSERVATION]], axis=-1)

    def act(self, observation: NDArray[Any]) -> NDArray[np.float32]:
        """Run the network. Shape (48,) gives (12,), a batch (n, 48) gives (n, 12); with a history, 48 for each tick.

        Raises:
            PolicyError: The observation is not made of numbers, or has another width: the caller keeps no history.
        """
        try:
            batch = np.asarray(observation, dtype=np.float32)
        except (TypeError, ValueError):
            batch = np.empty(0, np.float32)
        if batch.ndim not in (1, 2) or batch.shape[-1] != self.width:
            raise PolicyError(
                f"policy {self.contract.name} expects {self.width} numbers ({N_OBSERVATION} per tick of "
                f"its history), got {batch.shape[-1] if batch.ndim else 1}; Policy.window() adds the ticks before"
            )
        if batch.ndim == 1:
            return self._act_on_one(batch)
        if self._takes_one_row and len(batch) != 1:
            return np.concatenate([self.act(row[None, :]) for row in batch])
        actions: NDArray[np.float32] = self.session.run([OUTPUT_NAME], {INPUT_NAME: batch})[0]
        return actions

    def with_joints_in_policy_order(self, observation: Array) -> Array:
        """A copy of values laid out as an observation, shape (..., 48), whose joints stood in canonical order."""
        ordered = np.array(observation)
        for part in OBSERVATION:
            if part.is_of_joints:
                values = observed(observation, part.name)
                observed(ordered, part.name)[...] = values[..., self.policy_from_canonical]
        return ordered

    @cached_property
    def _defaults(self) -> list[tuple[int, float]]:
        """For each canonical joint, its place in the policy's order and its default position, rad."""
        defaults_rad = self.default_position_rad.tolist()
        return [(i, defaults_rad[i]) for i in self.canonical_from_policy.tolist()]

    def setpoint_rad(self, action: NDArray[Any]) -> Array:
        """Joint position set-points of an action, canonical order. Shape (..., 12), rad.

        Raises:
            PolicyError: The action is not made of 12 numbers.
        """
        if getattr(action, "shape", None) == (facts.N_JOINTS,) and action.dtype == np.float32:
            # That of a tick: on plain numbers, as the observation of one robot is, and the same bit for bit.
            scale_rad, numbers = self.contract.action_scale_rad, action.tolist()
            return np.array([scale_rad * numbers[i] + default_rad for i, default_rad in self._defaults])
        try:
            given = np.asarray(action, dtype=np.float64)
        except (TypeError, ValueError):
            given = np.empty(0)
        if given.ndim == 0 or given.shape[-1] != facts.N_JOINTS:
            raise PolicyError(f"action of shape {given.shape}; allowed: numbers of shape (..., {facts.N_JOINTS})")
        policy_order = self.contract.action_scale_rad * given + self.default_position_rad
        return policy_order.take(self.canonical_from_policy, axis=-1)

    def gains(self) -> Gains:
        """The contract's gains, canonical order."""
        order = self.canonical_from_policy
        return Gains(np.array(self.contract.kp_nm_per_rad)[order], np.array(self.contract.kd_nm_s_per_rad)[order])


def observations(
    sensed: Sensed, velocity_command: AnyArray, last_action: AnyArray, order: AnyArray, default_position_rad: AnyArray
) -> AnyArray:
    """Observations of many robots, shape (n, 48), of the array library that all arguments share.

    Args:
        sensed: What the robots report.
        velocity_command: Shape (n, 3).
        last_action: Shape (n, 12), policy order.
        order: Joints of the canonical order in the policy's, shape (12,).
        default_position_rad: Policy order, shape (12,).
    """
    return build_observation(
        world_from_body_wxyz=sensed.world_from_body_wxyz,
        linear_vel_of_body_in_world_m_s=sensed.linear_vel_of_body_in_world_m_s,
        angular_vel_of_body_in_world_rad_s=sensed.angular_vel_of_body_in_world_rad_s,
        velocity_command=velocity_command,
        position_rad=sensed.position_rad[:, order],
        velocity_rad_s=sensed.velocity_rad_s[:, order],
        last_action=last_action,
        default_position_rad=default_position_rad,
    )


def load_policy(path: Path, *, provider: str = "cpu", admit: Callable[[str], None] | None = None) -> Policy:
    """Load a policy and check all that its contract promises, where it will be computed.

    Args:
        path: ONNX file with its contract.
        provider: Where it will be computed.
        admit: Told the SHA-256 before anything else looks at the content; raises where this file may not run.

    Raises:
        PolicyError: The file cannot be read, is not an ONNX model, has no contract or one that does not hold, or ONNX
            Runtime does not have the provider.
    """
    try:
        data = read_at_most(path, MAX_POLICY_BYTES)
    except FileTooLargeError as error:
        raise PolicyError(f"policy {path} cannot be read: {error}") from error
    except OSError as error:
        raise PolicyError(f"policy {path} cannot be read: {error.strerror or error}; give an ONNX file") from error
    if admit is not None:
        admit(sha256_hex(data))
    return policy_from_bytes(data, source=str(path), provider=provider, path=path)


def policy_from_bytes(data: bytes, *, source: str, provider: str = "cpu", path: Path | None = None) -> Policy:
    """Like :func:`load_policy`, for a file's content; ``source`` names it in errors."""
    text = contract_text(data, source)
    contract = read_contract(text, source)
    session = open_session(data, source, provider)
    with words_for(source):
        if session.get_modelmeta().custom_metadata_map.get(METADATA_KEY) != text:
            raise PolicyError(f"policy {source}: ONNX Runtime reads another contract than was checked; export it again")
        check_shapes(session, source, contract.observation_history * N_OBSERVATION)
    index = {name: i for i, name in enumerate(facts.JOINT_NAMES)}
    policy_from_canonical = np.array([index[name] for name in contract.joint_names], dtype=np.intp)
    policy = Policy(
        contract=contract,
        sha256=sha256_hex(data),
        session=session,
        policy_from_canonical=policy_from_canonical,
        canonical_from_policy=np.argsort(policy_from_canonical),
        default_position_rad=np.array(contract.default_position_rad),
        path=path,
        file_bytes=data,
    )
    with words_for(source):
        _check_stored_pair(policy, source)
    return policy


def _check_stored_pair(policy: Policy, source: str) -> None:
    pair = policy.contract.stored_pair
    action = policy.act(np.array(pair.observation))
    error = float(np.max(np.abs(action - np.array(pair.action))))
    if not error <= pair.tolerance:
        raise PolicyError(
            f"policy {source}: the stored input gives an action that is off by {error:g}; expected at most "
            f"{pair.tolerance:g}; the network is not the one that was exported"
        )
