"""Every fault that can be injected: those of the wire, made here, and those of the robot, passed on."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bosdyn.api import lease_pb2

from fake_robot.network.robot_port import FaultKind
from fake_robot.services.authority.lease_records import ROOT_RESOURCE
from fake_robot.services.sensors.world import World
from spot_model.errors import BadInputError

FIRST_WIRE_FAULT_ID = 1_000_000
LICENSE_STATES = ("expired", "missing")

WIRE_FAULTS = (
    FaultKind("token_expired", "Every user token becomes invalid; a client has to log in again."),
    FaultKind("lease_stolen", "Another client takes the lease.", {"owner": "Name of that client (text)."}),
    FaultKind("lease_expired", "The lease is revoked, as if its holder had been silent too long."),
    FaultKind("estop_pressed", "A stop button that no client holds is pressed."),
    FaultKind("license_invalid", "The joint-control licence is gone.", {"state": "expired or missing (text)."}),
    FaultKind("time_sync_not_ready", "The time-sync service answers that it is not ready."),
    FaultKind("state_stream_closed", "The open state streams are ended by the robot."),
    FaultKind("network_cut", "Calls are refused and streams end, for duration_s of host time (default 5 s)."),
    FaultKind("reboot", "The robot cuts its motors, forgets its clients and is away for a while."),
)
_NAMES = {kind.name: kind for kind in WIRE_FAULTS}
DEFAULT_CUT_S = 5.0


@dataclass(frozen=True)
class LastingFault:
    """A fault that goes on until its end, robot time elapsed (None: until cleared)."""

    name: str
    end_ns: int | None
    undo: Callable[[], None]


class FaultDesk:
    """Injects, lists and clears faults. Thread-safe."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._elapsed_ns = world.robot.clock.elapsed_ns
        self._lasting: dict[int, LastingFault] = {}
        self._last_id = FIRST_WIRE_FAULT_ID
        self._lock = threading.Lock()

    def kinds(self) -> tuple[FaultKind, ...]:
        """Every fault that there is, by name."""
        return tuple(sorted((*WIRE_FAULTS, *self._world.robot.fault_kinds()), key=lambda kind: kind.name))

    def inject(self, name: str, parameters: Mapping[str, float | str], duration_s: float | None) -> int:
        """Make a fault happen now; returns its number.

        Raises:
            BadInputError: No such fault or parameter, or a value that is not allowed.
        """
        if duration_s is not None and not 0 < duration_s < 1e6:
            raise BadInputError(f"fault {name}: duration_s = {duration_s:g} is not allowed; give 0 < duration_s < 1e6")
        if name not in _NAMES:
            names = [kind.name for kind in self.kinds()]
            if name not in names:
                raise BadInputError(f"there is no fault {name!r}; allowed: {', '.join(names)}")
            return self._world.robot.inject(name, parameters, duration_s)
        for key in parameters:
            if key not in _NAMES[name].parameters:
                allowed = ", ".join(_NAMES[name].parameters) or "none"
                raise BadInputError(f"fault {name} has no parameter {key!r}; allowed: {allowed}")
        undo = self._begin(name, parameters, duration_s)
        with self._lock:
            self._last_id += 1
            if undo is not None:
                end_ns = None if duration_s is None else self._elapsed_ns() + round(duration_s * 1e9)
                self._lasting[self._last_id] = LastingFault(name, end_ns, undo)
            return self._last_id

    def active(self) -> dict[int, str]:
        """Number and name of every fault that goes on."""
        with self._lock:
            mine = {fault_id: fault.name for fault_id, fault in self._lasting.items()}
        return mine | dict(self._world.robot.active_faults())

    def clear(self, fault_ids: tuple[int, ...] = ()) -> tuple[int, ...]:
        """End faults (all, if empty); returns the numbers of those that ended.

        Raises:
            BadInputError: A number is not that of an active fault; nothing is cleared then.
        """
        active = self.active()
        for fault_id in fault_ids:
            if fault_id not in active:
                raise BadInputError(f"fault {fault_id} is not active; active: {', '.join(map(str, active)) or 'none'}")
        chosen = fault_ids or tuple(active)
        mine = [fault_id for fault_id in chosen if fault_id > FIRST_WIRE_FAULT_ID]
        theirs = tuple(fault_id for fault_id in chosen if fault_id <= FIRST_WIRE_FAULT_ID)
        cleared = [fault_id for fault_id in mine if self._end(fault_id)]
        return (*cleared, *(self._world.robot.clear_faults(theirs) if theirs else ()))

    def tick(self) -> None:
        """End the faults whose time is over."""
        now_ns = self._elapsed_ns()
        with self._lock:
            over = [i for i, fault in self._lasting.items() if fault.end_ns is not None and now_ns >= fault.end_ns]
        for fault_id in over:
            self._end(fault_id)

    def _end(self, fault_id: int) -> bool:
        with self._lock:
            fault = self._lasting.pop(fault_id, None)
        if fault is None:
            return False
        fault.undo()
        self._world.tick()
        return True

    def _begin(
        self, name: str, parameters: Mapping[str, float | str], duration_s: float | None
    ) -> Callable[[], None] | None:
        """Start a fault; returns what ends it, None for one that happens in an instant."""
        world = self._world
        if name == "token_expired":
            world.tokens.revoke_all()
        elif name == "lease_stolen":
            owner = str(parameters.get("owner", "another client"))
            world.leases.take(ROOT_RESOURCE, lease_pb2.LeaseOwner(client_name=owner, user_name=owner))
        elif name == "lease_expired":
            world.expire_lease()
        elif name == "estop_pressed":
            world.estop.press_elsewhere(is_pressed=True)
            world.apply_estop()
            return lambda: world.estop.press_elsewhere(is_pressed=False)
        elif name == "license_invalid":
            return self._invalidate_license(str(parameters.get("state", "expired")))
        elif name == "time_sync_not_ready":
            world.time_sync.is_ready = False
            return lambda: setattr(world.time_sync, "is_ready", True)
        elif name == "state_stream_closed":
            world.link.end_streams("state")
        elif name == "network_cut":
            world.link.cut(duration_s or DEFAULT_CUT_S, "the network is cut")
        elif name == "reboot":
            world.reboot()
        return None

    def _invalidate_license(self, state: str) -> Callable[[], None]:
        if state not in LICENSE_STATES:
            raise BadInputError(f"fault license_invalid: state = {state!r}; allowed: {', '.join(LICENSE_STATES)}")
        self._world.license_state = state
        return lambda: setattr(self._world, "license_state", self._world.config.joint_control_license)
