"""Every script that a page names runs: here at its smallest, in CI's weekly job, or in another test."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

from spot_model.console.command_registry import source_of
from spot_model.user_code import OWN_PACKAGES

from .blocks import REPOSITORY
from .scripts import BY_CI, ELSEWHERE, LEDGER, NOT_RUN, SCRIPT, SMALL, WEEKLY
from .shell import ENVIRONMENT, PROGRAMS

AHEAD = """\
schema: spot-rl/velocity-sequence/1
name: ahead
duration_s: 4
waypoints: [{time_s: 0, v_x_m_s: 0.5}]
"""


def named_in(text: str) -> set[str]:
    """Scripts that a page names."""
    return set(SCRIPT.findall(text))


NAMED = {
    script
    for page in REPOSITORY.rglob("*.md")
    if not {".venv", "build"} & set(page.relative_to(REPOSITORY).parts)
    for script in named_in(page.read_text(encoding="utf-8"))
}


def test_every_script_of_a_page_is_run_or_has_its_reason() -> None:
    assert len(NAMED) > 30
    assert not NAMED - LEDGER.keys(), "run these in tests/docs/scripts.py, or say there why not"
    assert not LEDGER.keys() - NAMED, "no page names these"
    assert len(LEDGER) == sum(map(len, (SMALL, WEEKLY, ELSEWHERE, BY_CI, NOT_RUN))), "a script stands in two tables"
    assert not [script for script in LEDGER if not (REPOSITORY / script).is_file()]


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("run `python benchmarks/new.py --all`", {"benchmarks/new.py"}),
        ("[it](../examples/tour.ipynb), (deploy/a/b.sh)", {"deploy/a/b.sh"}),
        ("my/benchmarks/new.py and benchmarks/table.txt", set()),
    ],
)
def test_scripts_are_found_in_a_page(text: str, found: set[str]) -> None:
    assert named_in(text) == found


def test_what_runs_elsewhere_is_there() -> None:
    for script, (file, words) in ELSEWHERE.items():
        assert words in (REPOSITORY / "tests" / file).read_text(encoding="utf-8"), script
    lines = (REPOSITORY / ".ci" / "run").read_text(encoding="utf-8").splitlines()
    assert set(BY_CI.values()) <= set(lines)
    assert "SPOT_RL_WEEKLY=1" in (REPOSITORY / ".ci" / "weekly").read_text(encoding="utf-8")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder with what the scripts take from the project's."""
    for name in ("benchmarks", "examples", "policies", "scripts", "docs"):
        (tmp_path / name).symlink_to(REPOSITORY / name)
    (tmp_path / "short.yaml").write_text("schema: spot-rl/sysid/1\nsearch: {generations: 1}\n")
    (tmp_path / "ahead.yaml").write_text(AHEAD)
    return tmp_path


def run(words: list[str], folder: Path) -> None:
    environment = {**ENVIRONMENT, "PATH": f"{PROGRAMS}:{os.environ['PATH']}", "XDG_STATE_HOME": f"{folder}-state"}
    told = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, stdin=subprocess.DEVNULL)
    assert told.returncode == 0, f"{words}\n{told.stdout[-4000:]}\n{told.stderr[-4000:]}"
    assert told.stdout.strip(), f"{words} says nothing"


def run_script(script: str, lines: tuple[str, ...], folder: Path) -> None:
    program = "bash" if script.endswith(".sh") else sys.executable
    for line in lines:
        words = [log_in(folder) if word == "LOG" else word for word in line.split()]
        run([program, script, *words], folder)


def log_in(folder: Path) -> str:
    """A log of a second's walk."""
    admin = f"unix:{folder}/admin.sock"
    words = [
        "spot-rl",
        "fake-robot",
        "--lock-step",
        "--admin",
        admin,
        "exec",
        "--",
        "spot-rl",
        "run",
        "--robot",
        "HOST",
    ]
    words += ["--lock-step", admin, "--policy", "walk", "--sequence", "ahead.yaml", "--duration", "1"]
    run([*words, "--log-dir", "logs"], folder)
    return str(next((folder / "logs").glob("*.mcap")))


@pytest.mark.parametrize("script", SMALL)
def test_it_runs_at_its_smallest(script: str, folder: Path) -> None:
    run_script(script, SMALL[script], folder)


@pytest.mark.skipif(
    "SPOT_RL_WEEKLY" not in os.environ, reason="takes minutes: CI runs it once a week, with SPOT_RL_WEEKLY"
)
@pytest.mark.parametrize("script", WEEKLY)
def test_it_runs_weekly(script: str, folder: Path) -> None:
    run_script(script, WEEKLY[script], folder)


def defined_in(file: Path) -> set[str]:
    """Names that a module has, and modules of a package, from the text alone."""
    names = {path.stem for path in file.parent.iterdir()} if file.name == "__init__.py" else set()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            names.add(node.name)
        elif isinstance(node, (ast.Import, ast.ImportFrom)):
            names |= {name.asname or name.name for name in node.names}
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            names.add(node.id)
    return names


@pytest.mark.parametrize("script", sorted(s for s in {*WEEKLY, *NOT_RUN} if s.endswith(".py")))
def test_what_it_takes_from_the_project_is_there(script: str) -> None:
    """A script that runs seldom, or never here, still has to find every name that it imports from our packages."""
    for node in ast.walk(ast.parse((REPOSITORY / script).read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in OWN_PACKAGES:
            file = source_of(node.module or "")
            assert file is not None, f"there is no module {node.module}"
            missing = {name.name for name in node.names} - defined_in(file)
            assert not missing, f"{node.module} has no {missing}"
