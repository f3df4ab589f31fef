"""Commands of the pages that want the whole project about them: they run in a copy of it, in this environment."""

from __future__ import annotations

import hashlib
from pathlib import Path

import pytest

from .shell import bash

pytestmark = pytest.mark.slow


def digests(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for name in ("protos", "spot_protos", "spot_model")
        for path in (folder / name).rglob("*.p*")
        if path.suffix != ".pyc"
    }


def test_set_up_and_activate(project: Path) -> None:
    told = bash("make setup\n. .venv/bin/activate\nmake help\nspot-rl --help", project)
    assert "make demo" in told
    assert "fake-robot" in told


def test_the_demo_in_lock_step(project: Path) -> None:
    told = bash("make demo", project)
    assert "outcome   completed" in told
    assert "nothing dropped" in told
    page = Path(told.splitlines()[-1].split()[-1])
    assert page.parts[0] == "demo-output"
    assert "<svg" in (project / page).read_text(encoding="utf-8")
    (log,) = (project / page).parent.glob("*.mcap")
    assert "waypoints over" in bash(f"spot-rl user-sequence '{log}' --out walked.yaml", project)


def test_formatting_and_protos_leave_the_project_as_it_is(project: Path) -> None:
    before = digests(project)
    bash("make format\nmake protos", project)
    assert digests(project) == before


def test_fuzzing(project: Path) -> None:
    pytest.importorskip("atheris")
    told = bash("make fuzz ARGS='--only config --runs 10 --seconds 600'", project)
    assert "config" in told
    bash("python tests/fuzz/run.py config -runs=10 -seed=777", project)
