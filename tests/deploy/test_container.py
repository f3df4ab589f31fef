"""Container files: what they name is there."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import tomllib
import yaml

from spot_model.console.command_registry import find_commands

REPOSITORY = Path(__file__).resolve().parents[2]
FILES = sorted((REPOSITORY / "deploy" / "container").glob("*.Containerfile"))
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
