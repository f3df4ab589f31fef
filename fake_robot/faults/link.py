"""Faults of the network, as far as it is the body's, and of the robot's clock."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field
from typing_extensions import override

from fake_robot.body.fault_effects import FaultEffects
from fake_robot.faults.fault import Fault


class StateGap(Fault, name="state_gap"):
    """No state message is sent; those of this time are lost."""

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.has_state_gap = True


class StateDelay(Fault, name="state_delay"):
    """State messages take longer, all alike."""

    channel: ClassVar[str] = "states"
    delay_s: float = Field(ge=0.0, le=10.0, description="added delay, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        getattr(effects, self.channel).delay_s += self.delay_s


class CommandDelay(StateDelay, name="command_delay"):
    """Commands take longer, all alike."""

    channel: ClassVar[str] = "commands"


class StateJitter(Fault, name="state_jitter"):
    """State messages take longer, each by its own exponential draw."""

    channel: ClassVar[str] = "states"
    mean_s: float = Field(ge=0.0, le=1.0, description="mean of the added delay, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        getattr(effects, self.channel).jitter_s += self.mean_s


class CommandJitter(StateJitter, name="command_jitter"):
    """Commands take longer, each by its own exponential draw."""

    channel: ClassVar[str] = "commands"


class StateDrops(Fault, name="state_drops"):
    """Some state messages are lost."""

    channel: ClassVar[str] = "states"
    probability: float = Field(ge=0.0, le=1.0, description="share of messages")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        of = getattr(effects, self.channel)
        of.drop_probability = 1.0 - (1.0 - of.drop_probability) * (1.0 - self.probability)


class CommandDrops(StateDrops, name="command_drops"):
    """Some commands are lost on their way."""

    channel: ClassVar[str] = "commands"


class DuplicatedStates(Fault, name="duplicated_states"):
    """Some state messages are sent twice."""

    probability: float = Field(default=0.2, ge=0.0, le=1.0, description="share of messages")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.duplicate_probability = max(effects.duplicate_probability, self.probability)


class BackDatedStates(Fault, name="back_dated_states"):
    """Some state messages bear the stamps of an earlier time."""

    probability: float = Field(default=0.2, ge=0.0, le=1.0, description="share of messages")
    shift_s: float = Field(default=0.03, gt=0.0, le=100.0, description="how much earlier, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.back_date_probability, effects.back_date_s = self.probability, self.shift_s


class MalformedStates(Fault, name="malformed_states"):
    """State messages arrive that are no states of this Spot: without a joint, without its arm, cut, noise, or empty."""

    kind: Literal["eleven_joints", "no_arm", "cut", "noise", "empty"] = Field(
        default="eleven_joints", description="eleven_joints, no_arm, cut, noise or empty"
    )

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.malformed_states = self.kind


class ClockJump(Fault, name="clock_jump"):
    """The robot's clock jumps; when the fault ends, it jumps back."""

    jump_s: float = Field(ge=-1e6, le=1e6, description="forward, or back if negative, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.clock_offset_s += self.jump_s
