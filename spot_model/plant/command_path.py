"""How set-points reach the servos in a closed loop: through the plant's channel, or with receipts for a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from array_api_compat import device

from spot_model.effects.base import CommandEffect, Draws
from spot_model.plant.command_channel import CommandQueue, ServoCommand, moved_on
from spot_model.plant.plant import Plant
from spot_model.robot.arrays import copy_of, like, namespace_of
from spot_model.robot.facts import Array
from spot_model.robot.rotation import AnyArray
from spot_model.robot.state import Gains


class CommandPath(Protocol):
    """Takes a set-point a tick and moves the plant by physics steps."""

    def send(self, number: int, setpoint_rad: Array) -> None:
        """Issue command ``number``, counted from 1: position set-points, shape (n_sims, 12), canonical order."""
        ...

    def advance(self, n_steps: int) -> None:
        """Move the plant by physics steps."""
        ...


class PlantPath:
    """Through the plant's own channel, with its command effects."""

    def __init__(self, plant: Plant, gains: Gains) -> None:
        self._plant, self._gains = plant, gains_like(plant, gains)

    def send(self, number: int, setpoint_rad: Array) -> None:
        """Issue a command; :class:`CommandPath`."""
        self._plant.command(servo_command(setpoint_rad, self._gains))

    def advance(self, n_steps: int) -> None:
        """Move the plant by physics steps."""
        self._plant.advance(n_steps)


class ReceiptPath:
    """Beside the plant's channel: it knows which command was received when, as a state message tells.

    A set-point that arrives within a physics step counts for the share of the step that is left, so a delay of 4.6 ms
    acts as such and not as the next multiple of the step.

    Args:
        plant: Without command effects of its own.
        gains: Of every command.
        start_setpoint_rad: In effect until the first command arrives, shape (n_sims, 12), an array of the plant's.
        effects: On the commands' way.
        rng: What they draw from.
        start_ns: Robot time at which the loop starts.
    """

    def __init__(
        self,
        plant: Plant,
        gains: Gains,
        start_setpoint_rad: AnyArray,
        effects: Sequence[CommandEffect],
        rng: Draws,
        start_ns: int,
    ) -> None:
        xp, where = namespace_of(start_setpoint_rad), device(start_setpoint_rad)
        n = plant.n_sims
        self._plant, self._gains, self._rng, self._start_ns = plant, gains_like(plant, gains), rng, start_ns
        self._queue = CommandQueue(effects, start_setpoint_rad, rng)
        self._step_ns = round(plant.timestep_s * 1e9)
        self._elapsed_ns: Any = 0 if self._queue.grows else xp.zeros(1, dtype=xp.float64, device=where)
        """Since the start; on a GPU recorded work moves it on."""
        self._setpoint = copy_of(start_setpoint_rad)
        self._followed: AnyArray = None
        self._received_s = xp.zeros(n, dtype=xp.float64, device=where)
        self._advances: dict[int, Any] = {}
        self.now_ns = start_ns
        """Robot time of the next physics step."""
        self.key = xp.zeros(n, dtype=xp.int64, device=where)
        """Newest command received, shape (n,); 0 before the first."""

    @property
    def received_ns(self) -> AnyArray:
        """When the newest command was received, robot time, int64, shape (n,); 0 before the first."""
        xp = namespace_of(self.key)
        stamp = self._start_ns + xp.astype(xp.round(self._received_s * 1e9), xp.int64)
        return xp.where(self.key > 0, stamp, 0)

    def send(self, number: int, setpoint_rad: AnyArray) -> None:
        """Issue a command; :class:`CommandPath`."""
        self._queue.issue(number, setpoint_rad, 1e-9 * self._elapsed_ns)

    def advance(self, n_steps: int) -> None:
        """Move the plant by physics steps, on a GPU as one recorded piece of work."""
        if n_steps not in self._advances:
            self._advances[n_steps] = self._plant.recorded(lambda: self._advance(n_steps), self._rng)
        self._advances[n_steps]()
        self.now_ns += n_steps * self._step_ns

    def _advance(self, n_steps: int) -> None:
        for _ in range(n_steps):
            setpoint = self._mean_setpoint()
            if setpoint is not self._followed:
                self._followed = setpoint
                self._plant.command(servo_command(setpoint, self._gains))
            self._plant.advance()
            self._elapsed_ns += self._step_ns

    def _mean_setpoint(self) -> AnyArray:
        """Mean set-point over the coming physics step, shape (n, 12)."""
        where, astype = namespace_of(self._setpoint).where, namespace_of(self._setpoint).astype
        end_s = 1e-9 * (self._elapsed_ns + self._step_ns)
        mean = self._setpoint
        for sent in self._queue.sent:
            due = (sent.arrival_s < end_s - 1e-9) & (self.key < sent.number)
            if self._queue.grows and not due.any():
                continue
            # The share of the step that is left when the set-point arrives.
            share = (end_s - where(due, sent.arrival_s, end_s)) / (1e-9 * self._step_ns)
            share = astype(namespace_of(share).clip(share, 0.0, 1.0), mean.dtype)[:, None]
            mean = where(due[:, None], mean + share * (sent.command - mean), mean)
            self._setpoint = moved_on(self._setpoint, where(due[:, None], sent.command, self._setpoint))
            self._received_s = moved_on(self._received_s, where(due, sent.arrival_s, self._received_s))
            self.key = moved_on(self.key, where(due, sent.number, self.key))
        if mean is not self._setpoint and self._queue.grows:
            self._queue.sent = [
                sent for sent in self._queue.sent if np.any(np.isfinite(sent.arrival_s) & (self.key < sent.number))
            ]
        return mean


def gains_like(plant: Plant, gains: Gains) -> Gains:
    """Gains as arrays of the plant's library and device."""
    position = plant.joint_position_rad
    return Gains(like(position, gains.kp_nm_per_rad), like(position, gains.kd_nm_s_per_rad))


def servo_command(setpoint_rad: AnyArray, gains: Gains) -> ServoCommand:
    """Position set-points under a policy's gains."""
    kp, kd = gains.kp_nm_per_rad, gains.kd_nm_s_per_rad
    return ServoCommand(position_rad=setpoint_rad, kp_nm_per_rad=kp, kd_nm_s_per_rad=kd)
