"""Why two runs cannot be compared; each message says what to give instead."""

from __future__ import annotations

from spot_model.errors import BadInputError


class CompareError(BadInputError):
    """Two runs cannot be compared as asked."""


class DifferentCommandsError(CompareError):
    """Two runs were told to do different things."""

    def __init__(self, first: str, second: str, difference: float, allowed: float) -> None:
        super().__init__(
            f"{first} and {second} follow different velocity commands: they differ by {difference:.2f} m/s on average, "
            f"{allowed:g} is allowed; compare runs of one command sequence, or a log with a model, "
            "which is simulated with the log's own commands"
        )


class DifferentJointsError(CompareError):
    """A run is of another robot."""

    def __init__(self, name: str, joints: tuple[str, ...]) -> None:
        super().__init__(f"{name} has the joints {', '.join(joints)}; only runs of Spot's twelve joints are compared")


class TooShortError(CompareError):
    """A run holds less than can be compared."""

    def __init__(self, name: str, seconds: float, needed: float) -> None:
        super().__init__(f"{name} has {seconds:.1f} s under the policy; at least {needed:g} s are needed")
