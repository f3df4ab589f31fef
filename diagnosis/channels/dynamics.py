"""Inverse dynamics of the logged motion against the measured loads, for channels *load to motion* and *base wrench*.

The nominal residual is computed at the full rate and then smoothed, since inverse dynamics are not linear; what a
change of a parameter or a sensor adds to it is small, and computed from smoothed signals at the kept rows.

Channel *load to motion* looks at the load less what the model needs where a leg swings, and the ground has no force on
its foot; channel *base wrench* puts the forces on all feet into the body's rows.

Time convention: a sampled torque loop, or a simulator, computes a load from positions at the start of its step, and
the step's mean acceleration lies in the middle. Left alone, such an offset looks like a displaced weight or a wrong
encoder; fitted freely, it takes part of real effects with it. So the choice is between conventions only: all of one
instant, or a load that is older by the lag that channel *set-point to load* measured.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from diagnosis.channels import Array, Channel, ChannelView, Flags
from diagnosis.channels.body_model import (
    BodyInputs,
    BodyModel,
    Residuals,
    feet_wrench,
    full_rate_inputs,
    place_of_feet,
    residuals,
)
from diagnosis.channels.stack import GRAVITY_M_S2, STRIDE, Stack, white_noise
from spot_model.effects.base import Effect
from spot_model.robot import facts
from spot_model.robot.rotation import multiply_wxyz, rotate_wxyz
from trainer.signals.smoothing import smooth

CARRIES: Final = 0.1
"""Share of the robot's weight that a standing foot carries at least; in a trot it carries a half."""


@dataclass(frozen=True)
class DynamicsSignals:
    """Signals of channels *load to motion* and *base wrench*."""

    stack: Stack
    model: BodyModel
    """The nominal one."""
    rows: NDArray[np.intp]
    """Rows of the stack that are kept, shape (n,)."""
    inputs: BodyInputs
    load_rate_nm_s: Array
    """Shape (n, 12)."""
    position_rate_rad_s: Array
    """Rate of the joints' positions, shape (n, 12): their velocity, whatever is reported as velocity."""
    position_curvature_rad_s2: Array
    """Rate of that."""
    contact: Flags
    """Feet on the ground at the full rate, by flags; where logs have none, by the forces on the feet. Shape (N, 4)."""
    nominal: Residuals
    """Smoothed, at the kept rows."""
    reference: Residuals
    """Residuals of the smoothed signals, with which changed residuals are compared."""
    force: Array
    """What the motion needs, as :meth:`BodyModel.inverse_dynamics` has it. Shape (n, 18)."""
    place: tuple[Array, Array]
    """As :func:`place_of_feet` has it; like the force the same for many changes of inputs."""
    drive: ChannelView | None = None
    """What the nominal drive gives, where it stands in for loads that no log has."""
    cache: dict[object, Any] = field(default_factory=dict, compare=False)

    def thinned(self, apart: int) -> tuple[DynamicsSignals, Flags]:
        """Signals of rows ``apart`` states from each other, or a little less, and these rows."""
        stride = max(STRIDE, apart - apart % STRIDE)
        keep = self.rows % stride == 0
        drive = None if self.drive is None else self.drive.of_rows(*self.drive.signals.thinned(stride))
        rows = {name: _of_rows(getattr(self, name), keep) for name in BY_ROW}
        return replace(self, **rows, drive=drive, cache={}), keep

    def with_inputs(self, **changes: Array) -> Residuals:
        """Residuals of the nominal model for other inputs."""
        return residuals(
            self.model,
            replace(self.inputs, **changes),
            force=self.force if changes.keys() <= {"load_nm"} else None,
            place=None if changes.keys() & {"position_rad", "world_from_body_wxyz"} else self.place,
        )

    def correction(self, channel: Channel, key: object, **changes: Array) -> Array:
        """What the channel shows less what it would show for other inputs, shape (n, R); kept under ``key``."""
        return self._change(channel, key, lambda: self.with_inputs(**changes))

    def change_by(self, channel: Channel, key: object, effect: Effect) -> Array:
        """The same for a nominal model with one more model effect."""

        def computed() -> Residuals:
            model = BodyModel((*self.model.effects, effect))
            same = np.array_equal(model.foot_radius_m, self.model.foot_radius_m)
            return residuals(model, self.inputs, place=self.place if same else None)

        return self._change(channel, key, computed)

    def _change(self, channel: Channel, key: object, compute: Callable[[], Residuals]) -> Array:
        """Of both channels, since they share what is computed; in single precision, since there are many."""
        if key not in self.cache:
            new = compute()
            both = (Channel.LOAD_TO_MOTION, Channel.BASE_WRENCH)
            self.cache[key] = {c: (self.reference.of(c) - new.of(c)).astype(np.float32) for c in both}
        return np.asarray(self.cache[key][channel], dtype=np.float64)

    def shifted_s(self) -> Residuals:
        """Change of the residuals for each second that positions and attitude were older when the loads acted."""
        age_s = 1e-3
        turned = self.inputs.angular_vel_in_body_rad_s * (0.5 * age_s)
        step = np.concatenate([np.ones((len(turned), 1)), -turned], axis=1)
        earlier = multiply_wxyz(self.inputs.world_from_body_wxyz, step / np.linalg.norm(step, axis=1, keepdims=True))
        moved = self.with_inputs(
            position_rad=self.inputs.position_rad - age_s * self.inputs.velocity_rad_s,
            world_from_body_wxyz=np.asarray(earlier),
        )
        change = {f.name: getattr(moved, f.name) - getattr(self.reference, f.name) for f in fields(Residuals)}
        return Residuals(**{name: value / age_s for name, value in change.items()})


BY_ROW: Final = (
    *("rows", "inputs", "nominal", "reference", "force", "place"),
    *("load_rate_nm_s", "position_rate_rad_s", "position_curvature_rad_s2"),
)
"""Fields of :class:`DynamicsSignals` with a value for each kept row."""


def _of_rows(values: Any, keep: Flags) -> Any:
    """Some rows of an array, or of all arrays that a tuple or a dataclass holds."""
    if isinstance(values, tuple):
        return tuple(v[keep] for v in values)
    if isinstance(values, (BodyInputs, Residuals)):
        return replace(values, **{f.name: getattr(values, f.name)[keep] for f in fields(values)})
    return values[keep]


def dynamics_signals(stack: Stack, model: BodyModel, drive: ChannelView | None) -> DynamicsSignals:
    """Smooth, differentiate and compute the nominal residuals; ``drive`` stands in for loads that were not measured."""
    rows = stack.kept_rows()
    raw = full_rate_inputs(stack, stack.states.load_nm if drive is None else drive.signals.load_nm)
    inputs = BodyInputs(**{f.name: smooth(getattr(raw, f.name), rows) for f in fields(BodyInputs)})
    length = np.linalg.norm(inputs.world_from_body_wxyz, axis=1, keepdims=True)
    inputs = replace(inputs, world_from_body_wxyz=inputs.world_from_body_wxyz / np.maximum(length, 1e-9))
    position_rate = stack.rate(raw.position_rad)
    full = residuals(model, raw)
    nominal = Residuals(*(smooth(getattr(full, f.name), rows) for f in fields(Residuals)))
    force = model.inverse_dynamics(inputs)
    place = place_of_feet(inputs, model.foot_radius_m)
    contact = stack.states.foot_contact if stack.has("foot_contact") else carrying(raw, full.foot_force_n)
    return DynamicsSignals(
        stack=stack,
        model=model,
        rows=rows,
        inputs=inputs,
        load_rate_nm_s=stack.rate(raw.load_nm, rows),
        position_rate_rad_s=position_rate[rows],
        position_curvature_rad_s2=stack.rate(position_rate, rows),
        contact=contact,
        nominal=nominal,
        reference=residuals(model, inputs, force=force, place=place),
        force=force,
        place=place,
        drive=drive,
    )


def carrying(inputs: BodyInputs, foot_force_n: Array) -> Flags:
    """Feet (N, 4) that the ground pushes up by more than :data:`CARRIES` of the robot's weight; all at full rate."""
    up = rotate_wxyz(inputs.world_from_body_wxyz[:, None, :], foot_force_n)[..., 2]
    return np.asarray(smooth(up) > CARRIES * facts.TOTAL_MASS_KG * GRAVITY_M_S2)


def wrench_of_joints(signals: DynamicsSignals) -> Array:
    """Force and moment on the body for each newton metre that a joint's load exceeds the model's; shape (n, 12, 6)."""
    if "wrench_of_joints" not in signals.cache:
        n = len(signals.rows)
        out = np.empty((n, facts.N_JOINTS, 6))
        for k in range(3):
            joint = np.broadcast_to(np.arange(facts.N_JOINTS) % 3 == k, (n, facts.N_JOINTS)).astype(np.float64)
            out[:, k::3] = feet_wrench(signals.place, joint)
        signals.cache["wrench_of_joints"] = out
    found: Array = signals.cache["wrench_of_joints"]
    return found


AFTER_LIFT_OFF: Final = 6
BEFORE_TOUCH_DOWN: Final = 7
"""States by which a swing is shortened at its ends: impacts are smoothed over."""
LIGHT_N: Final = 25.0
"""A foot that by the legs' loads carries more than this stands, whatever its flag says: flags come late."""
JOINT_FLOOR_NM: Final = 0.15
"""What differentiated velocities and a rigid model leave at least."""
JOINT_SHARE: Final = 0.03
"""Of a joint's load in the air; links bend, and accelerations come a millisecond late."""
BASE_ROWS: Final = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")
BASE_FLOOR: Final = np.array([1.5, 1.5, 2.5, 0.8, 1.5, 0.8])
"""What a rigid model and smoothed impacts leave at least, N and N·m."""
EDGE: Final = 4
"""States around a change of any contact flag that channel *base wrench* leaves out."""
BASE_SCALE: Final = np.array([3.0, 3.0, 5.0, 1.5, 3.0, 1.5])
"""Usual size of the residuals, so that joints and base weigh alike; N·m, N, N·m."""
LEGS: Final = np.repeat(np.arange(facts.N_LEGS), 3)


def motion_views(signals: DynamicsSignals, lag_s: float) -> tuple[ChannelView, ChannelView]:
    """Build both channels; ``lag_s`` is the load's by channel *set-point to load*, 0 where it is unknown."""
    stack, contact = signals.stack, signals.contact
    in_air = stack.inner(~contact, AFTER_LIFT_OFF, BEFORE_TOUCH_DOWN)[signals.rows]
    swinging = in_air & (np.linalg.norm(signals.nominal.foot_force_n, axis=2) < LIGHT_N)
    steady = stack.inner(contact, EDGE, EDGE) | stack.inner(~contact, EDGE, EDGE)
    calm = np.all(steady[signals.rows], axis=1)
    _, _, residuals = realigned(signals, swinging, calm, lag_s)
    # A foot that skips over the ground is carried by no flag, and shakes its whole leg.
    rattles = stack.rattles[signals.rows].reshape(-1, facts.N_LEGS, 3).any(axis=2)
    usable = np.repeat(swinging & ~rattles, 3, axis=1)
    load = signals.inputs.load_nm
    moved = [float(np.sqrt(np.mean(load[rows, i] ** 2))) if rows.any() else 0.0 for i, rows in enumerate(usable.T)]
    floor = np.maximum(JOINT_FLOOR_NM, JOINT_SHARE * np.array(moved))
    # The rows are already smoothed, so the noise found in them is what smoothing leaves.
    joints = stack.joint_view(
        Channel.LOAD_TO_MOTION,
        signals.rows,
        residuals.joint_nm,
        LEGS,
        unit="N·m",
        usable=usable,
        noise=np.maximum(white_noise(residuals.joint_nm, usable, is_smoothed=True), floor),
        signals=signals,
    )
    usable = np.repeat(calm[:, None], len(BASE_ROWS), axis=1)
    base = stack.view(
        Channel.BASE_WRENCH,
        signals.rows,
        residuals.base,
        rows=BASE_ROWS,
        unit="N, N·m",
        usable=usable,
        noise=np.maximum(white_noise(residuals.base, usable, is_smoothed=True), BASE_FLOOR),
        leg_of_joint=LEGS,
        signals=signals,
    )
    return joints, base


def realigned(signals: DynamicsSignals, swinging: Flags, calm: Flags, lag_s: float) -> tuple[float, float, Residuals]:
    """Choose the convention that leaves least over swinging joints (n, 4) and the body's rows where calm (n,).

    Returns:
        How much older than the motion the loads are, and the positions at which they acted, s; the residuals without
        what these offsets make.
    """
    drift = feet_wrench(signals.place, signals.load_rate_nm_s).sum(axis=1)
    shifted, nominal = signals.shifted_s(), signals.nominal
    found: list[tuple[float, float, Residuals]] = []
    for load_s, position_s in ((0.0, 0.0), (0.5 * lag_s, lag_s)):
        residuals = Residuals(
            joint_nm=nominal.joint_nm + load_s * signals.load_rate_nm_s + position_s * shifted.joint_nm,
            base=nominal.base + load_s * drift + position_s * shifted.base,
            foot_force_n=nominal.foot_force_n,
        )
        found.append((load_s, position_s, residuals))
    return min(found, key=lambda each: _size_left(each[2], swinging, calm))


def _size_left(residuals: Residuals, swinging: Flags, calm: Flags) -> float:
    """Mean size of the residuals, which outliers do not rule."""
    base = np.abs(residuals.base[calm] / BASE_SCALE)
    joint = np.abs(residuals.joint_nm[np.repeat(swinging, 3, axis=1)])
    every = np.concatenate([base.ravel(), joint.ravel() / 0.4])
    return float(np.mean(np.minimum(every, 5.0))) if len(every) else 0.0
