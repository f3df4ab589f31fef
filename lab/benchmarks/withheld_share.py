"""A share of the withheld check on a machine without a network, with many cores: pack, run for some minutes, merge.

    python lab/benchmarks/withheld_share.py pack                         # wheels for that machine's Python into .whl/
    python3 lab/benchmarks/withheld_share.py share --first 0 --end 400 --seed S --minutes 5 --to $OUT
    python lab/benchmarks/withheld_share.py merge --out DIR share-*.tar.gz

``share`` needs the repository's sources, the wheels and NumPy, SciPy, ONNX Runtime, Typer and PyYAML of the machine
itself; where the sources have no history, SPOT_RL_REVISION says their revision. It begins no case after its minutes,
finishes those that it has begun, and leaves one file; with ``--from`` such a file it goes on where that stopped. Every
share of a run has the same seed; ``merge`` scores them.

    python3 lab/benchmarks/withheld_share.py share ... -- --reality calibrating --kind single
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[2]
CARRIED: Final = (
    "mujoco",
    "mujoco-core",
    "mujoco-studio",
    "glfw",
    "pydantic",
    "pydantic-core",
    "annotated-types",
    "annotated-doc",
    "typing-inspection",
    "typing-extensions",
    "mcap",
    "mcap-protobuf-support",
    "foxglove-schemas-protobuf",
    "protobuf",
    "lz4",
    "zstandard",
    "array-api-compat",
    "cmaes",
    "cloudpickle",
    "typer",
    "rich",
    "shellingham",
)
"""What such a machine lacks, or has in another version."""
COMMAND: Final = "from withheld.command import app; app()"
MOST_MIB: Final = 15.0


def pack(folder: Path, python: str, platform: str) -> None:
    """Download the pinned wheels of :data:`CARRIED` for another Python."""
    pins = dict(re.findall(r"^([A-Za-z0-9_.-]+)==([^\s;\\]+)", (ROOT / "requirements.lock").read_text(), re.MULTILINE))
    wanted = [f"{name}=={pins[name]}" for name in CARRIED if name in pins]
    words = ["download", "--only-binary=:all:", "--no-deps", "--python-version", python, "--dest", str(folder)]
    words += [w for tag in platform.split(",") for w in ("--platform", tag)]
    subprocess.run([sys.executable, "-m", "pip", *words, *wanted], check=True)  # noqa: S603 - our own command
    wheels = sorted(folder.glob("*.whl"))
    print(f"{len(wheels)} wheels, {sum(w.stat().st_size for w in wheels) / 2**20:.1f} MiB in {folder}")


def share(
    first: int,
    end: int,
    seed: int,
    cases: int,
    minutes: float,
    workers: int,
    wheels: Path,
    to: Path,
    begun: Path | None,
    more: list[str],
) -> None:
    """Run cases ``first`` to ``end`` of a run, as many as the minutes allow, and pack what is done."""
    site, run = to.parent / "withheld-site", to.parent / f"withheld-{first}-{end}"
    for wheel in sorted(wheels.glob("*.whl")):
        zipfile.ZipFile(wheel).extractall(site)  # noqa: S202 - pinned wheels
    paths = [str(ROOT), str(ROOT / "lab"), *([str(site)] if site.is_dir() else []), os.environ.get("PYTHONPATH", "")]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, paths))}
    words = ["run", "--out", str(run), "--workers", str(workers), "--until", str(60.0 * minutes)]
    if begun is not None:
        with tarfile.open(begun) as archive:
            archive.extractall(run, filter="data")
    is_begun = (run / "run.json").exists()
    words += (
        ["--resume"] if is_begun else ["--cases", str(cases), "--seed", str(seed), "--only", f"{first}:{end}", *more]
    )
    subprocess.run([sys.executable, "-c", COMMAND, *words], check=True, cwd=ROOT, env=environment)  # noqa: S603 - our own command
    to.mkdir(parents=True, exist_ok=True)
    file = to / f"share-{first}-{end}.tar.gz"
    file.unlink(missing_ok=True)
    words = ["pack", str(run), str(file), "--most-mib", str(MOST_MIB)]
    subprocess.run([sys.executable, "-c", COMMAND, *words], check=True, cwd=ROOT, env=environment)  # noqa: S603 - our own command


def merge(files: list[Path], out: Path) -> None:
    """Unpack shares beside each other and score them as one run."""
    folders = []
    for file in files:
        folder = out / file.name.removesuffix(".tar.gz")
        with tarfile.open(file) as archive:
            archive.extractall(folder, filter="data")
        folders.append(str(folder))
    words = ["score", *folders, "--out", str(out)]
    subprocess.run([sys.executable, "-c", COMMAND, *words], check=True, cwd=ROOT)  # noqa: S603 - our own command


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    steps = parser.add_subparsers(dest="step", required=True)
    one = steps.add_parser("pack")
    one.add_argument("--python", default="3.12")
    one.add_argument("--platform", default="manylinux_2_28_x86_64,manylinux_2_17_x86_64,manylinux2014_x86_64")
    two = steps.add_parser("share")
    for name in ("--first", "--end", "--seed"):
        two.add_argument(name, type=int, required=True)
    two.add_argument("--cases", type=int, default=800, help="of the whole run, the same for every share")
    two.add_argument("--minutes", type=float, default=5.0, help="a case takes up to three more")
    two.add_argument("--workers", type=int, default=len(os.sched_getaffinity(0)))
    two.add_argument("--from", dest="begun", type=Path)
    two.add_argument("--to", type=Path, required=True)
    two.add_argument("more", nargs="*", help="more words for spot-rl withheld run, after --")
    for step in (one, two):
        step.add_argument("--wheels", type=Path, default=Path(".whl"))
    three = steps.add_parser("merge")
    three.add_argument("files", type=Path, nargs="+")
    three.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    if given.step == "pack":
        pack(given.wheels, given.python, given.platform)
    elif given.step == "share":
        share(
            given.first,
            given.end,
            given.seed,
            given.cases,
            given.minutes,
            given.workers,
            given.wheels,
            given.to.resolve(),
            given.begun,
            given.more,
        )
    else:
        merge(given.files, given.out)


if __name__ == "__main__":
    main()
