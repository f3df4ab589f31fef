"""The modes of a run and the one function that moves between them.

ready ──► activating ──► ramping_in ──► active ──► soft_stop ──► ramping_out ──► standing
             │               │            │            │              │
             └───────────────┴────────────┴─────┬──────┴──────────────┘
                                                ▼
                                damping ──► released (nothing is sent)
"""

from __future__ import annotations

from enum import Enum
from typing import Final, NamedTuple

from typing_extensions import Self

from spot_runtime.config import HandoverConfig
from spot_runtime.stops import Reaction

TAKE_HOLD_S: Final = 0.4
"""Robot time in which joint control takes hold: in twenty policy periods a stiffness that becomes tenfold rises by an
eighth in each, and has not doubled before the answer to it is back."""


class Mode(Enum):
    """What the loop does with the joints."""

    READY = "ready", "the vendor's stand holds the robot, the load is averaged, nothing is sent"
    ACTIVATING = "activating", "the robot switches to joint control, and its pose is held ever more stiffly"
    RAMPING_IN = "ramping_in", "from the measured pose with the stand's gains to the policy"
    ACTIVE = "active", "the policy follows the velocity command"
    SOFT_STOP = "soft_stop", "the policy, while the velocity command fades to zero"
    RAMPING_OUT = "ramping_out", "from the policy to a held pose with the stand's gains"
    STANDING = "standing", "the pose is held until the vendor's stand takes over"
    DAMPING = "damping", "no stiffness, only damping: the robot sinks; needs neither policy nor state"
    RELEASED = "released", "nothing is sent any more"

    meaning: str
    sends: bool
    """Whether commands are sent in this mode."""
    runs_policy: bool
    """Whether the policy ticks in this mode."""

    def __new__(cls, value: str, meaning: str) -> Self:
        """A mode has its name in logs as its value."""
        mode = object.__new__(cls)
        mode._value_, mode.meaning = value, meaning
        mode.sends = value not in ("ready", "released")
        mode.runs_policy = value in ("ramping_in", "active", "soft_stop", "ramping_out")
        return mode


class ModeInputs(NamedTuple):
    """What the machine looks at."""

    in_mode_s: float
    """Robot time since the mode began."""
    reaction: Reaction | None = None
    """How the run is to end; None while it goes on."""
    is_activation_asked: bool = False
    held_s: float = 0.0
    """Robot time since it confirmed joint control; 0 before."""


def next_mode(mode: Mode, inputs: ModeInputs, config: HandoverConfig) -> Mode:
    """The mode that follows; the same one where nothing changes."""
    if inputs.reaction is not None:
        forced = _forced(mode, inputs.reaction)
        if forced is not mode:
            return forced
    if mode is Mode.READY and inputs.is_activation_asked:
        return Mode.ACTIVATING
    if mode is Mode.ACTIVATING and inputs.held_s >= TAKE_HOLD_S:
        return Mode.RAMPING_IN
    if mode is Mode.RAMPING_IN and inputs.in_mode_s >= config.ramp_in_s:
        return Mode.ACTIVE
    if mode is Mode.SOFT_STOP and inputs.in_mode_s >= config.soft_stop_s + config.soft_stop_settle_s:
        return Mode.RAMPING_OUT
    if mode is Mode.RAMPING_OUT and inputs.in_mode_s >= config.ramp_out_s:
        return Mode.STANDING
    if mode is Mode.DAMPING and inputs.in_mode_s >= config.damping_s:
        return Mode.RELEASED
    return mode


def _forced(mode: Mode, reaction: Reaction) -> Mode:
    if mode in (Mode.READY, Mode.RELEASED):
        return Mode.RELEASED
    if reaction is Reaction.EXPIRE:
        return Mode.RELEASED
    if reaction in (Reaction.DAMP, Reaction.ESTOP):
        return Mode.DAMPING
    return {
        Mode.ACTIVATING: Mode.STANDING,
        Mode.RAMPING_IN: Mode.RAMPING_OUT,
        Mode.ACTIVE: Mode.SOFT_STOP,
    }.get(mode, mode)
