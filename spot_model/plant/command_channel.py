"""Servo commands and their channel: they take effect late, in order, or never."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np
from array_api_compat import device
from numpy.typing import NDArray

from spot_model.effects.base import CommandEffect, Draws
from spot_model.effects.commands import CommandJitter
from spot_model.errors import BadInputError
from spot_model.robot import facts
from spot_model.robot.arrays import copy_of, namespace_of
from spot_model.robot.facts import Array
from spot_model.robot.rotation import AnyArray

JITTER_MEANS: Final = 12.0
"""Room on a GPU for delays of so many means; one command in 160,000 is later, and takes effect when its buffer ends."""
SHORTEST_PERIOD_S: Final = 0.005
"""Between two commands, by which the number of buffers is chosen."""


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
class SentCommand:
    """A command on its way; on a GPU each part is a buffer."""

    number: Any
    arrival_s: AnyArray
    """When it takes effect in each simulation, shape (n,); infinity where it was lost or dropped."""
    command: Any
    """A :class:`ServoCommand` or position set-points, shape (n, 12)."""
    first_s: float = -math.inf
    """No simulation receives it earlier; not known on a GPU."""
    last_s: float = math.inf
    """None receives it later; not known on a GPU."""

    @classmethod
    def on_cores(cls, number: int, arrival_s: Array, command: Any) -> SentCommand:
        """A command with bounds of its arrival, so that most steps need not look at the single simulations."""
        finite_s = arrival_s[np.isfinite(arrival_s)]
        first_s, last_s = finite_s.min(initial=math.inf), finite_s.max(initial=-math.inf)
        return cls(number, arrival_s, command, float(first_s), float(last_s))

    def take(self, other: SentCommand) -> None:
        """On a GPU, hold another command from now on."""
        self.number[...] = other.number
        self.arrival_s[...] = other.arrival_s
        self.command[...] = other.command


class CommandQueue:
    """Commands on their way to the servos of many simulations, the oldest first; none overtakes an earlier one.

    On the cores it grows with what is on its way. On a GPU, where no value may be looked at, it is a fixed number of
    buffers, enough for the longest delay, and a new command moves all others on by one.

    Args:
        effects: On the commands' way.
        setpoint_rad: Any position set-points, shape (n, 12); says where and how numbers are kept.
        rng: What the effects draw from.
    """

    def __init__(self, effects: Sequence[CommandEffect], setpoint_rad: AnyArray, rng: Draws) -> None:
        xp, where = namespace_of(setpoint_rad), device(setpoint_rad)
        n = setpoint_rad.shape[0]
        self._rng = rng
        self._issued_s = xp.zeros(n, dtype=xp.float64, device=where)
        self._latest_s = xp.full(n, -math.inf, dtype=xp.float64, device=where)
        self.grows = type(setpoint_rad) is np.ndarray
        self._effects = list(effects) if self.grows else [effect.arrays_like(setpoint_rad) for effect in effects]
        n_buffers = 0 if self.grows else 1 + math.ceil(longest_delay_s(effects, n) / SHORTEST_PERIOD_S)
        self.sent = [
            SentCommand(
                xp.zeros(1, dtype=xp.int64, device=where),
                xp.full(n, math.inf, dtype=xp.float64, device=where),
                copy_of(setpoint_rad),
            )
            for _ in range(n_buffers)
        ]

    def issue(self, number: int, command: Any, now_s: Any) -> None:
        """Send a command at ``now_s``, a number or, on a GPU, of shape (1,). It is kept, not copied, on the cores."""
        xp = namespace_of(self._latest_s)
        arrival = xp.astype(arrival_of(self._issued_s + now_s, self._effects, self._rng), xp.float64)
        arrival = xp.maximum(arrival, self._latest_s)
        self._latest_s = moved_on(self._latest_s, xp.where(xp.isfinite(arrival), arrival, self._latest_s))
        if self.grows:
            self.sent.append(SentCommand.on_cores(number, arrival, command))
            return
        for older, newer in pairwise(self.sent):
            older.take(newer)
        self.sent[-1].take(SentCommand(number, arrival, command))

    def drop(self, rows: AnyArray) -> None:
        """Drop what is on its way in the simulations of ``rows``, shape (n,)."""
        where = namespace_of(self._latest_s).where
        self._latest_s = moved_on(self._latest_s, where(rows, -math.inf, self._latest_s))
        for sent in self.sent:
            sent.arrival_s = moved_on(sent.arrival_s, where(rows, math.inf, sent.arrival_s))

    def buffers(self) -> list[Any]:
        """On a GPU, all that moves."""
        return [self._latest_s, *(part for sent in self.sent for part in (sent.arrival_s, sent.command))]

    def snapshot(self) -> dict[str, Any]:
        """On the cores, what is on its way, as plain arrays and numbers."""
        pending = [{"command": _plain(sent.command), "arrival_s": sent.arrival_s.copy()} for sent in self.sent]
        return {"latest_s": self._latest_s.copy(), "pending": pending}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """On the cores, continue from a snapshot of a queue of the same size and effects."""
        self._latest_s = np.array(snapshot["latest_s"])
        n = len(self._latest_s)
        self.sent = [
            SentCommand.on_cores(0, np.array(entry["arrival_s"]), ServoCommand(**entry["command"]).copied_for(n))
            for entry in snapshot["pending"]
        ]


class CommandChannel:
    """Carries commands to the servos of many simulations, each with its own delay.

    A command takes effect at the first physics step that starts at or after its arrival, and never before one that
    was issued earlier. Without effects it takes effect at once. On a GPU only position set-points are late: gains and
    feed-forward hold at once, as they never change.

    Args:
        effects: On the commands' way.
        start: In effect until the first command arrives; its set-points have shape (n_sims, 12).
        timestep_s: Length of a physics step.
        rng: What the effects draw from.
    """

    def __init__(self, effects: Sequence[CommandEffect], start: ServoCommand, timestep_s: float, rng: Draws) -> None:
        self._is_late = bool(effects)
        self._queue = CommandQueue(effects, start.position_rad, rng)
        # Times are sums of steps, so a step may start a rounding error before the arrival that it meets.
        self._tolerance_s = 1e-6 * timestep_s
        self._newest = start
        self._held = start if self._queue.grows else copy_of(start.position_rad)
        """What every simulation has received; newer commands that only some have are still in the queue."""

    def issue(self, command: ServoCommand, now_s: Any) -> None:
        """Send a command at ``now_s``. The sender must not write into its arrays any more."""
        self._newest = command
        late = self._carried(command)
        if not self._is_late:
            self._held = moved_on(self._held, late)
            return
        if not self._queue.grows:
            # The oldest buffer is needed anew; by now its command has arrived, or is lost.
            oldest = self._queue.sent[0]
            arrived = namespace_of(self._held).isfinite(oldest.arrival_s)
            self._held = moved_on(self._held, _merged(arrived, oldest.command, self._held))
        self._queue.issue(0, late, now_s)

    def at(self, now_s: Any) -> ServoCommand:
        """The command in effect in the physics step that starts at ``now_s``."""
        active, sent, grows = self._held, self._queue.sent, self._queue.grows
        if self._is_late and sent:
            until_s = now_s + self._tolerance_s
            for entry in sent:
                # On a GPU the time is a tensor, and to compare it in Python would wait for the device.
                if not grows or entry.first_s <= until_s:
                    active = _merged(entry.arrival_s <= until_s, entry.command, active)
            while grows and sent and sent[0].last_s <= until_s:
                self._held = _merged(sent[0].arrival_s <= until_s, sent[0].command, self._held)
                del sent[0]
        return active if isinstance(active, ServoCommand) else replace(self._newest, position_rad=active)

    def reset(self, rows: AnyArray, command: ServoCommand) -> None:
        """In the simulations of ``rows`` (shape (n_sims,)), drop what is on its way and put ``command`` in effect."""
        self._held = moved_on(self._held, _merged(rows, self._carried(command), self._held))
        self._queue.drop(rows)

    def buffers(self) -> list[Any]:
        """On a GPU, all that moves."""
        return [self._held, *(self._queue.buffers() if self._is_late else ())]

    def snapshot(self) -> dict[str, Any]:
        """On the cores, the command in effect and those on their way, as plain arrays and numbers."""
        return {"held": _plain(self._held), **self._queue.snapshot()}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """On the cores, continue from a snapshot of a channel of the same size and effects."""
        self._held = ServoCommand(**snapshot["held"]).copied_for(len(snapshot["latest_s"]))
        self._queue.restore(snapshot)

    def _carried(self, command: ServoCommand) -> Any:
        return command if self._queue.grows else command.position_rad


def arrival_of(issued_s: AnyArray, effects: Sequence[CommandEffect], rng: Draws) -> AnyArray:
    """When commands take effect that are issued at these times, shape (n,), s; infinity for one that is lost."""
    arrival = issued_s
    for effect in effects:
        arrival = namespace_of(issued_s).broadcast_to(effect.arrival_s(arrival, rng), issued_s.shape)
    return arrival


def moved_on(old: Any, new: Any) -> Any:
    """``new`` on the cores; on a GPU ``old``, which takes its values, so that recorded work finds them again."""
    if not hasattr(old, "clone"):
        return new
    old[...] = new
    return old


def _plain(command: ServoCommand) -> dict[str, Any]:
    values = {name: getattr(command, name) for name in _NAMES}
    return {name: value if isinstance(value, float) else np.array(value) for name, value in values.items()}


def _merge(mask: NDArray[np.bool_], first: Array | float, second: Array | float) -> Any:
    same = isinstance(first, float) and isinstance(second, float) and first == second
    if first is second or same:
        return first
    return np.where(mask, first, second)


def _merged(rows: AnyArray, new: Any, old: Any) -> Any:
    """``new`` in the simulations of ``rows``, shape (n,), ``old`` elsewhere: whole commands or set-points."""
    if type(rows) is np.ndarray:
        if rows.all():
            return new
        if not rows.any():
            return old
    if isinstance(new, ServoCommand):
        return new.where(rows, old)
    return namespace_of(new).where(rows[:, None], new, old)


def longest_delay_s(effects: Sequence[CommandEffect], n: int) -> float:
    """The longest time that commands of n simulations are under way, lost ones aside.

    Raises:
        BadInputError: An effect other than ``command_jitter`` draws its delays, so that no room is enough.
    """
    longest = 0.0
    for effect in effects:
        if isinstance(effect, CommandJitter):
            longest += JITTER_MEANS * float(np.max(np.asarray(effect.mean_s)))
        else:
            delays_s = [
                np.asarray(effect.arrival_s(np.full(n, at_s), np.random.default_rng(k))) - at_s
                for k, at_s in enumerate((0.0, 1.0, 1.37))
            ]
            finite_s = [np.where(np.isfinite(delay_s), delay_s, np.nan) for delay_s in delays_s]
            spread_s = np.nanmax(finite_s, axis=0) - np.nanmin(finite_s, axis=0)
            if np.nanmax(spread_s, initial=0.0) > 1e-9:
                raise BadInputError(
                    f"effect {effect.name}: its delay changes from command to command; on a GPU only command_jitter's "
                    "may: use --device cpu, or leave it out"
                )
            longest += float(np.nanmax(finite_s, initial=0.0))
    return longest
