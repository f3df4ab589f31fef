"""An adapter of the vendor's robot that is watched over: with a note of its lease, and a guardian that reads it."""

from __future__ import annotations

import os
from collections.abc import Callable

from spot_log.write.sink import LogSink
from spot_model.io.child_process import ChildProcess
from spot_runtime.hal.base import Hal
from spot_runtime.hal.connection.address import parse_address
from spot_runtime.hal.registry import Adapter, HalRequest
from spot_runtime.hal.spot.lock_step import LockStep
from spot_runtime.host.clock import HostClock
from spot_runtime.rescue.guardian import start_guardian
from spot_runtime.rescue.lease_note import note_folder
from spot_runtime.rescue.noting_hal import NotingHal


def guarded(
    adapter: Adapter, request: HalRequest, *, service_pid: int = 0, on_pause: Callable[[], None] = lambda: None
) -> Callable[[LogSink], Hal]:
    """What makes the adapter, guarded where it is the vendor's; any other is as it is, and its robot on its own.

    Args:
        adapter: The one that was found.
        request: What it is made for.
        service_pid: The operator's service, which acts before the guardian does; 0: there is none.
        on_pause: Told of each look at a motion of the vendor's.
    """
    if request.config.robot.hal != "spot":
        return adapter.make
    address, folder = parse_address(request.robot), note_folder(os.environ)

    def guardian() -> ChildProcess:
        return start_guardian(
            str(address),
            request.config,
            folder,
            control_pid=os.getpid(),
            service_pid=service_pid,
            lock_step=request.lock_step,
        )

    def make(sink: LogSink) -> Hal:
        pace = LockStep(request.lock_step, HostClock().now_ns()) if request.lock_step else None
        return NotingHal(address, request.config, sink, pace, folder=folder, guardian=guardian, on_pause=on_pause)

    return make
