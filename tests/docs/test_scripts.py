"""Every script that a page names runs at its smallest: here, or in CI's weekly job.

What takes more than some seconds of CPU time, or runs in real time, is ``WEEKLY``: it runs where ``SPOT_RL_WEEKLY`` is
set, as ``.ci/weekly`` does.
"""

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
from .shell import ENVIRONMENT, PROGRAMS

SMALL: dict[str, tuple[str, ...]] = {
    "lab/benchmarks/gait_figures.py": ("walk --speeds 0.5",),
    "lab/benchmarks/log_damage.py": ("LOG 5",),
    "lab/benchmarks/solver_options.py": ("--policy walk --rounds 1 --robots 4",),
    "scripts/draw_effects.py": ("",),
}
"""Script, and the words after it in each of its runs; ``LOG`` stands for a log of a short walk."""

WEEKLY: dict[str, tuple[str, ...]] = {
    "lab/benchmarks/start_up.py": ("2",),
    "lab/benchmarks/conformance_errors.py": ("body_velocity_negated",),
    "lab/benchmarks/log_reading.py": ("--minutes 1 --rounds 1",),
    "lab/benchmarks/claims/loop.py": ("--seconds 2 --plain",),
    "lab/benchmarks/claims/fakes.py": ("--seconds 1 --most 2",),
    "lab/benchmarks/calibrate_diagnosis.py": ("robots --seed 1 --to 1 --out clean --workers 1",),
    "lab/benchmarks/claims/identification.py": ("--generations 1 --seconds 6",),
    "lab/benchmarks/claims/training.py": ("--envs 16",),
    "lab/benchmarks/gait_on_robot.py": ("walk --speeds 0.5",),
    "lab/benchmarks/has_it_changed.py": ("robots --seed 71 --to 1 --workers 1 --out changed", "score changed"),
    "lab/benchmarks/identify_fake.py": ("--out found --truth 0 --policy walk --repeats 1 --config short.yaml",),
    "lab/benchmarks/identify_session.sh": (
        "run small --truth 0 --policy walk --sequences ahead.yaml --repeats 1 --config short.yaml",
    ),
    "lab/benchmarks/loop_parts.py": ("--seconds 2",),
    "lab/benchmarks/judge_policy.py": ("walk --n 2 --seeds 2",),
    "lab/benchmarks/substitution.py": ("robots --seed 777301 --to 1 --out parts", "table parts"),
    "lab/benchmarks/withheld_fake.py": ("--work found --policy walk --repeats 1",),
    "examples/close_the_loop.py": ("--robot torque_lag --out loop --improved walk --oracle walk",),
    "examples/has_it_changed.py": ("changed --weeks 3 --repeats 1",),
    "examples/hidden_friction.py": ("hidden_friction",),
}

SEEN = [file for folder in ("lab/benchmarks", "examples") for file in sorted((REPOSITORY / folder).rglob("*.py"))]

AHEAD = """\
schema: spot-rl/velocity-sequence/1
name: ahead
duration_s: 4
waypoints: [{time_s: 0, v_x_m_s: 0.5}]
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder with what the scripts take from the project's."""
    for name in ("lab", "examples", "policies", "scripts", "docs"):
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
@pytest.mark.slow
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


@pytest.mark.parametrize("script", SEEN, ids=lambda script: script.name)
def test_what_it_takes_from_the_project_is_there(script: Path) -> None:
    """A script that runs seldom, or never here, still has to find every name that it imports from our packages."""
    for node in ast.walk(ast.parse(script.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in OWN_PACKAGES:
            file = source_of(node.module or "")
            assert file is not None, f"there is no module {node.module}"
            missing = {name.name for name in node.names} - defined_in(file)
            assert not missing, f"{node.module} has no {missing}"
