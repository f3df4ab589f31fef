"""Boot a Debian-like root with its own systemd; install the service there, walk, hang, kill, upgrade, remove it.

    sudo .venv/bin/python scripts/try_systemd.py --root ROOT --python PYTHON --scratch DIR [--nspawn FILE] BUNDLE NEWER

ROOT is a root that debootstrap made with systemd and dbus, and that holds PYTHON, of the bundles' version. It is
changed, so give a copy. systemd-nspawn boots it: processes, mounts, /tmp and the network are its own, but for the
loopback that it shares with a fake robot beside it. systemd of this computer is neither asked nor touched.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import grpc

from fake_robot.start.process import FakeAddress, FakeProcess
from spot_protos import fake_admin_pb2
from spot_protos.stub import stub

REPOSITORY = Path(__file__).resolve().parent.parent
INSIDE = "SPOT_RL_TRY_SYSTEMD_INSIDE"
GROUP = "spot-rl-trial"
PROGRAM = "/opt/spot-rl/current/venv/bin/spot-rl"
PATIENCE_S = 120.0
TRIES = 4
DROP_IN = """\
# This container cannot grant LimitRTPRIO and LimitMEMLOCK; the capability stands in for the first.
[Service]
CapabilityBoundingSet=CAP_SYS_NICE
AmbientCapabilities=CAP_SYS_NICE
"""


class Container:
    """A booted root."""

    def __init__(self, root: Path, nspawn: str) -> None:
        options = ["--boot", "--register=no", "--keep-unit", "--link-journal=no", "--console=pipe", "--machine=robot"]
        options += ["--settings=no", "--resolv-conf=off", "--timezone=off", f"--directory={root}"]
        environment = {**os.environ, "SYSTEMD_NSPAWN_UNIFIED_HIERARCHY": "1", "SYSTEMD_NSPAWN_LOCK": "0"}
        self.root = root
        self._process = subprocess.Popen(
            [nspawn, *options], env=environment, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL
        )
        self.leader = 0
        wait_for(self._find_leader, "the container has a first process")
        wait_for(lambda: self.say("systemctl", "is-system-running") in ("running", "degraded"), "it has booted")

    def _find_leader(self) -> bool:
        pid = self._process.pid
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        self.leader = int(children[0]) if children else 0
        return bool(self.leader) and b"systemd" in Path(f"/proc/{self.leader}/cmdline").read_bytes()

    def run(self, *words: str, **options: Any) -> subprocess.CompletedProcess[str]:
        """Run a command inside, as root."""
        namespaces = ["--mount", "--uts", "--ipc", "--pid", "--cgroup", "--root", "--wd"]
        enter = ["nsenter", f"--target={self.leader}", *namespaces]
        environment = {"PATH": "/usr/sbin:/usr/bin:/sbin:/bin", "HOME": "/root", "LANG": "C.UTF-8"}
        return subprocess.run([*enter, *words], env=environment, capture_output=True, text=True, check=False, **options)

    def say(self, *words: str) -> str:
        """What a command inside prints."""
        return self.run(*words).stdout.strip()

    def must(self, *words: str) -> str:
        """The same, of a command that must succeed."""
        told = self.run(*words)
        if told.returncode != 0:
            journal = self.say("journalctl", "-u", "spot-rl", "-n", "60", "--no-pager", "-o", "cat")
            sys.exit(f"{' '.join(words)}: {told.returncode}: {told.stdout}{told.stderr}\n{journal}")
        return told.stdout.strip()

    def show(self, name: str) -> str:
        """A property of the unit."""
        return self.say("systemctl", "show", "spot-rl", "--value", "--property", name)

    def ctl(self, *words: str) -> str:
        """An operator's command."""
        return self.must(PROGRAM, "ctl", *words)

    def status(self) -> dict[str, Any]:
        """The service's status."""
        return dict(json.loads(self.ctl("status", "--json")))

    def control_process(self) -> int:
        """The process that controls the robot, as numbered out here."""
        return next(p for p in self.processes() if b"operator.run.run_child" in _command_line(p))

    def processes(self) -> list[int]:
        """All processes of the installed program, as numbered out here."""
        found = [int(folder.name) for folder in Path("/proc").iterdir() if folder.name.isdecimal()]
        return [pid for pid in found if b"/opt/spot-rl/" in _command_line(pid)]

    def close(self) -> None:
        """Power it off."""
        self.run("systemctl", "poweroff")
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(60.0)
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()


def _command_line(pid: int) -> bytes:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return b""


def files(root: Path) -> set[str]:
    """Every file, folder and link, but for what the kernel shows and what Python caches."""
    found = set()
    for folder, folders, names in os.walk(root):
        folders[:] = [f for f in folders if f != "__pycache__" and Path(folder, f) not in (root / "proc", root / "sys")]
        found |= {str(Path(folder, name).relative_to(root)) for name in [*folders, *names]}
    return found


@contextlib.contextmanager
def robot(folder: Path) -> Iterator[tuple[FakeAddress, Any]]:
    """A fake robot outside the container, on the loopback of this network namespace."""
    with FakeProcess(fifo_priority=30, state_dir=folder) as fake, grpc.insecure_channel(fake.address.admin) as channel:
        yield fake.address, stub(channel, fake_admin_pb2)


def wait_for(is_so: Callable[[], bool], what: str) -> float:
    """Wait. Returns the seconds; ends the program where it does not come."""
    began_s = time.monotonic()
    while not is_so():
        if time.monotonic() - began_s > PATIENCE_S:
            sys.exit(f"waited {PATIENCE_S:g} s in vain until {what}")
        time.sleep(0.1)
    return round(time.monotonic() - began_s, 2)


def fill_in(box: Container, fake: FakeAddress) -> None:
    """What a person fills in after the installation."""
    settings = box.root / "etc/spot-rl"
    shutil.copy(REPOSITORY / "policies/walk.onnx", box.root / "var/lib/spot-rl/policies")
    shutil.copyfile(fake.ca_file, settings / "ca.pem")
    text = (settings / "spot-rl.env").read_text().replace("192.168.50.3", fake.robot)
    (settings / "spot-rl.env").write_text(text.replace("#SPOT_RL_CA_FILE", "SPOT_RL_CA_FILE"))
    user, password = (fake.environment[f"BOSDYN_CLIENT_{name}"] for name in ("USERNAME", "PASSWORD"))
    (settings / "credentials.yaml").write_text(json.dumps({"username": user, "password": password}))
    run = settings / "run.yaml"
    run.write_text(run.read_text().replace("attendance_s: 10.0", "attendance_s: 60.0"))  # commands start one by one


def walk(box: Container) -> dict[str, Any]:
    """An operator walks the robot for three seconds. Returns figures of the run.

    On a busy computer a run may end in ``state_stale``, as it should; then it is tried again, and that is told.
    """
    ended: list[str] = []
    while len(ended) < TRIES:
        wait_for(lambda: box.status()["state"] == "idle", "the service is idle")
        box.ctl("arm", "walk", "--operator", "try_systemd")
        box.ctl("start")
        walked = box.run(PROGRAM, "ctl", "velocity", "0.5", "--for", "3")
        status = box.status()
        if walked.returncode == 0 and status["state"] == "running":
            figures = ("mode", "rate_hz", "skipped_ticks", "state_age_p99_s", "compute_p50_s")
            return {"tries that ended": ended, **{name: status["run"].get(name) for name in figures}}
        ended.append(status.get("last", {}).get("outcome", walked.stderr.strip()))
    sys.exit(f"no walk in {TRIES} tries: {ended}")


def life(box: Container, python: str, bundles: tuple[Path, Path], scratch: Path) -> Iterator[tuple[str, object]]:
    """The whole life of an installation, step by step: what was done, what was seen."""
    before = files(box.root)
    yield "systemd", box.say("systemctl", "--version").splitlines()[0]
    with robot(scratch) as (fake, admin):

        def left() -> dict[str, object]:
            status = admin.GetStatus(fake_admin_pb2.GetStatusRequest())
            truth = admin.GetTruth(fake_admin_pb2.GetTruthRequest())
            return {
                "motor_power": status.motor_power,
                "lease_owner": status.lease_owner,
                "body_height_m": round(truth.body_height_m, 3),
                "fastest_joint_rad_s": round(max(map(abs, truth.joint_velocity_rad_s)), 3),
            }

        def is_off() -> bool:
            return left()["motor_power"] == "off"

        def is_idle_again() -> bool:
            return box.show("ActiveState") == "active" and box.status()["state"] == "idle"

        for bundle in bundles:
            shutil.copytree(bundle, box.root / "opt" / bundle.parent.name)
        older, newer = (f"/opt/{bundle.parent.name}/install.py" for bundle in bundles)
        yield "install", box.must(python, older, "install").splitlines()
        yield "user", box.must("id", "spot-rl")
        fill_in(box, fake)
        limit = int(box.must("sh", "-c", "grep 'Max realtime priority' /proc/1/limits").split()[-1])
        if limit < 40:
            folder = box.root / "etc/systemd/system/spot-rl.service.d"
            folder.mkdir()
            (folder / "trial.conf").write_text(DROP_IN)
            box.must("systemctl", "daemon-reload")
        yield "rights", "as in the unit" if limit >= 40 else "CAP_SYS_NICE in place of LimitRTPRIO, memory not locked"
        yield "verify", box.run("systemd-analyze", "verify", "/etc/systemd/system/spot-rl.service").stderr.strip()
        began_s = time.monotonic()
        box.must("systemctl", "start", "spot-rl")
        yield "start_s", round(time.monotonic() - began_s, 2)
        yield "after_start", {n: box.show(n) for n in ("ActiveState", "StatusText", "WatchdogUSec", "NRestarts")}
        yield "state", box.status()["state"]
        yield "security", box.say("systemd-analyze", "security", "spot-rl").splitlines()[-1]
        yield "walk", walk(box)
        told = Path(f"/proc/{box.control_process()}/status").read_text().splitlines()
        wanted = ("Uid", "CapEff", "NoNewPrivs", "Seccomp", "VmLck")
        yield "control_process", [" ".join(line.split()) for line in told if line.split(":")[0] in wanted]
        yield "stop", box.ctl("stop", "--wait").splitlines()[-1]
        entry = json.loads(box.must("journalctl", "-u", "spot-rl", "SPOT_RL_EVENT=stop", "-o", "json", "-n", "1"))
        yield "journal_fields", sorted(k for k in entry if k.startswith("SPOT_RL"))

        yield "walk before it hangs", walk(box)
        os.kill(box.control_process(), signal.SIGSTOP)
        journal = ("journalctl", "-u", "spot-rl", "--no-pager")
        seen_s = wait_for(lambda: box.say(*journal, "-q", "--grep", "Watchdog timeout") != "", "watchdog")
        yield "hung: systemd saw it after s", seen_s
        yield "hung: motors off after s more", wait_for(is_off, "the motors are off")
        yield "hung: robot", left()
        yield "hung: idle again after s more", wait_for(is_idle_again, "the service is idle again")
        yield "hung: restarts", box.show("NRestarts")
        lines = box.say(*journal, "-o", "cat").splitlines()
        marks = ("is safe", "atchdog", "Fatal Python", "recovered")
        yield "hung: journal", [line for line in lines if any(mark in line for mark in marks)]

        yield "walk before the service is killed", walk(box)
        box.must("systemctl", "kill", "--kill-who=main", "--signal=SIGKILL", "spot-rl")
        yield "service killed: motors off after s", wait_for(is_off, "the motors are off")
        yield "service killed: idle again after s more", wait_for(is_idle_again, "the service is idle again")
        yield "service killed: robot", left()

        yield "walk before the control process is killed", walk(box)
        os.kill(box.control_process(), signal.SIGKILL)
        yield "control process killed: motors off after s", wait_for(is_off, "the motors are off")
        wait_for(is_idle_again, "the service is idle again")
        yield "control process killed: told", box.status()["last"]["sentence"]

        yield "upgrade while it runs", box.run(python, newer, "install").stderr.strip()
        yield "walk before it is stopped", walk(box)
        began_s = time.monotonic()
        box.must("systemctl", "stop", "spot-rl")
        yield "stopped while walking, s", round(time.monotonic() - began_s, 2)
        yield "stopped: robot", left()
        yield "stopped: logs", sorted(p.suffix for p in (box.root / "var/log/spot-rl").glob("*.mcap*"))

        yield "upgrade", box.must(python, newer, "install").splitlines()
        box.must("systemctl", "start", "spot-rl")
        yield "upgraded: state", box.status()["state"]
        box.must("systemctl", "stop", "spot-rl")
        yield "rollback", box.must(python, newer, "rollback")
        box.must("systemctl", "enable", "--now", "spot-rl")
        yield "rolled back: state", box.status()["state"]
        box.must("systemctl", "start", "spot-rl-logs.service")
        box.must("systemctl", "enable", "--now", "spot-rl-logs.timer")
        box.must("systemctl", "stop", "spot-rl")
    yield "uninstall", box.must(python, newer, "uninstall", "--logs")
    shutil.rmtree(box.root / "etc/systemd/system/spot-rl.service.d", ignore_errors=True)
    for bundle in bundles:
        shutil.rmtree(box.root / "opt" / bundle.parent.name)
    yield "left running", box.processes()
    yield "left failed", box.say("systemctl", "--failed", "--no-legend")
    yield "left user", box.run("id", "spot-rl").stderr.strip()
    yield "left behind", sorted(files(box.root) - before)


def set_apart() -> None:
    """A control group of our own, for whatever systemd-nspawn makes below it."""
    top = Path("/sys/fs/cgroup")
    tops = [top] if (top / "cgroup.procs").exists() else [top / "systemd", top / "unified"]
    for folder in (t / GROUP for t in tops if t.is_dir()):
        folder.mkdir(exist_ok=True)
        (folder / "cgroup.procs").write_text(str(os.getpid()))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--root", type=Path, required=True)
    parser.add_argument("--python", required=True, help="the Python inside, as a path")
    parser.add_argument("--scratch", type=Path, required=True, help="folder for the fake robot's certificates")
    parser.add_argument("--nspawn", default="systemd-nspawn")
    parser.add_argument("bundle", type=Path)
    parser.add_argument("newer", type=Path)
    chosen = parser.parse_args()
    if os.environ.get(INSIDE) != "1":
        os.environ[INSIDE] = "1"
        words = ["unshare", "--net", "--mount", "--propagation", "private", sys.executable]
        os.execvp(words[0], [*words, *sys.argv])  # noqa: S606 - the same program, set apart
    root = chosen.root.resolve()
    if root == Path("/"):
        sys.exit("--root is this computer's own; give a copy of another")
    set_apart()
    # systemd-nspawn leaves folders there.
    subprocess.run(["mount", "-t", "tmpfs", "tmpfs", "/run"], check=True)
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    box = Container(root, chosen.nspawn)
    try:
        for name, value in life(box, chosen.python, (chosen.bundle, chosen.newer), chosen.scratch):
            print(f"{name}: {json.dumps(value, ensure_ascii=False)}", flush=True)
    finally:
        box.close()


if __name__ == "__main__":
    main()
