"""An operator's service whose robot is running, in a process of its own; its control process answers at once."""

from __future__ import annotations

import contextlib
import os
import sys
from typing import Any, Final

from spot_protos import run_link_pb2
from spot_runtime.config import RunConfig
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.server.server import OperatorServer
from spot_runtime.operator.server.service_state import State
from spot_runtime.operator.server.supervisor import Supervisor

NICENESS: Final = -10
"""As in the unit ``deploy/spot-rl.service``; without the right to it, measurements are made without it."""


class AnsweringProcess:
    """In place of a control process."""

    pid = 1

    def __init__(self, supervisor: Supervisor) -> None:
        """Answer to ``supervisor``."""
        self._supervisor = supervisor

    def tell(self, message: run_link_pb2.ToRun) -> bool:
        """Answer at once."""
        answer = run_link_pb2.Answer(request_id=message.request_id, is_done=True, text=str(message.WhichOneof("what")))
        self._supervisor._take(run_link_pb2.FromRun(answer=answer))
        return True


def serve(listen: str, **service: Any) -> tuple[OperatorServer, Supervisor]:
    """A service that believes its robot to be running."""
    config = RunConfig.model_validate({"service": {"listen": listen, **service}})
    supervisor = Supervisor("127.0.0.1:1", config, manager=ServiceManager(), tell=lambda _: None)
    supervisor.adopt(AnsweringProcess(supervisor), State.RUNNING)  # type: ignore[arg-type]
    return OperatorServer(supervisor, config), supervisor


def main() -> None:
    """Serve on the address that is given, with the TLS files if there are any, until standard input ends."""
    with contextlib.suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    listen, *files = sys.argv[1:]
    names = ("tls_certificate", "tls_key", "tls_client_ca")
    server, _ = serve(listen, **dict(zip(names, files, strict=False)))
    sys.stdout.write(f"{server.address}\n")
    sys.stdout.flush()
    sys.stdin.read()
    server.close()


if __name__ == "__main__":
    main()
