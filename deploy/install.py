"""Install, upgrade, roll back and remove the service on a robot's computer; offline, with the system's Python alone.

    sudo python3 install.py install      # from the folder that this file lies in; again with a newer one to upgrade
    sudo python3 install.py rollback     # back to the version before; again to return
    sudo python3 install.py status
    sudo python3 install.py uninstall    # keeps the logs; with --logs they go too

Nothing here starts, enables or restarts the service, and starting it moves nothing: only an operator who arms the robot
sets it in motion. While the service runs, everything but 'status' is refused.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NoReturn

BUNDLE = Path(__file__).resolve().parent
OPT = "opt/spot-rl"
CONFIGURATION, STATE, LOGS = "etc/spot-rl", "var/lib/spot-rl", "var/log/spot-rl"
USER = "spot-rl"
UNITS = ("spot-rl.service", "spot-rl-logs.service", "spot-rl-logs.timer")
SYSTEM_FILES = {
    **{unit: f"etc/systemd/system/{unit}" for unit in UNITS},
    "spot-rl.sysusers.conf": "etc/sysusers.d/spot-rl.conf",
    "spot-rl.tmpfiles.conf": "etc/tmpfiles.d/spot-rl.conf",
}
SETTINGS = {
    "spot-rl.env.example": ("spot-rl.env", 0o644),
    "run.yaml.example": ("run.yaml", 0o644),
    "credentials.yaml.example": ("credentials.yaml", 0o600),
}
TIMER_STAMP = "var/lib/systemd/timers/stamp-spot-rl-logs.timer"
RUNNING = ("active", "activating", "deactivating", "reloading")


def refuse(text: str) -> NoReturn:
    """End with one line."""
    sys.exit(f"install.py: {text}")


class Place:
    """The computer's files under a root, and its service manager."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.opt = root / OPT
        self.current, self.previous = self.opt / "current", self.opt / "previous"
        self.made = self.opt / "folders-made"

    @property
    def is_this_computer(self) -> bool:
        """Whether it is no scratch root."""
        return self.root == Path("/")

    def refuse_if_running(self) -> None:
        """End where a run goes on: its files must not change under it."""
        systemctl = shutil.which("systemctl")
        if systemctl is None:
            return
        told = subprocess.run([systemctl, "is-active", "spot-rl.service"], capture_output=True, text=True, check=False)
        if told.stdout.strip() in RUNNING:
            refuse(f"spot-rl.service is {told.stdout.strip()}; stop it first: systemctl stop spot-rl (the robot sits)")

    def system(self, *words: str) -> None:
        """Run a system's tool, on this computer alone; one that is not there is named."""
        if not self.is_this_computer:
            return
        if shutil.which(words[0]) is None:
            print(f"not done, for {words[0]} is not here: {' '.join(words)}")
        elif subprocess.run(words, check=False).returncode != 0:
            print(f"failed, do it by hand: {' '.join(words)}")

    def make_folder(self, folder: Path) -> None:
        """Make a folder of the system's where there is none, and remember that it was made."""
        missing = [p for p in (folder, *folder.parents) if not p.exists()]
        folder.mkdir(parents=True, exist_ok=True)
        with self.made.open("a", encoding="utf-8") as stream:
            stream.writelines(f"{p.relative_to(self.root)}\n" for p in missing)

    def made_folders(self) -> list[Path]:
        """The folders that were made, deepest first."""
        lines = self.made.read_text(encoding="utf-8").splitlines() if self.made.is_file() else []
        return sorted({self.root / line for line in lines}, key=lambda p: len(p.parts), reverse=True)

    def version_of(self, link: Path) -> str:
        """The version that a link names; empty where there is none."""
        return link.readlink().name if link.is_symlink() else ""

    def point(self, link: Path, version: str) -> None:
        """Set a link in one step: whoever looks sees the old or the new, never none."""
        unfinished = link.with_name(link.name + ".new")
        unfinished.unlink(missing_ok=True)
        unfinished.symlink_to(f"versions/{version}")
        unfinished.replace(link)


def read_manifest(bundle: Path) -> dict:
    """The bundle's manifest, after every file was compared with it."""
    try:
        manifest = json.loads((bundle / "manifest.json").read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        refuse(f"{bundle} is no bundle of build_wheelhouse.py: {error}")
    for name, digest in manifest["sha256"].items():
        path = bundle / name
        if not path.is_file() or hashlib.sha256(path.read_bytes()).hexdigest() != digest:
            refuse(f"{path} is missing or not what was built; copy the whole folder again")
    python = ".".join(map(str, sys.version_info[:2]))
    if (manifest["python"], manifest["machine"]) != (python, platform.machine()):
        wanted = f"Python {manifest['python']} on {manifest['machine']}"
        refuse(f"this bundle is for {wanted}, here is Python {python} on {platform.machine()}; take the other bundle")
    return manifest


def install(place: Place, bundle: Path) -> None:
    """Install the bundle's version beside what is there, try it, then switch to it."""
    manifest = read_manifest(bundle)
    place.refuse_if_running()
    version = str(manifest["version"])
    digest = hashlib.sha256((bundle / "requirements.txt").read_bytes()).hexdigest()[:8]
    name = f"{version}-{digest}"
    folder = place.opt / "versions" / name
    if place.version_of(place.current) == name:
        refuse(f"version {name} is installed already")
    if folder.exists():
        shutil.rmtree(folder)  # left by a try that was cut short, or the version before the one before
    try:
        make_environment(folder / "venv", bundle)
        (folder / "share").mkdir()
        shutil.copy(bundle / "deploy.md", folder / "share" / "deploy.md")
        program = folder / "venv" / "bin" / "spot-rl"
        told = subprocess.run([str(program), "--version"], capture_output=True, text=True, check=False)
        if told.returncode != 0 or version not in told.stdout:
            refuse(f"{program} does not run: {(told.stdout + told.stderr).strip()}; nothing was switched")
    except BaseException:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    before = place.version_of(place.current)
    copy_system_files(place, bundle)
    place.point(place.current, name)
    if before:
        place.point(place.previous, before)
    drop_other_versions(place)
    print(f"installed {name}" + (f"; {before} is kept, 'install.py rollback' returns to it" if before else ""))
    print(f"next: fill in {place.root / CONFIGURATION}, then read {place.current / 'share' / 'deploy.md'}")


def make_environment(folder: Path, bundle: Path) -> None:
    """A virtual environment with the bundle's wheels, each held to its digest. pip runs from its own wheel."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    pip = next((bundle / "wheels").glob("pip-*.whl"), None)
    if pip is None:
        refuse(f"{bundle / 'wheels'} holds no pip")
    words = [str(folder / "bin" / "python"), str(pip / "pip"), "install", "--quiet"]
    words += ["--no-index", "--find-links", str(bundle / "wheels"), "--require-hashes", "--no-deps"]
    words += ["--disable-pip-version-check", "--no-cache-dir", "-r", str(bundle / "requirements.txt")]
    # Settings of the computer's own pip, as another index, must not count here.
    environment = {k: v for k, v in os.environ.items() if not k.startswith(("PIP_", "PYTHON"))}
    if subprocess.run(words, env={**environment, "PIP_CONFIG_FILE": os.devnull}, check=False).returncode != 0:
        refuse("pip refused the wheels, see above; nothing was switched")


def copy_system_files(place: Place, bundle: Path) -> None:
    """Units, user and folders; settings only where there are none yet."""
    for source, destination in SYSTEM_FILES.items():
        path = place.root / destination
        place.make_folder(path.parent)
        path.write_bytes((bundle / source).read_bytes())
        path.chmod(0o644)
    settings = place.root / CONFIGURATION
    settings.mkdir(parents=True, exist_ok=True)
    for source, (name, mode) in SETTINGS.items():
        path = settings / name
        with contextlib.suppress(FileExistsError):
            descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
            with os.fdopen(descriptor, "wb") as stream:
                stream.write((bundle / source).read_bytes())
    place.system("systemd-sysusers", str(place.root / SYSTEM_FILES["spot-rl.sysusers.conf"]))
    place.system("systemd-tmpfiles", "--create", str(place.root / SYSTEM_FILES["spot-rl.tmpfiles.conf"]))
    place.system("systemctl", "daemon-reload")


def drop_other_versions(place: Place) -> None:
    """Keep two versions."""
    kept = {place.version_of(place.current), place.version_of(place.previous)}
    for folder in (place.opt / "versions").iterdir():
        if folder.name not in kept:
            shutil.rmtree(folder)


def rollback(place: Place) -> None:
    """Switch to the version before, and remember this one in its place."""
    place.refuse_if_running()
    current, previous = place.version_of(place.current), place.version_of(place.previous)
    if not previous or not (place.opt / "versions" / previous).is_dir():
        refuse("there is no version to return to")
    place.point(place.current, previous)
    place.point(place.previous, current)
    print(f"back at {previous}; {current} is kept")


def uninstall(place: Place, *, with_logs: bool) -> None:
    """Remove everything; the logs only if asked."""
    place.refuse_if_running()
    place.system("systemctl", "disable", "--now", "spot-rl-logs.timer", "spot-rl.service")
    for destination in (*SYSTEM_FILES.values(), TIMER_STAMP):
        (place.root / destination).unlink(missing_ok=True)
    for folder in place.made_folders():
        with contextlib.suppress(OSError):  # something of somebody else's lies in it by now
            folder.rmdir()
    for folder in (OPT, CONFIGURATION, STATE, *((LOGS,) if with_logs else ())):
        shutil.rmtree(place.root / folder, ignore_errors=True)
    place.system("systemctl", "daemon-reload")
    if place.is_this_computer and (place.root / LOGS).is_dir():
        place.system("chown", "-R", "root:root", str(place.root / LOGS))
    place.system("userdel", USER)
    left = place.root / LOGS
    print("removed" + (f"; the logs are in {left}" if left.is_dir() else ""))


def status(place: Place) -> None:
    """Say which versions are there."""
    for name, link in (("current", place.current), ("previous", place.previous)):
        print(f"{name}: {place.version_of(link) or 'none'}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("action", choices=("install", "upgrade", "rollback", "uninstall", "status"))
    parser.add_argument("--root", type=Path, default=Path("/"), help="install under another root, to look at it")
    parser.add_argument("--bundle", type=Path, default=BUNDLE, help="the folder that build_wheelhouse.py made")
    parser.add_argument("--logs", action="store_true", help="with uninstall: delete the logs too")
    chosen = parser.parse_args()
    place = Place(chosen.root.resolve())
    if place.is_this_computer and chosen.action != "status" and os.geteuid() != 0:
        refuse("needs root: sudo python3 install.py ...")
    if chosen.action in ("install", "upgrade"):
        install(place, chosen.bundle.resolve())
    elif chosen.action == "rollback":
        rollback(place)
    elif chosen.action == "uninstall":
        uninstall(place, with_logs=chosen.logs)
    else:
        status(place)


if __name__ == "__main__":
    main()
