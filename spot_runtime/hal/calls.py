"""Single calls to a robot through the SDK, with its errors turned into ours."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import grpc
from bosdyn.client.exceptions import Error as SdkError

from spot_runtime.hal.errors import HalError
from spot_runtime.hal.vendor_errors import translate


class Calls:
    """Finds the SDK's clients and makes calls. Every method raises HalError and nothing else."""

    def __init__(self, robot: Any = None) -> None:
        """Use the SDK's robot; without one, every call says that there is no connection."""
        self._robot = robot

    def client(self, kind: Any) -> Any:
        """The SDK's client of a service, given its class."""
        if self._robot is None:
            raise HalError("there is no connection to the robot; connect first")
        name = kind.default_service_name
        return self.make(f"finding {name}", lambda: self._robot.ensure_client(name))

    def make(self, doing: str, call: Callable[[], Any]) -> Any:
        """Make a call; ``doing`` says in errors what it was for."""
        try:
            return call()
        except (SdkError, grpc.RpcError) as error:
            raise translate(error, doing) from error
