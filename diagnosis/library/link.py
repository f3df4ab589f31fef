"""The way of a command to the servos: constant delay, jitter, loss. Counted from stamps and keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from diagnosis.library.base import Coefficient, LibraryEffect, Location
from diagnosis.library.experiments import WIRED_LINK, Experiment
from diagnosis.seam import Array, ChannelView, Flags, Shape
from spot_model.effects.base import Effect
from spot_model.effects.command_delay import CommandDelay
from spot_model.effects.command_drop import CommandDrop
from spot_model.effects.command_jitter import CommandJitter
from spot_model.model_file import RobotModel

DELAY, SPREAD, LOST = 0, 1, 2
"""Rows of channel T."""


class _LinkEntry(LibraryEffect):
    channels: ClassVar[tuple[str, ...]] = ("T",)
    location: ClassVar[Location] = Location.ROBOT
    split_by: ClassVar[Experiment] = WIRED_LINK

    def rows(self, view: ChannelView, joints: Flags) -> Flags:
        """All three, so that what one leaves in another's row counts against it."""
        return np.ones(len(view.rows), dtype=np.bool_)


class CommandDelayEntry(_LinkEntry):
    """All commands later by the same time."""

    name: ClassVar[str] = "command_delay"
    title: ClassVar[str] = "delay of commands"
    effect: ClassVar[type[Effect]] = CommandDelay
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("delay_s", "s", -0.2, 0.2),)
    confused_with: ClassVar[tuple[str, ...]] = ("torque_bandwidth", "command_jitter")

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One, in the delay."""
        out = np.zeros((view.n, len(view.rows), 1))
        out[:, DELAY, 0] = 1.0
        return out

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Delay beyond the nominal one; may be negative."""
        return {"delay_s": float(coefficients[0])}

    def add_to(self, model: RobotModel, values: Mapping[str, float], joints: tuple[str, ...]) -> RobotModel:
        """One delay in place of the nominal ones, longer or shorter by what was found, at least none."""
        nominal_s = sum(float(np.mean(e.delay_s)) for e in model.effects if isinstance(e, CommandDelay))
        others = tuple(e for e in model.effects if not isinstance(e, CommandDelay))
        total_s = max(0.0, nominal_s + values["delay_s"])
        return RobotModel(effects=(*others, CommandDelay(delay_s=total_s)), robot=model.robot)


class CommandJitterEntry(_LinkEntry):
    """Exponentially distributed delays on top."""

    name: ClassVar[str] = "command_jitter"
    title: ClassVar[str] = "jitter of commands"
    effect: ClassVar[type[Effect]] = CommandJitter
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("mean_s", "s", 0.0, 0.05),)
    confused_with: ClassVar[tuple[str, ...]] = ("command_delay", "command_drop")

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One, in delay and spread."""
        out = np.zeros((view.n, len(view.rows), 1))
        out[:, (DELAY, SPREAD), 0] = 1.0
        return out

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Mean of what is added."""
        return {"mean_s": float(coefficients[0])}


class CommandDropEntry(_LinkEntry):
    """Commands that never arrive."""

    name: ClassVar[str] = "command_drop"
    title: ClassVar[str] = "lost commands"
    effect: ClassVar[type[Effect]] = CommandDrop
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("probability", "1", 0.0, 0.9),)
    confused_with: ClassVar[tuple[str, ...]] = ("command_jitter",)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One, in the losses."""
        out = np.zeros((view.n, len(view.rows), 1))
        out[:, LOST, 0] = 1.0
        return out

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Probability."""
        return {"probability": float(coefficients[0])}
