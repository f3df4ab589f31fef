"""Finding an adapter by name: a built-in one, one of an installed package, or ``module:function``."""

from __future__ import annotations

import pkgutil
from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Final, NamedTuple

from spot_log.write.sink import LogSink
from spot_model.errors import BadInputError
from spot_model.user_code import users_code
from spot_runtime.config import RunConfig
from spot_runtime.hal.base import Hal

ENTRY_POINT_GROUP: Final = "spot_rl.hal"
BUILT_IN: Final = {"spot": "spot_runtime.hal.spot.adapter:adapter"}


class HalRequest(NamedTuple):
    """What an adapter is made for."""

    robot: str
    """The robot's address, as given; what it means is the adapter's matter."""
    config: RunConfig
    lock_step: str = ""
    """Admin address of a fake robot in lock-step mode; empty: real time."""


class Adapter(NamedTuple):
    """An adapter that may be made; nothing was sent yet."""

    robot: str
    """Names the robot, so that only one process drives it at a time."""
    make: Callable[[LogSink], Hal]
    """Makes it, given the log."""
    check: Callable[[], object] = lambda: None
    """Raises SpotRlError where making it would be in vain; asked before a run has a log."""


AdapterFactory = Callable[[HalRequest], Adapter]
"""What a name stands for. Raises BadInputError where the request is not one that it can serve."""


def find_adapter(request: HalRequest) -> Adapter:
    """The adapter that the configuration names in ``robot.hal``. Raises BadInputError."""
    name = request.config.robot.hal
    installed = {entry.name: entry.value for entry in entry_points(group=ENTRY_POINT_GROUP)}
    target = BUILT_IN.get(name) or installed.get(name) or (name if ":" in name else "")
    if not target:
        known = ", ".join(sorted({*BUILT_IN, *installed}))
        raise BadInputError(f"HAL adapter {name!r} is unknown; allowed: {known}, or module:function of your own")
    with users_code(f"HAL adapter {name!r}", "check module and function"):
        factory: AdapterFactory = pkgutil.resolve_name(target)
    return factory(request)
