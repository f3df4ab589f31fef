"""Faults of the network, as far as it is the body's, and of the robot's clock."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field
from typing_extensions import override

from fake_robot.body.fault_effects import FaultEffects
from fake_robot.faults.fault import Fault


class StateGap(Fault):
    """No state message is sent; those of this time are lost."""

    name: ClassVar[str] = "state_gap"

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.has_state_gap = True


class StateDelay(Fault):
    """State messages take longer, all alike."""

    name: ClassVar[str] = "state_delay"
    delay_s: float = Field(ge=0.0, le=10.0, description="added delay, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.state_delay_s += self.delay_s


class CommandDelay(Fault):
    """Commands take longer, all alike."""

    name: ClassVar[str] = "command_delay"
    delay_s: float = Field(ge=0.0, le=10.0, description="added delay, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.command_delay_s += self.delay_s


class StateJitter(Fault):
    """State messages take longer, each by its own exponential draw."""

    name: ClassVar[str] = "state_jitter"
    mean_s: float = Field(ge=0.0, le=1.0, description="mean of the added delay, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.state_jitter_s += self.mean_s


class CommandJitter(Fault):
    """Commands take longer, each by its own exponential draw."""

    name: ClassVar[str] = "command_jitter"
    mean_s: float = Field(ge=0.0, le=1.0, description="mean of the added delay, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.command_jitter_s += self.mean_s


class StateDrops(Fault):
    """Some state messages are lost."""

    name: ClassVar[str] = "state_drops"
    probability: float = Field(ge=0.0, le=1.0, description="share of messages")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.state_drop_probability = 1.0 - (1.0 - effects.state_drop_probability) * (1.0 - self.probability)


class CommandDrops(Fault):
    """Some commands are lost on their way."""

    name: ClassVar[str] = "command_drops"
    probability: float = Field(ge=0.0, le=1.0, description="share of messages")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.command_drop_probability = 1.0 - (1.0 - effects.command_drop_probability) * (1.0 - self.probability)


class DuplicatedStates(Fault):
    """Some state messages are sent twice."""

    name: ClassVar[str] = "duplicated_states"
    probability: float = Field(default=0.2, ge=0.0, le=1.0, description="share of messages")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.duplicate_probability = max(effects.duplicate_probability, self.probability)


class BackDatedStates(Fault):
    """Some state messages bear the stamps of an earlier time."""

    name: ClassVar[str] = "back_dated_states"
    probability: float = Field(default=0.2, ge=0.0, le=1.0, description="share of messages")
    shift_s: float = Field(default=0.03, gt=0.0, le=100.0, description="how much earlier, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.back_date_probability, effects.back_date_s = self.probability, self.shift_s


class MalformedStates(Fault):
    """State messages arrive that are no states of this Spot: without a joint, without its arm, cut, noise, or empty."""

    name: ClassVar[str] = "malformed_states"
    kind: Literal["eleven_joints", "no_arm", "cut", "noise", "empty"] = Field(
        default="eleven_joints", description="eleven_joints, no_arm, cut, noise or empty"
    )

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.malformed_states = self.kind


class ClockJump(Fault):
    """The robot's clock jumps; when the fault ends, it jumps back."""

    name: ClassVar[str] = "clock_jump"
    jump_s: float = Field(ge=-1e6, le=1e6, description="forward, or back if negative, s")

    @override
    def apply(self, effects: FaultEffects, onset_robot_stamp_ns: int) -> None:
        effects.clock_offset_s += self.jump_s
