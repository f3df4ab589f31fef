"""What the identification looks for beside the diagnosis: limits that show only where a robot reaches them.

The diagnosis compares the torque that was asked for with the load; a limit that the nominal model puts too low leaves
nothing there to see but in the few samples beyond it. The paper's search fits it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from spot_model.effects.base import Effect
from spot_model.effects.torque_limits import TorqueSpeedCurve
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from trainer.sysid.config import default_config
from trainer.sysid.result import ResultData

QUANTILE: Final = 1.645
"""Half of a 90 % interval of a normal variable, in standard deviations."""
CONTACT_S: Final = 0.02
"""Contact time constant of the simulator, to which a corrected model's ground is relative."""
GENERATIONS: Final = 8


@dataclass(frozen=True)
class Limit:
    """One number of the knees' torque–speed curve as the logs have it."""

    parameter: str
    unit: str
    nominal: float
    value: float
    low: float
    high: float
    """Upper end of its 90 % interval."""
    is_known: bool
    """Whether the logs determine it."""
    is_reached: bool
    """Whether a measured torque depends on it."""

    @property
    def differs(self) -> bool:
        """Whether the logs say that the nominal value is wrong."""
        return self.is_known and not self.low <= self.nominal <= self.high


def curve_of(model: RobotModel) -> TorqueSpeedCurve | None:
    """The model's one torque–speed curve; None where it has none, or several."""
    found = [e for e in model.effects if isinstance(e, TorqueSpeedCurve)]
    return found[0] if len(found) == 1 else None


def search_config(corrected: RobotModel, file: str, device: str, seed: int) -> dict[str, Any] | None:
    """The identification of the corrected model's torque–speed curve; None where it has none to search.

    Args:
        corrected: The model.
        file: Its file.
        device: What simulates.
        seed: Of the search.
    """
    curve = curve_of(corrected)
    if curve is None:
        return None
    usual = default_config(device)
    entries = []
    for p in usual.parameters:
        if p.effect != TorqueSpeedCurve.name:
            continue
        own = float(getattr(curve, p.parameter))
        entries.append(p.model_copy(update={"joints": curve.joints, "initial": float(np.clip(own, p.low, p.high))}))
    on_cores = {} if device != "cpu" else {"generations": GENERATIONS}
    config = usual.model_copy(
        update={
            "model": file,
            "parameters": tuple(entries),
            "search": usual.search.model_copy(update={"seed": seed, **on_cores}),
            "simulation": usual.simulation.model_copy(
                update={"contact_time_constant_s": CONTACT_S, "measured_delay": False, "measured_inertia": False}
            ),
        }
    )
    data: dict[str, Any] = config.model_dump(mode="json", by_alias=True)
    return data


def is_nearer(found: ResultData) -> bool:
    """Whether simulated runs are nearer to the robot's with the limits that were found than with the corrected model's.

    Otherwise something else in the torques was taken for a limit: a slow torque loop bends what they seem to say.
    """
    before, after = found.score["initial"], found.score["identified"]
    return after is not None and (before is None or after < before)


def limits_of(found: ResultData, nominal: RobotModel) -> tuple[Limit, ...]:
    """What an identification says, beside the nominal model's numbers."""
    curve = curve_of(nominal)
    out = []
    for p in found.parameters:
        parameter = p.name.rpartition(".")[2]
        before = float(getattr(curve, parameter)) if curve is not None else float("nan")
        out.append(Limit(parameter, p.unit, before, p.value, p.low, p.high, p.identified, p.by_torque is not None))
    return tuple(out)


def with_limits(
    robots: Sequence[RobotModel], limits: Sequence[Limit], rng: np.random.Generator
) -> tuple[RobotModel, ...]:
    """The fitted robot with the limits that were found, and the others with limits drawn within what is known of them.

    A limit that the logs determine is drawn from its interval. One that no torque reached lies between the nominal one
    and what the search found; all these of a robot alike, as the curve is one. Others are as they were found.
    """
    fitted, *others = robots
    out = [_with(fitted, {limit.parameter: limit.value for limit in limits})]
    for robot in others:
        share = float(rng.uniform())
        drawn = {}
        for limit in limits:
            value = limit.value
            if limit.is_known:
                value = float(rng.normal(value, (limit.high - limit.low) / (2.0 * QUANTILE)))
            elif not limit.is_reached and np.isfinite(limit.nominal):
                value = limit.nominal + share * (value - limit.nominal)
            drawn[limit.parameter] = value
        out.append(_with(robot, drawn))
    return tuple(out)


def _with(robot: RobotModel, values: Mapping[str, float]) -> RobotModel:
    def changed(effect: Effect) -> Effect:
        if not isinstance(effect, TorqueSpeedCurve):
            return effect
        own = {**effect.values, **values}
        for side, sign in (("max", 1.0), ("min", -1.0)):
            # No corner lies beyond the speed at which the torque is gone.
            corner, end = f"intersect_{side}_rad_s", f"speed_{side}_rad_s"
            own[corner] = sign * min(max(0.0, sign * own[corner]), sign * own[end])
        try:
            return replace(effect, **own)
        except BadInputError:
            return effect

    return replace(robot, effects=tuple(map(changed, robot.effects)))
