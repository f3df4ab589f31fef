"""The draw of a run's cases: each follows from the run's seed and its number alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.contract import PolicyContract
from spot_model.policy.policy import load_policy
from withheld.cases import protocol
from withheld.cases.protocol import CaseKind
from withheld.cases.sequences import fast_sequences, ordinary_sequences
from withheld.cases.source import Source
from withheld.plan import IMPORT_LACKS, SIGNALS, Detail, FaultRequest, Place, Signal

SMALLEST_LOGS = (2, 3.0)
"""Repeats and seconds of a trial run; too short for a figure."""


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
    repeats = int(rng.choice(list(protocol.REPEATS), p=list(protocol.REPEATS.values())))
    seconds = protocol.SECONDS[repeats]
    missing = frozenset[Signal]()
    if rng.random() < protocol.MISSING_SHARE:
        missing = frozenset(SIGNALS[i] for i in rng.choice(len(SIGNALS), rng.integers(1, 3), replace=False))
    if kind == "short":
        repeats, seconds, missing = 1, float(np.round(rng.uniform(*protocol.SHORT_S), 1)), IMPORT_LACKS
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
    slots = [kind for kind, count in protocol.SLOTS.items() for _ in range(count)]
    block, place = divmod(number, len(slots))
    return slots[int(np.random.default_rng([seed, 0, block]).permutation(len(slots))[place])]


def chosen(seed: int, numbers: Sequence[int], kinds: Sequence[str]) -> list[int]:
    """Numbers of the cases of some kinds, kind by kind; all of them if no kind is given.

    Raises:
        BadInputError: There is no such kind.
    """
    unknown = sorted(set(kinds) - set(protocol.WORDS))
    if unknown:
        raise BadInputError(f"kind {unknown[0]!r} is unknown; allowed: {', '.join(protocol.SLOTS)}")
    return [n for kind in kinds for n in numbers if kind_of(seed, n) == kind] if kinds else list(numbers)


def _policy(kind: CaseKind, policies: Path, rng: np.random.Generator) -> tuple[str, PolicyContract]:
    """Any policy; for a sprint one that can be told to go fast enough, where there is one."""
    contracts = {p.stem: load_policy(p).contract for p in sorted(policies.glob("*.onnx"))}
    if not contracts:
        raise BadInputError(f"folder {policies} has no policy (*.onnx); give --policies")
    quick = [n for n, c in contracts.items() if c.velocity_command_high[0] > protocol.SPRINT_M_S]
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
        "sprint": _present(protocol.SPRINT_KINDS, source),
    }.get(kind) or known
    sizes = protocol.SPRINT_SIZES if kind == "sprint" else protocol.SIZES
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
    weights = np.array([protocol.PLACES[p] for p in places])
    return places[int(rng.choice(len(places), p=weights / weights.sum()))]


def _without(
    kind: CaseKind, requests: tuple[FaultRequest, ...], source: Source, rng: np.random.Generator
) -> tuple[str, ...]:
    """The true effect's names, or those of a kind that has nothing to do with the case."""
    true = {n for r in requests for n in source.kinds[r.kind].names}
    apart = protocol.SPRINT_KINDS if kind == "sprint" else ()
    kept = true | {n for k in _present(apart, source) for n in source.kinds[k].names}
    decoys = sorted({k.names for k in source.kinds.values() if k.names and not set(k.names) & kept})
    decoy = decoys[int(rng.integers(len(decoys)))] if decoys else ()
    return tuple(sorted(true if kind == "left_out" else decoy))
