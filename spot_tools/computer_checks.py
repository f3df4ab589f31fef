"""Checks of this computer: Python, packages, CPUs, rights, disk, policy."""

from __future__ import annotations

import ctypes
import importlib.metadata
import os
import platform
import re
import shutil
import sys
from pathlib import Path
from typing import Final

from spot_model.policy.policy import load_policy
from spot_runtime.config import RunConfig
from spot_runtime.rescue.lease_note import HeldNote, LeaseNoteError, NoteHeldError, note_folder
from spot_tools.checks import DoctorCheck, Finding, fail, ok, skipped, warn

MACHINES: Final = ("x86_64", "aarch64")
GB: Final = 1e9
DISK_FAIL_GB: Final = 1.0
DISK_WARN_GB: Final = 10.0
"""A raw log takes about 1 GB an hour."""

_PIN: Final = re.compile(r"^([A-Za-z0-9_.-]+)==([^ ;]+)(.*)$")


class Host:
    """What the checks ask of this computer; a test gives another one. Every question leaves it as it was."""

    def __init__(self, root: Path = Path("/")) -> None:
        """Read ``/sys`` and ``/proc`` under ``root``."""
        self._root = root

    def python_version(self) -> tuple[int, int, int]:
        """Major, minor, micro."""
        return sys.version_info[0], sys.version_info[1], sys.version_info[2]

    def machine(self) -> str:
        """The processor's architecture, as ``aarch64``."""
        return platform.machine()

    def text(self, path: str) -> str | None:
        """The content of a file under the root, stripped; None where it cannot be read."""
        try:
            return (self._root / path).read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError):
            return None

    def texts(self, pattern: str) -> dict[str, str]:
        """Content of every file that matches, by its path under the root."""
        found = {str(path.relative_to(self._root)): "" for path in sorted(self._root.glob(pattern))}
        return {path: text for path in found if (text := self.text(path)) is not None}

    def requirements(self, package: str) -> list[str]:
        """Requirement lines of an installed package; empty where it is not installed."""
        try:
            return importlib.metadata.requires(package) or []
        except importlib.metadata.PackageNotFoundError:
            return []

    def installed_version(self, package: str) -> str | None:
        """An installed package's version."""
        try:
            return importlib.metadata.version(package)
        except importlib.metadata.PackageNotFoundError:
            return None

    def fifo_refusal(self, priority: int) -> str:
        """Why SCHED_FIFO is refused; empty where it is granted. Asked for and given back at once."""
        policy, parameter = os.sched_getscheduler(0), os.sched_getparam(0)
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
        except OSError as error:
            return error.strerror or str(error)
        os.sched_setscheduler(0, policy, parameter)
        return ""

    def memory_lock_refusal(self) -> str:
        """Why locking all memory is refused; empty where it is granted. Locked and given back at once."""
        libc = ctypes.CDLL(None, use_errno=True)
        current_future_onfault = 1 | 2 | 4
        if libc.mlockall(current_future_onfault) != 0:
            return os.strerror(ctypes.get_errno())
        libc.munlockall()
        return ""

    def note_folder(self) -> Path:
        """Where a control process leaves its note of a lease."""
        return note_folder(os.environ)

    def usable_cpus(self) -> set[int]:
        """CPUs that this process may use."""
        return os.sched_getaffinity(0)

    def free_bytes(self, folder: Path) -> int | None:
        """Room on the disk of a folder that is there and writable; None where it is not."""
        if not folder.is_dir() or not os.access(folder, os.W_OK | os.X_OK):
            return None
        return shutil.disk_usage(folder).free


def checks_of_computer(host: Host, config: RunConfig, policy: Path | None) -> list[DoctorCheck]:
    """All of them, in the order in which to fix them."""
    real_time = config.real_time
    return [
        DoctorCheck("python", lambda: python(host)),
        DoctorCheck("packages", lambda: packages(host)),
        DoctorCheck("policy", lambda: policy_file(policy)),
        DoctorCheck("cpu governor", lambda: cpu_governor(host)),
        DoctorCheck("cpu isolation", lambda: cpu_isolation(host, real_time.cpu_affinity)),
        DoctorCheck("real-time priority", lambda: fifo(host, real_time.fifo_priority)),
        DoctorCheck("memory lock", lambda: memory_lock(host, is_wanted=real_time.lock_memory)),
        DoctorCheck("disk for logs", lambda: disk(host, config.log.directory)),
        DoctorCheck("left behind", lambda: left_behind(host.note_folder())),
    ]


def python(host: Host) -> Finding:
    """The interpreter is one that the runtime is made for."""
    version, machine = host.python_version(), host.machine()
    found = f"Python {'.'.join(map(str, version))} on {machine}"
    if version[:2] < (3, 10):
        return fail(found, "install Python 3.10, 3.11 or 3.12")
    if version[:2] > (3, 12):
        return warn(found, "the runtime is made for Python 3.10 to 3.12; use one of those")
    if machine not in MACHINES:
        return warn(found, f"the wheels are checked for {' and '.join(MACHINES)} only")
    return ok(found)


def packages(host: Host) -> Finding:
    """Every package of the runtime is installed at a pinned version."""
    allowed = runtime_pins(host.requirements("spot-rl"))
    if not allowed:
        return fail(
            "the package spot-rl is not installed", "install it: pip install '.[runtime]', or deploy/install.py"
        )
    missing, other = [], []
    for name, versions in allowed.items():
        there = host.installed_version(name)
        if there is None:
            missing.append(name)
        elif there not in versions:
            other.append(f"{name} {there} (made for {' or '.join(sorted(versions))})")
    if missing:
        return fail(f"missing: {', '.join(missing)}", "install the extra 'runtime', with the lock as constraints")
    if other:
        return warn(
            f"other versions: {', '.join(other)}", "install with: pip install -c requirements.lock '.[runtime]'"
        )
    return ok(f"{len(allowed)} packages at the versions of the lock")


def runtime_pins(requirements: list[str]) -> dict[str, set[str]]:
    """Versions that the runtime allows, by package: one for each Python where they differ."""
    pins: dict[str, set[str]] = {}
    for line in requirements:
        match = _PIN.match(line)
        if match is None:
            continue
        name, version, marker = match.groups()
        if "extra" not in marker or re.search(r"extra == ['\"]runtime['\"]", marker):
            pins.setdefault(name.lower(), set()).add(version)
    return pins


def policy_file(path: Path | None) -> Finding:
    """The policy's contract holds: order, scale, rate, and the stored pair that the network reproduces."""
    if path is None:
        return skipped("no policy was named; give --policy FILE")
    policy = load_policy(path)
    contract = policy.contract
    return ok(f"{contract.name}, {contract.rate_hz:g} Hz, sha256 {policy.sha256[:12]}; reproduces its stored pair")


def cpu_governor(host: Host) -> Finding:
    """No CPU sleeps its way down: a governor that saves power adds milliseconds of lateness."""
    governors = host.texts("sys/devices/system/cpu/cpu[0-9]*/cpufreq/scaling_governor")
    if not governors:
        return skipped("this kernel has no frequency governors (a virtual machine?)")
    slow = sorted({text for text in governors.values() if text != "performance"})
    if slow:
        advice = "set it to performance: sudo nvpmodel -m 0 && sudo jetson_clocks on a Jetson, else cpupower"
        return warn(f"{', '.join(slow)} on some of {len(governors)} CPUs", advice)
    return ok(f"performance on all {len(governors)} CPUs")


def cpu_isolation(host: Host, affinity: tuple[int, ...]) -> Finding:
    """The CPUs that are asked for may be used, and the kernel keeps others off them."""
    if not affinity:
        return skipped("real_time.cpu_affinity names no CPUs, so none need be isolated")
    usable = host.usable_cpus()
    outside = sorted(set(affinity) - usable)
    if outside:
        return fail(f"CPUs {outside} may not be used; usable: {sorted(usable)}", "mend real_time.cpu_affinity")
    isolated = cpu_list(host.text("sys/devices/system/cpu/isolated") or "")
    shared = sorted(set(affinity) - isolated)
    if shared:
        names = ",".join(map(str, shared))
        return warn(f"CPUs {shared} are not isolated", f"add isolcpus={names} to the kernel's command line")
    return ok(f"CPUs {sorted(affinity)} are isolated")


def cpu_list(text: str) -> set[int]:
    """The kernel's list format: ``2-3,6`` is {2, 3, 6}."""
    cpus: set[int] = set()
    for part in filter(None, text.split(",")):
        low, _, high = part.partition("-")
        cpus.update(range(int(low), int(high or low) + 1))
    return cpus


def fifo(host: Host, priority: int) -> Finding:
    """SCHED_FIFO is granted; without it states are used several milliseconds later under load."""
    if priority == 0:
        return warn("real_time.fifo_priority is 0, so none is asked for", "set it to 40 on a robot's computer")
    refusal = host.fifo_refusal(priority)
    if refusal:
        grant = f"run as the service (LimitRTPRIO={priority}), or grant rtprio in /etc/security/limits.d"
        return warn(f"SCHED_FIFO {priority} is refused: {refusal}", grant)
    budget = host.text("proc/sys/kernel/sched_rt_runtime_us")
    if budget == "-1":
        return warn("granted, but the kernel bounds no real-time process", "sysctl kernel.sched_rt_runtime_us=950000")
    return ok(f"SCHED_FIFO {priority} is granted")


def memory_lock(host: Host, *, is_wanted: bool) -> Finding:
    """Memory may be locked, so that no page fault waits for a disk."""
    if not is_wanted:
        return skipped("real_time.lock_memory is off")
    refusal = host.memory_lock_refusal()
    if refusal:
        grant = "run as the service (LimitMEMLOCK=infinity), or grant memlock in /etc/security/limits.d"
        return warn(f"locking memory is refused: {refusal}", grant)
    return ok("all memory may be locked")


def disk(host: Host, folder: Path) -> Finding:
    """Logs have a place and room."""
    existing = next((path for path in (folder.absolute(), *folder.absolute().parents) if path.exists()), Path("/"))
    free = host.free_bytes(existing)
    if free is None:
        return fail(
            f"{existing} is not writable", f"make {folder} writable for this user, or name another log.directory"
        )
    found = f"{free / GB:.1f} GB free under {folder}"
    if free < DISK_FAIL_GB * GB:
        return fail(found, f"make room: at least {DISK_FAIL_GB:g} GB")
    if free < DISK_WARN_GB * GB:
        return warn(found, f"an hour takes about 1 GB; better {DISK_WARN_GB:g} GB: spot-rl prune-logs, or another disk")
    return ok(found)


def left_behind(folder: Path) -> Finding:
    """No control process of this computer died before its robot was at rest."""
    robots, live = [], []
    for path in sorted(folder.glob("lease-*.json")) if folder.is_dir() else []:
        try:
            found = HeldNote.find(path)
        except NoteHeldError:
            live.append(path.name)
            continue
        except LeaseNoteError as error:  # no reason to keep a service from starting
            return warn(str(error), "see to the robot, then delete the file")
        if found is not None:
            found[0].let_go()
            robots.append(found[1].robot)
    if robots:
        advice = f"see to it; then: spot-rl make-safe --robot {robots[0]} (a service that starts does so, too)"
        return warn(f"a control process died with the robot in hand: {', '.join(robots)}", advice)
    return ok("every robot was brought to rest" if not live else f"{len(live)} in hand now")
