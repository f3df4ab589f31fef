"""A models file: a fitted robot and others that are as possible, for training and trials on what is not sure.

schema: spot-rl/models/1
models:
  - {schema: spot-rl/model/1, effects: [...]}   # the fitted one first
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final, Literal

import yaml
from pydantic import Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.model_file import BUILT_IN, RobotModel, load_model, model_from_data
from spot_model.io.settings import Settings, explain
from spot_model.io.whole import write_new
from spot_model.io.yaml_text import read_yaml

SCHEMA: Final = "spot-rl/models/1"


class ModelsFileData(Settings):
    """The file's keys."""

    schema_name: Literal["spot-rl/models/1"] = Field(default=SCHEMA, alias="schema")
    models: tuple[dict[str, Any], ...] = Field(min_length=1, max_length=1000)
    """Each as in a model file; the fitted robot first."""


def load_models(name_or_path: str) -> tuple[RobotModel, ...]:
    """The models of a models file, or the one of a model file or built-in name.

    Raises:
        BadInputError: There is no such model, or the file is not valid.
    """
    path = Path(name_or_path)
    data = read_yaml(path, "model file") if name_or_path not in BUILT_IN and path.is_file() else None
    if not isinstance(data, dict) or data.get("schema") != SCHEMA:
        return (load_model(name_or_path),)
    try:
        parsed = ModelsFileData.model_validate(data)
    except ValidationError as error:
        raise BadInputError(f"models file {path}:\n{explain(error, ModelsFileData)}") from error
    return tuple(model_from_data(m, source=f"models file {path}: models.{i}") for i, m in enumerate(parsed.models))


def save_models(models: Sequence[RobotModel], path: Path) -> None:
    """Write several models as YAML; refuses to overwrite. Raises OutputExistsError: the file exists."""
    data = {"schema": SCHEMA, "models": [model.to_data() for model in models]}
    # The same text as the safe dumper's in Python, ten times as fast.
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    write_new(path, yaml.dump(data, Dumper=dumper, sort_keys=False, allow_unicode=True))
