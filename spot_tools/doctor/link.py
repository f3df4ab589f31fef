"""The way to a robot, step by step: address, route, latency, certificate."""

from __future__ import annotations

import ssl
import time
from dataclasses import dataclass
from datetime import datetime, timezone

from spot_runtime.config import RobotConfig
from spot_runtime.hal.connection.address import TLS_NAME, Address, connect, explain_no_connection
from spot_runtime.hal.connection.credentials import trusted_certificates
from spot_runtime.hal.errors import HalError
from spot_tools.doctor.check import Finding, fail, ok, warn

PROBES = 10
LATENCY_WARN_S = 0.005
LATENCY_FAIL_S = 0.030
"""A command is void 50 ms after it was sent, a state is too old after 40 ms: little may be spent on the way."""
CERTIFICATE_WARN_DAYS = 30


@dataclass
class Link:
    """A robot's address and what it takes to trust it."""

    address: Address
    config: RobotConfig

    def route(self) -> Finding:
        """TCP connections are taken, soon."""
        round_trips_s = []
        local = ""
        for _ in range(PROBES):
            begin_s = time.perf_counter()
            try:
                with connect(self.address, self.config.rpc_timeout_s) as connection:
                    round_trips_s.append(time.perf_counter() - begin_s)
                    local = "" if self.address.is_unix else f", from {connection.getsockname()[0]}"
            except OSError as error:
                raise self._explain(str(error)) from error
        return judge_latency(sorted(round_trips_s), str(self.address), local)

    def certificate(self) -> Finding:
        """The robot proves who it is, and goes on doing so."""
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.load_verify_locations(cadata=self.trusted_pem().decode("ascii"))
        try:
            with (
                connect(self.address, self.config.rpc_timeout_s) as connection,
                context.wrap_socket(connection, server_hostname=TLS_NAME) as secure,
            ):
                described = secure.getpeercert() or {}
        except OSError as error:
            raise self._explain(str(error)) from error
        until_s = ssl.cert_time_to_seconds(str(described["notAfter"]))
        return judge_expiry(until_s, time.time())

    def trusted_pem(self) -> bytes:
        """The vendor's certificate, and the one that the configuration names."""
        return trusted_certificates(self.config.ca_file)

    def _explain(self, reason: str) -> HalError:
        return explain_no_connection(self.address, self.trusted_pem(), reason, self.config.rpc_timeout_s)


def judge_latency(round_trips_s: list[float], where: str, local: str) -> Finding:
    """Judge sorted round trips, shortest first, by their median and their longest."""
    median_s, longest_s = round_trips_s[len(round_trips_s) // 2], round_trips_s[-1]
    found = f"{where}{local}: round trip {median_s * 1e3:.2f} ms, longest {longest_s * 1e3:.2f} ms"
    if median_s > LATENCY_FAIL_S:
        return fail(found, f"over {LATENCY_FAIL_S * 1e3:g} ms: use a cable to the payload port, not Wi-Fi")
    if longest_s > LATENCY_WARN_S:
        return warn(found, "a cable to the payload port answers within a millisecond")
    return ok(found)


def judge_expiry(until_unix_s: float, now_unix_s: float) -> Finding:
    """Judge how long a trusted certificate still holds."""
    days = (until_unix_s - now_unix_s) / 86400.0
    until = datetime.fromtimestamp(until_unix_s, timezone.utc).date().isoformat()
    if days < CERTIFICATE_WARN_DAYS:
        return warn(f"trusted, until {until}: {days:.0f} days", "renew it, or mend this computer's clock")
    return ok(f"trusted, until {until}")
