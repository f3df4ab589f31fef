"""Faults of the program: action scale, default pose, joints exchanged. Seen where set-points are recomputed."""

from __future__ import annotations

import numpy as np

from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import Array, ChannelView, Flags, Shape
from diagnosis.library.base import Coefficient, LibraryEffect, on_joints
from diagnosis.library.experiments import STAND
from spot_model.effects.command.action_scale import ActionScale
from spot_model.effects.command.default_pose import DefaultPose
from spot_model.effects.command.joint_swap import LEFT_RIGHT, JointSwap
from spot_model.robot.facts import DEFAULT_POSITION_RAD


class _ProgramEntry(LibraryEffect):
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
