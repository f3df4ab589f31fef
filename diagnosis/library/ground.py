"""Ground that is not level, and grass: what surrounds the feet beyond what they stand on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from diagnosis.channels import Array, Channel, ChannelView, Flags, Ints, Shape, Views
from diagnosis.channels.dynamics import DynamicsSignals
from diagnosis.channels.kinematics import StanceSignals
from diagnosis.library import Coefficient, LibraryEffect, Location, ShapeGrid
from diagnosis.library.experiments import OTHER_GROUND, TURN
from spot_model.effects.ground import FootDrag, GroundSlope, foot_motion, level_turn_wxyz, low_feet
from spot_model.robot import facts
from spot_model.robot.rotation import multiply_wxyz
from trainer.signals.smoothing import smooth

STEP_RAD: Final = 0.01
STRETCH_S: Final = 5.0
"""A walking robot gets some metres further in it, and its strides are many."""
WHOLE_S: Final = 1e4
"""Longer than any recording."""
HEIGHTS: Final = slice(3 * facts.N_LEGS, None)
LEAST_SQUARE: Final = 1e-9
RISE: Final = ("rise_x_rad", "rise_y_rad")


class GroundSlopeEntry(LibraryEffect):
    """Standing feet that lie on a plane which keeps its direction in odom, whichever way the robot faces.

    The slope is one of all recordings in odom, or one of each recording or stretch, as its feet show it. Of several,
    the coefficients say how much of them there is: up the slopes, and across.
    """

    title = "slope of the ground"
    family = "another ground"
    effect = GroundSlope
    channels = (Channel.STANCE_KINEMATICS,)
    location = Location.ROBOT
    coefficients = tuple(Coefficient(name, "rad", -0.3, 0.3) for name in RISE)
    # Steeper than policies hold.
    largest: ClassVar[Mapping[str, float]] = dict.fromkeys(RISE, 0.2)
    confused_with = ("imu_tilt", "encoder_offset", "foot_radius")
    split_by = TURN

    def shapes(self, views: Views, joints: Flags) -> tuple[Shape, ...]:
        """One slope, one a recording, one a stretch; of several, the direction of their mean goes into a model."""
        view = views[Channel.STANCE_KINEMATICS]
        tried: list[Shape] = [{"stretch_s": 0.0}]
        for stretch_s in (WHOLE_S, STRETCH_S):
            of = _stretches(view, stretch_s)
            if of.max() > (view.run.max() if stretch_s < WHOLE_S else 0):
                mean = _rises(view, self._plane(view), of)[of].mean(axis=0)
                x, y = mean / max(float(np.hypot(*mean)), LEAST_SQUARE)
                tried.append({"stretch_s": stretch_s, "x": float(x), "y": float(y)})
        return tuple(tried)

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """What the feet of a robot on level ground would show less, for each radian."""
        plane = self._plane(view)
        if not shape["stretch_s"]:
            time_s = view.state * view.signals.stack.period_s
            is_there = (time_s >= shape.get("from_s", 0.0)) & (time_s < shape.get("until_s", np.inf))
            return np.asarray(plane * is_there[:, None, None])
        of = _stretches(view, shape["stretch_s"])
        rise = _rises(view, plane, of)[of]
        rise /= max(float(np.sqrt(np.mean(np.sum(rise**2, axis=1)))), LEAST_SQUARE)
        x, y = rise.T[:, :, None]
        return np.stack([plane[..., 0] * x + plane[..., 1] * y, plane[..., 1] * x - plane[..., 0] * y], axis=2)

    def values(self, coefficients: Array, shape: Shape) -> Mapping[str, float]:
        """The rise along x and y of odom; of several slopes, their root mean square in the direction of their mean."""
        up, across = (float(c) for c in coefficients)
        x, y = shape.get("x", 1.0), shape.get("y", 0.0)
        return dict(zip(RISE, np.clip([up * x - across * y, up * y + across * x], -0.3, 0.3).tolist(), strict=True))

    def inverse(self, values: Mapping[str, float]) -> tuple[Array, Shape]:
        """The rise, and the stretch in which it is there."""
        stretch = {name: values[name] for name in ("from_s", "until_s") if name in values}
        return np.array([values[name] for name in RISE]), {"stretch_s": 0.0, **stretch}

    def _plane(self, view: ChannelView) -> Array:
        """What one radian along x and y of odom adds, shape (n, 16, 2)."""
        k: StanceSignals = view.signals
        attitude, found = k.inputs.odom_from_body_wxyz, []
        for x, y in STEP_RAD * np.eye(2):
            level = multiply_wxyz(np.broadcast_to(level_turn_wxyz(*np.array([[[x]], [[y]]])), attitude.shape), attitude)
            change = k.correction(view.name, ("ground_slope", x > 0.0), odom_from_body_wxyz=np.asarray(level))
            found.append(change / STEP_RAD)
        return np.stack(found, axis=2)


def _stretches(view: ChannelView, stretch_s: float) -> Ints:
    """Number of each sample's stretch of its recording, counted over all; shape (n,)."""
    part = (view.state * view.signals.stack.period_s / stretch_s).astype(np.intp)
    return np.unique(np.stack([view.run, part], axis=1), axis=0, return_inverse=True)[1].astype(np.intp).ravel()


def _rises(view: ChannelView, plane: Array, of: Ints) -> Array:
    """The slope that standing feet show in each stretch, rad, shape (stretches, 2)."""
    use = view.usable[:, HEIGHTS, None]
    x, y = plane[:, HEIGHTS] * use, view.response[:, HEIGHTS, None] * use
    gram, right = np.zeros((of.max() + 1, 2, 2)), np.zeros((of.max() + 1, 2))
    np.add.at(gram, of, np.einsum("nri,nrj->nij", x, x))
    np.add.at(right, of, np.einsum("nri,nrj->ni", x, y))
    return np.asarray(np.linalg.solve(gram + LEAST_SQUARE * np.eye(2), right[..., None])[..., 0])


class FootDragEntry(LibraryEffect):
    """Swinging feet that something holds back while they are low: their legs' loads carry it on."""

    title = "drag on low feet, as by tall grass"
    family = "another ground"
    effect = FootDrag
    channels = (Channel.LOAD_TO_MOTION,)
    location = Location.ROBOT
    coefficients = (Coefficient("drag_n_s_per_m", "N·s/m", 0.0, 40.0),)
    grid: ClassVar[ShapeGrid] = {"height_m": (0.04, 0.08, 0.16)}
    # A foot meets the grass before the ground.
    confused_with = ("leg_mass", "viscous_friction", "contact_delay")
    split_by = OTHER_GROUND

    def show(self, views: Views) -> tuple[Channel, ...]:
        """Only where the body's velocity is known."""
        view = views.get(Channel.LOAD_TO_MOTION)
        known = view is not None and view.signals.stack.has("linear_vel_of_body_in_odom_m_s")
        return super().show(views) if known else ()

    def columns(self, view: ChannelView, shape: Shape, joints: Flags) -> Array:
        """Torque of the joints that moves a low foot on against one newton for each metre per second."""
        s: DynamicsSignals = view.signals
        if "foot_drag" not in s.cache:
            states, moves = s.stack.states, (s.stack.linear_vel_in_body_m_s, s.stack.angular_vel_in_body_rad_s)
            foot, jacobian, velocity = foot_motion(*moves, states.position_rad, states.velocity_rad_s)
            s.cache["foot_drag"] = (jacobian * velocity[..., None]).sum(axis=2).reshape(-1, 12), foot
        torque, foot = s.cache["foot_drag"]
        low = low_feet(s.stack.states.odom_from_body_wxyz, foot, shape["height_m"])
        return np.asarray(smooth(torque * np.repeat(low, 3, axis=1), s.rows)[:, :, None])
