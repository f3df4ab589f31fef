"""A process that outlives the one in control, and makes the robot safe if no other process does.

It is started before the motors get power, and sleeps. When the control process is gone and its note is still there, it
lets the operator's service act, if that lives; if that is gone too, it acts itself.
"""

from __future__ import annotations

import contextlib
import json
import signal
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from spot_model.errors import SpotRlError
from spot_model.io.child_process import HEARD, LOOK_PERIOD_S, ChildProcess, LivingProcess

if TYPE_CHECKING:  # it sleeps for as long as all goes well, and should be small
    from spot_runtime.config import RunConfig

MODULE: Final = "spot_runtime.rescue.guardian"


def start_guardian(
    robot: str,
    config: RunConfig,
    folder: Path,
    *,
    control_pid: int = 0,
    service_pid: int = 0,
    lock_step: str = "",
    is_heard: bool = False,
) -> ChildProcess:
    """Start one. Raises OSError.

    Args:
        robot: The robot's address.
        config: How to reach it.
        folder: Where the note lies.
        control_pid: The process in control; 0: it is gone already.
        service_pid: The operator's service, which comes first; 0: there is none.
        lock_step: Admin address of a fake robot in lock-step mode.
        is_heard: Whether what was done goes to the process's output, and not to standard error.
    """
    told = {
        "robot": robot,
        "config": config.model_dump_json(by_alias=True),
        "folder": str(folder),
        "control_pid": control_pid,
        "service_pid": service_pid,
        "lock_step": lock_step,
        "is_heard": is_heard,
    }
    return ChildProcess.start(
        MODULE, told=json.dumps(told).encode(), output=HEARD if is_heard else None, has_own_session=True
    )


def main() -> None:
    """Watch, and act if need be."""
    # A signal that ends a run goes to all its processes; this one acts afterwards.
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT):
        signal.signal(number, signal.SIG_IGN)
    told = json.loads(sys.stdin.buffer.read())
    control, service = LivingProcess(told["control_pid"]), LivingProcess(told["service_pid"])
    control.has_ended(None)
    from spot_runtime.rescue.lease_note import note_path

    note = note_path(told["robot"], Path(told["folder"]))
    while note.exists() and not service.has_ended():
        time.sleep(LOOK_PERIOD_S)
    if not note.exists() and not told["is_heard"]:
        return
    from spot_runtime.config import RunConfig
    from spot_runtime.rescue.make_safe import WITHIN_S, make_safe_by_note

    config = RunConfig.model_validate_json(told["config"])
    code = 0
    try:
        words = make_safe_by_note(told["robot"], config, note.parent, lock_step=told["lock_step"], within_s=WITHIN_S)
    except SpotRlError as error:
        words, code = str(error), error.exit_code
    with contextlib.suppress(OSError):
        print(words, file=sys.stdout if told["is_heard"] else sys.stderr, flush=True)
    raise SystemExit(code)


if __name__ == "__main__":
    main()
