"""Faults of the program: action scale, default pose, joints exchanged. Seen where set-points are recomputed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape
from diagnosis.channels.replay import ReplaySignals
from diagnosis.library.base import Coefficient, LibraryEffect, on_joints
from diagnosis.library.experiments import STAND, Experiment
from spot_model.effects.base import Effect
from spot_model.effects.command.action_scale import ActionScale
from spot_model.effects.command.default_pose import DefaultPose
from spot_model.effects.command.joint_swap import LEFT_RIGHT, JointSwap
from spot_model.robot.facts import DEFAULT_POSITION_RAD


class ActionScaleEntry(LibraryEffect):
    """Set-points too far from the default pose, or too near."""

    title: ClassVar[str] = "wrong action scale in the program"
    effect: ClassVar[type[Effect]] = ActionScale
    channels: ClassVar[tuple[Channel, ...]] = (Channel.POLICY_REPLAY,)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("scale", "1", -0.9, 9.0),)
    confused_with: ClassVar[tuple[str, ...]] = ("default_pose",)
    split_by: ClassVar[Experiment] = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The intended distance from the default pose."""
        s: ReplaySignals = view.signals
        return on_joints(s.intended_rad - DEFAULT_POSITION_RAD, joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Scale."""
        return {"scale": 1.0 + float(coefficients[0])}


class DefaultPoseEntry(LibraryEffect):
    """A constant added to the set-points."""

    title: ClassVar[str] = "wrong default pose in the program"
    effect: ClassVar[type[Effect]] = DefaultPose
    channels: ClassVar[tuple[Channel, ...]] = (Channel.POLICY_REPLAY,)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("offset_rad", "rad", -1.0, 1.0),)
    confused_with: ClassVar[tuple[str, ...]] = ("action_scale",)
    split_by: ClassVar[Experiment] = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """One."""
        return on_joints(np.ones((view.n, len(view.rows))), joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Offset."""
        return {"offset_rad": float(coefficients[0])}


class JointSwapEntry(LibraryEffect):
    """Set-points of the other side."""

    title: ClassVar[str] = "joints exchanged in the program"
    effect: ClassVar[type[Effect]] = JointSwap
    channels: ClassVar[tuple[Channel, ...]] = (Channel.POLICY_REPLAY,)
    coefficients: ClassVar[tuple[Coefficient, ...]] = (Coefficient("share", "1", 0.0, 1.0),)
    confused_with: ClassVar[tuple[str, ...]] = ("default_pose",)
    split_by: ClassVar[Experiment] = STAND

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """The other side's intended set-point less the joint's own."""
        s: ReplaySignals = view.signals
        return on_joints(s.intended_rad[:, LEFT_RIGHT] - s.intended_rad, joints)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """Share."""
        return {"share": float(coefficients[0])}
