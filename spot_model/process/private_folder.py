"""A folder for a socket of our own, and a file for a secret, for this user alone; what a killed process left goes."""

from __future__ import annotations

import os
import shutil
import socket
import tempfile
from collections.abc import Mapping
from pathlib import Path


def make_private_folder(environment: Mapping[str, str], prefix: str, socket_name: str, kind: socket.SocketKind) -> Path:
    """Make a new folder whose name begins with ``prefix``, and remove those whose socket has no listener.

    Args:
        environment: Says where the unit's or the user's run-time folder is.
        prefix: Of such folders' names.
        socket_name: Of the socket in each.
        kind: Of that socket.
    """
    base = environment.get("RUNTIME_DIRECTORY", "").partition(":")[0] or environment.get("XDG_RUNTIME_DIR", "")
    base = base if os.access(base, os.W_OK) else tempfile.gettempdir()
    for left in Path(base).glob(f"{prefix}*"):
        if _is_left_behind(left / socket_name, kind):
            shutil.rmtree(left, ignore_errors=True)
    return Path(tempfile.mkdtemp(prefix=prefix, dir=base))


def new_private_file(place: Path) -> tuple[Path, int]:
    """A new file beside ``place``, to be moved there when it holds its secret: no other user ever had it open.

    Returns:
        Its path and its descriptor, open to read and write.

    Raises:
        OSError: It cannot be made.
    """
    path = place.with_name(f".{place.name}.{os.getpid()}")
    path.unlink(missing_ok=True)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC, 0o600)
    os.fchmod(descriptor, 0o600)  # whatever the umask
    return path, descriptor


def _is_left_behind(path: Path, kind: socket.SocketKind) -> bool:
    try:
        if path.lstat().st_uid != os.getuid():
            return False
        with socket.socket(socket.AF_UNIX, kind) as probe:
            probe.setblocking(False)
            probe.connect(str(path))
    except ConnectionRefusedError:
        return True
    except OSError:
        return False
    return False
