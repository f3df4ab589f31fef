"""The installation page, word by word, with stand-ins for root, systemd and the package index."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.deploy.test_install import FILES, PIP, write_wheel

from .blocks import REPOSITORY, spans_of
from .shell import OFFLINE, PROGRAMS, bash, block_with, write_program

pytestmark = pytest.mark.slow


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """First on PATH: ``sudo`` gives another root in the place of rights, ``systemctl`` says that nothing runs."""
    folder = tmp_path / "programs"
    folder.mkdir()
    write_program(folder / "sudo", f'exec "$@" --root "{tmp_path / "root"}"')
    write_program(folder / "systemctl", "echo inactive")
    (folder / "python3").symlink_to(sys.executable)
    return folder


def make_bundle(folder: Path, version: str) -> None:
    """What build_wheelhouse.py makes, for this computer, with one tiny wheel."""
    (folder / "wheels").mkdir(parents=True)
    assert PIP is not None
    shutil.copy(PIP, folder / "wheels")
    wheel = write_wheel(folder / "wheels", version, prints=f"spot-rl {version}")
    digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
    (folder / "requirements.txt").write_text(f"spot-rl=={version} --hash=sha256:{digest}\n")
    for name in FILES:
        shutil.copy(REPOSITORY / "deploy" / name, folder / name)
    shutil.copy(REPOSITORY / "docs" / "deploy.md", folder / "deploy.md")
    found = [path for path in folder.rglob("*") if path.is_file()]
    sha256 = {path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in found}
    about = {"version": version, "python": "{}.{}".format(*sys.version_info), "machine": platform.machine()}
    (folder / "manifest.json").write_text(json.dumps({**about, "sha256": sha256}))


@pytest.mark.skipif(PIP is None, reason="this Python has no bundled pip wheel to install with")
def test_the_installer_does_what_the_page_says(tmp_path: Path, programs: Path) -> None:
    path, root = f"{programs}:{PROGRAMS}:{os.environ['PATH']}", tmp_path / "root"
    make_bundle(tmp_path / "spot-rl-0.1.0-cp310-aarch64", "0.1.0")
    make_bundle(tmp_path / "newer", "0.2.0")
    told = bash(block_with("deploy", "cd spot-rl-0.1.0").text, tmp_path, PATH=path)
    assert "installed 0.1.0-" in told
    assert (root / "etc/spot-rl/credentials.yaml").stat().st_mode & 0o777 == 0o600
    on_path = block_with("deploy", "export PATH").text.replace("/opt", f"{root}/opt")
    assert bash(f"{on_path}spot-rl", tmp_path, PATH=path).strip() == "spot-rl 0.1.0"
    told = bash(block_with("deploy", "install.py rollback").text, tmp_path / "newer", PATH=path)
    assert "is kept, 'install.py rollback' returns to it" in told
    assert "back at 0.1.0-" in told
    assert "current: 0.1.0-" in told
    assert not [path for path in root.rglob("*") if path.is_file()]


def test_the_bundle_is_built_but_for_the_download(tmp_path: Path, programs: Path) -> None:
    write_program(
        programs / "python3.10",
        'case "$*" in *" download "*) while [ "$1" != --dest ]; do shift; done; touch "$2/a-1-py3-none-any.whl"; esac',
    )
    line = block_with("deploy", "build_wheelhouse").lines[0].partition("#")[0]
    path = f"{programs}:{PROGRAMS}:{os.environ['PATH']}"
    told = bash(f"{line} --out '{tmp_path / 'dist'}'", REPOSITORY, PATH=path, **OFFLINE)
    (folder,) = (tmp_path / "dist").iterdir()
    assert told.startswith(f"{folder}: ")
    assert block_with("deploy", "cd spot-rl-0.1.0").lines[0] == f"cd {folder.name}"
    manifest = json.loads((folder / "manifest.json").read_text(encoding="utf-8"))
    assert {"install.py", "deploy.md", "requirements.txt", "spot-rl.service"} <= manifest["sha256"].keys()
    assert "spot-rl==0.1.0 --hash=sha256:" in (folder / "requirements.txt").read_text(encoding="utf-8")
    words = [sys.executable, "install.py", "install", "--root", str(tmp_path / "root")]
    refused = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    assert "take the other bundle" in refused.stderr


def test_what_the_quota_would_delete(tmp_path: Path) -> None:
    (tmp_path / "old.mcap").write_bytes(b"log")
    words = next(words for words in spans_of(REPOSITORY / "docs" / "deploy.md") if words[1:2] == ["prune-logs"])
    line = " ".join(words).replace("20", "0.000000001").replace("/var/log/spot-rl", f"'{tmp_path}'")
    assert "would delete" in bash(line, tmp_path)
    assert (tmp_path / "old.mcap").is_file()
