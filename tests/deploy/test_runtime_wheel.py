"""What is installed on a robot's computer: the runtime and what it needs of ours, and nothing that tries or trains."""

from __future__ import annotations

import ast
import importlib.util
import subprocess
import sys
import zipfile
from pathlib import Path
from types import ModuleType

import pytest
import tomllib

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def trimming() -> ModuleType:
    spec = importlib.util.spec_from_file_location("runtime_wheel", REPOSITORY / "deploy" / "runtime_wheel.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def wheel(tmp_path: Path) -> Path:
    """A wheel with a module of every package, and the entry points of the real one."""
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())
    packages = [name.rstrip("*") for name in project["tool"]["setuptools"]["packages"]["find"]["include"]]
    groups = {"console_scripts": project["project"]["scripts"], **project["project"]["entry-points"]}
    points = "".join(
        f"[{group}]\n" + "".join(f"{name} = {target}\n" for name, target in entries.items()) + "\n"
        for group, entries in groups.items()
    )
    path = tmp_path / "spot_rl-9.9-py3-none-any.whl"
    info = "spot_rl-9.9.dist-info"
    contents = {f"{name}/__init__.py": f"NAME = {name!r}\n" for name in packages}
    contents |= {
        f"{info}/METADATA": "Metadata-Version: 2.1\nName: spot-rl\nVersion: 9.9\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/entry_points.txt": points,
        f"{info}/top_level.txt": "".join(f"{name}\n" for name in packages),
    }
    with zipfile.ZipFile(path, "w") as archive:
        for name, text in contents.items():
            archive.writestr(name, text)
        archive.writestr(f"{info}/RECORD", "")
    return path


def test_only_what_runs_on_the_robot_is_left(trimming: ModuleType, wheel: Path) -> None:
    gone = trimming.trim(wheel)
    assert {"fake_robot", "trainer", "diagnosis"} <= set(gone)
    with zipfile.ZipFile(wheel) as archive:
        names = archive.namelist()
        points = archive.read("spot_rl-9.9.dist-info/entry_points.txt").decode()
    assert {name.split("/")[0] for name in names} == {*trimming.PACKAGES, "spot_rl-9.9.dist-info"}
    assert "serve = spot_tools" in points
    assert "log = spot_log" in points
    for package in gone:
        assert f"= {package}" not in points


def test_pip_installs_it_and_its_record_holds(trimming: ModuleType, wheel: Path, tmp_path: Path) -> None:
    trimming.trim(wheel)
    words = ["install", "--quiet", "--no-deps", "--no-index", "--target", str(tmp_path / "there"), str(wheel)]
    done = subprocess.run([sys.executable, "-m", "pip", *words], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "there" / "spot_runtime" / "__init__.py").exists()
    assert not (tmp_path / "there" / "fake_robot").exists()


def test_nothing_in_it_needs_what_is_gone(trimming: ModuleType) -> None:
    gone = {"proof", "fake_robot", "trainer", "diagnosis", "withheld"}
    for package in trimming.PACKAGES:
        for path in (REPOSITORY / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                modules = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
                modules += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
                assert not gone & {module.split(".")[0] for module in modules}, path
