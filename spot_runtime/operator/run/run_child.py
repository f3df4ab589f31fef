"""The process that controls the robot for one arming: argument is the socket's descriptor, the spec comes on stdin.

It holds only what control needs: the adapter with its receiver and its command generator, the loop, and one end of the
link. The operator's service, the log and the live view are other processes.
"""

from __future__ import annotations

import os
import socket
import sys

from pydantic import ValidationError

from spot_log.write.logger_process import LoggerProcess
from spot_log.write.run_writer import make_log_folder
from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.validation import explain
from spot_protos import operator_pb2
from spot_runtime.hal.registry import HalRequest, find_adapter
from spot_runtime.host.instance_lock import InstanceLock
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.run.link import RunLink
from spot_runtime.operator.run.operated_run import OperatedRun
from spot_runtime.operator.run.run_spec import MAX_SPEC_BYTES, RunSpec, load_checked
from spot_runtime.rescue.guarded import guarded
from spot_runtime.stops import StopReason


def read_spec(data: bytes) -> RunSpec:
    """The spec of a run. Raises BadInputError."""
    try:
        return RunSpec.model_validate_json(data)
    except ValidationError as error:
        raise BadInputError(f"the run's specification:\n{explain(error)}") from error


def drive(spec: RunSpec, link: RunLink) -> int:
    """Carry it out. Returns the exit code. Raises SpotRlError where the robot was never touched."""
    policy = load_checked(spec.policy, spec.policy_sha256, spec.config)
    request = HalRequest(spec.robot, spec.config, spec.lock_step)
    adapter = find_adapter(request)
    make_log_folder(spec.config.log.directory)
    manager = ServiceManager.from_environment(os.environ)
    # The watchdog is also fed while the robot sits down, because the operator's service may be gone.
    make_hal = guarded(adapter, request, service_pid=os.getppid(), on_pause=manager.progressed, tell=link.event)
    with InstanceLock(adapter.robot):
        run = OperatedRun(spec, policy, link, LoggerProcess.start, manager=manager)
        return int(run.drive(make_hal).exit_code)


def main() -> None:
    """Run the process; leaves with the outcome's exit code."""
    link = RunLink(socket.socket(fileno=int(sys.argv[1])))
    try:
        spec = read_spec(sys.stdin.buffer.read(MAX_SPEC_BYTES))
        os.environ.update(spec.credentials)
        code = drive(spec, link)
    except SpotRlError as error:
        link.ended(operator_pb2.Outcome(outcome=type(error).__name__, exit_code=error.exit_code, sentence=str(error)))
        code = error.exit_code
    except Exception as error:
        sentence = f"{type(error).__name__}: {error}; report it"
        link.ended(operator_pb2.Outcome(outcome="internal_error", exit_code=70, sentence=sentence))
        code = StopReason.INTERNAL_ERROR.exit_code
        raise
    finally:
        link.close()
    raise SystemExit(code)


if __name__ == "__main__":
    main()
