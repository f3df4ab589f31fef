"""Faults of the services and the network: tokens, leases, e-stop buttons, licences, closed streams, reboots."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Literal

from bosdyn.api import lease_pb2
from pydantic import Field
from typing_extensions import override

from fake_robot.faults.fault import ServiceFault


class TokenExpired(ServiceFault, name="token_expired"):
    """Every user token becomes invalid; a client has to log in again."""

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.auth.revoke_all()


class LeaseStolen(ServiceFault, name="lease_stolen"):
    """Another client takes the lease."""

    owner: str = Field(default="another client", max_length=200, description="name of that client (text)")

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.leases.grant("body", lease_pb2.LeaseOwner(client_name=self.owner, user_name=self.owner))


class LeaseExpired(ServiceFault, name="lease_expired"):
    """The lease is revoked, as if its holder had been silent too long."""

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.expire_lease()


class EstopPressed(ServiceFault, name="estop_pressed"):
    """A stop button that no client holds is pressed."""

    @override
    def begin(self, world: Any, duration_s: float | None) -> Callable[[], None]:
        world.estop.press_elsewhere(is_pressed=True)
        world.estop.apply()
        return lambda: world.estop.press_elsewhere(is_pressed=False)


class LicenseInvalid(ServiceFault, name="license_invalid"):
    """The joint-control licence is gone."""

    state: Literal["expired", "missing"] = Field(default="expired", description="expired or missing (text)")

    @override
    def begin(self, world: Any, duration_s: float | None) -> Callable[[], None]:
        world.license.state = self.state
        return lambda: setattr(world.license, "state", world.config.joint_control_license)


class TimeSyncNotReady(ServiceFault, name="time_sync_not_ready"):
    """The time-sync service answers that it is not ready."""

    @override
    def begin(self, world: Any, duration_s: float | None) -> Callable[[], None]:
        world.time_sync.is_ready = False
        return lambda: setattr(world.time_sync, "is_ready", True)


class StateStreamClosed(ServiceFault, name="state_stream_closed"):
    """The open state streams are ended by the robot."""

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.link.end_streams("state")


class NetworkCut(ServiceFault, name="network_cut"):
    """Calls are refused and streams end, for duration_s of host time (default 5 s)."""

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.link.cut(duration_s or 5.0, "the network is cut")


class Reboot(ServiceFault, name="reboot"):
    """The robot cuts its motors, forgets its clients and is away for a while."""

    @override
    def begin(self, world: Any, duration_s: float | None) -> None:
        world.reboot()
