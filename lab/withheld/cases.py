"""The draw of a run's cases: each follows from the run's seed and its number alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

import numpy as np

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings
from spot_model.io.velocity_sequence import VelocitySequence, sequence_of
from spot_model.policy.contract import PolicyContract
from spot_model.policy.policy import load_policy
from withheld.plan import IMPORT_LACKS, SIGNALS, Detail, FaultRequest, Place, Signal
from withheld.realities.source import Source

CaseKind = Literal["faultless", "single", "sprint", "double", "outside", "left_out", "short", "own"]
SLOTS: Final[dict[CaseKind, int]] = {
    "faultless": 15,
    "single": 24,
    "sprint": 6,
    "double": 15,
    "outside": 12,
    "left_out": 3,
    "short": 5,
}
"""Of every eighty cases; their order is drawn. Ten such blocks are a whole run."""
BLOCK: Final = sum(SLOTS.values())
WHOLE_RUN: Final = 10 * BLOCK
WORDS: Final[dict[CaseKind, str]] = {
    "faultless": "no fault",
    "single": "one effect of the library",
    "sprint": "power, rotor, friction or heat at 4 to 6 m/s",
    "double": "two effects of the library",
    "outside": "one effect that the library does not have",
    "left_out": "one effect that is left out of the library for the case",
    "short": "one short run as a foreign recording has it",
    "own": "a user's reality",
}
SIZES: Final = (0.3, 1.0)
"""Bounds of a fault's size, uniform; 1 is the end of its realistic range."""
PLACES: Final[dict[Place, float]] = {"joint": 1.0, "leg": 1.0, "type": 2.0, "all": 2.0, "body": 1.0}
"""Weights of the places at which a kind may act."""
REPEATS: Final[dict[int, float]] = {5: 0.6, 2: 0.2, 1: 0.2}
"""Runs of each of three sequences, and how often so many are recorded."""
SECONDS: Final[dict[int, float]] = {5: 6.0, 2: 8.0, 1: 12.0}
"""Length of a sequence by repeats."""
SHORT_S: Final = (3.0, 9.0)
MISSING_SHARE: Final = 0.15
"""Share of cases whose logs lack one or two signals."""
SPRINT_KINDS: Final = (
    "power_budget",
    "corroded_cable",
    "loaded_rotor",
    "dry_bearing",
    "rubbing_teeth",
    "warm_magnets",
)
"""What can explain missing torque at speed: the limit that the paper names, and its rivals."""
SPRINT_SIZES: Final = (0.5, 1.0)
SPRINT_M_S: Final = 4.0
"""A policy that is told to go slower cannot sprint."""
SMALLEST_LOGS: Final = (2, 3.0)
"""Repeats and seconds of a trial run; too short for a figure."""
COMFORT: Final = 0.75
"""Share of a policy's range that ordinary cases use; the rest belongs to :func:`fast_sequences`."""
TOP_M_S: Final = 3.0
FAST_M_S: Final = (4.0, 6.0)
"""Speeds at which a power-distribution limit shows; source: the paper."""


class Case(Settings):
    """All of a case but its reality's own draws."""

    number: int
    attempt: int = 0
    """Robots drawn before this one that broke their simulation."""
    kind: CaseKind
    requests: tuple[FaultRequest, ...]
    policy: str
    """Name of a file in the folder of policies."""
    sequences: tuple[VelocitySequence, ...]
    repeats: int
    missing: tuple[Signal, ...] = ()
    detail: Detail = "stream"
    without: tuple[str, ...] = ()
    """Left out of the library. Every case leaves something out, so that this tells nothing."""
    reality_seed: int
    recording_seed: int
    diagnosis_seed: int


def draw(seed: int, number: int, source: Source, policies: Path, is_quick: bool = False, attempt: int = 0) -> Case:
    """Case ``number`` of the run with that seed; every attempt is of the same kind, policy, commands and logs.

    Raises:
        BadInputError: There is no policy.
    """
    kind = kind_of(seed, number) if source.kinds else "own"
    rng = np.random.default_rng([seed, 1, number])
    name, contract = _policy(kind, policies, rng)
    repeats = int(rng.choice(list(REPEATS), p=list(REPEATS.values())))
    seconds = SECONDS[repeats]
    missing = frozenset[Signal]()
    if rng.random() < MISSING_SHARE:
        missing = frozenset(SIGNALS[i] for i in rng.choice(len(SIGNALS), rng.integers(1, 3), replace=False))
    if kind == "short":
        repeats, seconds, missing = 1, float(np.round(rng.uniform(*SHORT_S), 1)), IMPORT_LACKS
    if is_quick:
        repeats, seconds = min(repeats, SMALLEST_LOGS[0]), SMALLEST_LOGS[1]
    motion = fast_sequences if kind == "sprint" else ordinary_sequences
    sequences = motion(contract, rng, seconds)
    if kind == "short":
        sequences = (sequences[int(rng.integers(len(sequences)))],)
    robot = np.random.default_rng([seed, 2, number, attempt])
    requests = _requests(kind, source, robot)
    without = _without(kind, requests, source, robot)
    seeds = [int(s) for s in robot.integers(2**31, size=3)]
    return Case(
        number=number,
        attempt=attempt,
        kind=kind,
        requests=requests,
        policy=name,
        sequences=sequences,
        repeats=repeats,
        missing=tuple(sorted(missing)),
        detail="import" if kind == "short" else "stream",
        without=without,
        reality_seed=seeds[0],
        recording_seed=seeds[1],
        diagnosis_seed=seeds[2],
    )


def kind_of(seed: int, number: int) -> CaseKind:
    """The kind of a case: every block of cases holds each kind as often as the protocol says."""
    slots = [kind for kind, count in SLOTS.items() for _ in range(count)]
    block, place = divmod(number, len(slots))
    return slots[int(np.random.default_rng([seed, 0, block]).permutation(len(slots))[place])]


def chosen(seed: int, numbers: Sequence[int], kinds: Sequence[str]) -> list[int]:
    """Numbers of the cases of some kinds, kind by kind; all of them if no kind is given.

    Raises:
        BadInputError: There is no such kind.
    """
    unknown = sorted(set(kinds) - set(WORDS))
    if unknown:
        raise BadInputError(f"kind {unknown[0]!r} is unknown; allowed: {', '.join(SLOTS)}")
    return [n for kind in kinds for n in numbers if kind_of(seed, n) == kind] if kinds else list(numbers)


def _policy(kind: CaseKind, policies: Path, rng: np.random.Generator) -> tuple[str, PolicyContract]:
    """Any policy; for a sprint one that can be told to go fast enough, where there is one."""
    contracts = {p.stem: load_policy(p).contract for p in sorted(policies.glob("*.onnx"))}
    if not contracts:
        raise BadInputError(f"folder {policies} has no policy (*.onnx); give --policies")
    quick = [n for n, c in contracts.items() if c.velocity_command_high[0] > SPRINT_M_S]
    pool = quick if kind == "sprint" and quick else list(contracts)
    name = pool[int(rng.integers(len(pool)))]
    return name, contracts[name]


def _requests(kind: CaseKind, source: Source, rng: np.random.Generator) -> tuple[FaultRequest, ...]:
    if kind == "short":
        kind = (("faultless", "single", "outside"))[int(rng.choice(3, p=(0.4, 0.4, 0.2)))]
    if kind in ("faultless", "own"):
        return ()
    kinds = source.kinds
    known = [n for n, k in kinds.items() if k.names]
    pool = {
        "outside": [n for n, k in kinds.items() if not k.names],
        "sprint": _present(SPRINT_KINDS, source),
    }.get(kind) or known
    sizes = SPRINT_SIZES if kind == "sprint" else SIZES
    return tuple(
        FaultRequest(kind=name, place=_place(kinds[name].places, rng), size=float(rng.uniform(*sizes)))
        for name in _different(pool, 2 if kind == "double" else 1, source, rng)
    )


def _present(names: Sequence[str], source: Source) -> list[str]:
    return [name for name in names if name in source.kinds]


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
    weights = np.array([PLACES[p] for p in places])
    return places[int(rng.choice(len(places), p=weights / weights.sum()))]


def _without(
    kind: CaseKind, requests: tuple[FaultRequest, ...], source: Source, rng: np.random.Generator
) -> tuple[str, ...]:
    """The true effect's names, or those of a kind that has nothing to do with the case."""
    true = {n for r in requests for n in source.kinds[r.kind].names}
    apart = SPRINT_KINDS if kind == "sprint" else ()
    kept = true | {n for k in _present(apart, source) for n in source.kinds[k].names}
    decoys = sorted({k.names for k in source.kinds.values() if k.names and not set(k.names) & kept})
    decoy = decoys[int(rng.integers(len(decoys)))] if decoys else ()
    return tuple(sorted(true if kind == "left_out" else decoy))


# Velocity commands ----------------------------------------------------------------------------------------------------


def ordinary_sequences(
    contract: PolicyContract, rng: np.random.Generator, duration_s: float
) -> tuple[VelocitySequence, ...]:
    """``ahead`` (a ramp up and down), ``around`` (one axis at a time) and ``mixed`` (all at once)."""
    low, high = _range(contract)
    v, w, t = low, high, duration_s
    top = float(rng.uniform(0.7, 1.0)) * w[0]
    a, b = (float(rng.uniform(0.5, 1.0)) for _ in range(2))
    ahead = _sequence(
        "ahead",
        t,
        (0, 0, 0, 0, False),
        (0.08, 0.25 * top, 0, 0, False),
        (0.5, top, 0, 0, True),
        (0.8, top, 0, 0, True),
        (0.95, 0, 0, 0, True),
    )
    around = _sequence(
        "around",
        t,
        (0, 0, 0, 0, False),
        (0.08, a * 0.5 * w[0], 0, 0, False),
        (0.26, b * v[0], 0, 0, False),
        (0.44, 0, a * w[1], 0, False),
        (0.6, 0, b * v[1], 0, False),
        (0.75, 0, 0, a * w[2], False),
        (0.93, 0, 0, 0, False),
    )
    points: list[tuple[float, float, float, float, bool]] = [(0.0, 0.0, 0.0, 0.0, False)]
    for share in (0.08, 0.3, 0.52, 0.74):
        x, y, yaw = rng.uniform(0.8 * low, 0.8 * high)
        points.append((share, float(x), float(y), float(yaw), False))
    points.append((0.95, 0.0, 0.0, 0.0, False))
    return ahead, around, _sequence("mixed", t, *points)


def fast_sequences(
    contract: PolicyContract, rng: np.random.Generator, duration_s: float
) -> tuple[VelocitySequence, ...]:
    """Straight on at 4 to 6 m/s: hold, two steps, and a ramp with a gentle turn."""
    top_m_s = min(FAST_M_S[1], contract.velocity_command_high[0])
    a, b, c = np.sort(rng.uniform(FAST_M_S[0], top_m_s, 3))
    t = duration_s
    hold = _sequence(
        "ahead",
        t,
        (0, 0, 0, 0, False),
        (0.05, 1, 0, 0, False),
        (0.4, b, 0, 0, True),
        (0.8, b, 0, 0, True),
        (0.97, 0, 0, 0, True),
    )
    steps = _sequence(
        "around",
        t,
        (0, 0, 0, 0, False),
        (0.05, 2, 0, 0, False),
        (0.3, a, 0, 0, True),
        (0.6, c, 0, 0, True),
        (0.85, c, 0, 0, True),
        (0.98, 0, 0, 0, True),
    )
    turn = _sequence(
        "mixed",
        t,
        (0, 0, 0, 0, False),
        (0.05, 1.5, 0, 0, False),
        (0.45, c, 0, 0, True),
        (0.65, a, 0, 0.3, True),
        (0.8, a, 0, -0.3, True),
        (0.97, 0, 0, 0, True),
    )
    return hold, steps, turn


def _range(contract: PolicyContract) -> tuple[np.ndarray, np.ndarray]:
    low = COMFORT * np.array(contract.velocity_command_low)
    high = COMFORT * np.array(contract.velocity_command_high)
    return low, np.minimum(high, [TOP_M_S, 1.0, 1.5])


def _sequence(name: str, duration_s: float, *points: tuple[float, float, float, float, bool]) -> VelocitySequence:
    """A sequence of points, with their times as shares of the duration."""
    told = [(round(share * duration_s, 3), float(x), float(y), float(w), r) for share, x, y, w, r in points]
    return sequence_of(name, duration_s, *told)
