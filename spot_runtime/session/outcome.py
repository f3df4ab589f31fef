"""How a run ended: the first thing that went wrong stays the outcome, whatever follows, unless the robot fell."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from spot_runtime.hal.errors import HalError
from spot_runtime.stops import Stop, StopReason


@dataclass(frozen=True)
class Outcome:
    """What the summary, the log and the exit code say about the end."""

    label: str = ""
    """Name of the reason; empty while the run goes on."""
    exit_code: int = 0
    sentence: str = ""
    is_fault: bool = False
    """Whether something went wrong; neither what the operator asked for nor the end of a sequence is a fault."""

    def after_stop(self, stop: Stop) -> Outcome:
        """The outcome after this stop."""
        reason = stop.reason
        return self._after(Outcome(reason.label, reason.exit_code, stop.sentence(), is_fault=reason.is_fault))

    def after_fall(self, lean_rad: float) -> Outcome:
        """The outcome once the robot is seen to lie on its side or back."""
        words = f"the robot fell and lies at {math.degrees(lean_rad):.0f}°; see to it"
        tilt = StopReason.TILT
        return Outcome(
            tilt.label, tilt.exit_code, f"{self.sentence}; then {words}" if self.sentence else words, is_fault=True
        )

    def after_error(self, error: HalError) -> Outcome:
        """The outcome once the robot could not be used."""
        return self._after(Outcome(error.label, error.exit_code, str(error), is_fault=True))

    def after_power_failure(self, error: HalError) -> Outcome:
        """The outcome after powering off failed, which its sentence always names."""
        words = f"powering off failed: {error}; see to the robot"
        if self.is_fault or self.exit_code == StopReason.OPERATOR_ESTOP.exit_code:
            return replace(self, sentence=f"{self.sentence}; then {words}")
        return Outcome("power_off_failed", error.exit_code, f"{self.sentence}; then {words}", is_fault=True)

    def after_loss_of_log(self, problem: str) -> Outcome:
        """The outcome of a run that has left no log; what went wrong before stays, and so does an e-stop."""
        lost = Stop(StopReason.LOG_FAILED, problem)
        words = f"{self.sentence}; then {lost.sentence()}"
        if self.is_fault or self.exit_code == StopReason.OPERATOR_ESTOP.exit_code:
            return replace(self, sentence=words)
        return Outcome(lost.reason.label, lost.reason.exit_code, words, is_fault=True)

    def _after(self, later: Outcome) -> Outcome:
        is_fall = self.sentence and later.label == StopReason.TILT.label
        if not self.is_fault and not is_fall:
            return later
        return replace(later if is_fall else self, sentence=f"{self.sentence}; then {later.sentence}")
