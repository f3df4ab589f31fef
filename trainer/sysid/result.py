"""The identification as data: ``result.json``, and the files that others take as they are."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, Literal

import numpy as np
from pydantic import Field

from spot_model.io.model_file import save_model
from trainer.sysid.config import SysidConfig
from trainer.sysid.identify import Identification
from trainer.sysid.measured import MeasuredData, ResultPart, write_noise
from trainer.sysid.verdict import CONFIDENCE, ParameterVerdict

SCHEMA: Final = "spot-rl/sysid-result/1"
RESULT_NAME: Final = "result.json"
MODEL_NAME: Final = "identified.yaml"
NOISE_NAME: Final = "noise.yaml"
REPORT_NAME: Final = "report.html"
OUTPUTS: Final = (RESULT_NAME, MODEL_NAME, NOISE_NAME, REPORT_NAME)


class SequenceData(ResultPart):
    """One command sequence: floor and distances, Wasserstein in N·m, MMD without unit."""

    name: str
    """Name of the sequence."""
    repeats: int
    """Real runs of it."""
    floor_w1_nm: float | None
    """Mean Wasserstein distance between real runs; null without repeats."""
    floor_mmd: float | None
    """Mean maximum mean discrepancy (MMD) between real runs; null without repeats."""
    mmd_bandwidth_nm: float
    """Median distance between two samples, which sets the kernels' widths."""


class ResultData(ResultPart):
    """What an identification found: ``result.json``."""

    schema_name: Literal["spot-rl/sysid-result/1"] = Field(default=SCHEMA, alias="schema")
    policy_sha256: str
    """Digest of the policy that ran."""
    logs: list[str]
    """Names of the logs that were used."""
    confidence: float
    """Confidence of all intervals: 0.9."""
    parameters: list[ParameterVerdict]
    """The searched parameters; below."""
    measured: list[MeasuredData]
    """Quantities measured directly and put into the model; below."""
    score: dict[str, float | None]
    """Score of the initial values, the search's mean and the identified model."""
    score_is_over_floor: bool
    """Whether scores are in units of the floor: 1 is as close as two real runs."""
    score_by_generation: list[float | None]
    """Best score of each generation."""
    sequences: list[SequenceData]
    """Each command sequence: `name`, `repeats`, floors."""
    command_delay_median_s: float | None
    """From the hand-over of a command to its receipt."""
    path_delay_median_s: float | None
    """From the acquisition of a state to the receipt of the command that answers it."""
    observation_noise_sigma: list[float]
    """Standard deviation of the noise of each observation, shape (48,)."""
    load_noise_nm: list[float | None]
    """Standard deviation of the noise of each joint's load, shape (12,)."""
    torque_residual_nm: float | None
    """What the fit of the loads leaves, root mean square."""
    time_offset_s: float | None
    """By how much a sampled load is older than the motion in the same state."""
    warnings: list[str]
    """Logs that were left out, and other limits, a sentence each."""
    config: dict[str, Any]
    """The whole configuration of the identification."""


def result_data(found: Identification, config: SysidConfig) -> ResultData:
    """Collect all that was found."""
    preparation, problem = found.preparation, found.preparation.problem
    sequences = []
    for reference in problem.references:
        floor = reference.floor
        sequences.append(
            SequenceData(
                name=reference.sequence,
                repeats=len(reference.real),
                floor_w1_nm=None if floor is None else float(floor[0]),
                floor_mmd=None if floor is None else float(floor[1]),
                mmd_bandwidth_nm=reference.bandwidth_nm,
            )
        )
    best = [min(problem.score(r) for r in g.results) for g in found.search.generations]
    delays = preparation.delays
    return ResultData(
        policy_sha256=problem.policy.sha256,
        logs=[str(run.path) for run in preparation.logs.runs],
        confidence=CONFIDENCE,
        parameters=list(found.verdicts),
        measured=list(preparation.changes),
        score={name: _finite(value) for name, value in found.scores.items()},
        score_is_over_floor=all(s.repeats > 1 for s in sequences),
        score_by_generation=[_finite(b) for b in best],
        sequences=sequences,
        command_delay_median_s=_finite(delays.transit_median_s),
        path_delay_median_s=_finite(delays.path_median_s),
        observation_noise_sigma=preparation.noise.sigma.tolist(),
        load_noise_nm=[_finite(v) for v in preparation.noise.load_nm],
        torque_residual_nm=None if found.fit is None else found.fit.residual_nm,
        time_offset_s=None if found.fit is None else float(found.fit.nuisance[0]),
        warnings=list(preparation.logs.warnings),
        config=config.model_dump(mode="json", by_alias=True),
    )


def write_result(found: Identification, config: SysidConfig, folder: Path) -> ResultData:
    """Write result, identified model, noise and delays into a folder that holds none of them."""
    data = result_data(found, config)
    save_model(found.model, folder / MODEL_NAME)
    write_noise(found.preparation.noise, found.preparation.delays, folder / NOISE_NAME)
    (folder / RESULT_NAME).write_text(data.model_dump_json(by_alias=True, indent=1) + "\n", encoding="utf-8")
    return data


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
