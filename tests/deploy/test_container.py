"""Container files and the action: what they name is there, and the action starts a robot that a job can reach."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import tomllib
import yaml

from spot_model.console.command_registry import find_commands

REPOSITORY = Path(__file__).resolve().parents[2]
FILES = sorted((REPOSITORY / "deploy" / "container").glob("*.Containerfile"))
ACTION = REPOSITORY / "deploy" / "action"
INSTRUCTIONS = {"FROM", "RUN", "USER", "WORKDIR", "COPY", "VOLUME", "EXPOSE", "ENTRYPOINT", "CMD"}


def instructions(path: Path) -> list[tuple[str, str]]:
    text = re.sub(r"\\\n\s*", "", path.read_text(encoding="utf-8"))
    lines = [line for line in text.splitlines() if line and not line.startswith("#")]
    return [(line.split()[0], line.partition(" ")[2]) for line in lines]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_a_container_file_names_what_is_there(path: Path) -> None:
    found = instructions(path)
    assert {word for word, _ in found} <= INSTRUCTIONS
    project = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = {e for _, words in found for e in re.findall(r"\.\[([\w,]+)\]", words)}
    assert len(extras) == 1
    assert extras <= set(project["optional-dependencies"])
    (base,) = (words for word, words in found if word == "FROM")
    assert re.fullmatch(r"docker\.io/library/python:3\.1[1-3]-slim-\w+", base)
    entry = yaml.safe_load(dict(found)["ENTRYPOINT"])
    assert entry[0] == "spot-rl"
    assert entry[1] in find_commands()
    users = [words for word, words in found if word == "USER"]
    assert users == ["spot"], "nothing runs as root"
    assert "-c requirements.lock" in " ".join(words for _, words in found)


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_the_page_builds_it_as_its_head_says(path: Path) -> None:
    page = (REPOSITORY / "docs" / "other-tools.md").read_text(encoding="utf-8").replace(" \\\n ", "")
    head = [line[2:].strip() for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("#   podman")]
    assert head
    assert all(line in page for line in head)


def test_the_action_is_one() -> None:
    action = yaml.safe_load((ACTION / "action.yml").read_text(encoding="utf-8"))
    assert action["runs"]["using"] == "composite"
    used = set(re.findall(r"inputs\.([\w-]+)", (ACTION / "action.yml").read_text(encoding="utf-8")))
    assert used == set(action["inputs"])
    assert set(action["outputs"]) == {"host"}


def test_the_action_starts_a_robot_and_tells_the_job(tmp_path: Path) -> None:
    programs = tmp_path / "spot-rl-fake" / "venv" / "bin"
    programs.mkdir(parents=True)
    for name in ("spot-rl", "python"):  # what the first step of the script would install
        (programs / name).write_text(f'#!/bin/sh\nexec "{Path(sys.executable).parent / name}" "$@"\n')
        (programs / name).chmod(0o755)
    given = {
        "PYTHON": sys.executable,
        "SOURCE": str(REPOSITORY),
        "SCENARIO": "default",
        "PORT": "0",
        "RUNNER_TEMP": str(tmp_path),
        "GITHUB_ENV": str(tmp_path / "env"),
        "GITHUB_OUTPUT": str(tmp_path / "output"),
    }
    try:
        told = subprocess.run(
            ["bash", str(ACTION / "start.sh")], env={**os.environ, **given}, capture_output=True, text=True
        )
        assert told.returncode == 0, told.stderr
        host = (tmp_path / "output").read_text().removeprefix("host=").strip()
        variables = dict(line.split("=", 1) for line in (tmp_path / "env").read_text().splitlines())
        assert "BOSDYN_CLIENT_USERNAME" in variables
        program = (
            "import sys, bosdyn.client.util; r = bosdyn.client.create_standard_sdk('t').create_robot(sys.argv[1]); "
            "bosdyn.client.util.authenticate(r); print(r.get_id().serial_number)"
        )
        done = subprocess.run(
            [sys.executable, "-c", program, host], env={**os.environ, **variables}, capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        assert "FAKE" in done.stdout
    finally:
        pid = tmp_path / "spot-rl-fake" / "pid"
        if pid.exists():
            os.kill(int(pid.read_text()), signal.SIGTERM)


def test_a_robot_that_does_not_start_fails_the_step(tmp_path: Path) -> None:
    programs = tmp_path / "spot-rl-fake" / "venv" / "bin"
    programs.mkdir(parents=True)
    (programs / "spot-rl").write_text("#!/bin/sh\necho no such scenario >&2\nexit 2\n")
    (programs / "spot-rl").chmod(0o755)
    given = {"PYTHON": sys.executable, "SOURCE": str(REPOSITORY), "SCENARIO": "none", "PORT": "0"}
    told = subprocess.run(
        ["bash", str(ACTION / "start.sh")],
        env={**os.environ, **given, "RUNNER_TEMP": str(tmp_path)},
        capture_output=True,
        text=True,
    )
    assert told.returncode == 1
    assert "no such scenario" in told.stderr
