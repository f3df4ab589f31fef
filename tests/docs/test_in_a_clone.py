"""Commands of the pages that want the whole project about them: they run in a copy of it, in this environment."""

from __future__ import annotations

import hashlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from .blocks import REPOSITORY, spans_of
from .ledger import runs
from .shell import OFFLINE, bash, block_with, write_program


@pytest.fixture(scope="module")
def project(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project's files as they are, with the environment of these tests as its own."""
    folder = tmp_path_factory.mktemp("project") / "a clone"
    listing = subprocess.run(["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, text=True, check=True)
    for name in filter(None, listing.stdout.split("\0")):
        if (REPOSITORY / name).is_file():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(REPOSITORY / name, folder / name)
    environment = folder / ".venv"
    environment.mkdir()
    for entry in Path(sys.prefix).iterdir():
        if entry.name != ".installed":
            (environment / entry.name).symlink_to(entry)
    (environment / ".installed").touch()  # so that nothing is fetched: the environment is in place
    return folder


def digests(folder: Path) -> dict[str, str]:
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for name in ("protos", "spot_protos", "spot_model")
        for path in (folder / name).rglob("*.p*")
        if path.suffix != ".pyc"
    }


@runs("make setup", ". .venv/bin/activate", "make help", "spot-rl --help")
def test_set_up_and_activate(project: Path) -> None:
    block = block_with("first-run-fake", "make setup")
    told = bash(f"{block.text}\nmake help\nspot-rl --help", project)
    assert "make demo" in told
    assert "fake-robot" in told


@runs("make demo", "spot-rl user-sequence LOG --out FILE.yaml")
def test_the_demo_in_lock_step(project: Path) -> None:
    told = bash("make demo", project)
    assert "outcome   completed" in told
    assert "nothing dropped" in told
    page = Path(told.splitlines()[-1].split()[-1])
    assert page.parts[0] == "demo-output"
    assert "<svg" in (project / page).read_text(encoding="utf-8")
    (log,) = (project / page).parent.glob("*.mcap")
    assert "waypoints over" in bash(f"spot-rl user-sequence '{log}' --out walked.yaml", project)


@runs("make format", "make protos")
def test_formatting_and_protos_leave_the_project_as_it_is(project: Path) -> None:
    before = digests(project)
    bash("make format\nmake protos", project)
    assert digests(project) == before


@runs("make fuzz", "python tests/fuzz/run.py NAME -runs=1000000 -seed=777")
def test_fuzzing(project: Path) -> None:
    pytest.importorskip("atheris")
    told = bash("make fuzz ARGS='--only config --runs 10 --seconds 600'", project)
    assert "config" in told
    bash("python tests/fuzz/run.py config -runs=10 -seed=777", project)


@runs("pip install -c requirements.lock .[runtime]", "pip install -c requirements.lock .[fake]")
@runs("pip install -c requirements.lock .[live]")
def test_pip_installs_the_project_and_all_extras_are_in_the_lock(project: Path, tmp_path: Path) -> None:
    environment, packages = tmp_path / "environment", tmp_path / "packages"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(environment)], check=True)
    (site,) = environment.glob("lib/python*/site-packages")
    (installed,) = Path(sys.prefix).glob("lib/python*/site-packages")
    packages.mkdir()
    for entry in installed.iterdir():  # all that the lock pins, but not this project
        if not entry.name.lower().startswith(("spot_rl", "__editable__")):
            (packages / entry.name).symlink_to(entry)
    (site / "packages.pth").write_text(f"{packages}\n")
    write_program(environment / "bin" / "pip", f'exec "{environment}/bin/python" -m pip "$@"')
    path = f"{environment / 'bin'}:{os.environ['PATH']}"
    assert shutil.which("pip", path=path) == str(environment / "bin" / "pip")

    words = next(words for words in spans_of(REPOSITORY / "README.md") if words[-1] == ".[runtime]")
    told = bash(" ".join(f"'{word}'" for word in words), project, PATH=path, **OFFLINE)
    assert "Successfully installed spot-rl" in told
    (version,) = site.glob("spot_rl-*.dist-info")
    assert bash("spot-rl --version", tmp_path, PATH=path).split()[-1] in version.name
    told = bash('python -c "import spot_runtime; print(spot_runtime.__file__)"', tmp_path, PATH=path, PYTHONPATH="")
    assert told.startswith(str(site))
    table = (REPOSITORY / "README.md").read_text(encoding="utf-8")
    extras = ("fake", "live", "train", "sysid", "diagnosis", "gamepad", "gym", "ros", "all")
    assert all(f"'.[{name}]'" in table for name in extras if name != "live")
    bash(f"pip install --dry-run -c requirements.lock '.[{','.join(extras)}]'", project, PATH=path, **OFFLINE)
