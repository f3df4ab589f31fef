"""Faults of the services and the network: tokens, leases, e-stop buttons, licences, closed streams, reboots."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar, Literal

from bosdyn.api import lease_pb2
from pydantic import Field
from typing_extensions import override

from fake_robot.faults.fault import ServiceFault

DEFAULT_CUT_S = 5.0


class TokenExpired(ServiceFault):
    """Every user token becomes invalid; a client has to log in again."""

    name: ClassVar[str] = "token_expired"

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.auth.revoke_all()


class LeaseStolen(ServiceFault):
    """Another client takes the lease."""

    name: ClassVar[str] = "lease_stolen"
    owner: str = Field(default="another client", max_length=200, description="name of that client (text)")

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.leases.grant("body", lease_pb2.LeaseOwner(client_name=self.owner, user_name=self.owner))


class LeaseExpired(ServiceFault):
    """The lease is revoked, as if its holder had been silent too long."""

    name: ClassVar[str] = "lease_expired"

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.expire_lease()


class EstopPressed(ServiceFault):
    """A stop button that no client holds is pressed."""

    name: ClassVar[str] = "estop_pressed"

    @override
    def begin(self, world: Any, duration_s: float | None) -> Callable[[], None]:
        world.estop.press_elsewhere(is_pressed=True)
        world.estop.apply()
        return lambda: world.estop.press_elsewhere(is_pressed=False)


class LicenseInvalid(ServiceFault):
    """The joint-control licence is gone."""

    name: ClassVar[str] = "license_invalid"
    state: Literal["expired", "missing"] = Field(default="expired", description="expired or missing (text)")

    @override
    def begin(self, world: Any, duration_s: float | None) -> Callable[[], None]:
        world.license.state = self.state
        return lambda: setattr(world.license, "state", world.config.joint_control_license)


class TimeSyncNotReady(ServiceFault):
    """The time-sync service answers that it is not ready."""

    name: ClassVar[str] = "time_sync_not_ready"

    @override
    def begin(self, world: Any, duration_s: float | None) -> Callable[[], None]:
        world.time_sync.is_ready = False
        return lambda: setattr(world.time_sync, "is_ready", True)


class StateStreamClosed(ServiceFault):
    """The open state streams are ended by the robot."""

    name: ClassVar[str] = "state_stream_closed"

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.link.end_streams("state")


class NetworkCut(ServiceFault):
    """Calls are refused and streams end, for duration_s of host time (default 5 s)."""

    name: ClassVar[str] = "network_cut"

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.link.cut(duration_s or DEFAULT_CUT_S, "the network is cut")


class Reboot(ServiceFault):
    """The robot cuts its motors, forgets its clients and is away for a while."""

    name: ClassVar[str] = "reboot"

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.reboot()
