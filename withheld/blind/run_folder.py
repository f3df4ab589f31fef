"""A run's folder: the frozen protocol that all its cases have in common, and the seed until it is published."""

from __future__ import annotations

import hashlib
import platform
import secrets
import tarfile
from importlib.metadata import version
from pathlib import Path
from typing import Final, Literal

from pydantic import Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings, explain
from spot_model.io.whole import check_new, whole_file
from withheld.blind.jail import HOME_OF_OURS, Level
from withheld.blind.seal import LEDGER, file_digest

RUN: Final = "run.json"
SEED_FILE: Final = "seed.json"
DIAGNOSES: Final = ("diagnosis", "spot_model", "trainer/sysid")
"""Sources that decide a verdict."""
GENERATES: Final = ("withheld/plan.py", "withheld/cases.py", "withheld/realities", "withheld/simulator")
"""Sources that draw and make the cases."""
NUMBERS: Final = ("mujoco-core", "numpy", "onnxruntime", "scikit-learn", "scipy")
"""Libraries that decide numbers."""
PACKED_OF_A_RUN: Final = (RUN, SEED_FILE, LEDGER, "scores.json")
PACKED_OF_A_CASE: Final = ("outcome.json", "verdict.json", LEDGER, "corrected_model.yaml")


class RunHead(Settings):
    """``run.json``: fixed before the first case."""

    schema_name: Literal["spot-rl/withheld-run/3"] = Field(default="spot-rl/withheld-run/3", alias="schema")
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
        """Write ``run.json`` of a folder.

        Raises:
            BadInputError: The part lies outside of the run.
        """
        if self.part[1] > self.cases:
            raise BadInputError(f"part {self.part[0]}:{self.part[1]} ends beyond the run's {self.cases} cases")
        (out / RUN).write_text(self.model_dump_json(by_alias=True, indent=1) + "\n", encoding="utf-8")


class Secret(Settings):
    """``seed.json``: readable by the generator's user alone; cases can be made again from it."""

    seed: int
    nonce: str = Field(default_factory=lambda: secrets.token_hex(32))

    @property
    def digest(self) -> str:
        """What ``run.json`` says of it."""
        return hashlib.sha256(f"{self.nonce}\n{self.seed}".encode()).hexdigest()


def begin(
    out: Path,
    secret: Secret,
    policies: Path,
    *,
    reality: str,
    level: Level,
    cases: int,
    part: tuple[int, int],
    is_quick: bool,
) -> RunHead:
    """Begin a run: everything that decides a verdict is fixed from here on.

    Raises:
        BadInputError: The folder holds a run, or the part lies outside of it.
    """
    protocol, generator = source_digests()
    digests = policy_digests(policies)
    if not digests:
        raise BadInputError(f"folder {policies} has no policy (*.onnx); name another with --policies, or leave it out")
    head = RunHead(
        protocol=protocol,
        generator=generator,
        seed_digest=secret.digest,
        policies=digests,
        reality=reality,
        locked_in=level,
        cases=cases,
        part=part,
        is_quick=is_quick,
        versions={
            "python": platform.python_version(),
            "machine": platform.machine(),
            **{name: version(name) for name in NUMBERS},
        },
    )
    make_folder(out, head, secret)
    return head


def make_folder(out: Path, head: RunHead, secret: Secret) -> None:
    """Make the folder of a run without cases.

    Raises:
        BadInputError: It holds a run, or the part lies outside of it.
    """
    if (out / RUN).exists():
        raise BadInputError(f"folder {out} holds a run; give --resume to go on, or another --out folder")
    (out / "cases").mkdir(parents=True, exist_ok=True)
    out.chmod(0o700)
    (out / SEED_FILE).touch(mode=0o600)
    (out / SEED_FILE).write_text(secret.model_dump_json(), encoding="utf-8")
    head.write(out)


def go_on(out: Path, policies: Path, part: tuple[int, int] | None) -> tuple[RunHead, Secret]:
    """Go on with the part of a run that its folder was begun with, or from now on with another one.

    Raises:
        BadInputError: There is none, or sources or policies are no longer what they were.
    """
    head = load_head(out)
    if (*source_digests(), policy_digests(policies)) != (head.protocol, head.generator, head.policies):
        raise BadInputError(
            f"{out / RUN} was begun with other sources or policies; a scored run has one protocol: start anew"
        )
    secret = load_secret(out, head)
    if part is not None:
        head = head.model_copy(update={"part": part})
        head.write(out)
    return head, secret


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


def pack(out: Path, file: Path, most_mib: float) -> int:
    """Write a ``.tar.gz`` with all of a run but its reports, which can be scored and resumed when it is unpacked.

    Args:
        out: The run's folder.
        file: To write.
        most_mib: Largest size, MiB.

    Returns:
        Number of cases.

    Raises:
        OutputExistsError: The file exists.
        BadInputError: It would be larger; nothing is written.
    """
    check_new(file)
    folders = sorted(p.parent for p in (out / "cases").glob("*/outcome.json"))
    with whole_file(file) as part:
        with tarfile.open(part, "w:gz", compresslevel=9) as archive:
            for folder, names in ((out, PACKED_OF_A_RUN), *((folder, PACKED_OF_A_CASE) for folder in folders)):
                for path in (folder / name for name in names if (folder / name).exists()):
                    archive.add(path, str(path.relative_to(out)))
        size = part.stat().st_size / 2**20
        if size > most_mib:
            raise BadInputError(f"{file} would have {size:.1f} MiB; allowed: {most_mib:g} (--most-mib)")
    return len(folders)


def policy_digests(folder: Path) -> dict[str, str]:
    """Return the SHA-256 of each policy."""
    return {path.stem: file_digest(path) for path in sorted(folder.glob("*.onnx"))}


def source_digests() -> tuple[str, str]:
    """Return the SHA-256 of the sources that decide a verdict, and of those that draw and make the cases."""
    return _digest(DIAGNOSES), _digest(GENERATES)


def _digest(places: tuple[str, ...]) -> str:
    """Over names and bytes of all sources and constants of some folders and files."""
    h = hashlib.sha256()
    for place in (HOME_OF_OURS / place for place in places):
        files = [p for p in place.rglob("*") if p.suffix in (".py", ".json")] if place.is_dir() else [place]
        for path in sorted(files):
            h.update(f"{path.relative_to(HOME_OF_OURS).as_posix()}\n{path.stat().st_size}\n".encode())
            h.update(path.read_bytes())
    return h.hexdigest()
