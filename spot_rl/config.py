"""The config of a training or an environment, from what a script gives."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from spot_model.errors import BadInputError
from spot_model.policy import built_in
from spot_rl.checks import AnyPath, a_file, mapping, to_path
from trainer.config.train_config import TrainConfig, load_train_config, train_config_from_data


def training_config(config: AnyPath | Mapping[str, Any], changes: Mapping[str, Any] | None) -> TrainConfig:
    """A training config from a file or plain data, with changes."""
    changed = {} if changes is None else mapping(changes, "changes", "a mapping of keys of the config")
    try:
        overrides = tuple(f"{key}={json.dumps(value)}" for key, value in changed.items())
    except TypeError as error:
        raise BadInputError(f"changes: {error}; allowed: numbers, text, lists and mappings") from error
    if isinstance(config, Mapping):
        return train_config_from_data(
            mapping(config, "config", "a mapping of keys"), source="config", overrides=overrides
        )
    return load_train_config(a_file(built_in.config_file(to_path(config, "config")), "config"), overrides)
