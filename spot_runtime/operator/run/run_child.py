"""The process that controls the robot for one arming: argument is the socket's descriptor, the spec comes on stdin.

It holds only what control needs: the adapter with its receiver and its command generator, the loop, and one end of the
link. The operator's service, the log and the live view are other processes. Its first word is said, and signals are
answered, before anything that takes long is imported.
"""

from __future__ import annotations

import os
import signal
import socket
import sys
from collections.abc import Callable
from typing import NoReturn

from spot_model.errors import SpotRlError
from spot_model.process.signals import STOP_SIGNALS, answered
from spot_protos import operator_pb2
from spot_runtime.operator.run.link import RunLink
from spot_runtime.stops import StopReason, unforeseen


class BrokenOffError(SpotRlError):
    """A signal came before there was a run that could have answered it."""

    exit_code = StopReason.OPERATOR_STOP.exit_code


def drive(link: RunLink, check: Callable[[], None]) -> int:
    """Read the spec and carry it out. Returns the exit code. Raises SpotRlError where the robot was never touched.

    ``check`` raises where a signal has come.
    """
    from spot_log.write.logger_process import LoggerProcess
    from spot_log.write.run_writer import make_log_folder
    from spot_runtime.hal.registry import HalRequest, find_adapter
    from spot_runtime.host.instance_lock import InstanceLock
    from spot_runtime.host.service_manager import ServiceManager
    from spot_runtime.operator.run.operated_run import OperatedRun
    from spot_runtime.operator.run.run_spec import load_checked, read_spec
    from spot_runtime.rescue.guarded import guarded

    check()
    spec = read_spec(sys.stdin.buffer)
    os.environ.update(spec.credentials)
    policy = load_checked(spec.policy, spec.policy_sha256, spec.config)
    request = HalRequest(spec.robot, spec.config, spec.lock_step)
    adapter = find_adapter(request)
    make_log_folder(spec.config.log.directory)
    manager = ServiceManager.from_environment(os.environ)
    # The watchdog is also fed while the robot sits down, because the operator's service may be gone.
    make_hal = guarded(adapter, request, service_pid=os.getppid(), on_pause=manager.progressed, tell=link.event)
    with InstanceLock(adapter.robot):
        run = OperatedRun(spec, policy, link, LoggerProcess.start, manager=manager)
        check()
        return int(run.drive(make_hal).exit_code)


def main() -> None:
    """Run the process; leaves with the outcome's exit code."""
    link = RunLink(socket.socket(fileno=int(sys.argv[1])))

    came: list[int] = []

    def break_off(number: int) -> NoReturn:
        came.append(number)
        raise BrokenOffError(f"{signal.Signals(number).name} came before the robot was touched; arm again")

    def check() -> None:  # Python swallows what a handler raises within a callback of its own, as imports have them
        if came:
            break_off(came[0])

    try:
        with answered(break_off, *STOP_SIGNALS):
            link.begin()
            code = drive(link, check)
    except SpotRlError as error:
        link.ended(operator_pb2.Outcome(outcome=type(error).__name__, exit_code=error.exit_code, sentence=str(error)))
        code = error.exit_code
    except Exception as error:
        stop = unforeseen(error)
        code = stop.reason.exit_code
        link.ended(operator_pb2.Outcome(outcome=stop.reason.label, exit_code=code, sentence=stop.sentence()))
        raise
    finally:
        link.close()
    raise SystemExit(code)


if __name__ == "__main__":
    main()
