"""Channel *base wrench*: the body's rows of the equations of motion, the feet's forces taken from the legs' loads.

All four legs count, whatever their contact flags say. Force and moment are in the body's frame, about its origin.
Time convention as in channel *load to motion*.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from diagnosis.channels.body.dynamics import DynamicsSignals
from diagnosis.channels.body.load_alignment import Alignment
from diagnosis.channels.channel import Channel
from diagnosis.channels.channel_view import ChannelView, Flags
from diagnosis.channels.stack import white_noise
from spot_model.robot import facts

ROWS: Final = ("force_x", "force_y", "force_z", "moment_x", "moment_y", "moment_z")
FLOOR: Final = np.array([1.5, 1.5, 2.5, 0.8, 1.5, 0.8])
"""What a rigid model and smoothed impacts leave at least, N and N·m."""
EDGE: Final = 4
"""States around a change of any contact flag that are left out."""


def base_view(signals: DynamicsSignals, alignment: Alignment) -> ChannelView:
    """Build the channel *base wrench*."""
    response = alignment.residuals.base
    calm = calm_rows(signals)
    usable = np.repeat(calm[:, None], len(ROWS), axis=1)
    none = np.full(len(ROWS), -1, dtype=np.intp)
    return ChannelView(
        name=Channel.BASE_WRENCH,
        rows=ROWS,
        unit="N, N·m",
        response=response,
        usable=usable,
        run=signals.stack.run[signals.rows],
        state=signals.stack.state[signals.rows],
        noise=np.maximum(white_noise(response, usable, is_smoothed=True), FLOOR),
        nuisance=np.zeros((*response.shape, 0)),
        row_joint=none,
        row_leg=none,
        leg_of_joint=np.repeat(np.arange(facts.N_LEGS, dtype=np.intp), 3),
        signals=signals,
        measured={"load_age_s": alignment.load_age_s, "position_age_s": alignment.position_age_s},
    )


def calm_rows(signals: DynamicsSignals) -> Flags:
    """Rows with no change of contact nearby. Shape (n,)."""
    stack, contact = signals.stack, signals.contact
    steady = stack.inner(contact, EDGE, EDGE) | stack.inner(~contact, EDGE, EDGE)
    return np.asarray(np.all(steady[signals.rows], axis=1))
