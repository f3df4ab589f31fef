"""The draw of a run's cases: each follows from the run's seed and its number alone."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict

from spot_model.errors import BadInputError
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.policy import load_policy
from withheld.cases.sequences import fast_sequences, ordinary_sequences
from withheld.cases.source import Source
from withheld.plan import SIGNALS, FaultRequest, Place, Signal

CaseKind = Literal["none", "known", "left_out", "never", "two", "three", "power", "own"]
SLOTS: Final[dict[CaseKind, int]] = {
    "none": 8,
    "known": 20,
    "left_out": 6,
    "never": 6,
    "two": 6,
    "three": 1,
    "power": 3,
}
"""How many of every fifty cases; their order is drawn."""
WORDS: Final[dict[CaseKind, str]] = {
    "none": "no effect",
    "known": "one effect of the library",
    "left_out": "one effect, left out of the library for the case",
    "never": "one effect that the library never had",
    "two": "two effects at once",
    "three": "three effects at once",
    "power": "power-distribution limit at 4 to 6 m/s",
    "own": "a user's reality",
}
LADDER: Final[dict[float, float]] = {0.2: 0.08, 0.4: 0.12, 0.6: 0.2, 0.8: 0.25, 1.0: 0.35}
"""Sizes and how often they are drawn: most figures are asked of effects that move the gap, and small ones do not."""
REPEATS: Final[dict[int, float]] = {5: 0.75, 2: 0.15, 1: 0.1}
ASKED_SHARE: Final = 1 / 4
"""Share of cases that are what the figures are asked of, see :attr:`Case.is_asked`; the others are as they come."""
MISSING_SHARE: Final = 0.1
"""Share of cases whose logs lack a signal."""
SECONDS: Final[dict[int, float]] = {5: 6.0, 2: 8.0, 1: 12.0}
"""Length of a sequence by repeats."""
Pace = Literal["full", "quick"]
QUICK_REPEATS: Final = 2
QUICK_SECONDS: Final = 3.0
"""To try a run out; too short for a figure."""
FAST_POLICY: Final = "fast"
POWER_EFFECTS: Final = frozenset({"power_limit", "bus_sag"})
RIVALS: Final = frozenset({"armature", "coulomb_friction", "viscous_friction", "load_friction", "stribeck_friction"})
"""What else could explain the picture that the paper blames on power distribution; never left out there."""


class Case(BaseModel):
    """All of a case but its reality's own draws."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    number: int
    attempt: int = 0
    """Robots drawn before this one that broke their simulation, or moved the gap too little for a case that asks."""
    is_asked: bool = False
    """Five repeats, all signals; a robot with effects is drawn anew until they move the gap by twice its floor."""
    kind: CaseKind
    requests: tuple[FaultRequest, ...]
    policy: str
    """Name of a file in the folder of policies."""
    sequences: tuple[VelocitySequence, ...]
    repeats: int
    missing: tuple[Signal, ...]
    without: tuple[str, ...]
    """Left out of the library. Every case leaves something out, so that this tells nothing."""
    reality_seed: int
    recording_seed: int
    diagnosis_seed: int


def draw(seed: int, number: int, source: Source, policies: Path, pace: Pace = "full", attempt: int = 0) -> Case:
    """Case ``number`` of the run with that seed; every attempt is of the same kind, policy, commands and logs.

    Raises:
        BadInputError: There is no policy.
    """
    names = sorted(p.stem for p in policies.glob("*.onnx"))
    if not names:
        raise BadInputError(f"folder {policies} has no policy (*.onnx); give --policies")
    kind = kind_of(seed, number) if source.kinds else "own"
    rng = np.random.default_rng([seed, 1, number])
    drawn = names[int(rng.integers(len(names)))]
    policy = FAST_POLICY if kind == "power" and FAST_POLICY in names else drawn
    repeats = int(rng.choice(list(REPEATS), p=list(REPEATS.values())))
    is_cut = rng.random() < MISSING_SHARE
    missing = tuple(sorted(SIGNALS[i] for i in rng.choice(len(SIGNALS), rng.integers(1, 3), replace=False)))
    # Cases without an effect ask as often, so that five repeats tell nothing.
    is_asked = kind not in ("power", "own") and rng.random() < ASKED_SHARE
    if kind == "power" or is_asked:
        repeats, is_cut = 5, False
    seconds = SECONDS[repeats]
    if pace == "quick":
        repeats, seconds, is_asked = QUICK_REPEATS, QUICK_SECONDS, False
    motion = fast_sequences if kind == "power" else ordinary_sequences
    sequences = motion(load_policy(policies / f"{policy}.onnx").contract, rng, seconds)
    robot = np.random.default_rng([seed, 2, number, attempt])
    requests = _requests(kind, source, robot)
    without = _without(kind, requests, source, robot)
    seeds = [int(s) for s in robot.integers(2**31, size=3)]
    return Case(
        number=number,
        attempt=attempt,
        is_asked=is_asked,
        kind=kind,
        requests=requests,
        policy=policy,
        sequences=sequences,
        repeats=repeats,
        missing=missing if is_cut else (),
        without=without,
        reality_seed=seeds[0],
        recording_seed=seeds[1],
        diagnosis_seed=seeds[2],
    )


def kind_of(seed: int, number: int) -> CaseKind:
    """The kind of a case: every fifty cases hold each kind as often as :data:`SLOTS` says."""
    slots = [kind for kind, count in SLOTS.items() for _ in range(count)]
    block, place = divmod(number, len(slots))
    return slots[int(np.random.default_rng([seed, 0, block]).permutation(len(slots))[place])]


def _requests(kind: CaseKind, source: Source, rng: np.random.Generator) -> tuple[FaultRequest, ...]:
    if kind in ("none", "own"):
        return ()
    known = [n for n, k in source.kinds.items() if k.names]
    never = [n for n, k in source.kinds.items() if not k.names]
    power = [n for n in known if set(source.kinds[n].names) & POWER_EFFECTS]
    pool = {"never": never or known, "power": power or known}.get(kind, known)
    count = min({"two": 2, "three": 3}.get(kind, 1), len(pool))
    chosen = _different(pool, count, source, rng)
    # The sub-table asks what is said of a limit that acts at all; its ladder has no lowest step.
    ladder = list(LADDER)[1:] if kind == "power" else list(LADDER)
    often = np.array([LADDER[size] for size in ladder])
    return tuple(
        FaultRequest(
            kind=name,
            place=_place(source.kinds[name].places, rng),
            size=float(rng.choice(ladder, p=often / often.sum())),
        )
        for name in chosen
    )


def _different(pool: list[str], count: int, source: Source, rng: np.random.Generator) -> list[str]:
    """Kinds with no right answer in common."""
    chosen: list[str] = []
    said: set[str] = set()
    for i in rng.permutation(len(pool)):
        names = set(source.kinds[pool[i]].names)
        if len(chosen) < count and not names & said:
            chosen.append(pool[i])
            said |= names
    return chosen


def _place(places: tuple[Place, ...], rng: np.random.Generator) -> Place:
    return places[int(rng.integers(len(places)))]


def _without(
    kind: CaseKind, requests: tuple[FaultRequest, ...], source: Source, rng: np.random.Generator
) -> tuple[str, ...]:
    """The true effect's names, or those of another kind, drawn alike."""
    true = {n for r in requests for n in source.kinds[r.kind].names}
    kept = true | (RIVALS if kind == "power" else frozenset())
    decoys = sorted({k.names for k in source.kinds.values() if k.names and not set(k.names) & kept})
    decoy = decoys[int(rng.integers(len(decoys)))] if decoys else ()
    return tuple(sorted(true)) if kind == "left_out" else tuple(sorted(decoy))
