"""How set-points reach the servos in a closed loop: through the plant's channel, or with receipts for a log."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from spot_model.effects.base import CommandEffect, Draws
from spot_model.plant.command_channel import ServoCommand
from spot_model.plant.plant import Plant
from spot_model.robot.arrays import like, namespace_of
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
        start_setpoint_rad: In effect until the first command arrives, shape (n_sims, 12).
        effects: On the commands' way.
        rng: What they draw from.
        start_ns: Robot time at which the loop starts.
    """

    def __init__(
        self,
        plant: Plant,
        gains: Gains,
        start_setpoint_rad: Array,
        effects: Sequence[CommandEffect],
        rng: Draws,
        start_ns: int,
    ) -> None:
        n = plant.n_sims
        self._plant, self._gains, self._start_ns = plant, gains, start_ns
        self._effects, self._rng = effects, rng
        self._step_ns = round(plant.timestep_s * 1e9)
        self._setpoint = start_setpoint_rad
        self._followed: Array | None = None
        self._waiting: list[tuple[int, Array, Array]] = []
        self._latest_s = np.full(n, -np.inf)
        self.now_ns = start_ns
        """Robot time of the next physics step."""
        self.key: NDArray[np.int64] = np.zeros(n, dtype=np.int64)
        """Newest command received, shape (n,); 0 before the first."""
        self.received_ns: NDArray[np.int64] = np.zeros(n, dtype=np.int64)
        """When it was, robot time; 0 before the first."""

    def send(self, number: int, setpoint_rad: Array) -> None:
        """Issue a command; :class:`CommandPath`."""
        issued_s = np.full(self._plant.n_sims, 1e-9 * (self.now_ns - self._start_ns))
        arrival = np.maximum(arrival_of(issued_s, self._effects, self._rng), self._latest_s)
        self._latest_s = np.where(np.isfinite(arrival), arrival, self._latest_s)
        self._waiting.append((number, arrival, setpoint_rad))

    def advance(self, n_steps: int) -> None:
        """Move the plant by physics steps."""
        for _ in range(n_steps):
            setpoint = self._mean_setpoint()
            if setpoint is not self._followed:
                self._followed = setpoint
                self._plant.command(servo_command(setpoint, self._gains))
            self._plant.advance()
            self.now_ns += self._step_ns

    def _mean_setpoint(self) -> Array:
        """Mean set-point over the coming physics step, shape (n, 12)."""
        end_s = 1e-9 * (self.now_ns + self._step_ns - self._start_ns)
        mean, any_due = self._setpoint, False
        for number, arrival_s, setpoint in self._waiting:
            due = (arrival_s < end_s - 1e-9) & (self.key < number)
            if due.any():
                any_due = True
                share = np.clip((end_s - np.where(due, arrival_s, end_s)) / (1e-9 * self._step_ns), 0.0, 1.0)[:, None]
                mean = mean + share * (setpoint - mean)
                self._setpoint = np.where(due[:, None], setpoint, self._setpoint)
                stamp = self._start_ns + np.round(np.where(due, arrival_s, 0.0) * 1e9).astype(np.int64)
                self.received_ns = np.where(due, stamp, self.received_ns)
                self.key = np.where(due, number, self.key)
        if any_due:
            self._waiting = [w for w in self._waiting if np.any(np.isfinite(w[1]) & (self.key < w[0]))]
        return mean


def gains_like(plant: Plant, gains: Gains) -> Gains:
    """Gains as arrays of the plant's library and device."""
    position = plant.joint_position_rad
    return Gains(like(position, gains.kp_nm_per_rad), like(position, gains.kd_nm_s_per_rad))


def receipt_path(
    plant: Plant,
    gains: Gains,
    start_setpoint_rad: AnyArray,
    effects: Sequence[CommandEffect],
    rng: Draws,
    start_ns: int,
) -> Any:
    """A path with receipts over a plant on the cores or on a GPU; arguments of :class:`ReceiptPath`."""
    own = gains_like(plant, gains)
    if isinstance(start_setpoint_rad, np.ndarray):
        return ReceiptPath(plant, own, start_setpoint_rad, effects, rng, start_ns)
    from spot_model.plant.gpu.torch_channel import TorchReceiptPath

    return TorchReceiptPath(plant, own, start_setpoint_rad, effects, rng, start_ns)


def arrival_of(issued_s: AnyArray, effects: Sequence[CommandEffect], rng: Draws) -> AnyArray:
    """When commands take effect that are issued at these times, shape (n,), s; infinity for one that is lost."""
    arrival = issued_s
    for effect in effects:
        arrival = namespace_of(issued_s).broadcast_to(effect.arrival_s(arrival, rng), issued_s.shape)
    return arrival


def servo_command(setpoint_rad: AnyArray, gains: Gains) -> ServoCommand:
    """Position set-points under a policy's gains."""
    kp, kd = gains.kp_nm_per_rad, gains.kd_nm_s_per_rad
    return ServoCommand(position_rad=setpoint_rad, kp_nm_per_rad=kp, kd_nm_s_per_rad=kd)
