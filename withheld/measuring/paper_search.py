"""The paper's way, stretched to more parameters: CMA-ES on W1 + MMD over all at once; the largest change wins."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Final

import numpy as np

from spot_model.effects.registry import make_effect
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy
from trainer.sysid.logs.read_logs import read_logs
from trainer.sysid.search.config import SearchConfig
from trainer.sysid.search.problem import build_problem
from trainer.sysid.search.search import candidates_engine, run_search
from trainer.sysid.search.space import SearchParameter, SearchSpace
from trainer.sysid.simulation.rollout import RolloutOptions

GENERATIONS: Final = 25
POPULATION: Final = 10
"""250 evaluations of one simulated robot a sequence; the paper takes 1000, of eight parameters."""
HAS_GAP: Final = 0.10
TIMESTEP_S: Final = 0.005
"""The paper's own simulator steps so."""
CONTACT_S: Final = 0.02

PARAMETERS: Final[tuple[tuple[str, str, str, float, float, float], ...]] = (
    ("coulomb_friction", "hips", "level_nm", 0.0, 0.0, 1.5),
    ("coulomb_friction", "knees", "level_nm", 0.0, 0.0, 1.5),
    ("viscous_friction", "hips", "damping_nm_s_per_rad", 0.0, 0.0, 0.3),
    ("viscous_friction", "knees", "damping_nm_s_per_rad", 0.0, 0.0, 0.3),
    ("load_friction", "all", "share", 0.0, 0.0, 0.25),
    ("torque_gain", "hips", "gain", 1.0, 0.7, 1.1),
    ("torque_gain", "knees", "gain", 1.0, 0.7, 1.1),
    ("armature", "hips", "inertia_kg_m2", 0.0, 0.0, 0.06),
    ("armature", "knees", "inertia_kg_m2", 0.0, 0.0, 0.06),
    ("torque_bandwidth", "all", "time_constant_s", 0.0, 0.0, 0.025),
    ("payload_mass", "all", "mass_kg", 0.0, -2.5, 14.0),
)
"""Effect, joints, parameter, null, bounds: what a simulator's config usually has. Source of the ranges: literature."""


def paper_search(logs: Path, nominal: RobotModel, policy_path: Path, seed: int) -> str:
    """Search, and name the effect whose parameter moved furthest in units of its range; empty where none moved far.

    Raises:
        BadInputError: No log can be used.
    """
    policy = load_policy(policy_path)
    runs = read_logs([logs], policy).compared
    own = tuple(
        make_effect(effect, {"joints": [joints], parameter: null})
        for effect, joints, parameter, null, _, _ in PARAMETERS
    )
    first = len(nominal.effects)
    parameters = tuple(
        SearchParameter(
            effect_index=first + i,
            effect=effect,
            joints=(joints,),
            parameter=parameter,
            unit="",
            initial=null,
            low=low,
            high=high,
        )
        for i, (effect, joints, parameter, null, low, high) in enumerate(PARAMETERS)
    )
    space = SearchSpace(nominal.with_effects(*own), parameters)
    problem = build_problem(
        space,
        policy_path.read_bytes(),
        runs,
        RolloutOptions(timestep_s=TIMESTEP_S, contact_time_constant_s=CONTACT_S),
        robots_per_sequence=1,
        weights={},
        seed=seed,
    )
    config = SearchConfig(generations=GENERATIONS, population=POPULATION, seed=seed)
    with tempfile.TemporaryDirectory() as folder, candidates_engine(problem) as engine:
        state = run_search(problem, engine, config, Path(folder) / "search.jsonl")
    values = space.values_of_unit(state.mean_unit)
    change = np.array([abs(v - p.initial) / (p.high - p.low) for v, p in zip(values, parameters, strict=True)])
    best = int(np.argmax(change))
    return parameters[best].effect if change[best] > HAS_GAP else ""
