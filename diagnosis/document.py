"""The verdict: what ``verdict.json`` holds."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field

from diagnosis.decision_constants import NAMED
from spot_model.io.settings import Settings

Status = Literal["explained", "partly_explained", "unknown_effect", "calibration", "no_gap", "cannot_tell"]
GapName = Literal[
    "torque",
    "joint motion",
    "body motion",
    "swing-leg torque",
    "joint velocity",
    "body force",
    "body acceleration",
    "body velocity",
]
"""Three in closed loop; the others are what is predicted of logged signals in place of the motion."""


class GapCell(Settings):
    """The gap of one signal at one joint in one regime."""

    signal: str
    """What was compared: a joint's position, velocity or load, or a velocity of the body."""
    joint: str
    """Name of the joint; `body` for the body."""
    regime: str
    """The part of the motion, such as stance or swing."""
    gap: float
    """Mean Wasserstein distance of real and nominal runs of the same commands, in ``unit``."""
    floor: float
    """Mean distance between real runs of the same commands; 0 where there are no repeats."""
    ratio: float | None
    """gap / floor; null without repeats."""
    p_value: float | None
    """From permuting whole runs between real and nominal, adjusted by Benjamini–Hochberg; null without repeats."""
    low: float | None = None
    high: float | None = None
    """Interval of the gap from blocks of one second, where there are no repeats."""
    unit: str = ""
    """Unit of `gap` and `floor`."""
    n_samples: int = 0
    """Samples of the real runs in this cell."""


class Number(Settings):
    """A fitted number with its 90 % interval."""

    value: float
    """The estimate."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of that interval."""
    unit: str = ""
    """Its unit; empty for a share."""


class Split(Settings):
    """The recording that would distinguish the members of a group."""

    name: str
    """Name of the recording."""
    text: str
    """What to do, in a sentence."""
    by_hand: str = ""
    """What has to be done by hand, if anything."""
    command: str
    """For a terminal."""
    sequence_file: str = ""
    """Velocity sequence written beside the verdict."""


class GapChange(Settings):
    """One of the three gaps between robot and simulator, without something and with it."""

    gap: GapName
    """What is compared."""
    unit: str
    """Unit of the distances."""
    before: float
    """Mean distance from the robot without it."""
    after: float
    """Mean distance from the robot with it."""
    floor: float
    """The larger of ``repeats`` and 2 % of the signal's own spread, in closed loop; without repeats, models' scatter
    stands in for them. In open loop, what formulas and noise leave."""
    share: float | None
    """(before - after) / (before - floor), at most 1, measured on sequences that nothing was fitted to; null where
    ``before`` does not exceed ``floor``. In closed loop a distance under 2 % of the signal's spread counts as that."""
    low: float | None = None
    """Lower end of its 90 % interval."""
    high: float | None = None
    """Upper end of that interval."""
    repeats: float | None = None
    """Distance between two runs of the robot; null where it did not repeat itself."""


class QuantityChange(Settings):
    """One quantity of simulated runs, without something and with it."""

    quantity: str
    """Name of the quantity."""
    title: str
    """The quantity in words."""
    unit: str
    """Unit of all its values."""
    before: float | None
    """Without it; null where no run gives it."""
    after: float | None
    """With it."""
    robot: float | None = None
    """In the robot's own runs of the same commands."""
    low: float | None = None
    """Lower end of the 90 % interval of ``after - before``."""
    high: float | None = None
    """Upper end of that interval."""


class Consequences(Settings):
    """What something does: measured by simulation with it and without it, or by prediction of logged signals."""

    loop: Literal["closed", "open"]
    """Closed: the policy runs on the simulated robot. Open: logged signals are predicted from each other."""
    gaps: tuple[GapChange, ...] = ()
    """How much of each gap it closes."""
    changes: tuple[QuantityChange, ...] = ()
    """Speed, tracking, power, torque, lean and falls; empty in open loop."""


class Difference(Settings):
    """An effect, or a group of effects that these logs do not distinguish, which the robot has and the model lacks."""

    name: str
    """Name of the effect, as in a model file."""
    title: str = ""
    """The effect in words."""
    probability: float = Field(ge=0.0, le=1.0)
    """Probability that an effect of this group is there."""
    group: tuple[str, ...]
    """Effects that the logs do not distinguish from it, most likely first, itself included."""
    joints: tuple[str, ...]
    """Where it acts."""
    split_by: str
    """What to record to distinguish the group's members; empty for a group of one."""
    split: Split | None = None
    """The recording that distinguishes them, with the command; null for a group of one."""
    parameters: dict[str, Number]
    """Fitted parameters of the effect, by name."""
    by_type: dict[str, dict[str, Number]] = Field(default_factory=dict)
    """Fitted parameters by joint type (``hx``, ``hy``, ``kn``) or joint, where they differ; empty where one serves."""
    rivals: dict[str, float] = Field(default_factory=dict)
    """Probability of each effect in this place, adding up to ``probability`` with the other members."""
    gain_nats: float = 0.0
    """Evidence for it: what it adds to the log-likelihood of data not used for fitting, nats (3: odds of 20 to 1)."""
    channels: dict[str, float] = Field(default_factory=dict)
    """The evidence for it by channel, in nats."""
    consequences: Consequences | None = None
    """What it does; null where nothing could be measured."""

    @property
    def is_found(self) -> bool:
        """Whether it is more probable than not; else it is merely possible."""
        return self.probability > NAMED


class CalibratedNumber(Settings):
    """One number of this robot beside the nominal model's."""

    effect: str
    """Name of the effect that holds it, as in a model file."""
    parameter: str
    """Name of its parameter."""
    title: str
    """Both in words."""
    where: str
    """Joint type (``hx``, ``hy``, ``kn``), leg or ``body``."""
    nominal: float
    """In the nominal model."""
    value: float
    """On this robot."""
    low: float
    """Lower end of the 90 % interval."""
    high: float
    """Upper end of that interval."""
    unit: str = ""
    """Its unit; empty for a share."""
    spread: float = 0.0
    """Published standard deviation of this number between robots and their models."""
    probability: float = Field(default=0.0, ge=0.0, le=1.0)
    """Probability that it is out of the ordinary."""
    stands_out: bool = False
    """Whether that is more probable than not."""


class Calibration(Settings):
    """The robot's own numbers, which every nominal model has a few per cent wrong."""

    numbers: tuple[CalibratedNumber, ...] = ()
    """Farthest from the nominal model first, in published standard deviations."""
    units: tuple[CalibratedNumber, ...] = ()
    """Numbers of single joints, of legs and of the floor, with the differences: what is compared with other dates."""
    consequences: Consequences | None = None
    """What they do together, without any difference; null where nothing could be measured."""
    effects: dict[str, Consequences] = Field(default_factory=dict)
    """What each kind of number does, by effect: the corrected model against the same without it."""


class GapLeft(Settings):
    """What nothing that was found explains of one gap."""

    gap: GapName
    """What is compared."""
    unit: str
    """Unit of the distances."""
    left: float
    """Distance of the corrected model from the robot."""
    floor: float
    """The larger of ``repeats`` and 2 % of the signal's own spread, in closed loop; without repeats, models' scatter
    stands in for them. In open loop, what formulas and noise leave."""
    ratio: float | None
    """left / floor."""
    repeats: float | None = None
    """Distance between two runs of the robot; null where it did not repeat itself."""


class UnknownEffect(Settings):
    """What the corrected model leaves beyond what corrected models of faultless robots leave, where most is left."""

    joints: tuple[str, ...]
    """Where it is left; empty where the channel is of no joint."""
    regime: str
    """The part of the motion in which most is left; empty where the channel does not tell."""
    channel: str
    """The channel in which it shows."""
    unit: str
    """Unit of `left` and `usual`."""
    left: float
    """Root mean square that the corrected model leaves in that channel at those joints."""
    usual: float
    """What corrected models of faultless robots leave there at most, 95 in 100."""


class Shrink(Settings):
    """How much of the gap closes with the effects added, in closed loop, on sequences to which no size was fitted."""

    metric: Literal["w1_mmd"] = "w1_mmd"
    """The mean of two distances, 1-Wasserstein and MMD, each over its floor."""
    d0: float
    """Distance from the robot before, in times what repeats explain."""
    d1: float
    """Distance after."""
    floor: float
    """Distance between two runs of ``floor_of``, in the same unit."""
    floor_of: Literal["robot", "model"] = "robot"
    """Whose: the robot's, or, where it repeated no command sequence, the model's."""
    s: float | None
    """(d0 - d1) / (d0 - floor); null where the gap does not exceed its floor."""
    s_low: float | None
    """Lower end of its 90 % interval."""
    s_high: float | None
    """Upper end of that interval."""
    held_out: tuple[str, ...]
    """Sequences, each run by a model with numbers fitted to the others; empty: by the model that was fitted to all."""


class Stretch(Settings):
    """A stretch of a log: cut out, or carrying much of the gap."""

    log: str
    """Name of the log."""
    kind: str
    """Whether it was cut out, or contains much of the gap."""
    start_s: float
    """From the log's first state."""
    end_s: float
    """From the log's first state, too."""
    reason: str
    """Why, in words."""


class Verdict(Settings):
    """All that a diagnosis says."""

    schema_name: Literal["spot-rl/verdict/2"] = Field(default="spot-rl/verdict/2", alias="schema")
    status: Status
    """The answer, in one word; see [how it is decided](../diagnosis.md#how-to-read-it)."""
    where: tuple[GapCell, ...]
    """Where the gap is largest, largest first."""
    headline: str = ""
    """The largest consequence and what to do next, in a sentence."""
    warnings: tuple[str, ...] = ()
    """What has to be known before anything is done with the corrected model, a sentence each."""
    differences: tuple[Difference, ...]
    """Effects that the logs show, those that close most of a gap first."""
    calibration: Calibration = Calibration()
    """The robot's own numbers beside the nominal ones."""
    consequences: Consequences | None = None
    """What the corrected model changes as a whole: differences and calibration."""
    remainder: tuple[GapLeft, ...] = ()
    """What the corrected model leaves of each gap."""
    distances: dict[str, float] = Field(default_factory=dict)
    """Distance of closed-loop runs from the robot's, in times what repeats explain: of the nominal model, the
    calibrated one, the corrected one, and that without each difference; empty if nothing was simulated."""
    probability_none: float = Field(ge=0.0, le=1.0)
    """Probability that nothing is there beside the robot's own calibration."""
    probability_unknown: float = Field(ge=0.0, le=1.0)
    """Probability of an effect that the library lacks."""
    unknown: UnknownEffect | None
    """What no effect explains; null if nothing remains to be described."""
    channels: dict[str, str]
    """``used``, or ``off`` and the reason, by channel."""
    invisible: tuple[str, ...] = ()
    """Effects of the library that these logs cannot show."""
    shrink: Shrink | None
    """How much of the gap closes; null if nothing could be simulated or nothing was found."""
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
    since: str = ""
    """Date of the earlier diagnosis whose corrected model is the nominal one (`--history`); empty for other models."""
    robot: str = ""
    """The robot's serial number or name; empty where the logs do not tell."""
    no_model: str = ""
    """Why there is no corrected model file, and what to do instead; empty where there is one."""
    held: tuple[str, ...] = ()
    """Fitted numbers that lie at the end of what is physically possible and are held there, a sentence each."""
    notes: tuple[str, ...] = ()
    """What limits the verdict, a sentence each."""

    def to_json(self) -> str:
        """The text of ``verdict.json``."""
        return self.model_dump_json(by_alias=True, indent=1) + "\n"


def load_verdict(path: Path) -> Verdict:
    """Read a ``verdict.json``. Raises pydantic.ValidationError: it does not follow the schema."""
    return Verdict.model_validate_json(path.read_bytes())
