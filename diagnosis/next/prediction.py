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
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Final, Literal

import numpy as np
from pydantic import Field, ValidationError
from scipy.stats import t as student

from diagnosis.closed_loop.run_numbers import QUANTITIES, Quantity, given_power_w, run_numbers
from diagnosis.closed_loop.simulation import SensorNoise, merged, simulate
from diagnosis.library import LibraryEffect
from diagnosis.next.robots import compact
from diagnosis.next.trial import STATE_S, try_on
from diagnosis.verdict.posterior_file import Posterior
from spot_log.read.run import Run
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.settings import Settings, explain
from spot_model.io.velocity_sequence import VelocitySequence
from spot_model.policy.contract import sha256_hex
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from trainer.signals.policy_ticks import policy_ticks, script_of, tick_period_s

DRAWS: Final = 12
LEVEL: Final = 0.90
KNOWN: Final = 4.0
"""ν₀: so many observations the usual error is worth."""
SEQUENCES: Final = 6
"""Logged sequences that are simulated, at most."""


@dataclass(frozen=True)
class Predicted(Quantity):
    """One of the numbers."""

    usual: float
    """Usual error of simulations of walking robots, as a share of the number. It is not calibrated."""


_USUAL: Final = {"top_speed": 0.04, "tracking_error": 0.15, "knee_torque": 0.08}
MOTION: Final = tuple(Predicted(q.name, q.title, q.unit, _USUAL[q.name]) for q in QUANTITIES if q.name in _USUAL)
HEAT: Final = Predicted("motor_temperature_rise", "rise of the hottest motor", "°C", 0.2)
BATTERY: Final = Predicted("battery_used", "battery used", "%", 0.2)


class Forecast(Settings):
    """One predicted number."""

    name: str
    """Name of the number, such as ``top_speed``."""
    title: str
    """The name in words."""
    unit: str
    """Unit of all numbers below."""
    value: float
    """What is expected."""
    low: float
    """Lower end of the interval."""
    high: float
    """Upper end of the interval."""
    measured: float | None = None
    """What the log of the run shows; None without a log."""


class Prediction(Settings):
    """All that is predicted of a command, and what tells the log of its run from others."""

    schema_name: Literal["spot-rl/prediction/2"] = Field(default="spot-rl/prediction/2", alias="schema")
    level: float = LEVEL
    """Probability of the intervals."""
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
    """The numbers."""
    fell: float = Field(ge=0.0, le=1.0)
    """Share of simulated robots that fell or were stopped."""
    notes: tuple[str, ...] = ()
    """What could not be predicted, and why."""

    def to_json(self) -> str:
        """The prediction as JSON text."""
        return self.model_dump_json(by_alias=True, indent=1) + "\n"

    def lines(self) -> list[str]:
        """For a terminal."""
        out = [f"{self.sequence.name}: what the robot will do ({100 * self.level:.0f} % intervals)"]
        for f in self.forecasts:
            line = f"  {f.title:36s} {f.value:8.3f} {f.unit:4s} {f.low:8.3f} to {f.high:.3f}"
            if f.measured is not None:
                holds = f.low <= f.measured <= f.high
                line += f"   measured {f.measured:.3f}: {'held' if holds else 'did not hold'}"
            out.append(line)
        if self.fell > 0.0:
            out.append(f"  {100 * self.fell:.0f} % of the simulated robots fell")
        return out + [f"  {note}" for note in self.notes]


def recorded(run: Run) -> tuple[str, int]:
    """What tells a log from others: the run's name, and when it began."""
    return run.header.run_id, run.header.started_host_stamp_ns


def digest_of(posterior: Posterior) -> str:
    """Digest by which a prediction knows the diagnosis that it was made from."""
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
    """Predict a run of a command within the policy's range; ``logs`` are those that were diagnosed.

    Raises:
        BadInputError: Every simulated robot falls.
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
    measured |= {HEAT.name: float(np.max(warmed_c(run))), BATTERY.name: float(battery_used_percent(run)[0])}
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
        together = merged(models)
        if script is None or together is None:
            continue
        runs = simulate(together, policy, [script] * len(models), rng, SensorNoise())
        real = np.mean([motion_numbers(run) for run in own], axis=0)
        simulated = np.nanmedian([motion_numbers(run) for run in runs], axis=0)
        found.append((real - simulated) / np.maximum(np.abs(real), 1e-3))
    return np.array([row for row in found if np.isfinite(row).all()]).reshape(-1, len(MOTION))


def _forecast(q: Predicted, numbers: Array, errors: Array) -> Forecast:
    n = len(errors)
    centre = float(numbers.mean()) * (1.0 + float(errors.sum()) / (n + 1))
    off = np.sqrt((KNOWN * q.usual**2 + float(np.sum(errors**2))) / (KNOWN + n)) * abs(centre)
    return _around(q, centre, float(np.hypot(off, numbers.std())), KNOWN + n)


def _of_heat_and_battery(runs: Sequence[Run], logs: Sequence[Run], notes: list[str]) -> list[Forecast]:
    made = []
    for q, cause, effect in ((HEAT, heat_and_time, warmed_c), (BATTERY, work_and_time, battery_used_percent)):
        x, y, new = (np.concatenate([f(r) for r in rs]) for f, rs in ((cause, logs), (effect, logs), (cause, runs)))
        forecast = _linear(q, x, y, new, len(runs))
        if forecast is None:
            notes.append(f"{q.title}: the logs do not show enough of it")
        else:
            made.append(forecast)
    return made


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
    return _around(q, mean, off, KNOWN)


def _around(q: Predicted, value: float, error: float, freedom: float) -> Forecast:
    half = float(student.ppf(0.5 + 0.5 * LEVEL, freedom) * error)
    return Forecast(name=q.name, title=q.title, unit=q.unit, value=value, low=value - half, high=value + half)


def motion_numbers(run: Run) -> Array:
    """:data:`MOTION` of a run, shape (3,); NaN where no policy ran for long enough."""
    numbers = run_numbers(run)
    return np.array([numbers[q.name] for q in MOTION])


def heat_and_time(run: Run) -> Array:
    """For each joint ∫τ² dt, (N·m)²·s, and the time, s; shape (12, 2)."""
    heat = (run.states.load_nm**2).sum(axis=0) * STATE_S
    return np.stack([heat, np.full(facts.N_JOINTS, len(run.states) * STATE_S)], axis=1)


def work_and_time(run: Run) -> Array:
    """Positive work of all joints, J, and the time, s; shape (1, 2)."""
    power_w = given_power_w(run.states.load_nm, run.states.velocity_rad_s).sum()
    return np.array([[float(power_w) * STATE_S, len(run.states) * STATE_S]])


def warmed_c(run: Run) -> Array:
    """How far each motor warmed up over the log, shape (12,); NaN where nobody measured it."""
    own = run.slow_states.motor_temperature_c
    return np.asarray(own[-1] - own[0]) if len(own) > 1 else np.full(facts.N_JOINTS, np.nan)


def battery_used_percent(run: Run) -> Array:
    """Over the log, shape (1,); NaN where nobody measured it."""
    own = run.slow_states.battery_charge_percent
    return np.array([float(own[0] - own[-1]) if len(own) > 1 else np.nan])


SLACK_S: Final = 5.0 / facts.POLICY_RATE_HZ
"""A run begins and ends with a tick, and may skip some: five of them."""
ROUNDING: Final = 1e-6
"""m/s and rad/s: what is lost where a log keeps commands in single precision."""


def check_prediction(made: Prediction, path: Path, wanted: VelocitySequence, policy: Policy, posterior: str) -> None:
    """Refuse a prediction that is there and is of something else than is asked for.

    Raises:
        BadInputError: It is of another command, policy or diagnosis (``posterior`` is the digest of the one asked).
    """
    parts = {
        f"other commands of sequence {made.sequence.name}": made.sequence == wanted,
        f"the policy with SHA-256 {made.policy_sha256[:12]}…": made.policy_sha256 == policy.sha256,
        "another diagnosis": made.posterior_sha256 == posterior,
    }
    differ = [what for what, is_same in parts.items() if not is_same]
    if differ:
        raise BadInputError(
            f"{path} holds a prediction of {' and '.join(differ)}, which stays as it is; give --out FILE for another"
        )


def check_log(made: Prediction, run: Run, policy: Policy) -> None:
    """Refuse a log that cannot say whether a prediction held.

    Raises:
        BadInputError: The log was used in the diagnosis, began before the prediction was made (by the clocks of the two
            computers), is of another policy or of other commands, or is not of the whole sequence.
    """
    path, header = run.path, run.header
    if recorded(run) in made.logs:
        raise BadInputError(f"log {path} was used in the diagnosis, so it proves nothing; give a run made since then")
    if header.started_host_stamp_ns <= made.made_host_stamp_ns:
        raise BadInputError(
            f"log {path} began at {_utc(header.started_host_stamp_ns)}, before the prediction was made at "
            f"{_utc(made.made_host_stamp_ns)}; give a run made since then (if the clock of the computer that recorded "
            "it was wrong, set it and run again)"
        )
    if header.policy_sha256 not in ("", policy.sha256):
        raise BadInputError(
            f"log {path} is of {header.policy_name or 'a policy'} with SHA-256 {header.policy_sha256[:12]}…; predicted "
            f"was {policy.contract.name} with {policy.sha256[:12]}…; give a run of that policy"
        )
    _check_commands(made.sequence, run)


def _check_commands(sequence: VelocitySequence, run: Run) -> None:
    rows = policy_ticks(run)
    stamps = run.ticks.robot_stamp_ns[rows]
    time_s = (stamps - stamps[0]) * 1e-9 if len(rows) else np.zeros(1)
    told, path = run.ticks.velocity_command[rows], run.path
    for at_s, command in zip(time_s, told, strict=False):
        near = np.array([sequence.at(max(0.0, t)) for t in np.linspace(at_s - SLACK_S, at_s + SLACK_S, 11)])
        if not ((command >= near.min(axis=0) - ROUNDING) & (command <= near.max(axis=0) + ROUNDING)).all():
            raise BadInputError(
                f"log {path} (sequence {run.header.command_sequence or 'unnamed'}) is of other commands than "
                f"{sequence.name}: after {at_s:.2f} s it was told {_words(command)}, predicted was "
                f"{_words(sequence.at(at_s))}; give a run of the predicted sequence"
            )
    if abs(time_s[-1] - sequence.duration_s) > SLACK_S:
        raise BadInputError(
            f"log {path} has {time_s[-1]:.1f} s under the policy (outcome: {run.outcome}); predicted were "
            f"{sequence.duration_s:g} s of {sequence.name}; give a whole run"
        )


def _words(command: np.ndarray) -> str:
    return ", ".join(f"{v:.2f}" for v in command) + " (m/s, m/s, rad/s)"


def _utc(stamp_ns: int) -> str:
    return datetime.fromtimestamp(stamp_ns * 1e-9, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
