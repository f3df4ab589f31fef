"""Effects for training: those of the model file, and extra ones with values drawn once a simulation."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch

from spot_model.effects.base import Effect
from spot_model.effects.registry import effect_class, make_effect
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel, load_model
from trainer.backends.random_draws import Draws
from trainer.config.task_config import RandomisationConfig


def training_effects(
    model: str | RobotModel, randomisation: RandomisationConfig, n: int, draws: Draws
) -> tuple[Effect, ...]:
    """All effects that act in training.

    Args:
        model: Built-in model name, model file, or a model.
        randomisation: Its ``effects`` are added (a parameter may be ``[low, high]``), ``replaced_effects`` left out.
        n: Number of simulations; a drawn parameter has shape (n, 1).
        draws: Where the draws come from.

    Raises:
        BadInputError: An effect, key or value is not allowed.
    """
    own = (model if isinstance(model, RobotModel) else load_model(model)).effects
    for name in randomisation.replaced_effects:
        if name not in {effect.name for effect in own}:
            raise BadInputError(
                f"randomisation.replaced_effects: the model has no effect {name!r}; "
                f"allowed: {', '.join(sorted({effect.name for effect in own})) or 'none'}"
            )
    kept = tuple(effect for effect in own if effect.name not in randomisation.replaced_effects)
    return kept + tuple(_randomised(i, dict(entry), n, draws) for i, entry in enumerate(randomisation.effects))


def _randomised(index: int, entry: dict[str, Any], n: int, draws: Draws) -> Effect:
    where = f"randomisation.effects.{index}"
    name = entry.pop("effect", None)
    if not isinstance(name, str):
        raise BadInputError(f"{where} has no key 'effect'; name the effect there")
    parameters = {p.name for p in effect_class(name).parameters()}
    ranges = {key: v for key, v in entry.items() if key in parameters and isinstance(v, (list, tuple))}
    fixed = {key: v for key, v in entry.items() if key not in ranges}
    values: dict[str, Any] = {}
    for key, bounds in ranges.items():
        if len(bounds) != 2 or not all(isinstance(b, (int, float)) for b in bounds) or bounds[0] > bounds[1]:
            raise BadInputError(f"{where}: {key} = {bounds}; allowed: a number, or [low, high]")
        drawn = draws.uniform((float(bounds[0]), float(bounds[1])), n, 1)
        values[key] = drawn.to(device="cpu", dtype=torch.float64).numpy()
    try:
        # Replacing builds the effect once, so related parameters are checked together.
        cls = effect_class(name)
        base = make_effect(name, {"joints": fixed["joints"]} if "joints" in fixed else {})
        numbers = make_effect(name, fixed).values if not ranges else {k: v for k, v in fixed.items() if k != "joints"}
        unknown = sorted(set(numbers) - {p.name for p in cls.parameters()})
        if unknown:
            raise BadInputError(f"unknown key {unknown[0]!r}; allowed: joints, {', '.join(sorted(parameters))}")
        return dataclasses.replace(base, **numbers, **values)
    except BadInputError as error:
        raise BadInputError(f"{where}: {error}") from error
