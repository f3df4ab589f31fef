"""Put what logs show directly into the nominal model before the search: command delay and inertia."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from spot_model.effects.command.command_delay import CommandDelay
from spot_model.effects.drive.armature import Armature
from spot_model.io.model_file import RobotModel
from trainer.sysid.logs.delays import MeasuredDelays
from trainer.sysid.search.space import SearchSpace
from trainer.sysid.torque.fit import TorqueFit

LEAST_INERTIA_KG_M2: Final = 0.002
"""A smaller inertia between motor and torque sensor is taken for none."""


@dataclass(frozen=True)
class DirectChange:
    """One number that was measured and put into the model."""

    what: str
    value: float
    unit: str
    source: str


def with_measured(
    space: SearchSpace, delays: MeasuredDelays, fit: TorqueFit | None, *, use_delay: bool, use_inertia: bool
) -> tuple[SearchSpace, tuple[DirectChange, ...]]:
    """The same search on a model with the measured delay and inertia; parameters that are searched stay untouched."""
    model, changes = space.model, []
    searched = {(p.effect, p.parameter) for p in space.parameters}
    if use_delay and np.isfinite(delays.path_median_s) and ("command_delay", "delay_s") not in searched:
        model = _with_delay(model, delays.path_median_s)
        changes.append(
            DirectChange("command delay", delays.path_median_s, "s", f"median of {len(delays.path_s)} command receipts")
        )
    has_armature = any(isinstance(e, Armature) for e in model.effects)
    if use_inertia and fit is not None and not has_armature:
        for joints, value in (("hips", float(fit.nuisance[3])), ("knees", float(fit.nuisance[4]))):
            if value > LEAST_INERTIA_KG_M2:
                model = model.with_effects(Armature(joints=(joints,), inertia_kg_m2=value))
                changes.append(
                    DirectChange(f"reflected inertia of {joints}", value, "kg·m²", "load against acceleration")
                )
    return replace(space, model=model), tuple(changes)


def _with_delay(model: RobotModel, delay_s: float) -> RobotModel:
    if not any(isinstance(e, CommandDelay) for e in model.effects):
        return model.with_effects(CommandDelay(delay_s=delay_s))
    effects = tuple(CommandDelay(delay_s=delay_s) if isinstance(e, CommandDelay) else e for e in model.effects)
    return replace(model, effects=effects)
