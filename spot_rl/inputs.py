"""What a script reads: logs, policies, models."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from spot_log.read.reader import read_run as read_log
from spot_log.read.run import Run
from spot_log.tools.gaits import GaitSpan
from spot_log.tools.gaits import gaits as gaits_of
from spot_model.effects.base import Effect
from spot_model.errors import BadInputError
from spot_model.io import model_file
from spot_model.io.model_file import RobotModel
from spot_model.policy import built_in
from spot_model.policy import policy as policies
from spot_model.policy.policy import Policy
from spot_rl.checks import AnyPath, a_file, a_run, mapping, to_path, with_our_errors, wrong

POLICIES: Final = "a built-in name, the path of an ONNX file, or a policy of load_policy"
MODELS: Final = "a built-in name, the path of a model file, or a model of load_model"


@with_our_errors
def read_run(path: AnyPath) -> Run:
    """Read one log into NumPy arrays.

    A log that was cut short or damaged is read as far as it goes; ``run.damage`` says what is missing.

    Args:
        path: A ``*.mcap`` file, or the ``*.mcap.active`` of a crash.

    Returns:
        The run: ``header``, ``states``, ``commands``, ``ticks``, ``slow_states``, ``events``, ``outcome``, and
        ``run.to_pandas("state")`` for a data frame. Joints are in the order ``run.header.joint_names``.

    Raises:
        SpotRlError: The file is not there, or is no log.
    """
    return read_log(a_file(path, "log"))


@with_our_errors
def gaits(run: Run) -> list[GaitSpan]:
    """Measure the gait of every stretch of three seconds or more in which the velocity command was held or ramped.

    Returns:
        A span each, in order: ``start_s``, ``end_s``, ``command`` and ``gait`` (``name``, ``stride_hz``, ``duty``,
        ``flight_share``, …; ``gait.sentence()`` says it in words). Empty where the run has no contacts or no policy.

    Raises:
        SpotRlError: It is no run.
    """
    return gaits_of(a_run(run))


@with_our_errors
def load_policy(path: AnyPath) -> Policy:
    """Load a policy from its ONNX file, and check its contract.

    Args:
        path: A built-in policy's name (``walk``, ``fast``, ``baseline``, ``bound``, ``walk_rough``), or a file of
            ``spot-rl export``.

    Returns:
        The policy: ``policy.contract`` says rate, gains, command range and training; ``policy.act(observation)``
        gives the action for an observation of shape (48,) or (n, 48).

    Raises:
        SpotRlError: The file is not there, is no ONNX model, or its contract does not hold.
    """
    return policies.load_policy(policy_file(path))


def policy_file(policy: AnyPath | Policy) -> Path:
    """The file of a policy that was given as a path, a built-in name, or as :func:`load_policy` returned it."""
    if not isinstance(policy, Policy):
        return a_file(built_in.policy_file(to_path(policy, "policy", POLICIES)), "policy")
    if policy.path is None:
        raise BadInputError(f"policy {policy.contract.name} was not loaded from a file; give the path of its ONNX file")
    return a_file(policy.path, "policy")


def policy_of(policy: AnyPath | Policy) -> Policy:
    """A policy that was given as a path, or as :func:`load_policy` returned it."""
    return policy if isinstance(policy, Policy) else load_policy(policy)


@with_our_errors
def load_model(name_or_path: AnyPath, *, effects: Iterable[Mapping[str, Any] | Effect] = ()) -> RobotModel:
    """Load the model of a simulated Spot: the effects that act in it.

    Args:
        name_or_path: ``ideal``, ``paper_initial``, ``paper_identified``, or a model file (YAML).
        effects: More effects, each as the keys of a model file, such as
            ``{"effect": "coulomb_friction", "joints": ["knees"], "level_nm": 5.0}``, or as an object of an effect's
            class, such as your own.

    Returns:
        The model; ``model.effects`` are those that act in it.

    Raises:
        SpotRlError: There is no such model or effect, or a key or value is not allowed.
    """
    model = model_file.load_model(str(to_path(name_or_path, "model", MODELS)))
    if isinstance(effects, (str, Mapping)) or not isinstance(effects, Iterable):
        raise wrong("effects", effects, "a list of effects, each a mapping or an object")
    for effect in effects:
        if not isinstance(effect, Effect):
            keys = mapping(effect, "effects", 'mappings such as {"effect": "payload_mass", "mass_kg": 5.0}, or effects')
            model = model.with_effects(*model_file.model_from_data({"effects": [keys]}).effects)
        else:
            model = model.with_effects(effect)
    return model


def model_of(given: str | AnyPath | RobotModel) -> tuple[RobotModel, str]:
    """A model and its name, from a model, a built-in name or a file."""
    if isinstance(given, RobotModel):
        return given, "model"
    return load_model(given), os.fspath(given)
