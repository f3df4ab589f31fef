"""What a recording will determine, before it is made: an identification by torques, rehearsed.

The model at the parameters' initial values walks the planned motions with a robot's usual sensor noise, and the fit of
torques is made on that as on logs. Its linear form, the inverse of JᵀWJ plus a prior as wide as the bounds, spread by
runs and legs, is the error to expect; it is formed again with each further motion that can be collected.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np
from pydantic import Field

from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.plant.closed_loop import StartState
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.rotation import LEVEL_WXYZ
from spot_model.text import counted
from trainer.collect.collect_run import PAPER_SEQUENCES, PlannedRun, plan_runs, sequence_sources
from trainer.signals.policy_ticks import Script, fall_stamp_ns
from trainer.signals.recording import Recording, record
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts
from trainer.sysid.config import SysidConfig
from trainer.sysid.logs import run_from_log
from trainer.sysid.measured import ResultPart
from trainer.sysid.torque_errors import FitErrors
from trainer.sysid.torque_fit import fit_torque
from trainer.sysid.torque_model import TorqueModel, torque_samples
from trainer.sysid.verdict import ParameterVerdict, judge_parameters

PLAN_NAME: Final = "plan.json"
OTHER_GAINS: Final = (50.0, 1.0)
"""Stiffness (N·m/rad) and damping (N·m·s/rad) of a further motion, as ``spot-rl collect --other-gains`` takes them."""
CONFOUNDED: Final = 0.9
"""Correlation of two estimates from which on one stands for the other."""
SHRINKS: Final = 0.9
"""A motion that leaves a larger share of a standard deviation is not worth its walk."""
UNCOVERED: Final = "no single sample of torque depends on it: only the search can find it, which a plan says nothing of"


class ExpectedParameter(ResultPart):
    """What is to be expected of one parameter."""

    name: str
    """Effect, joints and parameter."""
    unit: str
    low: float
    """Where it is known to be before: from here"""
    high: float
    """to here."""
    standard_deviation: float | None
    """Of its estimate from the planned recording; null where no sample depends on it."""
    is_determined: bool
    """Whether an identification would report it as identified."""
    reason: str
    """Why, or why not."""
    with_motion: dict[str, float | None]
    """By motion that can be added: its standard deviation then. Empty where everything is determined, and for what no
    torque depends on."""
    determined_with: tuple[str, ...]
    """The motions, of those, with which it would be determined."""


class Plan(ResultPart):
    """What a planned recording is expected to determine: ``plan.json``."""

    schema_name: Literal["spot-rl/sysid-plan/1"] = Field(default="spot-rl/sysid-plan/1", alias="schema")
    policy_sha256: str
    sequences: tuple[str, ...]
    repeats: int
    parameters: tuple[ExpectedParameter, ...]
    confounded: tuple[tuple[str, str, float], ...]
    """Pairs of parameters of which the recording shows little more than a combination, and their correlation."""
    notes: tuple[str, ...]
    """Falls of simulated robots, and runs that were too short to use."""


class _Rehearsal(NamedTuple):
    """One identification of simulated recordings."""

    errors: FitErrors
    verdicts: tuple[ParameterVerdict, ...]

    def deviation(self, i: int) -> float | None:
        value = float(self.errors.standard_error[i])
        return value if np.isfinite(value) else None


def make_plan(
    policy: Policy,
    config: SysidConfig,
    sequences: str,
    repeats: int,
    say: Callable[[str], None] = lambda _: None,
) -> Plan:
    """Rehearse the identification from motions and model alone.

    Args:
        policy: What will walk.
        config: Parameters, bounds and model; the parameters' initial values are taken for true.
        sequences: As ``spot-rl collect --sequences`` takes them.
        repeats: Runs of each; a further motion has as many.
        say: Is told what begins.

    Raises:
        BadInputError: A sequence is unknown, or no simulated robot keeps on its feet for long enough.
    """
    model, rng, notes = TorqueModel(config.space()), np.random.default_rng(0), list[str]()
    truth = model.space.model_with(model.space.initial)
    planned = plan_runs(sequence_sources(sequences), repeats, policy)
    names = tuple(dict.fromkeys(run.sequence.name for run in planned))

    def recorded(runs: Sequence[PlannedRun], under: Policy) -> list[Recording]:
        say(f"simulating {counted(len(runs), 'run')} …")
        made = simulate_scripts(truth, under, _scripts(runs, under), rng, UsualNoise()) if runs else []
        return _usable(made, under, notes)

    own, further = recorded(planned, policy), dict[str, list[Recording]]()
    if not own:
        raise BadInputError(f"--sequences {sequences}: no simulated run can be used:\n" + "\n".join(notes))
    base = _rehearsed(model, own)
    if not all(v.identified for v in base.verdicts):
        kp, kd = ((gain,) * facts.N_JOINTS for gain in OTHER_GAINS)
        softer = policy.contract.model_copy(update={"kp_nm_per_rad": kp, "kd_nm_s_per_rad": kd})
        first = [run for run in planned if run.sequence.name == names[0]]
        name = f"{names[0]} at other gains {OTHER_GAINS[0]:g},{OTHER_GAINS[1]:g}"
        further[name] = recorded(first, replace(policy, contract=softer))
        available = plan_runs(sequence_sources(",".join((*PAPER_SEQUENCES, "standing"))), repeats, policy)
        for recording in recorded([run for run in available if run.sequence.name not in names], policy):
            further.setdefault(recording.sequence, []).append(recording)
    with_motion = {name: _rehearsed(model, [*own, *some]) for name, some in further.items() if some}
    correlation = np.triu(base.errors.correlation, 1)
    return Plan(
        policy_sha256=policy.sha256,
        sequences=names,
        repeats=repeats,
        parameters=tuple(_expected(model, i, base, with_motion) for i in range(model.space.n)),
        confounded=tuple(
            (model.space.names[i], model.space.names[j], float(correlation[i, j]))
            for i, j in np.argwhere(np.abs(correlation) > CONFOUNDED)
        ),
        notes=tuple(notes),
    )


def standing_start() -> StartState:
    """The robot at rest in its stand."""
    rest = np.zeros(facts.N_JOINTS)
    return StartState(facts.DEFAULT_POSITION_RAD, rest, LEVEL_WXYZ, np.zeros(3), np.zeros(3), rest.astype(np.float32))


def _scripts(runs: Sequence[PlannedRun], policy: Policy) -> list[Script]:
    rate_hz, start = policy.contract.rate_hz, standing_start()
    return [Script(run.sequence.name, run.repeat, start, run.sequence.sampled(rate_hz), 1.0 / rate_hz) for run in runs]


def _usable(runs: Iterable[Run], policy: Policy, notes: list[str]) -> list[Recording]:
    """Recordings as an identification would cut them; falls are noted."""
    found = []
    for run in runs:
        name = f"{run.header.command_sequence} repeat {run.header.repeat}"
        try:
            cut, told = run_from_log(run, policy)
        except BadInputError as error:
            notes.append(f"{name} is left out: {error}")
            continue
        notes += [f"{name}: {told[0]}"] if fall_stamp_ns(run) is not None else []
        found.append(record(cut))
    return found


def _rehearsed(model: TorqueModel, recordings: Sequence[Recording]) -> _Rehearsal:
    space, samples = model.space, torque_samples(recordings)
    fit = fit_torque(model, samples, [space.initial], np.random.default_rng(0))
    return _Rehearsal(fit.errors, judge_parameters(model, samples, fit, space.initial, None))


def _expected(model: TorqueModel, i: int, base: _Rehearsal, further: Mapping[str, _Rehearsal]) -> ExpectedParameter:
    p, is_covered = model.space.parameters[i], bool(model.covered[i])
    return ExpectedParameter(
        name=p.name,
        unit=p.unit,
        low=p.low,
        high=p.high,
        standard_deviation=base.deviation(i),
        is_determined=base.verdicts[i].identified,
        reason=base.verdicts[i].reason if is_covered else UNCOVERED,
        with_motion={name: other.deviation(i) for name, other in further.items() if is_covered},
        determined_with=tuple(name for name, other in further.items() if other.verdicts[i].identified),
    )


def plan_text(plan: Plan) -> str:
    """The plan in sentences, for a terminal."""
    n = sum(p.is_determined for p in plan.parameters)
    what = f"{counted(plan.repeats, 'run')}{' each' * (len(plan.sequences) > 1)} of {' and '.join(plan.sequences)}"
    lines = [f"{what} would determine {n} of {counted(len(plan.parameters), 'parameter')}."]
    for p in plan.parameters:
        what = f"{p.name}: ± {_size(p)} (before: {p.low:g} to {p.high:g})"
        lines.append(f"{what}, {'determined' if p.is_determined else 'not determined: ' + p.reason}")
    lines += [f"{a} and {b} are confounded (correlation {both:+.2f})." for a, b, both in plan.confounded]
    return "\n".join((*lines, *filter(None, map(_advice, plan.parameters)), *plan.notes))


def _advice(p: ExpectedParameter) -> str:
    """What to add for a parameter that is not determined; empty for others."""
    known = {name: value for name, value in p.with_motion.items() if value is not None}
    if p.is_determined or not p.with_motion:
        return ""
    best = min(known, key=lambda name: (name not in p.determined_with, known[name]), default="")
    if best and (best in p.determined_with or known[best] < SHRINKS * (p.standard_deviation or np.inf)):
        enough = "determines it" if best in p.determined_with else "is not enough"
        return f"For {p.name}, add {best}: ± {known[best]:.3g} {p.unit} in place of ± {_size(p)}, which {enough}."
    return f"For {p.name}, none of these helps: {', '.join(p.with_motion)}."


def _size(p: ExpectedParameter) -> str:
    return "unknown" if p.standard_deviation is None else f"{p.standard_deviation:.3g} {p.unit}"
