"""The installer under a root of the test's own, from wheels that the test makes."""

from __future__ import annotations

import ensurepip
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
FILES = [
    *(path.name for path in DEPLOY.iterdir() if path.suffix in (".service", ".timer", ".conf", ".example")),
    "install.py",
]
PIP = next((Path(ensurepip.__file__).parent / "_bundled").glob("pip-*.whl"), None)
pytestmark = pytest.mark.skipif(PIP is None, reason="this Python has no bundled pip wheel to install with")

Install = Callable[..., subprocess.CompletedProcess[str]]


def write_wheel(folder: Path, version: str, *, prints: str) -> Path:
    """A wheel of a package spot-rl whose program prints what is asked for."""
    path = folder / f"spot_rl-{version}-py3-none-any.whl"
    info = f"spot_rl-{version}.dist-info"
    contents = {
        "spot_rl_stub.py": f"def main():\n    print({prints!r})\n",
        f"{info}/METADATA": f"Metadata-Version: 2.1\nName: spot-rl\nVersion: {version}\n",
        f"{info}/WHEEL": "Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        f"{info}/entry_points.txt": "[console_scripts]\nspot-rl = spot_rl_stub:main\n",
    }
    with zipfile.ZipFile(path, "w") as wheel:
        for name, text in contents.items():
            wheel.writestr(name, text)
        wheel.writestr(f"{info}/RECORD", "".join(f"{name},,\n" for name in [*contents, f"{info}/RECORD"]))
    return path


@pytest.fixture
def bundle(tmp_path: Path) -> Callable[..., Path]:
    """Makes bundles as build_wheelhouse.py does, with one tiny wheel."""

    def make(version: str, *, prints: str | None = None, **manifest: str) -> Path:
        folder = tmp_path / f"bundle-{version}"
        (folder / "wheels").mkdir(parents=True)
        assert PIP is not None
        shutil.copy(PIP, folder / "wheels")
        wheel = write_wheel(folder / "wheels", version, prints=f"spot-rl {version}" if prints is None else prints)
        digest = hashlib.sha256(wheel.read_bytes()).hexdigest()
        (folder / "requirements.txt").write_text(f"spot-rl=={version} --hash=sha256:{digest}\n")
        for name in FILES:
            shutil.copy(DEPLOY / name, folder / name)
        (folder / "deploy.md").write_text("how to\n")
        digests = {
            str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
            for path in folder.rglob("*")
            if path.is_file()
        }
        about = {"version": version, "python": "{}.{}".format(*sys.version_info), "machine": platform.machine()}
        (folder / "manifest.json").write_text(json.dumps({**about, **manifest, "sha256": digests}))
        return folder

    return make


@pytest.fixture
def root(tmp_path: Path) -> Path:
    return tmp_path / "root"


@pytest.fixture
def programs(tmp_path: Path) -> Iterator[Path]:
    """A folder first on PATH, with a service manager that writes down what it is asked and says that nothing runs."""
    folder = tmp_path / "programs"
    folder.mkdir()
    say_state(folder, "inactive")
    yield folder
    asked = (folder / "asked").read_text().splitlines() if (folder / "asked").exists() else []
    assert set(asked) <= {"is-active spot-rl.service"}  # never start, restart or enable


def say_state(folder: Path, state: str) -> None:
    program = folder / "systemctl"
    program.write_text(f'#!/bin/sh\necho "$@" >> {folder}/asked\necho {state}\n')
    program.chmod(0o755)


@pytest.fixture
def act(root: Path, programs: Path) -> Install:
    def act(action: str, bundle: Path | None = None, *words: str) -> subprocess.CompletedProcess[str]:
        script = DEPLOY / "install.py" if bundle is None else bundle / "install.py"
        return subprocess.run(
            [sys.executable, str(script), action, "--root", str(root), *words],
            capture_output=True,
            text=True,
            env={**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"},
            check=False,
        )

    return act


def program_says(root: Path) -> str:
    told = subprocess.run([str(root / "opt/spot-rl/current/venv/bin/spot-rl")], capture_output=True, text=True)
    return told.stdout.strip()


def files_under(root: Path) -> set[str]:
    return {str(path.relative_to(root)) for path in root.rglob("*") if path.is_file() or path.is_symlink()}


@pytest.mark.slow
def test_install_upgrade_roll_back_uninstall(act: Install, bundle: Callable[..., Path], root: Path) -> None:
    first, second = bundle("0.1.0"), bundle("0.2.0")
    told = act("install", first)
    assert told.returncode == 0, told.stderr
    assert program_says(root) == "spot-rl 0.1.0"
    assert (root / "etc/systemd/system/spot-rl.service").read_text() == (DEPLOY / "spot-rl.service").read_text()
    assert (root / "etc/spot-rl/credentials.yaml").stat().st_mode & 0o777 == 0o600
    assert (root / "opt/spot-rl/current/share/deploy.md").is_file()
    (root / "etc/spot-rl/run.yaml").write_text("mine\n")
    (root / "var/log/spot-rl").mkdir(parents=True)
    (root / "var/log/spot-rl/run.mcap").write_bytes(b"log")

    told = act("upgrade", second)
    assert told.returncode == 0, told.stderr
    assert program_says(root) == "spot-rl 0.2.0"
    assert (root / "etc/spot-rl/run.yaml").read_text() == "mine\n"
    assert act("install", second).stderr.startswith("install.py: version 0.2.0-")

    assert act("rollback").returncode == 0
    assert program_says(root) == "spot-rl 0.1.0"
    assert act("rollback").returncode == 0
    assert program_says(root) == "spot-rl 0.2.0"
    lines = act("status").stdout.splitlines()
    assert [line.partition("-")[0] for line in lines] == ["current: 0.2.0", "previous: 0.1.0"]

    # A third version drops the first; one that does not run changes nothing.
    assert act("install", bundle("0.3.0")).returncode == 0
    versions = root / "opt/spot-rl/versions"
    assert sorted(path.name.partition("-")[0] for path in versions.iterdir()) == ["0.2.0", "0.3.0"]
    before = files_under(root)
    told = act("install", bundle("0.4.0", prints="something else"))
    assert told.returncode != 0
    assert "does not run: something else; nothing was switched" in told.stderr
    assert files_under(root) == before
    assert program_says(root) == "spot-rl 0.3.0"

    assert act("uninstall").returncode == 0
    assert files_under(root) == {"var/log/spot-rl/run.mcap"}
    assert act("uninstall", None, "--logs").returncode == 0
    assert files_under(root) == set()


def test_folders_of_the_system_that_were_made_go_and_others_stay(
    act: Install, bundle: Callable[..., Path], root: Path
) -> None:
    for name in ("opt", "etc/systemd/system", "var/lib/systemd/timers", "var/log"):
        (root / name).mkdir(parents=True)
    before, first, second = {*root.rglob("*")}, bundle("0.1.0"), bundle("0.2.0")
    for folder in (first, second):  # an upgrade must not forget what the first installation made
        assert act("install", folder).returncode == 0
    assert (root / "etc/sysusers.d/spot-rl.conf").is_file()
    (root / "var/lib/systemd/timers/stamp-spot-rl-logs.timer").touch()  # as systemd does once the timer is enabled
    (root / "etc/tmpfiles.d/of-somebody-else.conf").touch()
    assert act("uninstall", None, "--logs").returncode == 0
    assert {*root.rglob("*")} - before == {root / "etc/tmpfiles.d", root / "etc/tmpfiles.d/of-somebody-else.conf"}


@pytest.mark.parametrize("state", ["active", "activating", "deactivating"])
def test_nothing_changes_under_a_running_service(
    act: Install, bundle: Callable[..., Path], root: Path, programs: Path, state: str
) -> None:
    say_state(programs, state)
    for action in ("install", "rollback", "uninstall"):
        told = act(action, bundle("0.1.0") if action == "install" else None)
        assert told.returncode != 0
        assert f"spot-rl.service is {state}; stop it first" in told.stderr
    assert not root.exists()


def test_a_file_that_was_changed_on_the_way_is_refused(act: Install, bundle: Callable[..., Path], root: Path) -> None:
    folder = bundle("0.1.0")
    (wheel,) = (folder / "wheels").glob("spot_rl-*.whl")
    wheel.write_bytes(wheel.read_bytes() + b"x")
    told = act("install", folder)
    assert "is missing or not what was built; copy the whole folder again" in told.stderr
    assert not root.exists()


def test_a_wheel_without_the_recorded_digest_is_refused_by_pip_too(
    act: Install, bundle: Callable[..., Path], root: Path
) -> None:
    folder = bundle("0.1.0")
    requirements = folder / "requirements.txt"
    requirements.write_text("spot-rl==0.1.0 --hash=sha256:" + "0" * 64 + "\n")
    manifest = json.loads((folder / "manifest.json").read_text())
    manifest["sha256"]["requirements.txt"] = hashlib.sha256(requirements.read_bytes()).hexdigest()
    (folder / "manifest.json").write_text(json.dumps(manifest))
    told = act("install", folder)
    assert "pip refused the wheels, see above; nothing was switched" in told.stderr
    assert not (root / "opt/spot-rl/current").is_symlink()


@pytest.mark.parametrize("about", [{"python": "3.9"}, {"machine": "riscv64"}])
def test_a_bundle_for_another_computer_is_refused(
    act: Install, bundle: Callable[..., Path], about: dict[str, str]
) -> None:
    assert "this bundle is for Python" in act("install", bundle("0.1.0", **about)).stderr


def test_no_bundle_and_no_version_before(act: Install, tmp_path: Path) -> None:
    told = act("install", None, "--bundle", str(tmp_path))
    assert "is no bundle of build_wheelhouse.py" in told.stderr
    assert "there is no version to return to" in act("rollback").stderr
