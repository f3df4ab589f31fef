"""Position set-points under way to the servos of simulations on a GPU: fixed buffers, and no look at a value."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final, cast

import numpy as np
import torch

from spot_model.effects.base import CommandEffect, Draws
from spot_model.effects.commands import CommandJitter
from spot_model.errors import BadInputError
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.command_path import arrival_of, servo_command
from spot_model.robot.state import Gains

Tensor = torch.Tensor

JITTER_MEANS: Final = 12.0
"""Room for delays of so many means; one command in 160,000 is later, and takes effect when its buffer ends."""
SHORTEST_PERIOD_S: Final = 0.005
"""Between two commands, by which the number of buffers is chosen."""


class TorchChannel:
    """Carries position set-points late, in order, or never; gains and feed-forward hold at once, as they never change.

    As :class:`spot_model.plant.command_channel.CommandChannel` does, a command takes effect at the first physics step
    that starts at or after its arrival, and never before one that was issued earlier.
    """

    def __init__(self, effects: Sequence[CommandEffect], start: ServoCommand, timestep_s: float, rng: Draws) -> None:
        self._effects = [effect.arrays_like(start.position_rad) for effect in effects]
        self._rng = rng
        self._tolerance_s = 1e-6 * timestep_s
        self._command = start
        held = _tensor(start.position_rad)
        self._held = held.clone()
        n = len(held)
        slots = 1 + math.ceil(longest_delay_s(effects, n) / SHORTEST_PERIOD_S)
        self._setpoints = [held.clone() for _ in range(slots)] if effects else []
        """The newest first."""
        self._arrival_s = [
            torch.full((n, 1), -math.inf, dtype=torch.float64, device=held.device) for _ in self._setpoints
        ]

    def issue(self, command: ServoCommand, now_s: Tensor) -> None:
        """Send a command at ``now_s``, shape (1,)."""
        if not self._effects:
            self._held.copy_(_tensor(command.position_rad))
        else:
            n = len(self._held)
            arrival = arrival_of(now_s.expand(n), self._effects, self._rng)[:, None].to(torch.float64)
            # In order: no earlier than the newest before it that was not lost.
            for earlier in self._arrival_s:
                arrival = torch.where(torch.isfinite(earlier), torch.maximum(arrival, earlier), arrival)
            self._settle(self._setpoints[-1], self._arrival_s[-1])
            for kept in (self._setpoints, self._arrival_s):
                for newer, older in reversed(list(itertools.pairwise(kept))):
                    older.copy_(newer)
            self._setpoints[0].copy_(_tensor(command.position_rad))
            self._arrival_s[0].copy_(arrival)
        self._command = command

    def at(self, now_s: Tensor) -> ServoCommand:
        """The command in effect in the physics step that starts at ``now_s``."""
        active = self._held
        for setpoint, arrival in zip(reversed(self._setpoints), reversed(self._arrival_s), strict=True):
            active = torch.where(arrival <= now_s + self._tolerance_s, setpoint, active)
        return replace(self._command, position_rad=cast("Any", active))

    def reset(self, mask: Tensor, command: ServoCommand) -> None:
        """In the simulations of ``mask``, drop what is on its way and hold the command's position."""
        rows = mask[:, None]
        self._held.copy_(torch.where(rows, _tensor(command.position_rad), self._held))
        for arrival in self._arrival_s:
            arrival.masked_fill_(rows, math.inf)

    def buffers(self) -> list[Tensor]:
        """All that moves."""
        return [self._held, *self._setpoints, *self._arrival_s]

    def _settle(self, setpoint: Tensor, arrival_s: Tensor) -> None:
        self._held.copy_(torch.where(torch.isfinite(arrival_s), setpoint, self._held))


class TorchReceiptPath:
    """What :class:`spot_model.plant.command_path.ReceiptPath` does, on fixed buffers of a GPU."""

    def __init__(
        self,
        plant: Any,
        gains: Gains,
        start_setpoint_rad: Tensor,
        effects: Sequence[CommandEffect],
        rng: Draws,
        start_ns: int,
    ) -> None:
        n, held = plant.n_sims, start_setpoint_rad
        slots = 1 + math.ceil(longest_delay_s(effects, n) / SHORTEST_PERIOD_S)
        self._plant, self._gains, self._rng, self._start_ns = plant, gains, rng, start_ns
        self._effects = [effect.arrays_like(held) for effect in effects]
        self._step_ns = round(plant.timestep_s * 1e9)
        self._now_s = torch.zeros(1, dtype=torch.float64, device=held.device)
        self._setpoint = held.clone()
        self._latest_s = torch.full((n, 1), -math.inf, dtype=torch.float64, device=held.device)
        self._received_s = torch.zeros_like(self._latest_s)
        self._numbers = [torch.zeros(1, dtype=torch.int64, device=held.device) for _ in range(slots)]
        self._arrivals_s = [torch.full_like(self._latest_s, math.inf) for _ in range(slots)]
        self._setpoints = [held.clone() for _ in range(slots)]
        """Of the newest commands, the oldest first."""
        self.now_ns = start_ns
        """Robot time of the next physics step."""
        self.key = torch.zeros(n, dtype=torch.int64, device=held.device)
        """Newest command received, shape (n,); 0 before the first."""
        self._records: dict[int, Any] = {}

    @property
    def received_ns(self) -> Tensor:
        """When it was, robot time, shape (n,); 0 before the first."""
        stamp = self._start_ns + torch.round(self._received_s[:, 0] * 1e9).long()
        return torch.where(self.key > 0, stamp, 0)

    def send(self, number: int, setpoint_rad: Tensor) -> None:
        """Issue command ``number``; position set-points, shape (n_sims, 12)."""
        issued_s = self._now_s.expand(len(self.key))
        arrival = torch.maximum(arrival_of(issued_s, self._effects, self._rng)[:, None].double(), self._latest_s)
        self._latest_s.copy_(torch.where(torch.isfinite(arrival), arrival, self._latest_s))
        for kept in (self._numbers, self._arrivals_s, self._setpoints):
            for older, newer in itertools.pairwise(kept):
                older.copy_(newer)
        self._numbers[-1].fill_(number)
        self._arrivals_s[-1].copy_(arrival)
        self._setpoints[-1].copy_(setpoint_rad)

    def advance(self, n_steps: int) -> None:
        """Move the plant by physics steps, on a GPU as one recorded piece of work."""
        if n_steps not in self._records:
            self._records[n_steps] = self._plant.recorded(lambda: self._advance(n_steps), self._rng)
        self._records[n_steps]()
        self.now_ns += n_steps * self._step_ns

    def _advance(self, n_steps: int) -> None:
        for _ in range(n_steps):
            self._plant.command(servo_command(cast("Any", self._mean_setpoint()), self._gains))
            self._plant.advance()
            self._now_s += 1e-9 * self._step_ns

    def _mean_setpoint(self) -> Tensor:
        """Mean set-point over the coming physics step, shape (n, 12)."""
        end_s = self._now_s + 1e-9 * self._step_ns
        mean = self._setpoint.clone()
        for number, arrival_s, setpoint in zip(self._numbers, self._arrivals_s, self._setpoints, strict=True):
            due = (arrival_s < end_s - 1e-9) & (self.key[:, None] < number)
            share = ((end_s - arrival_s) / (1e-9 * self._step_ns)).clamp(0.0, 1.0).to(mean.dtype)
            mean = torch.where(due, mean + share * (setpoint - mean), mean)
            self._setpoint.copy_(torch.where(due, setpoint, self._setpoint))
            self._received_s.copy_(torch.where(due, arrival_s, self._received_s))
            self.key.copy_(torch.where(due[:, 0], number, self.key))
        return mean


def _tensor(array: Any) -> Tensor:
    """A servo command's array, as what it is on a GPU."""
    return cast("Tensor", array)


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
