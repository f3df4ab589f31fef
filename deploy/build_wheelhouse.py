"""Build the folder from which a robot's computer installs offline: wheels held to recorded digests, installer, units.

    python deploy/build_wheelhouse.py --python 3.10 --machine aarch64 --out dist

Needs a network and an interpreter of the target's Python version on PATH. The result, a folder as
dist/spot-rl-0.1.0-cp310-aarch64/, is copied to the robot's computer as it is; its install.py needs nothing but the
system's Python there.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from runtime_wheel import trim
from wheel_targets import HASHES, MACHINES, PYTHONS, REPOSITORY, hash_file, interpreter, platform_options

DEPLOY = Path(__file__).resolve().parent
FILES = (
    "install.py",
    "spot-rl.service",
    "spot-rl-logs.service",
    "spot-rl-logs.timer",
    "spot-rl.sysusers.conf",
    "spot-rl.tmpfiles.conf",
    "spot-rl.env.example",
    "run.yaml.example",
    "credentials.yaml.example",
)


def download(python: str, machine: str, folder: Path) -> None:
    """Fetch the wheels, and pip's own; a file with another digest than the recorded one ends it."""
    base = [interpreter(python), "-m", "pip", "download", "--quiet", "--disable-pip-version-check", "--no-deps"]
    base += ["--require-hashes", "--dest", str(folder), *platform_options(python, machine)]
    for recorded in (hash_file(python), HASHES / "pip.txt"):
        subprocess.run([*base, "-r", str(recorded)], check=True)


def build_own_wheel(folder: Path) -> Path:
    """The newest commit's runtime as a wheel, built away from the working tree, whose leftovers would get in."""
    with tempfile.TemporaryDirectory() as scratch:
        archive = Path(scratch) / "source.tar"
        subprocess.run(["git", "archive", "--output", str(archive), "HEAD"], cwd=REPOSITORY, check=True)
        source = Path(scratch) / "source"
        shutil.unpack_archive(archive, source)
        words = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(source)]
        subprocess.run([sys.executable, "-m", "pip", *words], check=True)
    wheel = next(folder.glob("spot_rl-*.whl"))
    trim(wheel)
    return wheel


def write_manifest(folder: Path, python: str, machine: str, version: str) -> None:
    """Name the target and the digest of every file: the installer refuses a folder that differs."""
    digests = {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }
    manifest = {"version": version, "python": python, "machine": machine, "sha256": digests}
    (folder / "manifest.json").write_text(json.dumps(manifest, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", choices=PYTHONS, required=True)
    parser.add_argument("--machine", choices=MACHINES, required=True)
    parser.add_argument("--out", type=Path, default=Path("dist"))
    chosen = parser.parse_args()
    scratch = chosen.out / "unfinished"
    shutil.rmtree(scratch, ignore_errors=True)
    wheels = scratch / "wheels"
    wheels.mkdir(parents=True)
    download(chosen.python, chosen.machine, wheels)
    own = build_own_wheel(wheels)
    version = own.name.split("-")[1]
    digest = hashlib.sha256(own.read_bytes()).hexdigest()
    recorded = hash_file(chosen.python).read_text(encoding="utf-8")
    (scratch / "requirements.txt").write_text(
        f"{recorded}spot-rl=={version} --hash=sha256:{digest}\n", encoding="utf-8"
    )
    for name in FILES:
        shutil.copy(DEPLOY / name, scratch / name)
    shutil.copy(REPOSITORY / "docs" / "deploy.md", scratch / "deploy.md")
    write_manifest(scratch, chosen.python, chosen.machine, version)
    folder = chosen.out / f"spot-rl-{version}-cp{chosen.python.replace('.', '')}-{chosen.machine}"
    shutil.rmtree(folder, ignore_errors=True)
    scratch.rename(folder)
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    print(f"{folder}: {len(list((folder / 'wheels').iterdir()))} wheels, {size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
