"""A verdict as the judge reads it: what it scores and nothing else, so that any other field may come or go."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.validation import explain

EXPLAINS: Final = frozenset({"explained", "partly_explained"})
"""A verdict of any other status lists what it thought of, and names nothing."""


class _Part(BaseModel):
    model_config = ConfigDict(extra="ignore", frozen=True)


class Number(_Part):
    """A stated number with its 90 % interval."""

    value: float
    low: float
    high: float


class Said(_Part):
    """One stated cause, or a group of rivals that the logs cannot part."""

    name: str
    probability: float = Field(ge=0.0, le=1.0)
    group: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    parameters: dict[str, Number] = Field(default_factory=dict)

    @property
    def names(self) -> frozenset[str]:
        """The cause and its rivals."""
        return frozenset({self.name, *self.group})


class Seen(_Part):
    """What shows in the logs but does not matter to the gap."""

    name: str
    joints: tuple[str, ...] = ()


class Unknown(_Part):
    """What the library does not explain."""

    joints: tuple[str, ...] = ()


class Shrink(_Part):
    """How far the verdict says that the gap goes away."""

    d0: float
    d1: float
    floor: float
    s: float | None


class Verdict(_Part):
    """One verdict."""

    status: str
    effects: tuple[Said, ...] = ()
    """Causes of the gap."""
    seen: tuple[Seen, ...] = ()
    probability_none: float = 0.0
    probability_unknown: float = 0.0
    unknown: Unknown | None = None
    shrink: Shrink | None = None


def read_verdict(path: Path) -> Verdict:
    """Read a ``verdict.json``.

    Raises:
        BadInputError: It cannot be read, or lacks what is scored.
    """
    try:
        return Verdict.model_validate_json(path.read_text(encoding="utf-8"))
    except (OSError, ValidationError) as error:
        reason = explain(error) if isinstance(error, ValidationError) else str(error)
        raise BadInputError(f"{path} cannot be scored: {reason}") from error
