"""What logs show directly: command delays, sensor noise, and what of them goes into the model before the search.

The noise of each observation feature is the paper's estimate from the upper half of the spectrum. White noise of
standard deviation σ has the same power at every frequency; motion has less and less. The paper multiplies the spectrum
by the frequency and averages the power over [f_s/4, f_s/2]; dividing by the same average of the factor makes the
estimate exact for white noise. Three choices keep a gait out of it: the spectrum is that of the whole state stream
(f_s = 333 Hz) where the paper has the 50 Hz ticks; of all short stretches only the tenth counts in which the set-points
moved least; and over those, the median power is taken, so that single impacts do not count.

Source: the paper, section on observation noise.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy.signal
import yaml
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict
from scipy.ndimage import find_objects, label

from spot_log.read.run import Run
from spot_log.tools.measures import NEVER_NS, receipts_ns
from spot_model.effects.commands import CommandDelay
from spot_model.effects.friction import Armature
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.io.whole import write_new
from spot_model.plant.delay import EmpiricalDelay
from spot_model.policy.observation import N_OBSERVATION, OBSERVATION, ObservationField, observations_at_rest, observed
from spot_model.robot import facts
from spot_model.robot.facts import Array
from trainer.signals.recording import Recording
from trainer.sysid.config import SearchSpace
from trainer.sysid.torque_fit import TorqueFit

STATE_RATE_HZ: Final = 1e9 / facts.STATE_PERIOD_NS
SEGMENT: Final = 64
"""Samples of a stretch, 0.19 s of the state stream."""
QUIET_SHARE: Final = 0.1
"""Share of the stretches that count, those with the least movement of set-points."""
MIN_QUIET: Final = 50
"""At least so many stretches count, where there are as many."""


@dataclass(frozen=True)
class ObservationNoise:
    """White noise on the observation, and on the measured load beside it."""

    sigma: Array
    """Standard deviations, shape (48,), in the layout of the observation, canonical joint order; 0 for the command and
    the last action, which have no sensor.
    """
    load_nm: Array
    """Shape (12,); NaN where a log has no measured load."""

    def block(self, name: str) -> Array:
        """The part of ``sigma`` that belongs to a block of the observation's layout."""
        return np.asarray(observed(self.sigma, name))

    def trainer_data(self) -> dict[str, Any]:
        """The keys of a training config's ``task.noise``; one value for all joints, the root of the mean square."""

        def short(field: ObservationField) -> float | list[float]:
            sigma = self.block(field.name)
            if field.is_of_joints:
                return float(f"{np.sqrt(np.mean(sigma**2)):.4g}")
            return [float(f"{v:.4g}") for v in sigma]

        return {field.noise: short(field) for field in OBSERVATION if field.noise}

    def scenario_data(self) -> dict[str, Any]:
        """The keys of a fake robot's ``sensors``."""
        trainer = self.trainer_data()

        def mean(values: Sequence[float]) -> float:
            return float(f"{math.sqrt(sum(v * v for v in values) / len(values)):.4g}")

        load = {"load_nm": mean(self.load_nm.tolist())} if np.isfinite(self.load_nm).all() else {}
        return {
            "position_rad": trainer["joint_position_rad"],
            "velocity_rad_s": trainer["joint_velocity_rad_s"],
            **load,
            "body_velocity_m_s": mean(trainer["linear_vel_m_s"]),
            "body_angular_velocity_rad_s": mean(trainer["angular_vel_rad_s"]),
            "attitude_rad": mean(trainer["gravity"][:2]),
        }


def observation_noise(logs: Sequence[Recording]) -> ObservationNoise:
    """Estimate the noise of every observation feature from all logs together.

    Raises:
        BadInputError: No log has an unbroken stretch that is long enough.
    """
    powers, movements = [], []
    for log in logs:
        row, setpoint = log.command_row(), log.position_rad
        if len(log.commands):
            setpoint = np.where((row >= 0)[:, None], log.commands.position_rad[row], setpoint)
        for (piece,) in find_objects(label(log.present)[0]):
            if piece.stop - piece.start >= SEGMENT:
                powers.append(_stretch_power(_signals(log, piece), SEGMENT))
                movements.append(_stretch_power(setpoint[piece], SEGMENT).sum(axis=(1, 2)))
    if not powers:
        raise BadInputError(
            f"noise: no log has {SEGMENT} states in a row, {facts.STATE_PERIOD_NS * 1e-6:g} ms apart; give a whole log"
        )
    power, movement = np.concatenate(powers), np.concatenate(movements)
    n_quiet = min(len(power), max(MIN_QUIET, round(QUIET_SHARE * len(power))))
    quiet = np.argsort(movement, kind="stable")[:n_quiet]
    sigma = _sigma_of_power(power[quiet], STATE_RATE_HZ, SEGMENT)
    sigma[~np.logical_and.reduce([_is_measured(log) for log in logs])] = np.nan
    return ObservationNoise(sigma=sigma[:N_OBSERVATION], load_nm=sigma[N_OBSERVATION:])


def write_noise(noise: ObservationNoise, delays: MeasuredDelays, path: Path) -> None:
    """Write a training config's ``task.noise``, and a scenario's ``sensors`` and ``command_channel``.

    Negative delays mean that the clocks of the logs do not fit together; then no channel is written.

    Raises:
        OutputExistsError: The file exists.
    """
    data: dict[str, Any] = {"task": {"noise": noise.trainer_data()}, "sensors": noise.scenario_data()}
    if len(delays.transit_s) and float(np.min(delays.transit_s)) >= 0.0:
        data["command_channel"] = {"delay": delay_histogram(delays.transit_s).model_dump(mode="json")}
    write_new(path, yaml.safe_dump(data, sort_keys=False))


def _signals(log: Recording, piece: slice) -> Array:
    return np.concatenate([observations_at_rest(log, piece), np.nan_to_num(log.load_nm[piece])], axis=1)


def _is_measured(log: Recording) -> NDArray[np.bool_]:
    """Whether a log has values of each signal, shape (60,); only the load may be missing."""
    loads = np.isfinite(log.load_nm[log.present]).all(axis=0)
    return np.concatenate([np.ones(N_OBSERVATION, dtype=np.bool_), loads])


def _stretch_power(signal: Array, segment: int) -> Array:
    """Power of each stretch at each frequency, so that white noise has the mean σ². Shape (n_stretches, n_f, ...)."""
    if len(signal) < segment:
        raise ValueError(f"the signal has {len(signal)} samples; at least {segment} are needed")
    starts = range(0, len(signal) - segment + 1, segment // 2)
    window = scipy.signal.windows.blackmanharris(segment, sym=False)
    shape = (segment,) + (1,) * (signal.ndim - 1)
    stretches = np.stack([scipy.signal.detrend(signal[i : i + segment], axis=0) for i in starts])
    spectrum = np.fft.rfft(stretches * window.reshape(shape), axis=1)
    return np.asarray(np.abs(spectrum) ** 2 / np.sum(window**2))


def _sigma_of_power(power: Array, rate_hz: float, segment: int) -> Array:
    frequency = np.fft.rfftfreq(segment, 1.0 / rate_hz)
    # The last bin is real where the others are complex: its power is distributed otherwise.
    upper = (frequency >= rate_hz / 4.0) & (np.arange(len(frequency)) < segment // 2)
    # Over stretches, white noise's power is distributed exponentially, with its median ln 2 times its mean.
    typical = np.median(power[:, upper], axis=0) / math.log(2.0)
    weight = frequency[upper] ** 2
    return np.asarray(np.sqrt(np.tensordot(weight, typical, axes=(0, 0)) / weight.sum()))


BIN_S: Final = 0.00025
"""Width of the histogram's bins."""


@dataclass(frozen=True)
class MeasuredDelays:
    """Delays of all commands whose receipt a state message shows."""

    path_s: Array
    """From the acquisition of the state that a command answers to its receipt; both by the robot's clock."""
    transit_s: Array
    """From the hand-over to the stream to the receipt; the former by the estimated robot clock, with its error."""

    @property
    def path_median_s(self) -> float:
        """Median of :attr:`path_s`; NaN without any."""
        return float(np.median(self.path_s)) if len(self.path_s) else float("nan")

    @property
    def transit_median_s(self) -> float:
        """Median of :attr:`transit_s`; NaN without any."""
        return float(np.median(self.transit_s)) if len(self.transit_s) else float("nan")


def measure_delays(runs: Sequence[Run]) -> MeasuredDelays:
    """Collect the delays of runs; each command counts once, at the first state that shows its receipt."""
    path: list[Array] = [np.zeros(0)]
    transit: list[Array] = [np.zeros(0)]
    for run in runs:
        received = receipts_ns(run)
        for sent, out in ((run.commands.state_robot_stamp_ns, path), (run.commands.robot_stamp_ns, transit)):
            known = (received < NEVER_NS) & (sent > 0)
            out.append(np.asarray((received[known] - sent[known]) * 1e-9, np.float64))
    return MeasuredDelays(np.concatenate(path), np.concatenate(transit))


def delay_histogram(delays_s: Array) -> EmpiricalDelay:
    """Histogram of delays, shape (n,), at least one, none of them negative, as a fake robot's channel takes it."""
    low, high = int(np.min(delays_s) / BIN_S), int(np.max(delays_s) / BIN_S) + 1
    edges = np.arange(low, high + 1) * BIN_S
    counts, _ = np.histogram(delays_s, edges)
    return EmpiricalDelay(edges_s=tuple(round(float(e), 6) for e in edges), counts=tuple(float(c) for c in counts))


LEAST_INERTIA_KG_M2: Final = 0.002
"""A smaller inertia between motor and torque sensor is taken for none."""


class ResultPart(BaseModel):
    """A part of ``result.json``."""

    model_config = ConfigDict(extra="forbid", frozen=True, populate_by_name=True)


class MeasuredData(ResultPart):
    """A quantity that was measured from the logs and put into the model."""

    what: str
    """Name of the quantity."""
    value: float
    """The number."""
    unit: str
    """Its unit."""
    source: str
    """What it was measured from."""


def with_measured(
    space: SearchSpace, delays: MeasuredDelays, fit: TorqueFit | None, *, use_delay: bool, use_inertia: bool
) -> tuple[SearchSpace, tuple[MeasuredData, ...]]:
    """The same search on a model with the measured delay and inertia; parameters that are searched stay untouched."""
    model, changes = space.model, []
    searched = {(p.effect, p.parameter) for p in space.parameters}
    if use_delay and np.isfinite(delays.path_median_s) and ("command_delay", "delay_s") not in searched:
        model = _with_delay(model, delays.path_median_s)
        changes.append(
            MeasuredData(
                what="command delay",
                value=delays.path_median_s,
                unit="s",
                source=f"median of {len(delays.path_s)} command receipts",
            )
        )
    has_armature = any(isinstance(e, Armature) for e in model.effects)
    if use_inertia and fit is not None and not has_armature:
        for joints, value in (("hips", float(fit.nuisance[3])), ("knees", float(fit.nuisance[4]))):
            if value > LEAST_INERTIA_KG_M2:
                model = model.with_effects(Armature(joints=(joints,), inertia_kg_m2=value))
                changes.append(
                    MeasuredData(
                        what=f"reflected inertia of {joints}",
                        value=value,
                        unit="kg·m²",
                        source="load against acceleration",
                    )
                )
    return replace(space, model=model), tuple(changes)


def _with_delay(model: RobotModel, delay_s: float) -> RobotModel:
    if not any(isinstance(e, CommandDelay) for e in model.effects):
        return model.with_effects(CommandDelay(delay_s=delay_s))
    effects = tuple(CommandDelay(delay_s=delay_s) if isinstance(e, CommandDelay) else e for e in model.effects)
    return replace(model, effects=effects)
