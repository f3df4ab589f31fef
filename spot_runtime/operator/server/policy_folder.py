"""The policies that an operator may name: files of one folder, within the allowed digests."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import grpc

from spot_model.io.yaml_text import FileTooLargeError, read_at_most
from spot_model.policy.built_in import FOLDER
from spot_model.policy.contract import MAX_POLICY_BYTES, PolicyError, sha256_hex
from spot_runtime.admission import admission
from spot_runtime.config import ServiceConfig
from spot_runtime.operator.door.access import Refusal, bad_request, not_now

NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}")
SUFFIX: Final = ".onnx"
MAX_LISTED: Final = 200
OWN: Final = Path("policies")
"""In the working folder: whoever keeps policies there means those, whatever the built-in ones are called."""


@dataclass(frozen=True)
class OfferedPolicy:
    """One file that is there."""

    name: str
    path: Path
    sha256: str
    size_bytes: int
    refusal: str = ""
    """Why it may not run; empty: it may."""

    @property
    def is_allowed(self) -> bool:
        """Whether digest and signature are as the configuration requires."""
        return not self.refusal


class PolicyFolder:
    """Looks policies up by name. A name is not a path, so nothing outside the folder can be reached."""

    def __init__(self, config: ServiceConfig) -> None:
        """The folder that a configuration names, else ``policies`` here if there is one, else the built-in ones."""
        self.folder = config.policies or (OWN if OWN.is_dir() else FOLDER)
        self._config = config

    def list(self) -> list[OfferedPolicy]:
        """All that can be named, at most :data:`MAX_LISTED`."""
        paths = sorted(self.folder.glob(f"*{SUFFIX}")) if self.folder.is_dir() else []
        found = [self._read(path) for path in paths[:MAX_LISTED] if NAME.fullmatch(path.stem)]
        return [policy for policy in found if policy is not None]

    def find(self, name: str, sha256: str) -> OfferedPolicy:
        """The policy that may be armed under this name, its file's without the ending.

        The digest is the one that the operator expects; empty: any.

        Raises:
            Refusal: There is none, or it is not the expected one, or not an allowed one.
        """
        if not NAME.fullmatch(name):
            raise bad_request(
                f"policy name {name[:80]!r} is not valid; allowed: letters, digits, '.', '_' and '-', at most 64, and "
                "no path; see 'spot-rl ctl policies'"
            )
        policy = self._read(self.folder / f"{name}{SUFFIX}")
        if policy is None:
            there = ", ".join(p.name for p in self.list()) or "none"
            raise not_now(f"there is no policy {name!r} in {self.folder}; there are: {there}")
        if sha256 and sha256.lower() != policy.sha256:
            raise not_now(f"policy {name!r} has SHA-256 {policy.sha256}, not {sha256[:64]}; copy the right file there")
        if not policy.is_allowed:
            raise Refusal(grpc.StatusCode.PERMISSION_DENIED, policy.refusal)
        return policy

    def _read(self, path: Path) -> OfferedPolicy | None:
        try:
            if path.is_symlink() or not path.is_file():
                return None
            data = read_at_most(path, MAX_POLICY_BYTES)
        except (OSError, FileTooLargeError):
            return None
        digest, refusal = sha256_hex(data), ""
        try:
            admission(self._config, path)(digest)
        except PolicyError as error:
            refusal = str(error)
        return OfferedPolicy(path.stem, path, digest, len(data), refusal)
