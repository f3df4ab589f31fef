"""A run's folder: the frozen protocol that all its cases have in common, and the seed until it is published."""

from __future__ import annotations

import hashlib
import platform
import secrets
from importlib.metadata import version
from pathlib import Path
from typing import Final, Literal

from pydantic import Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings
from spot_model.io.validation import explain
from withheld.blind.jail import Level

SCHEMA: Final = "spot-rl/withheld-run/3"
RUN: Final = "run.json"
SEED_FILE: Final = "seed.json"
SOURCES: Final = ("*.py", "*.json")
ROOT: Final = Path(__file__).resolve().parent.parent.parent
DIAGNOSES: Final = ("diagnosis", "spot_model", "trainer/sysid")
GENERATES: Final = ("withheld/plan.py", "withheld/cases", "withheld/realities", "withheld/simulator")
NUMBERS: Final = ("mujoco", "numpy", "onnxruntime", "scikit-learn", "scipy")


class RunHead(Settings):
    """``run.json``: fixed before the first case."""

    schema_name: Literal["spot-rl/withheld-run/3"] = Field(default=SCHEMA, alias="schema")
    protocol: str
    """Digest of diagnosis, calibration and library bounds."""
    generator: str
    """Digest of what draws and makes the cases."""
    seed_digest: str
    """SHA-256 of the seed and a nonce: the seed was there before the first verdict."""
    policies: dict[str, str]
    """Digest of each policy's file."""
    reality: str
    locked_in: Level
    """Where the run was begun; each case says how it was itself."""
    cases: int
    is_quick: bool = False
    part: tuple[int, int]
    """First case and end of the part that this folder is to hold."""
    versions: dict[str, str] = Field(default_factory=dict)
    """Of Python and the libraries that decide numbers: with others the last digits, and a close case, may differ."""

    def write(self, out: Path) -> None:
        """As ``run.json`` of a folder."""
        (out / RUN).write_text(self.model_dump_json(by_alias=True, indent=1) + "\n", encoding="utf-8")


class Secret(Settings):
    """``seed.json``: readable by the generator's user alone; cases can be made again from it."""

    seed: int
    nonce: str

    @property
    def digest(self) -> str:
        """What ``run.json`` says of it."""
        return hashlib.sha256(f"{self.nonce}\n{self.seed}".encode()).hexdigest()

    @staticmethod
    def of(seed: int | None) -> Secret:
        """A given seed, or one of the operating system."""
        return Secret(seed=secrets.randbits(62) if seed is None else seed, nonce=secrets.token_hex(32))


def start(out: Path, head: RunHead, secret: Secret) -> None:
    """Make the folder.

    Raises:
        BadInputError: It holds a run.
    """
    if (out / RUN).exists():
        raise BadInputError(f"folder {out} holds a run; give --resume to go on, or another --out folder")
    out.mkdir(parents=True, exist_ok=True)
    out.chmod(0o700)
    (out / "cases").mkdir(exist_ok=True)
    file = out / SEED_FILE
    file.touch(mode=0o600)
    file.write_text(secret.model_dump_json(), encoding="utf-8")
    head.write(out)


def begin(
    out: Path,
    seed: int | None,
    policies: Path,
    *,
    reality: str,
    level: Level,
    cases: int,
    part: tuple[int, int],
    is_quick: bool,
) -> tuple[RunHead, Secret]:
    """Begin a run: everything that decides a verdict is fixed from here on.

    Raises:
        BadInputError: The folder holds a run, or the part lies outside of it.
    """
    _check_part(part, cases)
    secret = Secret.of(seed)
    head = RunHead(
        protocol=protocol_digest(),
        generator=generator_digest(),
        seed_digest=secret.digest,
        policies=policy_digests(policies),
        reality=reality,
        locked_in=level,
        cases=cases,
        part=part,
        is_quick=is_quick,
        versions=versions(),
    )
    start(out, head, secret)
    return head, secret


def go_on(out: Path, policies: Path, part: tuple[int, int] | None) -> tuple[RunHead, Secret]:
    """Go on with the part of a run that its folder was begun with, or from now on with another one.

    Raises:
        BadInputError: There is none, or sources or policies are no longer what they were.
    """
    head = load_head(out)
    now = (protocol_digest(), generator_digest(), policy_digests(policies))
    if now != (head.protocol, head.generator, head.policies):
        raise BadInputError(
            f"{out / RUN} was begun with other sources or policies; a scored run has one protocol: start anew"
        )
    secret = load_secret(out, head)
    if part is not None and part != head.part:
        _check_part(part, head.cases)
        head = head.model_copy(update={"part": part})
        head.write(out)
    return head, secret


def _check_part(part: tuple[int, int], cases: int) -> None:
    if part[1] > cases:
        raise BadInputError(f"part {part[0]}:{part[1]} ends beyond the run's {cases} cases")


def load_head(out: Path) -> RunHead:
    """Read ``run.json``.

    Raises:
        BadInputError: There is none, or it is damaged.
    """
    try:
        return RunHead.model_validate_json((out / RUN).read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(f"folder {out} holds no run ({RUN}); start one with `spot-rl withheld run`") from error
    except ValidationError as error:
        raise BadInputError(f"{out / RUN}:\n{explain(error)}") from error


def load_secret(out: Path, head: RunHead) -> Secret:
    """Read the seed.

    Raises:
        BadInputError: It is not the one that the run began with.
    """
    try:
        secret = Secret.model_validate_json((out / SEED_FILE).read_text(encoding="utf-8"))
    except (OSError, ValidationError) as error:
        raise BadInputError(
            f"{out / SEED_FILE} cannot be read: {error}; without it no case can be made again"
        ) from error
    if secret.digest != head.seed_digest:
        raise BadInputError(f"{out / SEED_FILE}: its seed is not the one whose digest stands in {RUN}")
    return secret


def versions() -> dict[str, str]:
    """Of what computes."""
    return {"python": platform.python_version(), "machine": platform.machine(), **{n: version(n) for n in NUMBERS}}


def policy_digests(folder: Path) -> dict[str, str]:
    """SHA-256 of each policy."""
    return {p.stem: hashlib.sha256(p.read_bytes()).hexdigest() for p in sorted(folder.glob("*.onnx"))}


def protocol_digest() -> str:
    """SHA-256 over the sources of the diagnosis, its constants and the effects that it knows; hexadecimal."""
    return _digest(DIAGNOSES)


def generator_digest() -> str:
    """SHA-256 over the sources that draw and make the cases; hexadecimal."""
    return _digest(GENERATES)


def _digest(parts: tuple[str, ...]) -> str:
    h = hashlib.sha256()
    for part in parts:
        path = ROOT / part
        h.update(_folder(path) if path.is_dir() else path.read_bytes())
    return h.hexdigest()


def _folder(folder: Path) -> bytes:
    h = hashlib.sha256()
    files = sorted({p for pattern in SOURCES for p in folder.rglob(pattern)}, key=lambda p: p.relative_to(folder).parts)
    for path in files:
        h.update(f"{path.relative_to(folder).as_posix()}\n{path.stat().st_size}\n".encode())
        h.update(path.read_bytes())
    return h.digest()
