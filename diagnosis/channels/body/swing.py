"""Channel *load to motion*: the loads of swinging legs against what their motion needs, joint by joint.

Time convention: motion, positions and loads of one state belong together up to two small offsets, which
:mod:`diagnosis.channels.body.load_alignment` chooses for all joints at once and takes off.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels.body.dynamics import DynamicsSignals
from diagnosis.channels.body.load_alignment import Alignment
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import ChannelOff, ChannelView, Flags
from diagnosis.channels.drive.chatter import rattling
from diagnosis.channels.stack import white_noise
from spot_model.robot import facts

AFTER_LIFT_OFF: Final = 6
BEFORE_TOUCH_DOWN: Final = 7
"""States by which a swing is shortened at its ends: impacts are smoothed over."""
LIGHT_N: Final = 25.0
"""A foot that by the legs' loads carries more than this stands, whatever its flag says: flags come late."""
FLOOR_NM: Final = 0.15
"""What differentiated velocities and a rigid model leave at least."""
SHARE: Final = 0.03
"""Of a joint's load in the air; links bend, and accelerations come a millisecond late."""


def swing_view(signals: DynamicsSignals, alignment: Alignment) -> ChannelView | ChannelOff:
    """Build the channel *load to motion*."""
    swinging = swinging_legs(signals)
    rattles = rattling(signals.stack)[signals.rows]
    # A foot that skips over the ground is carried by no flag, and shakes its whole leg.
    calm = ~rattles.reshape(len(rattles), facts.N_LEGS, 3).any(axis=2)
    usable = np.repeat(swinging & calm, 3, axis=1)
    legs = np.repeat(np.arange(facts.N_LEGS, dtype=np.intp), 3)
    response = alignment.residuals.joint_nm
    # The rows are already smoothed, so the noise found in them is what smoothing leaves.
    noise = white_noise(response, usable, is_smoothed=True)
    load = signals.inputs.load_nm
    moved = np.array(
        [float(np.sqrt(np.mean(load[rows, i] ** 2))) if rows.any() else 0.0 for i, rows in enumerate(usable.T)]
    )
    return ChannelView(
        name=Channel.LOAD_TO_MOTION,
        rows=facts.JOINT_NAMES,
        unit="N·m",
        response=response,
        usable=usable,
        run=signals.stack.run[signals.rows],
        state=signals.stack.state[signals.rows],
        noise=np.maximum(noise, np.maximum(FLOOR_NM, SHARE * moved)),
        nuisance=np.zeros((*response.shape, 0)),
        row_joint=np.arange(facts.N_JOINTS, dtype=np.intp),
        row_leg=legs,
        leg_of_joint=legs,
        signals=signals,
        measured={"load_age_s": alignment.load_age_s, "position_age_s": alignment.position_age_s},
    )


def swinging_legs(signals: DynamicsSignals) -> Flags:
    """Legs off the ground at the kept rows, by flags and loads. Shape (n, 4)."""
    in_air = signals.stack.inner(~signals.contact, AFTER_LIFT_OFF, BEFORE_TOUCH_DOWN)[signals.rows]
    return np.asarray(in_air & (np.linalg.norm(signals.nominal.foot_force_n, axis=2) < LIGHT_N))
