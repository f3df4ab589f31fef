"""The program and its link to the servos: delays and losses of commands, scale, pose and order of set-points."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels import Array, Channel, ChannelView, Flags, Shape
from diagnosis.channels.program import FAST_QUANTILE, nominal_delay_s
from diagnosis.library import (
    ALL_OF_IT,
    WIDE_STEPS,
    Coefficient,
    LibraryEffect,
    Location,
    ShapeGrid,
    constant_columns,
    on_joints,
)
from diagnosis.library.experiments import STAND, WIRED_LINK
from spot_model.effects.commands import (
    LEFT_RIGHT,
    ActionScale,
    CommandDelay,
    CommandDrop,
    CommandJitter,
    DefaultPose,
    JointSwap,
)
from spot_model.io.model_file import RobotModel
from spot_model.robot.facts import DEFAULT_POSITION_RAD

PAST_FASTEST: Final = 1.0 + float(np.log(1.0 - FAST_QUANTILE))
"""Mean of an exponential wait beyond its fast quantile, over its mean."""


class _LinkEntry(LibraryEffect):
    family = "an error of the link"
    channels = (Channel.TIME_STAMPS,)
    location = Location.ROBOT
    split_by = WIRED_LINK


class CommandDelayEntry(_LinkEntry):
    """All commands later by the same time."""

    title = "delay of commands"
    family = "a lag or delay"
    effect = CommandDelay
    coefficients = (Coefficient("delay_s", "s", -0.2, 0.2),)
    confused_with = ("torque_bandwidth", "command_jitter")

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One, in the delay."""
        return constant_columns(view, np.array([1.0, 0.0, 0.0]))

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Delay beyond the nominal one; may be negative."""
        return {"delay_s": float(coefficients[0])}

    def add_to(self, model: RobotModel, values: Mapping[str, float], joints: tuple[str, ...]) -> RobotModel:
        """One delay in place of the nominal ones, longer or shorter by what was found, at least none."""
        others = tuple(e for e in model.effects if not isinstance(e, CommandDelay))
        total_s = max(0.0, nominal_delay_s(model.effects) + values["delay_s"])
        return RobotModel((*others, CommandDelay(delay_s=total_s)))


class CommandJitterEntry(_LinkEntry):
    """Exponentially distributed waits on top; commands are counted as they would come alone, whoever holds them up."""

    title = "jitter of commands"
    effect = CommandJitter
    coefficients = (ALL_OF_IT,)
    grid: ClassVar[ShapeGrid] = {"mean_s": (0.0005, 0.001, 0.002, 0.004, 0.008, 0.016)}
    nearby: ClassVar[ShapeGrid] = {"mean_s": WIDE_STEPS}
    confused_with = ("command_delay", "command_drop")

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """Later on average, and past the fastest; a late command holds others up, but none is lost."""
        mean_s = float(shape["mean_s"])
        return constant_columns(view, np.array([mean_s, mean_s * PAST_FASTEST, 0.0]))


class CommandDropEntry(_LinkEntry):
    """Commands that never arrive."""

    title = "lost commands"
    effect = CommandDrop
    coefficients = (Coefficient("probability", "1", 0.0, 0.9),)
    # A link that loses more is no link.
    largest: ClassVar[Mapping[str, float]] = {"probability": 0.3}
    confused_with = ("command_jitter",)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One, in the losses."""
        return constant_columns(view, np.array([0.0, 0.0, 1.0]))


class _ProgramEntry(LibraryEffect):
    family = "an error of the program"
    channels = (Channel.POLICY_REPLAY,)
    split_by = STAND


class ActionScaleEntry(_ProgramEntry):
    """Set-points too far from the default pose, or too near."""

    title = "wrong action scale in the program"
    effect = ActionScale
    coefficients = (Coefficient("scale", "1", -0.9, 9.0),)
    confused_with = ("default_pose",)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The intended distance from the default pose."""
        intended_rad: Array = view.signals
        return on_joints(intended_rad - DEFAULT_POSITION_RAD, joints)


class DefaultPoseEntry(_ProgramEntry):
    """A constant added to the set-points."""

    title = "wrong default pose in the program"
    effect = DefaultPose
    coefficients = (Coefficient("offset_rad", "rad", -1.0, 1.0),)
    confused_with = ("action_scale",)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One."""
        return on_joints(np.ones((view.n, len(view.rows))), joints)


class JointSwapEntry(_ProgramEntry):
    """Set-points of the other side."""

    title = "joints exchanged in the program"
    effect = JointSwap
    coefficients = (Coefficient("share", "1", 0.0, 1.0),)
    confused_with = ("default_pose",)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The other side's intended set-point less the joint's own."""
        intended_rad: Array = view.signals
        return on_joints(intended_rad[:, LEFT_RIGHT] - intended_rad, joints)
