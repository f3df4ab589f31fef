"""The computers that the runtime is built for, and what pip would install on each: versions, files, digests."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement

REPOSITORY = Path(__file__).resolve().parent.parent
HASHES = Path(__file__).resolve().parent / "hashes"
PYTHONS = ("3.10", "3.12")
"""Python versions of JetPack 6 (Ubuntu 22.04) and JetPack 7 (Ubuntu 24.04)."""
MACHINES = ("aarch64", "x86_64")
GLIBC = ("manylinux_2_35", "manylinux_2_34", "manylinux_2_28", "manylinux_2_27", "manylinux_2_17", "manylinux2014")
"""Ubuntu 22.04 has glibc 2.35."""


class Wheel(NamedTuple):
    """One file that pip would install."""

    name: str
    version: str
    file: str
    sha256: str


def interpreter(python: str) -> str:
    """An interpreter of this version: pip reads the markers of requirements for the Python that it runs on."""
    found = shutil.which(f"python{python}")
    if (
        found is None
        or subprocess.run([found, "-m", "pip", "--version"], capture_output=True, check=False).returncode != 0
    ):
        sys.exit(f"python{python} with pip is not on PATH; pip cannot resolve for it from another version. Install it.")
    return found


def runtime_requirements(python: str) -> list[str]:
    """The requirements of the runtime and its live view that hold for ``python``, as "3.10"."""
    listing = "import json, tomllib; print(json.dumps(tomllib.load(open('pyproject.toml', 'rb'))['project']))"
    text = subprocess.run(
        [sys.executable, "-c", listing], cwd=REPOSITORY, check=True, capture_output=True, text=True
    ).stdout
    project = json.loads(text)
    extras = project["optional-dependencies"]
    stated = [Requirement(line) for line in [*project["dependencies"], *extras["runtime"], *extras["live"]]]
    return [f"{r.name}{r.specifier}" for r in stated if _holds(r, python) and r.name != project["name"]]


def locked(python: str) -> list[str]:
    """The lock's lines that hold for ``python``, without markers."""
    lines = (REPOSITORY / "requirements.lock").read_text(encoding="utf-8").splitlines()
    stated = [Requirement(line) for line in lines if line and not line.startswith("#")]
    return [f"{r.name}{r.specifier}" for r in stated if _holds(r, python)]


def platform_options(python: str, machine: str) -> list[str]:
    """The options of pip that choose wheels for a target."""
    words = ["--only-binary=:all:", "--implementation", "cp", "--python-version", python]
    for glibc in GLIBC:
        words += ["--platform", f"{glibc}_{machine}"]
    return words


def resolve(python: str, machine: str) -> list[Wheel]:
    """What pip would install from wheels alone, held to the lock; ends the program with pip's words if it cannot."""
    with tempfile.TemporaryDirectory() as folder:
        constraints, report = Path(folder) / "constraints.txt", Path(folder) / "report.json"
        constraints.write_text("\n".join(locked(python)) + "\n", encoding="utf-8")
        command = [interpreter(python), "-m", "pip", "install", "--quiet", "--dry-run", "--ignore-installed"]
        command += ["--disable-pip-version-check", "--report", str(report), "--target", str(Path(folder) / "unused")]
        command += ["-c", str(constraints), *platform_options(python, machine), *runtime_requirements(python)]
        subprocess.run(command, check=True)
        items = json.loads(report.read_text(encoding="utf-8"))["install"]
    wheels = [
        Wheel(
            item["metadata"]["name"].lower().replace("_", "-"),
            item["metadata"]["version"],
            item["download_info"]["url"].rpartition("/")[2],
            item["download_info"]["archive_info"]["hashes"]["sha256"],
        )
        for item in items
    ]
    return sorted(wheels)


def hash_file(python: str) -> Path:
    """Where the digests for a Python stand."""
    return HASHES / f"cp{python.replace('.', '')}.txt"


def _holds(requirement: Requirement, python: str) -> bool:
    environment = {"python_version": python, "python_full_version": f"{python}.0"}
    return requirement.marker is None or requirement.marker.evaluate(environment)
