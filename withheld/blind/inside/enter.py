"""Enter namespaces in which only a few folders exist, then run a program there.

    python enter.py SPEC.json

``SPEC.json``: ``read_only`` (host path, path inside), ``optional`` (paths, where they can be shown), ``hidden``
(folders that appear empty), ``writable`` (host path, path inside), ``root`` (an empty folder to build on), ``user``
(number to become, where allowed), ``words`` (the program), ``environment``. Leaves with the program's code, or with 90
where the kernel does not allow namespaces.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import platform
import signal
import sys
from pathlib import Path
from typing import Any

NOT_ALLOWED = 90
NEW_MOUNTS, NEW_UTS, NEW_IPC, NEW_USER, NEW_PIDS, NEW_NETWORK = (
    0x20000,
    0x4000000,
    0x8000000,
    0x10000000,
    0x20000000,
    0x40000000,
)
READ_ONLY, NO_SUID, NO_DEVICES, REMOUNT, BIND, RECURSIVE, PRIVATE = 1, 2, 4, 32, 4096, 16384, 1 << 18
DETACH = 2
DIE_WITH_PARENT, NO_NEW_PRIVILEGES = 1, 38
PIVOT_ROOT = {"x86_64": 155, "aarch64": 41}

libc = ctypes.CDLL(None, use_errno=True)


def check(result: int, what: str) -> None:
    """Raise the system's error of a call that failed."""
    if result != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"{what}: {os.strerror(number)}")


def mount(source: str, target: str, kind: str | None, flags: int, data: str | None = None) -> None:
    """The system call of that name."""
    words = [w.encode() if w is not None else None for w in (source, target, kind)]
    check(libc.mount(*words, ctypes.c_ulong(flags), data.encode() if data else None), f"mount {target}")


def separate() -> None:
    """Leave the host's namespaces; an ordinary user first becomes root of a namespace of its own."""
    flags = NEW_MOUNTS | NEW_UTS | NEW_IPC | NEW_PIDS | NEW_NETWORK
    uid, gid = os.getuid(), os.getgid()
    if uid == 0 and libc.unshare(flags) == 0:
        return
    check(libc.unshare(flags | NEW_USER), "unshare")
    Path("/proc/self/setgroups").write_text("deny")
    Path("/proc/self/uid_map").write_text(f"0 {uid} 1")
    Path("/proc/self/gid_map").write_text(f"0 {gid} 1")


def bind(source: str, target: str, *, writable: bool) -> None:
    """Show a host's file or folder inside."""
    if Path(source).is_dir():
        Path(target).mkdir(parents=True, exist_ok=True)
    else:
        Path(target).parent.mkdir(parents=True, exist_ok=True)
        Path(target).touch()
    mount(source, target, None, BIND | RECURSIVE)
    if not writable:
        # A namespace of an ordinary user may refuse; the host's permissions protect the files then.
        with contextlib.suppress(OSError):
            mount("none", target, None, BIND | REMOUNT | READ_ONLY | NO_SUID)


def build(spec: dict[str, Any]) -> None:
    """Make the file system, and leave the host's."""
    root = spec["root"]
    mount("none", "/", None, RECURSIVE | PRIVATE)
    mount("tmpfs", root, "tmpfs", NO_SUID | NO_DEVICES, "mode=755")
    for name in ("tmp", "home", "proc", "dev/shm"):
        folder = Path(root, name)
        folder.mkdir(parents=True)
        folder.chmod(0o777)
    for source, inside in spec["read_only"]:
        bind(source, root + inside, writable=False)
    for path in spec["optional"]:
        with contextlib.suppress(OSError):
            bind(path, root + path, writable=False)
    for inside in spec["hidden"]:
        if Path(root + inside).is_dir():
            mount("tmpfs", root + inside, "tmpfs", READ_ONLY | NO_SUID | NO_DEVICES, "mode=000,size=0")
    for name in ("null", "zero", "random", "urandom"):
        bind(f"/dev/{name}", f"{root}/dev/{name}", writable=True)
    for source, inside in spec["writable"]:
        bind(source, root + inside, writable=True)
    old = Path(root, "host")
    old.mkdir()
    os.chdir(root)
    number = PIVOT_ROOT[platform.machine()]
    check(libc.syscall(number, str(root).encode(), str(old).encode()), "pivot_root")
    os.chdir("/")
    check(libc.umount2(b"/host", DETACH), "umount")
    Path("/host").rmdir()


def drop(user: int) -> None:
    """Become nobody, for good."""
    with contextlib.suppress(OSError):  # an ordinary user's namespace knows no other user
        os.setgroups([])
        os.setresgid(user, user, user)
        os.setresuid(user, user, user)
    check(libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0), "prctl")


def main() -> int:
    """Do it."""
    spec = json.loads(Path(sys.argv[1]).read_text())
    try:
        separate()
    except OSError as error:
        sys.stderr.write(f"{error}\n")
        return NOT_ALLOWED
    # Whoever started this may be killed; what runs inside must not outlive it.
    libc.prctl(DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
    child = os.fork()
    if child:
        _, status = os.waitpid(child, 0)
        return os.waitstatus_to_exitcode(status) % 256
    code = NOT_ALLOWED
    try:
        build(spec)
        drop(spec["user"])
        # The kernel forgets this whenever a process changes its user.
        libc.prctl(DIE_WITH_PARENT, signal.SIGKILL, 0, 0, 0)
        code = 1
        os.execve(spec["words"][0], spec["words"], spec["environment"])  # noqa: S606 - our own program
    except BaseException as error:  # noqa: BLE001 - a forked child must not return into its parent's code
        sys.stderr.write(f"{type(error).__name__}: {error}\n")
    os._exit(code)


if __name__ == "__main__":
    sys.exit(main())
