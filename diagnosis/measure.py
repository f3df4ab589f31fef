"""Closed-loop runs of the nominal, corrected and placebo models on sequences that the fit never saw, and the shrink."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from diagnosis.engine import Engine, LocalEngine, Tell
from diagnosis.fitted import corrected_model, without_fold
from diagnosis.logs import policy_ticks, script_of
from diagnosis.members import Member, members_of
from diagnosis.posterior import Group
from diagnosis.riders import Rider, riders_of, turned
from diagnosis.selection.board import Board
from diagnosis.selection.search import Rival, Selection
from diagnosis.shrink import Compared, Features, Shrinkage, compare, features_by_sequence, shrinkage
from diagnosis.simulated import Script
from diagnosis.surroundings import SURROUNDING_EFFECTS, Chosen, best_surroundings, run_all
from diagnosis.verdict import OtherGap, Placebo, Shrink
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.observation import observed
from spot_model.policy.policy import Policy


@dataclass(frozen=True)
class Bench:
    """What every model is put through."""

    runs: tuple[Run, ...]
    """Real logs."""
    scripts: tuple[Script, ...]
    """Of those that are long enough."""
    policy: Policy
    engine: Engine
    shared: RobotModel | None = None
    """The model whose surroundings serve all: the corrected one, where the ground or the estimator was found."""
    surroundings: dict[str, Chosen] = field(default_factory=dict)
    """Chosen ones, by name of the model."""

    def doubt(self, name: str) -> float:
        """Standard error of a model's distance from the choice of its surroundings, in floors."""
        chosen = self.surroundings.get("all" if self.shared is not None else name)
        return chosen.doubt if chosen is not None else 0.0

    @property
    def sequences(self) -> list[str]:
        """Names of the command sequences."""
        return sorted({s.sequence for s in self.scripts})

    def real(self) -> dict[str, Features]:
        """Real runs' features by sequence."""
        return dict(features_by_sequence(self.runs, self.policy))


@dataclass(frozen=True)
class Measured:
    """The shrink and the runs behind it."""

    shrink: Shrink | None
    nominal: tuple[Run, ...]
    corrected: tuple[Run, ...]
    notes: tuple[str, ...]


CLEARLY: Final = 0.3
"""In floors; less is what two simulations of one model differ by."""

Models = Mapping[str, RobotModel]
"""By command sequence, the model that runs it."""


def roll_out(
    bench: Bench, models: Mapping[str, Models], references: Models, rng: np.random.Generator, tell: Tell,
    like: Mapping[str, str] | None = None,
) -> dict[str, list[Run]]:  # fmt: skip
    """Runs of all scripts by each model, all side by side, in the surroundings that suit them.

    Args:
        bench: What to run.
        models: By name.
        references: By name, the model for which surroundings are chosen, unless the bench has one for all.
        like: By name of a model without a reference, the name of the one whose surroundings it shares.
        rng: Draws seeds.
        tell: Called with the share that is done.

    Raises:
        BadInputError: A model cannot be simulated.
    """
    wanted = references if bench.shared is None else {"all": bench.shared}
    missing = {name: model for name, model in wanted.items() if name not in bench.surroundings}
    if missing:
        bench.surroundings.update(best_surroundings(
            missing, bench.scripts, bench.real(), bench.policy, bench.engine, rng, lambda share: tell(0.6 * share)
        ))  # fmt: skip
    jobs, names = [], []
    for name, by_sequence in models.items():
        around = bench.surroundings["all" if bench.shared is not None else (like or {}).get(name, name)]
        for sequence, model in by_sequence.items():
            mine = [s for s in bench.scripts if s.sequence == sequence]
            jobs += [(model, s, around.by_sequence.get(sequence)) for s in mine]
            names += [name] * len(mine)
    made: dict[str, list[Run]] = {name: [] for name in models}
    for name, run in zip(names, run_all(jobs, bench.engine, rng, lambda share: tell(0.6 + 0.4 * share)), strict=True):
        made[name].append(run)
    return made


@dataclass(frozen=True)
class Simulated:
    """Closed-loop runs by name of the model: nominal, corrected, placebo, members of groups, riders."""

    runs: Mapping[str, list[Run]]
    placebo: str
    """Name of the wrong effect; empty without one."""
    members: tuple[Member, ...]
    """Of the found effects' groups; a run of each is there under its own name."""
    riders: tuple[Rider, ...]
    """Effects in doubt; the runs of the other model are there under its name."""
    is_crossed: bool
    """Whether each sequence's model was fitted without it."""
    notes: tuple[str, ...]


def simulate_all(
    bench: Bench, nominal: RobotModel, board: Board, selection: Selection, groups: Sequence[Group],
    rng: np.random.Generator, tell: Tell = lambda _: None,
) -> Simulated:  # fmt: skip
    """Run the nominal model and, where something was found, the corrected one with its variants, and the placebo.

    Args:
        bench: Real logs and how to simulate them.
        nominal: The model.
        board: With the folds.
        selection: What was chosen.
        groups: Of the chosen effects; none of their members is a placebo.
        rng: Draws seeds.
        tell: Called with the share that is done.

    Raises:
        BadInputError: The nominal model cannot be simulated.
    """
    names, notes = bench.sequences, []
    crossed = list(board.fold_names) == names and len(names) > 1
    placebo = _placebo(selection, frozenset(n for g in groups for n in g.names))
    members, riders = members_of(selection, groups), riders_of(selection, board)
    found = {"corrected": selection.best, "placebo": placebo.scored if placebo is not None else None}
    found |= {m.name: m.rival.scored for m in members} | {r.name: r.scored for r in riders}
    models: dict[str, Models] = {"nominal": dict.fromkeys(names, nominal)}
    references = {"nominal": nominal}
    # A placebo is hardly better than the nominal model, whose surroundings serve it.
    variants = [m.name for m in members] + [r.name for r in riders]
    like = {"placebo": "nominal", **dict.fromkeys(variants, "corrected")}
    for name, scored in found.items():
        if scored is None:
            continue
        try:
            models[name] = {
                s: corrected_model(nominal, board.robot, scored, without_fold(scored, k) if crossed else None)
                for k, s in enumerate(names)
            }
            if name == "corrected":
                references[name] = corrected_model(nominal, board.robot, scored)
        except BadInputError as error:
            models.pop(name, None)
            notes.append(f"{name} model cannot be simulated: {error}")
    try:
        runs = roll_out(bench, models, references, rng, tell, like)
    except BadInputError as error:
        notes.append(f"corrected model cannot be simulated: {error}")
        alone = replace(bench, shared=None)
        runs = roll_out(alone, {"nominal": models["nominal"]}, {"nominal": nominal}, rng, tell)
    named = placebo.scored.terms[-1].effect.name if placebo is not None and "placebo" in runs else ""
    there = tuple(m for m in members if m.name in runs), tuple(r for r in riders if r.name in runs)
    return Simulated(runs, named, *there, crossed, tuple(notes))


def decided(bench: Bench, simulated: Simulated) -> tuple[Simulated, Member | None, Rider | None]:
    """What closed loops decide: the member of a group, or else the effect in doubt, with which they come nearer.

    Runs of the model that won take the place of the corrected model's, and those of the other variants go.

    Args:
        bench: Real logs.
        simulated: Runs of the models.
    """
    variants = {m.name for m in simulated.members} | {r.name for r in simulated.riders}
    if "corrected" not in simulated.runs or not variants:
        return simulated, None, None
    runs = {name: some for name, some in simulated.runs.items() if name not in variants}
    compared = [c for c in _compared(bench, simulated.runs)[0] if c.real.shape[0] > 1]
    if not compared:
        # Without repeats a distance has no unit.
        return replace(simulated, runs=runs, members=(), riders=()), None, None
    far = {name: float(np.mean([c.models[name].mean() for c in compared])) for name in compared[0].models}
    members = tuple(replace(m, distance=far[m.name], chosen_distance=far["corrected"]) for m in simulated.members)
    winner = min(members, key=lambda m: m.distance, default=None)
    if winner is not None and winner.distance >= far["corrected"] - CLEARLY:
        winner = None
    rider = turned(simulated.riders, far, CLEARLY) if winner is None else None
    for nearer in (winner, rider):
        if nearer is not None:
            runs["corrected"] = simulated.runs[nearer.name]
    return replace(simulated, runs=runs, members=members), winner, rider


def measure(bench: Bench, simulated: Simulated, rng: np.random.Generator) -> Measured:
    """Compare.

    Args:
        bench: Real logs.
        simulated: Runs of the models.
        rng: Draws resamples.
    """
    made, crossed, notes = simulated.runs, simulated.is_crossed, list(simulated.notes)
    if "corrected" not in made:
        return Measured(None, tuple(made["nominal"]), (), tuple(notes))
    if not crossed:
        notes.insert(0, "all logs are of one command sequence: the shrink is measured on sequences that the fit saw")
    compared, told = _compared(bench, made)
    notes += told
    if not compared:
        return Measured(None, tuple(made["nominal"]), tuple(made["corrected"]), tuple(notes))
    doubt = (bench.doubt("nominal"), bench.doubt("corrected"))
    after = shrinkage(compared, "nominal", "corrected", rng, doubt)
    wrong = shrinkage(compared, "nominal", "placebo", rng) if "placebo" in made else None
    shrink = Shrink(
        d0=after.d0, d1=after.d1, floor=after.floor, s=after.s, s_low=after.low, s_high=after.high,
        held_out=tuple(c.sequence for c in compared) if crossed else (),
        placebo=Placebo(name=simulated.placebo, s=wrong.s) if wrong is not None and wrong.s is not None else None,
        beside=tuple(_beside(bench.runs, made["nominal"], made["corrected"])),
    )  # fmt: skip
    if any(c.real.shape[0] < 2 for c in compared):
        notes.append("each sequence was run once: the floor counts as 0, and S is a lower bound")
    return Measured(shrink, tuple(made["nominal"]), tuple(made["corrected"]), tuple(notes))


def shrink_of(
    runs: Sequence[Run], nominal: RobotModel, corrected: RobotModel, policy: Policy, rng: np.random.Generator
) -> Shrinkage | None:
    """S of a stated model on any runs, as a verdict measures it: both models, each in the surroundings that suit it.

    None where no run can be compared. With many runs of sequences that the diagnosis never saw, this is the true S.

    Args:
        runs: Real logs.
        nominal: Before.
        corrected: After.
        policy: The policy that ran.
        rng: Draws seeds and resamples.
    """
    scripts = tuple(s for run in runs if (s := script_of(run)) is not None)
    if not scripts:
        return None
    added = {e.name for e in corrected.effects} - {e.name for e in nominal.effects}
    bench = Bench(tuple(runs), scripts, policy, LocalEngine(policy), corrected if added & SURROUNDING_EFFECTS else None)
    models = {"nominal": nominal, "corrected": corrected}
    made = roll_out(
        bench, {name: dict.fromkeys(bench.sequences, model) for name, model in models.items()}, models, rng,
        lambda _: None,
    )  # fmt: skip
    compared, _ = _compared(bench, made)
    doubt = (bench.doubt("nominal"), bench.doubt("corrected"))
    return shrinkage(compared, "nominal", "corrected", rng, doubt) if compared else None


def _compared(bench: Bench, models: Mapping[str, Sequence[Run]]) -> tuple[list[Compared], list[str]]:
    """Distances by sequence, and what could not be compared."""
    real = bench.real()
    parts = {name: features_by_sequence(group, bench.policy) for name, group in models.items()}
    compared, notes = [], []
    for sequence in bench.sequences:
        fallen = [name for name, part in parts.items() if not part.get(sequence)]
        if fallen:
            notes.append(f"sequence {sequence}: {', '.join(fallen)} fell at once and is not compared")
            continue
        short = sum(s.sequence == sequence for s in bench.scripts) - len(real[sequence])
        if short:
            notes.append(f"sequence {sequence}: {short} real runs that fell or were cut short are not compared")
        compared.append(compare(sequence, real[sequence], {name: part[sequence] for name, part in parts.items()}))
    repeated = [c for c in compared if c.real.shape[0] > 1]
    if repeated and len(repeated) < len(compared):
        # Without a floor of its own, a sequence's distances have another unit.
        single = ", ".join(c.sequence for c in compared if c.real.shape[0] < 2)
        notes.append(f"one run alone of {single} is whole: there is no floor, and it does not count for the shrink")
    return repeated or compared, notes


def _placebo(selection: Selection, not_wrong: frozenset[str]) -> Rival | None:
    """The best wrong effect with at least as many parameters, in the place of the effect that explains most."""
    if selection.best is None or not selection.rivals:
        return None
    place = int(np.argmax(selection.gains)) if selection.gains else len(selection.rivals) - 1
    chosen = selection.rivals[place][0].scored.terms[-1] if selection.rivals[place] else selection.best.terms[-1]
    wrong = [r for r in selection.rivals[place] if r.scored.terms[-1].effect.name not in not_wrong]
    enough = [r for r in wrong if r.scored.terms[-1].n_parameters >= chosen.n_parameters]
    best = enough or wrong
    return best[0] if best else None


def _beside(runs: Sequence[Run], before: Sequence[Run], after: Sequence[Run]) -> list[OtherGap]:
    """Gaps of measured torque, joint and body speed: mean Wasserstein distance over the signal's components."""
    out = []
    for name, unit, pick in (
        ("load", "N·m", _load), ("joint velocity", "rad/s", _joint_velocity), ("body velocity", "m/s", _velocity),
    ):  # fmt: skip
        pairs = list(_matched(runs, before, after))
        gaps = [(_w1(pick(a), pick(b)), _w1(pick(a), pick(c))) for a, b, c in pairs]
        same = [
            _w1(pick(a), pick(b))
            for i, a in enumerate(runs) for b in runs[:i]
            if a.header.command_sequence == b.header.command_sequence and len(policy_ticks(a)) and len(policy_ticks(b))
        ]  # fmt: skip
        if gaps and np.isfinite(gaps).all():
            b, a = np.mean(gaps, axis=0)
            out.append(
                OtherGap(
                    name=name, unit=unit, before=float(b), after=float(a), floor=float(np.mean(same)) if same else 0.0
                )
            )
    return out


def _matched(runs: Sequence[Run], before: Sequence[Run], after: Sequence[Run]) -> list[tuple[Run, Run, Run]]:
    def key(run: Run) -> tuple[str, int]:
        return (run.header.command_sequence or "unnamed", run.header.repeat)

    first, second = {key(r): r for r in before}, {key(r): r for r in after}
    return [(r, first[key(r)], second[key(r)]) for r in runs if key(r) in first and key(r) in second]


def _load(run: Run) -> np.ndarray:
    return np.asarray(run.states.load_nm[_active(run)])


def _joint_velocity(run: Run) -> np.ndarray:
    return np.asarray(run.states.velocity_rad_s[_active(run)])


def _velocity(run: Run) -> np.ndarray:
    return np.asarray(
        observed(run.ticks.observation[policy_ticks(run)], "linear_vel_of_body_in_body_m_s"), dtype=np.float64
    )


def _active(run: Run) -> np.ndarray:
    rows = policy_ticks(run)
    stamps = run.ticks.robot_stamp_ns[rows]
    return np.asarray((run.states.robot_stamp_ns >= stamps[0]) & (run.states.robot_stamp_ns <= stamps[-1]))


def _w1(a: np.ndarray, b: np.ndarray) -> float:
    grid = (np.arange(200) + 0.5) / 200
    return float(np.mean(np.abs(np.quantile(a, grid, axis=0) - np.quantile(b, grid, axis=0))))


__all__ = ["Bench", "Compared", "Measured", "Simulated", "measure", "roll_out", "shrink_of", "simulate_all"]
