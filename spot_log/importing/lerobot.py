"""Rows from an episode of a LeRobot data set, v2 and v3: a column a feature, and one for each of its named entries.

``observation.state`` is an array with a column a motor, ``observation.state.NAME`` one motor by the data set's own
name. Pictures are left out. Files are found by their content and not by the paths of ``info.json``, so that both
layouts, of a file an episode and of many episodes a file, are read alike.
Source: LeRobotDataset v2.1 and v3.0, as described beside ``huggingface/lerobot``.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError

from spot_log.importing.reading import reading
from spot_model.errors import BadInputError
from spot_model.io.settings import explain
from spot_model.io.yaml_text import read_at_most

MAX_INFO_BYTES: Final = 1 << 24
PACKAGE: Final = "'spot-rl[report]'"
NOT_NUMBERS: Final = ("video", "image", "string")


class Feature(BaseModel):
    """One feature; its names are null, a list, a list of lists, or lists by a word."""

    dtype: str
    names: Any = None


class Info(BaseModel):
    """What ``meta/info.json`` says, as far as it is needed."""

    codebase_version: str = Field(pattern=r"^v[23]\.\d+")
    total_episodes: int = Field(ge=1)
    features: dict[str, Feature]


def is_lerobot(path: Path) -> bool:
    """Whether it is the folder of a LeRobot data set."""
    return (path / "meta" / "info.json").is_file()


def read_info(path: Path) -> Info:
    """Raises BadInputError, OSError where a data set says nothing, or is of another version."""
    file = path / "meta" / "info.json"
    with reading(path, "a LeRobot data set", PACKAGE):
        try:
            return Info.model_validate_json(read_at_most(file, MAX_INFO_BYTES))
        except ValidationError as error:
            raise BadInputError(
                f"{file}: versions 2 and 3 can be read, and this is not so:\n{explain(error, Info)}"
            ) from error


def read_episode(path: Path, episode: int | None) -> dict[str, NDArray[Any]]:
    """All numbers of an episode, by name; of the only one, if None is given.

    Raises:
        BadInputError: There is no such episode, or several where none is given; the data are damaged.
        OSError: They cannot be read.
    """
    info = read_info(path)
    if episode is None and info.total_episodes > 1:
        told = f"{path} holds {info.total_episodes} episodes, 0 to {info.total_episodes - 1}"
        raise BadInputError(f"{told}; give --episode NUMBER, or --episode all for a log of each")
    with reading(path, "a LeRobot data set", PACKAGE):
        from pyarrow import parquet

        chosen = [("episode_index", "=", episode or 0)]
        columns = [name for name, feature in info.features.items() if feature.dtype not in NOT_NUMBERS]
        table = parquet.read_table(path / "data", columns=columns, filters=chosen).sort_by("frame_index")
        arrays = {name: np.asarray(table.column(name).to_pylist()) for name in table.column_names}
    if not table.num_rows:
        told = f"{path} has no data of episode {episode or 0}"
        raise BadInputError(f"{told}; by meta/info.json it holds 0 to {info.total_episodes - 1}")
    for name in list(arrays):
        entries = list(entry_names(info.features[name].names))
        if arrays[name].ndim == 2 and len(entries) == arrays[name].shape[1]:
            arrays |= {f"{name}.{entry}": arrays[name][:, i] for i, entry in enumerate(entries)}
    return arrays


def chosen_episodes(path: Path, word: str) -> list[int]:
    """What ``--episode`` stands for: one number, or all. Raises BadInputError, OSError."""
    if not is_lerobot(path):
        raise BadInputError(
            f"--episode {word}: {path} is no LeRobot data set, whose folder has meta/info.json; leave it out"
        )
    total = read_info(path).total_episodes
    if word != "all" and not (word.isdecimal() and int(word) < total):
        raise BadInputError(f"--episode {word!r}: {path} holds 0 to {total - 1}; allowed: one of these, or all")
    return list(range(total)) if word == "all" else [int(word)]


def entry_names(names: Any) -> Iterator[str]:
    """The names of a feature's entries, however they are nested."""
    if isinstance(names, str):
        yield names
    for part in names.values() if isinstance(names, dict) else names if isinstance(names, list) else ():
        yield from entry_names(part)
