"""What a diagnosis was made of, kept beside it, so that it can be made again with more logs."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from pydantic import Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings
from spot_model.io.validation import explain
from spot_model.io.whole import write_over

NAME: Final = "inputs.json"


class Inputs(Settings):
    """The words of a ``spot-rl diagnose``; paths are absolute."""

    schema_name: Literal["spot-rl/diagnosis-inputs/1"] = Field(default="spot-rl/diagnosis-inputs/1", alias="schema")
    logs: tuple[str, ...]
    nominal: str
    policy: str | None = None
    add_effect: tuple[str, ...] = ()
    without: tuple[str, ...] = ()


def save_inputs(inputs: Inputs, folder: Path) -> None:
    """Write them into a diagnosis' folder."""
    write_over(folder / NAME, inputs.model_dump_json(by_alias=True, indent=1) + "\n")


def load_inputs(folder: Path) -> Inputs:
    """Read them.

    Raises:
        BadInputError: The folder holds none, or they are not valid.
    """
    path = folder / NAME
    try:
        return Inputs.model_validate_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(
            f"{path} cannot be read: {error.strerror}; diagnose the logs into this folder first"
        ) from error
    except ValidationError as error:
        raise BadInputError(f"{path}:\n{explain(error)}") from error


def absolute(name: str) -> str:
    """A file's absolute path; what is no file (a built-in name) stays as it is."""
    return str(Path(name).absolute()) if Path(name).exists() else name
