"""How well the corner's cases can be told apart at all: Bayes' answer by one who knows how they were drawn.

In the corner at most one of a few known kinds is hidden, at one type of joint. With y the summaries of a case's runs,
size z of fault c and scale s of the ordinary errors, the approximation is linear and Gaussian,

    y | c, z, s  ~  N(m + z·b_c, U + s²·E),

with m, b_c, U and E from the judge's own simulator, and z and s summed over their priors. What it reaches is a lower
bound of what is attainable: other summaries may say more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from spot_model.policy.policy import Policy, load_policy
from spot_model.robot.facts import JOINT_TYPES, Array
from withheld.cases.draw import Case
from withheld.cases.protocol import CORNER_KINDS, CORNER_PLACE, SIZES
from withheld.cases.sequences import ordinary_sequences
from withheld.measuring.summaries import N_SUMMARIES, summaries
from withheld.plan import FaultRequest, RecordingPlan
from withheld.realities.judging.catalogue import CATALOGUE
from withheld.realities.reality import make
from withheld.simulator.ordinary_errors import SCALES
from withheld.simulator.simulation import RealityDivergedError

SECONDS: Final = 3.0
N_FAULTLESS: Final = 60
N_PAIRS: Final = 6
"""Robots that are simulated with and without each kind at each joint type."""
PAIR_SIZE: Final = 0.65
N_GRID: Final = 9
RIDGE: Final = 1e-9
NOTHING: Final = ""
Tell = Callable[[float], None]


@dataclass(frozen=True)
class Corner:
    """The approximation for one policy."""

    mean: Array
    """Of faultless robots, shape (18,)."""
    surroundings: Array
    """U, shape (18, 18)."""
    errors: Array
    """E."""
    effects: dict[tuple[str, str], Array]
    """b_c by kind and joint type."""

    def posterior(self, y: Array) -> dict[str, float]:
        """Probability of each kind, and of nothing (the empty name), given the summaries of a case."""
        sizes = np.linspace(*SIZES, N_GRID)
        scales = np.geomspace(*SCALES, N_GRID)
        normals = [multivariate_normal(self.mean, self.surroundings + s**2 * self.errors, True) for s in scales]
        found = {NOTHING: float(logsumexp([n.logpdf(y) for n in normals]) - np.log(N_GRID))}
        for kind in CORNER_KINDS:
            terms = [
                n.logpdf(y - z * self.effects[kind, place]) for place in JOINT_TYPES for z in sizes for n in normals
            ]
            found[kind] = float(logsumexp(terms) - np.log(len(terms)))
        # Nothing and each kind are drawn equally often.
        total = logsumexp(list(found.values()))
        return {name: float(np.exp(value - total)) for name, value in found.items()}


def learn(policy_path: Path, seed: int, tell: Tell = lambda _: None, n_faultless: int = N_FAULTLESS) -> Corner:
    """Simulate robots of the corner under one policy.

    Args:
        policy_path: Its file.
        seed: Of all draws.
        tell: Called with the share that is done.
        n_faultless: Robots at each end of the scale of ordinary errors.

    Raises:
        ValueError: Too few robots could be simulated.
    """
    policy = load_policy(policy_path)
    low, high = SCALES
    jobs = [(NOTHING, "", scale, k) for scale in SCALES for k in range(n_faultless)]
    jobs += [(kind, place, low, k) for kind in CORNER_KINDS for place in JOINT_TYPES for k in range(N_PAIRS)]
    made: dict[tuple[str, str, float], list[Array]] = {}
    base: dict[int, Array] = {}
    for done, (kind, place, scale, k) in enumerate(jobs):
        tell(done / len(jobs))
        y = _robot(policy_path, policy, kind, place, scale, seed + k)
        if y is None:
            continue
        if kind == NOTHING and scale == low:
            base[k] = y
        change = y - base[k] if kind and k in base else y
        if not kind or k in base:
            made.setdefault((kind, place, scale), []).append(change)
    calm, rough = np.array(made[NOTHING, "", low]), np.array(made[NOTHING, "", high])
    if min(len(calm), len(rough)) <= N_SUMMARIES // 2:
        raise ValueError(f"{policy_path}: only {len(calm)} and {len(rough)} robots could be simulated")
    spread_low, spread_high = np.cov(calm.T), np.cov(rough.T)
    errors = _positive((spread_high - spread_low) / (high**2 - low**2))
    effects = {(kind, place): np.mean(v, axis=0) / PAIR_SIZE for (kind, place, _), v in made.items() if kind}
    return Corner(calm.mean(axis=0), _positive(spread_low - low**2 * errors), errors, effects)


def summaries_of_case(case: Case, policies: Path) -> Array:
    """Of a case, simulated once more from its seeds; the mean over its runs."""
    path = policies / f"{case.policy}.onnx"
    reality = make(case.requests, case.reality_seed, CATALOGUE)
    made = reality.make_runs(RecordingPlan(path, case.sequences, case.repeats, case.recording_seed))
    return np.asarray(np.mean([summaries(run, load_policy(path)) for _, _, _, run in made.runs], axis=0))


def _robot(path: Path, policy: Policy, kind: str, place: str, scale: float, seed: int) -> Array | None:
    """Summaries of one robot in commands of its own; None where its simulation breaks down."""
    requests: Sequence[FaultRequest] = ()
    if kind:
        requests = (FaultRequest(kind=kind, place=CORNER_PLACE, size=PAIR_SIZE),)
    catalogue = {kind: CATALOGUE[kind].at_type(place)} if kind else CATALOGUE
    reality = make(requests, seed, catalogue, error_scale=scale)
    sequences = ordinary_sequences(policy.contract, np.random.default_rng(seed), SECONDS)
    try:
        made = reality.make_runs(RecordingPlan(path, sequences, 1, seed))
    except RealityDivergedError:
        return None
    return np.asarray(np.mean([summaries(run, policy) for _, _, _, run in made.runs], axis=0))


def _positive(matrix: Array) -> Array:
    """The nearest covariance: negative eigenvalues are what sampling left."""
    values, vectors = np.linalg.eigh(matrix)
    floor = RIDGE + 1e-6 * float(values.max())
    return np.asarray((vectors * np.maximum(values, floor)) @ vectors.T)
