"""The verdict: what ``verdict.json`` holds. Its JSON Schema lies beside it and in docs/diagnosis.md."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field

from spot_model.io.settings import Settings

SCHEMA: Final = "spot-rl/verdict/1"

Status = Literal["explained", "partly_explained", "unknown_effect", "no_gap", "cannot_tell"]


class GapCell(Settings):
    """The gap of one signal at one joint in one regime."""

    signal: str
    joint: str
    regime: str
    gap: float
    """Mean Wasserstein distance of real and nominal runs of the same commands, in ``unit``."""
    floor: float
    """The same between real runs; 0 where there are no repeats."""
    ratio: float | None
    """gap / floor; null without repeats."""
    p_value: float | None
    """Of permuting whole runs between real and nominal, adjusted after Benjamini and Hochberg; null without repeats."""
    low: float | None = None
    high: float | None = None
    """Interval of the gap from blocks of one second, where there are no repeats."""
    unit: str = ""
    n_samples: int = 0


class Number(Settings):
    """A fitted number with its 90 % interval."""

    value: float
    low: float
    high: float
    unit: str = ""


class Split(Settings):
    """The recording that would tell the members of a group apart."""

    name: str
    text: str
    by_hand: str = ""
    command: str
    """For a terminal."""
    sequence_file: str = ""
    """Velocity sequence written beside the verdict."""


class FoundEffect(Settings):
    """An effect, or a group of effects that these logs cannot tell apart."""

    name: str
    title: str = ""
    probability: float = Field(ge=0.0, le=1.0)
    group: tuple[str, ...]
    """Names within the margin of the best, best first; the effect alone where nothing else comes near."""
    joints: tuple[str, ...]
    split_by: str
    """What to record to tell the group's members apart; empty for a group of one."""
    split: Split | None = None
    parameters: dict[str, Number]
    rivals: dict[str, float] = Field(default_factory=dict)
    """Probability of each effect in this place, adding up to ``probability`` with the other members."""
    gain_nats: float = 0.0
    """What it adds to the log-likelihood of folds that the fit never saw."""
    nearer_floors: float | None = None
    """By how much closed loops come nearer to the robot with it, in distances between the robot's own repeats."""
    moved_floors: float | None = None
    """(D − floor)/floor of closed loops of the simulator with it and without it: how much it matters here."""
    channels: dict[str, float] = Field(default_factory=dict)
    """Where that gain comes from, nats by channel."""


class SeenEffect(Settings):
    """An effect that is likely there and does not matter here: closed loops are hardly others with it."""

    name: str
    title: str = ""
    joints: tuple[str, ...]
    parameters: dict[str, Number]
    moved_floors: float | None = None
    """As for an effect that was found; null where nothing could be simulated."""


class Dependence(Settings):
    """A quantity on which an unexplained residual depends, with the fitted curve."""

    quantity: str
    importance: float
    at: tuple[float, ...]
    residual: tuple[float, ...]


class FormulaTerm(Settings):
    """One term: ``value`` times ``code``, in the angle q, the speed v and the torque."""

    code: str
    unit: str
    value: float
    at_rad: float | None = None
    """Of a term about one angle."""
    width_rad: float | None = None


class Formula(Settings):
    """A torque that would explain what is left: the sum of its terms."""

    terms: tuple[FormulaTerm, ...]
    predicted_share: float
    """Share of what is left that it predicts, in runs that it was not fitted to."""


class UnknownEffect(Settings):
    """What no effect of the library explains."""

    joints: tuple[str, ...]
    regime: str
    depends_on: tuple[str, ...]
    channel: str = ""
    unit: str = ""
    predictable_share: float = 0.0
    """Share of the remaining residual that is predictable from signals, in runs that the fit never saw."""
    curves: tuple[Dependence, ...] = ()
    formula: Formula | None = None
    """A short formula for it, where there is one; ``unknown_effect.py`` beside the verdict holds it as an effect."""


class Placebo(Settings):
    """The best wrong effect with as many parameters."""

    name: str
    s: float


class OtherGap(Settings):
    """A gap of another signal, before and after."""

    name: str
    unit: str
    before: float
    after: float
    floor: float


class Shrink(Settings):
    """How much of the gap closes with the effects added, in closed loop, on sequences not used for fitting."""

    metric: Literal["w1_mmd"] = "w1_mmd"
    d0: float
    d1: float
    floor: float
    s: float | None
    """(d0 - d1) / (d0 - floor); null where the gap does not exceed its floor."""
    s_low: float | None
    s_high: float | None
    held_out: tuple[str, ...]
    placebo: Placebo | None
    beside: tuple[OtherGap, ...] = ()


class Stretch(Settings):
    """A stretch of a log: cut out, or carrying much of the gap."""

    log: str
    kind: str
    start_s: float
    end_s: float
    reason: str


class Verdict(Settings):
    """All that a diagnosis says."""

    schema_name: Literal["spot-rl/verdict/1"] = Field(default=SCHEMA, alias="schema")
    status: Status
    where: tuple[GapCell, ...]
    """Where the gap is largest, largest first."""
    effects: tuple[FoundEffect, ...]
    """The causes, most important first."""
    seen: tuple[SeenEffect, ...] = ()
    """Effects that the logs show, but that hardly change the motion."""
    distances: dict[str, float] = Field(default_factory=dict)
    """Distance between closed-loop runs and the robot's, in floors: of the nominal model, of the one with ordinary
    errors only, and of each set of effects that was tried; empty if nothing was simulated."""
    probability_none: float = Field(ge=0.0, le=1.0)
    """Probability that there is no cause: only ordinary errors."""
    probability_unknown: float = Field(ge=0.0, le=1.0)
    """Probability that an effect acts that the library lacks."""
    unknown: UnknownEffect | None
    """What no effect explains; null if nothing remains to be described."""
    channels: dict[str, str]
    """``used``, or ``off`` and the reason, by channel."""
    invisible: tuple[str, ...] = ()
    """Effects of the library that these logs cannot show."""
    shrink: Shrink | None
    """How much of the gap closes; null if nothing could be simulated or nothing was found."""
    synthesis: dict[str, Any] | None = None
    """What the diagnosis says of the nominal simulator with the effects added; null if it was not asked for."""
    log_advice: tuple[str, ...]
    """What to record next, a sentence each."""
    timeline: tuple[Stretch, ...] = ()
    """Stretches of the logs that were cut out, or that contain much of the gap."""
    without: tuple[str, ...] = ()
    """Effects that were excluded from the library (``--without``), and so could not be found."""
    logs: tuple[str, ...] = ()
    """Names of the logs that were used."""
    nominal: str = ""
    """The nominal model: its file or built-in name."""
    notes: tuple[str, ...] = ()
    """What limits the verdict, a sentence each."""

    def to_json(self) -> str:
        """As text for ``verdict.json``."""
        return self.model_dump_json(by_alias=True, indent=1) + "\n"


def load_verdict(path: Path) -> Verdict:
    """Read a ``verdict.json``.

    Raises:
        pydantic.ValidationError: It does not follow the schema.
    """
    return Verdict.model_validate_json(path.read_text(encoding="utf-8"))


def json_schema() -> str:
    """The JSON Schema of ``verdict.json``, as text."""
    return json.dumps(Verdict.model_json_schema(by_alias=True), indent=1, sort_keys=True) + "\n"


SCHEMA_FILE: Final = Path(__file__).with_name("verdict.schema.json")
