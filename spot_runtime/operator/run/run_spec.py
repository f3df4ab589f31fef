"""What the operator's service hands to the process that controls the robot, as JSON on its standard input."""

from __future__ import annotations

from pathlib import Path
from typing import IO

from pydantic import Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings, explain
from spot_model.policy.contract import PolicyError
from spot_model.policy.policy import Policy, load_policy
from spot_runtime.admission import admission
from spot_runtime.config import RunConfig


class RunSpec(Settings):
    """One arming of a robot."""

    robot: str
    config: RunConfig
    policy: Path
    policy_sha256: str
    labels: dict[str, str] = Field(default_factory=dict)
    lock_step: str = ""
    """Admin address of a fake robot in lock-step mode; empty: real time."""
    credentials: dict[str, str] = Field(default_factory=dict, repr=False)
    """Variables with the login, which the process has from here and not in the environment that it is started with."""


def read_spec(stream: IO[bytes]) -> RunSpec:
    """The spec of a run, up to its end. Raises BadInputError."""
    try:
        return RunSpec.model_validate_json(stream.read(1 << 20))
    except ValidationError as error:
        raise BadInputError(f"the run's specification:\n{explain(error)}") from error


def load_checked(path: Path, sha256: str, config: RunConfig) -> Policy:
    """Load a policy whose file is still what the operator's service saw, and which may run.

    Raises:
        PolicyError: It is not, may not, or does not hold what its contract promises.
    """
    allowed = admission(config.service, path)

    def admit(found_sha256: str) -> None:
        if found_sha256 != sha256:
            raise PolicyError(f"policy {path} was replaced just now: SHA-256 {found_sha256}, not {sha256}; ask again")
        allowed(found_sha256)

    return load_policy(path, provider=config.control.inference, admit=admit)
