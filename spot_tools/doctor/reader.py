"""A session that only reads: it takes no lease, makes no e-stop endpoint, powers nothing and commands nothing."""

from __future__ import annotations

from typing import Any

from bosdyn.client.estop import EstopClient
from bosdyn.client.lease import LeaseClient
from bosdyn.client.license import LicenseClient
from bosdyn.client.robot_state import RobotStateClient

from spot_runtime.config import RobotConfig
from spot_runtime.hal.connection.address import Address
from spot_runtime.hal.spot.session import Session
from spot_runtime.host.clock import HostClock, RobotClockEstimate


class Reader:
    """Reads what a robot says of itself. Every method but ``close`` raises HalError."""

    def __init__(self, address: Address, config: RobotConfig) -> None:
        clock = HostClock()
        self._clock, self._timeout_s = clock, config.rpc_timeout_s
        self._estimate = RobotClockEstimate()
        self._session = Session(address, config, clock, self._estimate, clock.now_ns)

    def log_in(self) -> str:
        """Log in; serial number and nickname."""
        return self._session.log_in()

    def clock(self) -> tuple[float, float]:
        """Robot clock minus host clock, and the shortest round trip, s."""
        self._session.sync_clocks()
        return self._estimate.skew_ns(self._clock.now_ns()) / 1e9, 2 * self._estimate.uncertainty_ns() / 1e9

    def state(self) -> Any:
        """The vendor's RobotState."""
        return self._read(RobotStateClient, "reading the state", "get_robot_state")

    def license_info(self) -> Any:
        """The vendor's LicenseInfo."""
        return self._read(LicenseClient, "reading the licence", "get_license_info")

    def has_feature(self, code: str) -> bool:
        """Whether the licence covers a feature."""
        answer = self._read(LicenseClient, "reading the licence", "get_feature_enabled", [code])
        return bool(answer.get(code, False))

    def leases(self) -> Any:
        """The vendor's list of LeaseResource."""
        return self._read(LeaseClient, "reading the leases", "list_leases")

    def estop_status(self) -> Any:
        """The vendor's EstopSystemStatus."""
        return self._read(EstopClient, "reading the e-stop", "get_status")

    def close(self) -> None:
        """End the SDK's threads."""
        self._session.close()

    def _read(self, kind: Any, doing: str, method: str, *arguments: Any) -> Any:
        calls = self._session.calls
        client = calls.client(kind)
        return calls.make(doing, lambda: getattr(client, method)(*arguments, timeout=self._timeout_s))
