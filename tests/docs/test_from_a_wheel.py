"""The project installed from a wheel, used in an empty folder: nothing of a clone is about, and no network."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from .blocks import REPOSITORY, spans_of
from .shell import OFFLINE, bash, write_program

pytestmark = pytest.mark.slow

EXTRAS = ("fake", "cameras", "web", "live", "train", "sysid", "diagnosis", "gamepad", "gym", "ros", "all")
PLUGIN_TEST = """
def test_the_robot_answers(fake_spot):
    assert fake_spot.sdk_robot().get_id().serial_number
"""
SCRIPT = """
import spot_rl
assert "site-packages" in spot_rl.__file__, spot_rl.__file__
policy = spot_rl.load_policy("walk")
with spot_rl.FakeSpot() as spot:
    run = spot.walk("walk", velocity=(0.5, 0.0, 0.0), duration_s=2.0)
print(spot_rl.simulate(run, "paper_identified").header.policy_name)
"""

Shell = Callable[[str], str]


@pytest.fixture(scope="module")
def path(project: Path, tmp_path_factory: pytest.TempPathFactory) -> str:
    """Programs of an environment that has what the lock pins, and this project from a wheel."""
    folder = tmp_path_factory.mktemp("wheel")
    environment, packages = folder / "environment", folder / "packages"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    (site,) = environment.glob("lib/python*/site-packages")
    (installed,) = Path(sys.prefix).glob("lib/python*/site-packages")
    packages.mkdir()
    for entry in installed.iterdir():
        if not entry.name.lower().startswith(("spot_rl", "__editable__")):
            (packages / entry.name).symlink_to(entry)
    (site / "packages.pth").write_text(f"{packages}\n")
    write_program(environment / "bin" / "pip", f'exec "{environment}/bin/python" -m pip "$@"')
    programs = f"{environment / 'bin'}:{os.environ['PATH']}"
    assert shutil.which("pip", path=programs) == str(environment / "bin" / "pip")
    words = next(words for words in spans_of(REPOSITORY / "README.md") if words[-1] == ".[runtime]")
    told = bash(" ".join(f"'{word}'" for word in words), project, PATH=programs, **OFFLINE)
    assert "Successfully installed spot-rl" in told
    return programs


@pytest.fixture
def shell(path: str, tmp_path: Path) -> Shell:
    """Runs words in an empty folder."""
    return lambda text: bash(text, tmp_path, PATH=path, PYTHONPATH="")


def test_all_extras_are_in_the_lock_and_in_the_readme(project: Path, path: str) -> None:
    table = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    assert all(f"'.[{name}]'" in table for name in EXTRAS if name not in ("live", "cameras"))
    bash(f"pip install --dry-run -c requirements.lock '.[{','.join(EXTRAS)}]'", project, PATH=path, **OFFLINE)


def test_the_demo_and_a_walk_by_names(shell: Shell, tmp_path: Path) -> None:
    assert "completed" in shell("spot-rl demo --top-speed 0.5 --out shown")
    (log,) = (tmp_path / "shown").rglob("*.mcap")
    assert "walk" in shell(f"spot-rl log info '{log}'")
    shell(f"spot-rl compare '{log}' paper_identified --out beside")
    assert "turning" in shell("spot-rl policy show fast")
    exec_ = 'spot-rl fake-robot --lock-step --admin "unix:$PWD/a" --scenario slippery exec -- '
    run = 'spot-rl run --robot HOST --lock-step "unix:$PWD/a" --policy walk --sequence forward --duration 1'
    assert "completed" in shell(f"{exec_}{run} --log-dir logs")
    assert {entry.name for entry in tmp_path.iterdir()} == {"shown", "beside", "logs"}


def test_python_and_the_pytest_plug_in(shell: Shell, tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    assert shell("python script.py").strip() == "walk"
    (tmp_path / "test_mine.py").write_text(PLUGIN_TEST)
    assert "1 passed" in shell("python -m pytest -q test_mine.py")


def test_training(shell: Shell) -> None:
    small = "--set n_envs=8 --set iterations=1 --set ppo.steps_per_iteration=8"
    assert "checkpoint" in shell(f"spot-rl train --config walk_cpu {small} --out run")
