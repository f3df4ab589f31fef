"""Servo commands and their channel: they take effect late, in order, or never."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import CommandEffect
from spot_model.robot import facts
from spot_model.robot.facts import Array


@dataclass(frozen=True)
class ServoCommand:
    """Set-points and gains of all servos; each array broadcasts to (n_sims, 12), canonical joint order."""

    position_rad: Array
    velocity_rad_s: Array | float = 0.0
    load_nm: Array | float = 0.0
    """Feed-forward torque, N·m."""
    kp_nm_per_rad: Array | float = facts.POLICY_KP_NM_PER_RAD
    kd_nm_s_per_rad: Array | float = facts.POLICY_KD_NM_S_PER_RAD

    def copied_for(self, n_sims: int) -> ServoCommand:
        """The same command with its own arrays, checked to broadcast to (n_sims, 12).

        Raises:
            ValueError: One does not.
        """
        shape = (n_sims, facts.N_JOINTS)

        def copied(name: str) -> Any:
            value = getattr(self, name)
            if isinstance(value, float) and name != "position_rad":
                return value
            array: Array = np.array(value, dtype=np.float64)
            if array.shape == shape:
                return array
            try:
                return np.broadcast_to(array, shape)
            except ValueError:
                message = f"ServoCommand.{name} has shape {array.shape}; it must broadcast to {shape}"
                raise ValueError(message) from None

        return ServoCommand(**{name: copied(name) for name in _NAMES})

    def where(self, rows: NDArray[np.bool_], other: ServoCommand) -> ServoCommand:
        """This command in the simulations of ``rows`` (shape (n_sims,)), the other one elsewhere."""
        mask = rows[:, None]
        values = {name: _merge(mask, getattr(self, name), getattr(other, name)) for name in _NAMES}
        return ServoCommand(**values)


_NAMES = tuple(f.name for f in fields(ServoCommand))


@dataclass
class _Pending:
    """A command on its way."""

    command: ServoCommand
    arrival_s: Array
    """When it takes effect in each simulation; infinity where it already has, or was lost."""


class CommandChannel:
    """Carries whole commands to the servos of ``n_sims`` simulations, each with its own delay.

    A command takes effect at the first physics step that starts at or after its arrival, and never before one that
    was issued earlier. Without effects it takes effect at once.
    """

    def __init__(
        self,
        effects: Sequence[CommandEffect],
        n_sims: int,
        timestep_s: float,
        start: ServoCommand,
        rng: np.random.Generator,
    ) -> None:
        self._effects = tuple(effects)
        self._rng = rng
        self._n_sims = n_sims
        # Times are sums of steps, so a step may start a rounding error before the arrival that it meets.
        self._tolerance_s = 1e-6 * timestep_s
        self._pending: deque[_Pending] = deque()
        self._latest_s = np.full(n_sims, -math.inf)
        self.active = start

    def issue(self, command: ServoCommand, now_s: float) -> None:
        """Send a command at ``now_s``. It is kept, not copied: the sender must not write into its arrays."""
        if not self._effects:
            self.active = command
            return
        arrival = np.full(self._n_sims, now_s)
        for effect in self._effects:
            arrival = np.broadcast_to(effect.arrival_s(arrival, self._rng), (self._n_sims,))
        arrival = np.maximum(arrival, self._latest_s)
        self._latest_s = np.where(np.isfinite(arrival), arrival, self._latest_s)
        self._pending.append(_Pending(command, arrival))

    def at(self, now_s: float) -> ServoCommand:
        """The command in effect in the physics step that starts at ``now_s``."""
        if self._pending:
            self._receive(now_s + self._tolerance_s)
        return self.active

    def reset(self, rows: NDArray[np.bool_], command: ServoCommand) -> None:
        """In the simulations of ``rows`` (shape (n_sims,)), drop what is on its way and put ``command`` in effect."""
        self.active = command.where(rows, self.active)
        self._latest_s = np.where(rows, -math.inf, self._latest_s)
        for entry in self._pending:
            entry.arrival_s = np.where(rows, math.inf, entry.arrival_s)

    def snapshot(self) -> dict[str, Any]:
        """The command in effect and those on their way, as plain arrays and numbers."""
        return {
            "active": _plain(self.active),
            "latest_s": self._latest_s.copy(),
            "pending": [{"command": _plain(p.command), "arrival_s": p.arrival_s.copy()} for p in self._pending],
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot of a channel of the same size and effects."""
        self.active = ServoCommand(**snapshot["active"]).copied_for(self._n_sims)
        self._latest_s = np.array(snapshot["latest_s"])
        self._pending = deque(
            _Pending(ServoCommand(**entry["command"]).copied_for(self._n_sims), np.array(entry["arrival_s"]))
            for entry in snapshot["pending"]
        )

    def _receive(self, until_s: float) -> None:
        for entry in self._pending:
            due = entry.arrival_s <= until_s
            if due.all():
                self.active = entry.command
            elif due.any():
                self.active = entry.command.where(due, self.active)
            else:
                # Order is kept in every simulation, so what follows may still be due elsewhere.
                continue
            entry.arrival_s = np.where(due, math.inf, entry.arrival_s)
        while self._pending and not np.isfinite(self._pending[0].arrival_s).any():
            self._pending.popleft()


def _plain(command: ServoCommand) -> dict[str, Any]:
    values = {name: getattr(command, name) for name in _NAMES}
    return {name: value if isinstance(value, float) else np.array(value) for name, value in values.items()}


def _merge(mask: NDArray[np.bool_], first: Array | float, second: Array | float) -> Any:
    same = isinstance(first, float) and isinstance(second, float) and first == second
    if first is second or same:
        return first
    return np.where(mask, first, second)
