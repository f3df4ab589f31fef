"""A run's folder: what all its cases have in common, fixed before the first."""

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
from spot_model.version import software_revision

RUN: Final = "run.json"
CASES: Final = "cases"
WORK: Final = "work"
SCORES: Final = "scores.json"
PAGE: Final = "scores.html"
JUDGES_OWN: Final = (RUN, CASES, WORK, SCORES, PAGE)
"""All that a run's folder holds: seed, truths and verdicts."""
HOME: Final = Path(__file__).resolve().parents[3]
"""The clone."""
DRAWS: Final = tuple(HOME / "lab" / "withheld" / name for name in ("cases.py", "plan.py", "realities", "simulator"))
"""Sources that draw and make the cases."""
DIAGNOSES: Final = tuple(HOME / name for name in ("diagnosis", "spot_model", "trainer/sysid"))
"""Sources that decide a verdict."""
NUMBERS: Final = ("mujoco-core", "numpy", "onnxruntime", "scipy")
"""Libraries that decide numbers."""
PACKED_OF_A_RUN: Final = (RUN, SCORES)
PACKED_OF_A_CASE: Final = ("outcome.json", "verdict.json", "corrected_model.yaml")


class RunHead(Settings):
    """``run.json``: fixed before the first case."""

    schema_name: Literal["spot-rl/withheld-run/4"] = Field(default="spot-rl/withheld-run/4", alias="schema")
    revision: str
    """Of the sources; ends with ``+changes`` where they were not as committed, ``unknown`` outside a checkout."""
    digest: str
    """SHA-256 of sources and policies that decide cases and verdicts: parts with another one are another run."""
    seed: int
    is_seed_drawn: bool
    """Whether the operating system drew the seed, after revision and digest were taken; else it was given."""
    reality: str
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


def begin(
    out: Path, seed: int | None, policies: Path, *, reality: str, cases: int, part: tuple[int, int], is_quick: bool
) -> RunHead:
    """Begin a run: everything that decides a verdict is fixed from here on, and then the seed is drawn.

    Args:
        out: Folder of the run.
        seed: Of a run that is repeated, or of which this is a part; by default the operating system draws one.
        policies: Folder of policies.
        reality: Where robots come from.
        cases: Of the whole run.
        part: First case and end of this folder's part.
        is_quick: Whether runs are short.

    Raises:
        BadInputError: The folder holds a run, there is no policy, or the part lies outside of the run.
    """
    if not any(policies.glob("*.onnx")):
        raise BadInputError(f"folder {policies} has no policy (*.onnx); name another with --policies, or leave it out")
    revision, digest = software_revision(), digest_of(policies)
    head = RunHead(
        revision=revision,
        digest=digest,
        seed=secrets.randbits(62) if seed is None else seed,
        is_seed_drawn=seed is None,
        reality=reality,
        cases=cases,
        part=part,
        is_quick=is_quick,
        versions={
            "python": platform.python_version(),
            "machine": platform.machine(),
            **{name: version(name) for name in NUMBERS},
        },
    )
    make_folder(out, head)
    return head


def make_folder(out: Path, head: RunHead) -> None:
    """Make the folder of a run without cases.

    Raises:
        BadInputError: It holds a run, or the part lies outside of it.
    """
    if (out / RUN).exists():
        raise BadInputError(f"folder {out} holds a run; give --resume to go on, or another --out folder")
    (out / CASES).mkdir(parents=True, exist_ok=True)
    head.write(out)


def go_on(out: Path, policies: Path, part: tuple[int, int] | None) -> RunHead:
    """Go on with the part of a run that its folder was begun with, or from now on with another one.

    Raises:
        BadInputError: There is none, or sources or policies are no longer what they were.
    """
    head = load_head(out)
    if digest_of(policies) != head.digest:
        raise BadInputError(
            f"{out / RUN} was begun with other sources or policies, at revision {head.revision}; go on with these, or "
            "start anew with another --out folder"
        )
    if part is not None:
        head = head.model_copy(update={"part": part})
        head.write(out)
    return head


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
    folders = sorted(p.parent for p in (out / CASES).glob("*/outcome.json"))
    with whole_file(file) as part:
        with tarfile.open(part, "w:gz", compresslevel=9) as archive:
            for folder, names in ((out, PACKED_OF_A_RUN), *((folder, PACKED_OF_A_CASE) for folder in folders)):
                for path in (folder / name for name in names if (folder / name).exists()):
                    archive.add(path, str(path.relative_to(out)))
        size = part.stat().st_size / 2**20
        if size > most_mib:
            raise BadInputError(f"{file} would have {size:.1f} MiB; allowed: {most_mib:g} (--most-mib)")
    return len(folders)


def digest_of(policies: Path) -> str:
    """SHA-256 over names and bytes of the policies, and of the sources and constants that decide cases and verdicts."""
    h = hashlib.sha256()
    for folder, places in ((HOME, (*DIAGNOSES, *DRAWS)), (policies, policies.glob("*.onnx"))):
        for place in sorted(places):
            files = [p for p in place.rglob("*") if p.suffix in (".py", ".json")] if place.is_dir() else [place]
            for path in sorted(files):
                h.update(f"{path.relative_to(folder).as_posix()}\n{path.stat().st_size}\n".encode())
                h.update(path.read_bytes())
    return h.hexdigest()
