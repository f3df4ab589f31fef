"""Why two runs cannot be compared; each message says what to give instead."""

from __future__ import annotations

from spot_model.errors import BadInputError


class CompareError(BadInputError):
    """Two runs cannot be compared as asked."""


class DifferentCommandsError(CompareError):
    """Two runs were told to do different things."""

    def __init__(
        self,
        first: str,
        second: str,
        at_s: float,
        axis: tuple[str, str],
        told: tuple[float, float],
        allowed: float,
    ) -> None:
        """``at_s``: since the policy took over in the first; ``axis``: its name and unit; ``told``: both commands."""
        super().__init__(
            f"{first} and {second} follow different velocity commands: after {at_s:.1f} s they are told {told[0]:.2f} "
            f"and {told[1]:.2f} {axis[1]} {axis[0]}; {allowed:g} apart is allowed; compare runs of one sequence, "
            "or a log with a model, which is simulated with the log's own commands"
        )


class DifferentJointsError(CompareError):
    """A run is of another robot."""

    def __init__(self, name: str, joints: tuple[str, ...]) -> None:
        super().__init__(f"{name} has the joints {', '.join(joints)}; only runs of Spot's twelve joints are compared")


class TooShortError(CompareError):
    """A run holds less than can be compared."""

    def __init__(self, name: str, seconds: float, needed: float) -> None:
        super().__init__(f"{name} has {seconds:.1f} s under the policy; at least {needed:g} s are needed")
