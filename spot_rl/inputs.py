"""What a script gives, checked where it enters, and what it reads: logs, policies, models."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

from spot_log.read.reader import read_run as read_log
from spot_log.read.run import Run
from spot_model.effects.base import Effect
from spot_model.errors import BadInputError
from spot_model.io import model_file
from spot_model.io.model_file import RobotModel
from spot_model.policy import built_in
from spot_model.policy import policy as policies
from spot_model.policy.policy import Policy

AnyPath = str | os.PathLike[str]
T = TypeVar("T")


def to_path(value: AnyPath, name: str) -> Path:
    """The path that was given.

    Raises:
        BadInputError: It is neither text nor a path.
    """
    given: object = value
    if isinstance(given, (str, os.PathLike)) and str(given):
        return Path(given)
    raise BadInputError(f"{name} = {value!r} is no path; allowed: text or a pathlib.Path")


def existing(value: AnyPath, name: str) -> Path:
    """The path that was given, which must be there.

    Raises:
        BadInputError: It is no path, or there is nothing.
    """
    path = to_path(value, name)
    if not path.exists():
        raise BadInputError(f"{name} {path} does not exist (looked in {Path.cwd()}); give the path of a file or folder")
    return path


def existing_all(values: AnyPath | Iterable[AnyPath], name: str) -> list[Path]:
    """One path or several, which must be there.

    Raises:
        BadInputError: There is none, one is no path, or one is not there.
    """
    given = [values] if isinstance(values, (str, os.PathLike)) else list(values)
    if not given:
        raise BadInputError(f"{name} is empty; give at least one file or folder")
    return [existing(value, name) for value in given]


def whole(value: int, name: str, least: int = 0) -> int:
    """The whole number that was given, as a seed or a count.

    Raises:
        BadInputError: It is none, or below ``least``.
    """
    given: object = value
    if not isinstance(given, int) or isinstance(given, bool) or not least <= given < 2**63:
        raise BadInputError(f"{name} = {value!r}; allowed: a whole number, {least} or more")
    return given


def one_or_more(values: T | Iterable[T], name: str) -> list[T]:
    """One text or class, or several.

    Raises:
        BadInputError: It is something else.
    """
    if isinstance(values, (str, type)):
        return [values]
    if not isinstance(values, Iterable):
        raise BadInputError(f"{name} = {values!r:.60}; allowed: one, or a list of them")
    return list(values)


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
    return read_log(existing(path, "log"))


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
    return policies.load_policy(built_in.policy_file(to_path(path, "policy")))


def policy_file(policy: AnyPath | Policy) -> Path:
    """The file of a policy that was given as a path, a built-in name, or as :func:`load_policy` returned it."""
    if not isinstance(policy, Policy):
        return built_in.policy_file(to_path(policy, "policy"))
    if policy.path is None:
        raise BadInputError(f"policy {policy.contract.name} was not loaded from a file; give the path of its ONNX file")
    return existing(policy.path, "policy")


def load_model(name_or_path: AnyPath, *, effects: Sequence[Mapping[str, Any] | Effect] = ()) -> RobotModel:
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
    model = model_file.load_model(str(to_path(name_or_path, "model")))
    for effect in effects:
        made = [effect] if isinstance(effect, Effect) else model_file.model_from_data({"effects": [effect]}).effects
        model = model.with_effects(*made)
    return model


def model_of(given: str | AnyPath | RobotModel) -> tuple[RobotModel, str]:
    """A model and its name, from a model, a built-in name or a file."""
    if isinstance(given, RobotModel):
        return given, "model"
    return load_model(given), os.fspath(given)
