"""Install the service in a Debian-like root without a network, use it, upgrade it, remove it; print what was seen.

    sudo .venv/bin/python scripts/try_install.py --root ROOT --python PYTHON --scratch DIR BUNDLE NEWER_BUNDLE

ROOT is a root that debootstrap made and that holds PYTHON, of the bundles' version. It is changed, so give a copy.
Everything runs in namespaces of its own: no network but loopback, no other process, no mount of the host's. No systemd
runs: this program keeps its part of the notify protocol, as the unit asks, and touches nothing of the host.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import select
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import grpc

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_protos import fake_admin_pb2, fake_admin_pb2_grpc

REPOSITORY = Path(__file__).resolve().parent.parent
INSIDE = "SPOT_RL_TRY_INSTALL_INSIDE"
LIMITS = ["prlimit", "--rtprio=40", "--memlock=unlimited", "--core=0"]
PROGRAM = "/opt/spot-rl/current/venv/bin/spot-rl"


class Unit:
    """What the installed unit says, as far as this program keeps it."""

    def __init__(self, root: Path) -> None:
        self.lines: dict[str, list[str]] = {}
        for line in (root / "etc/systemd/system/spot-rl.service").read_text().splitlines():
            key, equals, value = line.partition("=")
            if equals and not line.startswith("#"):
                self.lines.setdefault(key, []).append(value)
        self.environment = dict(word.split("=", 1) for word in self.lines["Environment"][0].split())
        for line in (root / "etc/spot-rl/spot-rl.env").read_text().splitlines():
            if "=" in line and not line.startswith("#"):
                self.environment.update([line.split("=", 1)])

    def command(self, key: str) -> list[str]:
        """One command line, with its variables put in."""
        line = self.lines[key][0]
        for name, value in self.environment.items():
            line = line.replace("${" + name + "}", value)
        return line.split()


class Manager:
    """Starts the service as the unit says and keeps the watchdog."""

    def __init__(self, root: Path) -> None:
        self.root, self.unit = root, Unit(root)
        self.watchdog_s = float(self.unit.lines["WatchdogSec"][0])
        self.notify = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        path = root / "run/notify"
        path.unlink(missing_ok=True)
        self.notify.bind(str(path))
        path.chmod(0o777)
        self.process: subprocess.Popen[bytes] | None = None
        self.fed_s = 0.0
        # A container may not have the right to grant what systemd grants; then the capability stands in for it.
        self.grants_limits = subprocess.run([*LIMITS, "true"], capture_output=True, check=False).returncode == 0

    def start(self) -> float:
        """Start and wait until it is ready. Returns the seconds that took, the checks before it included."""
        began_s = time.monotonic()
        self._run(self.unit.command("ExecStartPre")).check_returncode()
        self.process = subprocess.Popen(  # a process group, as a control group
            self._words(self.unit.command("ExecStart")),
            env=self._environment(),
            start_new_session=True,
        )
        while "READY=1" not in self.listen(60.0):
            pass
        return time.monotonic() - began_s

    def listen(self, timeout_s: float) -> str:
        """The next message; a watchdog's feed is noted. Ends the program when none comes."""
        if not select.select([self.notify], [], [], timeout_s)[0]:
            sys.exit(f"the service said nothing for {timeout_s:g} s")
        message = self.notify.recv(4096).decode()
        if message == "WATCHDOG=1":
            self.fed_s = time.monotonic()
        return message

    def watch(self, seconds: float) -> bool:
        """Listen for so long. Returns whether the watchdog was fed all the time."""
        until_s = time.monotonic() + seconds
        self.fed_s = max(self.fed_s, time.monotonic() - self.watchdog_s / 2)
        while time.monotonic() < until_s:
            if select.select([self.notify], [], [], 0.05)[0]:
                self.listen(0.0)
            if time.monotonic() - self.fed_s > self.watchdog_s:
                return False
        return True

    def abort(self) -> None:
        """What systemd does when the watchdog is not fed: SIGABRT to every process of the unit, then SIGKILL."""
        for number in (signal.SIGABRT, signal.SIGKILL):
            for pid in self.processes():
                with contextlib.suppress(ProcessLookupError):
                    os.kill(pid, number)
            time.sleep(1.0)
        if self.process is not None:
            self.process.wait()

    def stop(self) -> float:
        """SIGTERM to all, as KillMode=control-group. Returns the seconds until the last one was gone."""
        began_s = time.monotonic()
        for pid in self.processes():
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGTERM)
        if self.process is not None:
            self.process.wait(60.0)
        while self.processes():
            time.sleep(0.05)
        return time.monotonic() - began_s

    def processes(self) -> list[int]:
        """All processes of the installed program."""
        folders = [folder for folder in Path("/proc").iterdir() if folder.name.isdecimal()]
        return [int(folder.name) for folder in folders if b"/opt/spot-rl/" in _command_line(folder)]

    def control_process(self) -> int:
        """The process that controls the robot."""
        (pid,) = (p for p in self.processes() if b"operator.run_child" in _command_line(Path(f"/proc/{p}")))
        return pid

    def ctl(self, *words: str) -> str:
        """An operator's command."""
        told = self._run([PROGRAM, "ctl", *words], capture_output=True, text=True)
        if told.returncode != 0:
            sys.exit(f"ctl {' '.join(words)}: {told.stdout}{told.stderr}")
        return str(told.stdout)

    def _run(self, words: list[str], **options: object) -> subprocess.CompletedProcess[str]:
        return subprocess.run(  # type: ignore[call-overload,no-any-return]
            self._words(words), env=self._environment(), check=False, **options
        )

    def _words(self, words: list[str]) -> list[str]:
        umask = f'umask {self.unit.lines["UMask"][0]}; exec "$@"'
        command = ["/bin/sh", "-c", umask, "sh", *words]
        user = ["--reuid=spot-rl", "--regid=spot-rl", "--init-groups"]
        if self.grants_limits:
            return [*LIMITS, "chroot", str(self.root), "setpriv", *user, *command]
        capability = ["--inh-caps=+sys_nice", "--ambient-caps=+sys_nice"]
        return ["chroot", str(self.root), "setpriv", *user, *capability, *command]

    def _environment(self) -> dict[str, str]:
        return {
            **self.unit.environment,
            "PATH": "/usr/sbin:/usr/bin:/sbin:/bin",
            "HOME": "/var/lib/spot-rl",
            "NOTIFY_SOCKET": "/run/notify",
            "WATCHDOG_USEC": str(round(self.watchdog_s * 1e6)),
            "RUNTIME_DIRECTORY": "/run/spot-rl",
            "CREDENTIALS_DIRECTORY": "/run/credentials/spot-rl.service",
        }


def _command_line(folder: Path) -> bytes:
    try:
        return (folder / "cmdline").read_bytes()
    except OSError:
        return b""


def install(root: Path, python: str, bundle: Path, *words: str) -> tuple[str, float]:
    """Run the installer inside. Returns what it said, and the seconds."""
    place = root / "tmp/bundle"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(bundle, place)
    began_s = time.monotonic()
    told = subprocess.run(
        ["chroot", str(root), python, "/tmp/bundle/install.py", *words],  # noqa: S108 - inside the root
        capture_output=True,
        text=True,
        check=False,
    )
    took_s = time.monotonic() - began_s
    shutil.rmtree(place)
    if told.returncode != 0:
        sys.exit(f"install.py {' '.join(words)}: {told.stdout}{told.stderr}")
    return told.stdout, took_s


def prepare(root: Path, fake: FakeAddress) -> None:
    """What systemd-sysusers and systemd-tmpfiles would do, and what a person fills in."""
    subprocess.run(
        ["chroot", str(root), "useradd", "--system", "--user-group", "--home-dir", "/var/lib/spot-rl", "spot-rl"],
        check=True,
    )
    for line in (root / "etc/tmpfiles.d/spot-rl.conf").read_text().splitlines():
        words = line.split()
        if words and words[0] == "d":
            _, path, mode, user, group, _ = words
            subprocess.run(
                ["chroot", str(root), "install", "-d", "-m", mode, "-o", user, "-g", group, path], check=True
            )
    for path in ("/run/spot-rl", "/run/credentials/spot-rl.service"):
        subprocess.run(
            ["chroot", str(root), "install", "-d", "-m", "0750", "-o", "spot-rl", "-g", "spot-rl", path], check=True
        )
    shutil.copy(REPOSITORY / "policies/walk.onnx", root / "var/lib/spot-rl/policies")
    shutil.copyfile(fake.ca_file, root / "etc/spot-rl/ca.pem")
    settings = root / "etc/spot-rl/spot-rl.env"
    text = settings.read_text().replace("192.168.50.3", fake.robot).replace("#SPOT_RL_CA_FILE", "SPOT_RL_CA_FILE")
    settings.write_text(text)
    run = root / "etc/spot-rl/run.yaml"
    text = run.read_text().replace("estop: external", "estop: auto")
    run.write_text(text.replace("attendance_s: 10.0", "attendance_s: 60.0"))  # the commands below start one by one
    user, password = (fake.environment[f"BOSDYN_CLIENT_{name}"] for name in ("USERNAME", "PASSWORD"))
    credential = root / "run/credentials/spot-rl.service/spot-credentials"
    credential.write_text(json.dumps({"username": user, "password": password}))
    credential.chmod(0o400)
    subprocess.run(["chroot", str(root), "chown", "spot-rl:spot-rl", f"/{credential.relative_to(root)}"], check=True)


def walk(manager: Manager) -> None:
    """An operator walks the robot for three seconds."""
    manager.ctl("arm", "walk", "--operator", "try_install")
    manager.ctl("start")
    manager.ctl("velocity", "0.5", "--for", "3")


def files(root: Path) -> set[str]:
    """Every file, folder and link, but for what the kernel shows and what Python caches."""
    found = set()
    for folder, folders, names in os.walk(root):
        folders[:] = [f for f in folders if f != "__pycache__" and Path(folder, f) not in (root / "proc", root / "sys")]
        found |= {str(Path(folder, name).relative_to(root)) for name in [*folders, *names]}
    return found


@contextlib.contextmanager
def robot(folder: Path) -> Iterator[tuple[FakeAddress, fake_admin_pb2_grpc.FakeAdminStub]]:
    """A fake robot outside the root, on the loopback of this network namespace."""
    with FakeProcess(fifo_priority=30, state_dir=folder) as fake, grpc.insecure_channel(fake.address.admin) as channel:
        yield fake.address, fake_admin_pb2_grpc.FakeAdminStub(channel)


def try_all(root: Path, python: str, bundle: Path, newer: Path, scratch: Path) -> dict[str, object]:
    """The whole life of an installation."""
    seen: dict[str, object] = {}
    before = files(root)
    reach = "import socket; socket.create_connection(('192.0.2.1', 80), 3)"
    seen["network_inside"] = (
        subprocess.run(["chroot", str(root), python, "-c", reach], check=False, capture_output=True).returncode == 0
    )
    said, seen["install_s"] = install(root, python, bundle, "install")
    seen["installed_mb"] = _size_mb(root / "opt/spot-rl")
    with robot(scratch) as (fake, admin):
        prepare(root, fake)
        manager = Manager(root)
        seen["rights"] = "limits, as in the unit" if manager.grants_limits else "CAP_SYS_NICE in place of the limits"
        if not manager.grants_limits:
            run_file = root / "etc/spot-rl/run.yaml"
            run_file.write_text(run_file.read_text().replace("lock_memory: true", "lock_memory: false"))
        seen["start_s"] = manager.start()
        seen["state_after_start"] = json.loads(manager.ctl("status", "--json"))["state"]
        seen["watchdog_fed_while_idle"] = manager.watch(5.0)
        walk(manager)
        seen["watchdog_fed_while_walking"] = manager.watch(3.0)
        run = json.loads(manager.ctl("status", "--json"))["run"]
        seen["walk"] = {k: run.get(k) for k in ("mode", "rate_hz", "skipped_ticks", "state_age_p99_s", "compute_p50_s")}
        seen["end_of_walk"] = manager.ctl("stop", "--wait").splitlines()[-1]

        walk(manager)
        os.kill(manager.control_process(), signal.SIGSTOP)
        stopped_s = time.monotonic()
        seen["watchdog_fed_by_a_stopped_loop"] = manager.watch(10.0)
        seen["watchdog_fired_after_s"] = time.monotonic() - stopped_s
        manager.abort()
        truth = admin.GetTruth(fake_admin_pb2.GetTruthRequest())
        status = admin.GetStatus(fake_admin_pb2.GetStatusRequest())
        seen["robot_after_watchdog"] = {
            "mode": status.mode,
            "motor_power": status.motor_power,
            "body_height_m": round(truth.body_height_m, 3),
            "fastest_joint_rad_s": round(max(map(abs, truth.joint_velocity_rad_s)), 3),
        }
        seen["restart_s"] = manager.start()
        seen["state_after_restart"] = json.loads(manager.ctl("status", "--json"))["state"]
        seen["stop_s"] = manager.stop()
        seen["logs"] = sorted(path.suffix for path in (root / "var/log/spot-rl").glob("*.mcap*"))

        said, seen["upgrade_s"] = install(root, python, newer, "install")
        seen["upgrade"] = said.splitlines()[0 if said.startswith("installed") else -2]
        manager = Manager(root)
        manager.start()
        seen["state_after_upgrade"] = json.loads(manager.ctl("status", "--json"))["state"]
        manager.stop()
        said, seen["rollback_s"] = install(root, python, newer, "rollback")
        seen["rollback"] = said.strip()
    said, _ = install(root, python, newer, "uninstall", "--logs")
    for path in ("run/notify", "run/spot-rl", "run/credentials"):  # of this program, not of the installer
        target = root / path
        shutil.rmtree(target) if target.is_dir() else target.unlink(missing_ok=True)
    seen["left_behind"] = sorted(files(root) - before)
    return seen


def _size_mb(folder: Path) -> int:
    return round(sum(p.stat().st_size for p in folder.rglob("*") if p.is_file() and not p.is_symlink()) / 1e6)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--python", required=True, help="the Python inside, as a path")
    parser.add_argument("--scratch", type=Path, required=True, help="folder for the fake robot's certificates")
    parser.add_argument("bundle", type=Path)
    parser.add_argument("newer", type=Path)
    chosen = parser.parse_args()
    if os.environ.get(INSIDE) != "1":
        words = ["unshare", "--mount", "--net", "--pid", "--fork", "--kill-child", "--mount-proc", sys.executable]
        os.environ[INSIDE] = "1"
        os.execvp(words[0], [*words, *sys.argv])  # noqa: S606 - the same program, set apart
    root = chosen.root.resolve()
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    subprocess.run(["mount", "-t", "proc", "proc", str(root / "proc")], check=True)
    print(json.dumps(try_all(root, chosen.python, chosen.bundle, chosen.newer, chosen.scratch), indent=1))


if __name__ == "__main__":
    main()
