"""What the robot will do on a command that was never run, with intervals; and whether that held.

Robots drawn from the posterior run the command in closed loop. They also run the commands of the logs: by how much they
are off there, e, widens the interval and moves its centre,

    s² = (ν₀ u² + Σ e²) / (ν₀ + n),    centre = mean + Σ e / (n + 1),

with e and the usual error u as shares of the number, and ν₀ = 4. The interval is Student's with ν₀ + n degrees of
freedom. Heat and battery are not simulated: they follow from loads by what the logs show, ΔT = a ∫τ² dt + b t and
Δcharge = c work + d t.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import Field, ValidationError
from scipy.stats import t as student

from diagnosis.closed_loop.merged_models import merged
from diagnosis.closed_loop.simulation import SensorNoise, simulate
from diagnosis.library.base import LibraryEffect
from diagnosis.next.choose.robots import compact
from diagnosis.next.choose.trial import try_on
from diagnosis.next.predict.outcome import (
    BATTERY,
    HEAT,
    MOTION,
    Predicted,
    battery_used_percent,
    heat_and_time,
    motion_numbers,
    warmed_c,
    work_and_time,
)
from diagnosis.read.policy_ticks import policy_ticks, script_of, tick_period_s
from diagnosis.verdict.posterior_file import Posterior
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.settings import Settings
from spot_model.io.validation import explain
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.contract import sha256_hex
from spot_model.policy.policy import Policy
from spot_model.robot.facts import Array

DRAWS: Final = 12
LEVEL: Final = 0.90
KNOWN: Final = 4.0
"""ν₀: so many observations the usual error is worth."""
SEQUENCES: Final = 6
"""Logged sequences that are simulated, at most."""


class Forecast(Settings):
    """One predicted number."""

    name: str
    title: str
    unit: str
    value: float
    low: float
    high: float
    measured: float | None = None

    @property
    def holds(self) -> bool | None:
        """Whether what was measured lies within; None before the run."""
        return None if self.measured is None else self.low <= self.measured <= self.high


class Prediction(Settings):
    """All that is predicted of a command, and what tells the log of its run from others."""

    schema_name: Literal["spot-rl/prediction/2"] = Field(default="spot-rl/prediction/2", alias="schema")
    level: float = LEVEL
    sequence: VelocitySequence
    """The command."""
    policy_sha256: str
    """Digest of the policy that will run."""
    posterior_sha256: str
    """Digest of what was still possible after the diagnosis."""
    logs: tuple[tuple[str, int], ...]
    """The logs that were diagnosed, each as :func:`recorded`."""
    made_host_stamp_ns: int
    """When it was made, this computer's clock."""
    forecasts: tuple[Forecast, ...]
    fell: float = Field(ge=0.0, le=1.0)
    """Share of simulated robots that fell or were stopped."""
    notes: tuple[str, ...] = ()

    def to_json(self) -> str:
        """As text."""
        return self.model_dump_json(by_alias=True, indent=1) + "\n"

    def lines(self) -> list[str]:
        """For a terminal."""
        out = [f"{self.sequence.name}: what the robot will do ({100 * self.level:.0f} % intervals)"]
        for f in self.forecasts:
            line = f"  {f.title:36s} {f.value:8.3f} {f.unit:4s} {f.low:8.3f} to {f.high:.3f}"
            if f.measured is not None:
                line += f"   measured {f.measured:.3f}: {'held' if f.holds else 'did not hold'}"
            out.append(line)
        if self.fell > 0.0:
            out.append(f"  {100 * self.fell:.0f} % of the simulated robots fell")
        return out + [f"  {note}" for note in self.notes]


def recorded(run: Run) -> tuple[str, int]:
    """What tells a log from others: the run's name, and when it began."""
    return run.header.run_id, run.header.started_host_stamp_ns


def digest_of(posterior: Posterior) -> str:
    """By which a prediction knows the diagnosis that it was made from."""
    return sha256_hex(posterior.model_dump_json(by_alias=True).encode())


def load_prediction(path: Path) -> Prediction:
    """Read a ``prediction.json``.

    Raises:
        BadInputError: It cannot be read, or is none of this release.
    """
    try:
        return Prediction.model_validate_json(path.read_bytes())
    except OSError as error:
        raise BadInputError(f"prediction {path} cannot be read: {error.strerror}") from error
    except ValidationError as error:
        raise BadInputError(
            f"{path} is no prediction of this release's 'spot-rl diagnose predict':\n{explain(error)}\n"
            "give --out FILE for a new one, made before the run"
        ) from error


def predict(
    posterior: Posterior,
    library: dict[str, LibraryEffect],
    sequence: VelocitySequence,
    policy: Policy,
    logs: Sequence[Run],
    seed: int,
) -> Prediction:
    """Predict a run.

    Args:
        posterior: What is still possible.
        library: Where its effects come from.
        sequence: The command, within the policy's range.
        policy: That will run.
        logs: Those that were diagnosed.
        seed: Of all draws.
    """
    rng = np.random.default_rng(seed)
    models = [compact(posterior.draw(library, rng)) for _ in range(DRAWS)]
    runs = try_on(sequence, models, policy, rng, tick_period_s(logs))
    numbers = np.array([motion_numbers(run) for run in runs])
    whole = np.isfinite(numbers).all(axis=1) & np.array([_is_whole(run, sequence) for run in runs])
    notes: list[str] = []
    if not whole.any():
        raise BadInputError(f"every simulated robot falls on {sequence.name}; ask for a slower command")
    errors = _errors(models, policy, logs, rng)
    if len(errors) == 0:
        notes.append("no log of the policy: intervals rest on the usual error of simulations alone")
    forecasts = [_forecast(q, numbers[whole, k], errors[:, k]) for k, q in enumerate(MOTION)]
    forecasts += _of_heat_and_battery([r for r, w in zip(runs, whole, strict=True) if w], logs, notes)
    return Prediction(
        sequence=sequence,
        policy_sha256=policy.sha256,
        posterior_sha256=digest_of(posterior),
        logs=tuple(recorded(log) for log in logs),
        made_host_stamp_ns=time.time_ns(),
        forecasts=tuple(forecasts),
        fell=float(1.0 - whole.mean()),
        notes=tuple(notes),
    )


def with_log(prediction: Prediction, run: Run) -> Prediction:
    """The prediction beside what came."""
    measured = dict(zip((q.name for q in MOTION), motion_numbers(run).tolist(), strict=True))
    measured |= {HEAT.name: float(np.max(warmed_c(run))), BATTERY.name: battery_used_percent(run)}
    forecasts = tuple(
        f.model_copy(update={"measured": measured[f.name]}) if np.isfinite(measured.get(f.name, np.nan)) else f
        for f in prediction.forecasts
    )
    return prediction.model_copy(update={"forecasts": forecasts})


def _is_whole(run: Run, sequence: VelocitySequence) -> bool:
    rows = policy_ticks(run)
    last_s = (run.ticks.robot_stamp_ns[rows[-1]] - run.ticks.robot_stamp_ns[0]) * 1e-9 if len(rows) else 0.0
    return bool(last_s >= sequence.duration_s)


def _errors(models: Sequence[RobotModel], policy: Policy, logs: Sequence[Run], rng: np.random.Generator) -> Array:
    """By logged sequence, real less simulated as a share of the real number, shape (n, 3)."""
    by_name: dict[str, list[Run]] = {}
    for log in logs:
        if log.header.policy_sha256 in ("", policy.sha256) and script_of(log) is not None:
            by_name.setdefault(log.header.command_sequence, []).append(log)
    found, period_s = [], tick_period_s(logs)
    for own in list(by_name.values())[:SEQUENCES]:
        script = script_of(own[0], period_s)
        together = merged(list(models))
        if script is None or together is None:
            continue
        runs = simulate(together, policy, [script] * len(models), rng, SensorNoise())
        real = np.mean([motion_numbers(run) for run in own], axis=0)
        simulated = np.nanmedian([motion_numbers(run) for run in runs], axis=0)
        found.append((real - simulated) / np.maximum(np.abs(real), 1e-3))
    return np.array([row for row in found if np.isfinite(row).all()]).reshape(-1, len(MOTION))


def _forecast(q: Predicted, numbers: Array, errors: Array) -> Forecast:
    mean, n = float(numbers.mean()), len(errors)
    centre = mean * (1.0 + float(errors.sum()) / (n + 1))
    off = np.sqrt((KNOWN * q.usual**2 + float(np.sum(errors**2))) / (KNOWN + n)) * abs(centre)
    half = float(student.ppf(0.5 + 0.5 * LEVEL, KNOWN + n) * np.hypot(off, numbers.std()))
    return _around(q, centre, half)


def _of_heat_and_battery(runs: Sequence[Run], logs: Sequence[Run], notes: list[str]) -> list[Forecast]:
    x = np.concatenate([heat_and_time(log) for log in logs])
    y = np.concatenate([warmed_c(log) for log in logs])
    heat = _linear(HEAT, x, y, np.concatenate([heat_and_time(r) for r in runs]), len(runs))
    x, y = np.array([work_and_time(log) for log in logs]), np.array([battery_used_percent(log) for log in logs])
    battery = _linear(BATTERY, x, y, np.array([work_and_time(r) for r in runs]), len(runs))
    missing = [q.title for q, made in ((HEAT, heat), (BATTERY, battery)) if made is None]
    notes += [f"{title}: the logs do not show enough of it" for title in missing]
    return [made for made in (heat, battery) if made is not None]


def _linear(q: Predicted, x: Array, y: Array, new: Array, n_runs: int) -> Forecast | None:
    """The largest of a run's numbers by a straight line through the logs; None where these hold too few."""
    known = np.isfinite(y)
    if known.sum() < 4 or np.ptp(y[known]) == 0.0:
        return None
    scale = np.maximum(np.abs(x[known]).max(axis=0), 1e-9)
    line, *_ = np.linalg.lstsq(x[known] / scale, y[known], rcond=None)
    left = y[known] - x[known] / scale @ line
    values = ((new / scale) @ line).reshape(n_runs, -1).max(axis=1)
    mean = float(values.mean())
    off = np.sqrt(float(left.var()) + (q.usual * mean) ** 2 + float(values.var()))
    half = float(student.ppf(0.5 + 0.5 * LEVEL, KNOWN) * off)
    return _around(q, mean, half)


def _around(q: Predicted, value: float, half: float) -> Forecast:
    return Forecast(name=q.name, title=q.title, unit=q.unit, value=value, low=value - half, high=value + half)
