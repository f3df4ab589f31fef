"""The revision of the sources is that of their own checkout, and of no other."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from spot_model import version


def git(folder: Path, *words: str) -> str:
    identity = ["-c", "user.name=nobody", "-c", "user.email=nobody@localhost"]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("GIT_")}
    done = subprocess.run(
        ["git", *identity, *words], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return done.stdout.strip()


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    (tmp_path / "site-packages").mkdir()
    (tmp_path / "file").write_text("one")
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", "file")
    git(tmp_path, "commit", "-q", "-m", "first")
    version._checked_out.cache_clear()
    return tmp_path


def test_of_a_checkout_its_revision(checkout: Path) -> None:
    head = git(checkout, "rev-parse", "HEAD")
    assert version._checked_out(checkout) == head
    version._checked_out.cache_clear()
    (checkout / "file").write_text("two")
    assert version._checked_out(checkout) == head + "+changes"


def test_a_wheel_in_the_checkout_of_another_project_has_none(checkout: Path) -> None:
    assert version._checked_out(checkout / "site-packages") == version.UNKNOWN


def test_without_git_there_is_none(checkout: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(checkout))
    assert version._checked_out(checkout) == version.UNKNOWN


def test_a_repository_without_a_commit_has_none(tmp_path: Path) -> None:
    git(tmp_path, "init", "-q")
    assert version._checked_out(tmp_path) == version.UNKNOWN


def test_who_copies_sources_says_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(version.REVISION_VARIABLE, "r1")
    assert version.software_revision() == "r1"
