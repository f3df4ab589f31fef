"""Checks of a robot: the link first, then what it says of itself. A step that cannot be made skips those after it."""

from __future__ import annotations

import math
import ssl
import time
from collections.abc import Callable
from datetime import datetime, timezone
from functools import partial
from typing import Any, Final

from bosdyn.api import estop_pb2, license_pb2, robot_state_pb2
from bosdyn.client.estop import EstopClient
from bosdyn.client.lease import LeaseClient
from bosdyn.client.license import LicenseClient
from bosdyn.client.robot_state import RobotStateClient

from spot_runtime.config import RobotConfig, RunConfig
from spot_runtime.hal.address import TLS_NAME, Address, connect, explain_no_connection, parse_address
from spot_runtime.hal.credentials import trusted_certificates
from spot_runtime.hal.errors import HalError, NoServiceError
from spot_runtime.hal.spot.arm import polled_arm_rad, refuse_arm_out
from spot_runtime.hal.spot.estop import is_alive
from spot_runtime.hal.spot.session import RobotCalls
from spot_runtime.hal.spot.slow_state import charge_percent, pressed_estops, reporting_battery, slow_state_from_message
from spot_runtime.hal.spot.vendor_errors import enum_word
from spot_runtime.host.clock import HostClock, RobotClockEstimate
from spot_runtime.stops import CRITICAL
from spot_tools.checks import CheckResult, DoctorCheck, Finding, fail, ok, skipped, warn

LATENCY_WARN_S: Final = 0.005
LATENCY_FAIL_S: Final = 0.030
"""A command is void 50 ms after it was sent, a state is too old after 40 ms: little may be spent on the way."""
CERTIFICATE_WARN_DAYS: Final = 30
SKEW_WARN_S: Final = 1.0
ROUND_TRIP_WARN_S: Final = 0.010
JOINT_CONTROL_FEATURE: Final = "joint_control"
"""The feature's code in the licence as the fake robot knows it; the vendor publishes no list."""
NO_FEATURE_ADVICE: Final = "if a run is refused joint control, ask the vendor for a licence with it"
BATTERY_WARN_PERCENT: Final = 30.0
MOTOR_MARGIN_C: Final = 10.0


class RobotDoctor:
    """Looks at one robot. Each gate opens the next: a route, a certificate that is trusted, an account."""

    def __init__(self, text: str, config: RunConfig) -> None:
        self._text, self._config = text, config
        self._route: Address | None = None
        self._trusted: Address | None = None
        self._reader: Reader | None = None

    def checks(self) -> list[DoctorCheck]:
        """All of them, in the order of a run."""
        steps = {"route": self.route, "certificate": self.certificate, "account": self.account}
        steps |= {name: partial(self._if_logged_in, look) for name, look in LOOKS.items()}
        return [DoctorCheck(f"{self._text} {name}", look) for name, look in steps.items()]

    def close(self) -> None:
        """Hang up."""
        if self._reader is not None:
            self._reader.close()

    def route(self) -> Finding:
        """The address is one, and TCP connections are taken there, soon."""
        address, robot = parse_address(self._text), self._config.robot
        round_trips_s, local = [], ""
        for _ in range(10):
            begin_s = time.perf_counter()
            try:
                with connect(address, robot.rpc_timeout_s) as connection:
                    round_trips_s.append(time.perf_counter() - begin_s)
                    local = "" if address.is_unix else f", from {connection.getsockname()[0]}"
            except OSError as error:
                raise _explain(address, robot, error) from error
        finding = judge_latency(sorted(round_trips_s), str(address), local)
        self._route = None if finding.verdict is CheckResult.FAIL else address
        return finding

    def certificate(self) -> Finding:
        """Who answers is a robot that we trust, and goes on being so."""
        address, robot = self._route, self._config.robot
        if address is None:
            return skipped("no route")
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        context.load_verify_locations(cadata=trusted_certificates(robot.ca_file).decode("ascii"))
        try:
            with (
                connect(address, robot.rpc_timeout_s) as connection,
                context.wrap_socket(connection, server_hostname=TLS_NAME) as secure,
            ):
                described = secure.getpeercert() or {}
        except OSError as error:
            raise _explain(address, robot, error) from error
        self._trusted = address
        return judge_expiry(ssl.cert_time_to_seconds(str(described["notAfter"])), time.time())

    def account(self) -> Finding:
        """User name and password are right."""
        if self._trusted is None:
            return skipped("no trusted connection")
        reader = Reader(self._trusted, self._config.robot)
        try:
            robot_id = reader.log_in()
        except BaseException:
            reader.close()
            raise
        self._reader = reader
        return ok(f"logged in to {robot_id}")

    def _if_logged_in(self, look: Callable[[Reader, RunConfig], Finding]) -> Finding:
        return skipped("not logged in") if self._reader is None else look(self._reader, self._config)


def _explain(address: Address, robot: RobotConfig, error: OSError) -> HalError:
    return explain_no_connection(address, trusted_certificates(robot.ca_file), str(error), robot.rpc_timeout_s)


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


class Reader:
    """A session that only reads: it takes no lease, makes no e-stop endpoint, powers nothing and commands nothing.

    Every method but ``close`` raises HalError.
    """

    def __init__(self, address: Address, config: RobotConfig) -> None:
        clock = HostClock()
        self._clock, self._timeout_s = clock, config.rpc_timeout_s
        self._estimate = RobotClockEstimate()
        self._session = RobotCalls(address, config, clock, self._estimate, clock.now_ns)

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


# What the robot says -------------------------------------------------------------------------------------------------


def clock(reader: Reader, _: RunConfig) -> Finding:
    """The clocks can be brought together; how far they are apart matters to people alone."""
    skew_s, round_trip_s = reader.clock()
    found = f"robot {skew_s:+.3f} s from this computer, round trip {round_trip_s * 1e3:.1f} ms"
    if round_trip_s > ROUND_TRIP_WARN_S:
        return warn(found, "the link is slow or busy; use a cable")
    if abs(skew_s) > SKEW_WARN_S:
        return warn(found, "a run allows for it, but stamps of two logs will not agree: set both clocks by NTP")
    return ok(found)


def joints(reader: Reader, _: RunConfig) -> Finding:
    """Those that policies drive, and those of an arm, which must be stowed."""
    message = reader.state()
    arm_rad = polled_arm_rad(message)
    try:
        refuse_arm_out(arm_rad)
    except HalError as error:
        return fail(*str(error).rsplit("; ", 1))
    n_joints = len(message.kinematic_state.joint_states)
    return ok(f"{n_joints}, with an arm, stowed: it is held while the legs walk" if arm_rad else f"{n_joints}, no arm")


def faults(reader: Reader, _: RunConfig) -> Finding:
    """No fault, and no wall power, that keeps the motors off."""
    if reader.state().power_state.shore_power_state == robot_state_pb2.PowerState.SHORE_POWER_STATE_ON:
        return fail("on wall power, so the motors stay off", "unplug it or have it leave its dock")
    slow = slow_state_from_message(reader.state(), 0)
    critical = [fault.removeprefix(CRITICAL) for fault in slow.system_faults if fault.startswith(CRITICAL)]
    if critical:
        return fail(f"system fault: {', '.join(critical)}", "see the robot's own page")
    if slow.behavior_faults:
        return fail(f"behaviour fault: {', '.join(slow.behavior_faults)}", "clear it on the tablet")
    others = [*slow.system_faults, *slow.service_faults]
    if others:
        return warn(f"not critical: {', '.join(others)}", "see the robot's own page")
    return ok(f"none; motors {'have power already' if slow.motors_powered else 'are off'}")


def battery(reader: Reader, config: RunConfig) -> Finding:
    """Enough charge for a run."""
    message, bound = reader.state(), config.safety.battery_percent
    percent, battery = charge_percent(message), reporting_battery(message)
    if math.isnan(percent):
        return fail("the robot does not report its battery's charge", "see the robot's own page")
    name = enum_word(robot_state_pb2.BatteryState.Status, battery.status, "STATUS_")
    found = f"{percent:.0f} %" + (f", {battery.voltage.value:.1f} V, {name}" if battery.HasField("voltage") else "")
    if percent < bound:
        return fail(found, f"below {bound:g} % a run ends at once: charge or change it")
    if percent < BATTERY_WARN_PERCENT:
        return warn(found, "enough for a short run; charge or change it soon")
    return ok(found)


def motors(reader: Reader, config: RunConfig) -> Finding:
    """No motor so hot that a run would end."""
    temperatures = slow_state_from_message(reader.state(), 0).motor_temperature_c
    if not temperatures:
        return skipped("the robot reports no motor temperatures")
    name, hottest_c = max(temperatures.items(), key=lambda item: item[1])
    bound_c = config.safety.motor_temperature_c
    found = f"hottest {name}, {hottest_c:.0f} °C; a run ends at {bound_c:g} °C"
    if hottest_c >= bound_c:
        return fail(found, "let the robot cool down")
    if hottest_c >= bound_c - MOTOR_MARGIN_C:
        return warn(found, "let the robot cool down, or keep the run short")
    return ok(found)


def estop(reader: Reader, config: RunConfig) -> Finding:
    """Nothing holds the robot stopped, and somebody other than us can stop it."""
    status = reader.estop_status()
    alive = [endpoint for endpoint in status.endpoints if is_alive(endpoint)]
    pressed = [e.endpoint.name or "unnamed" for e in alive if e.stop_level != estop_pb2.ESTOP_LEVEL_NONE]
    if pressed:
        return fail(f"pressed: {', '.join(pressed)}", "release it")
    # An endpoint with our name belongs to an earlier run, and nobody holds it.
    alive = [endpoint for endpoint in alive if endpoint.endpoint.name != config.robot.client_name]
    if not alive:
        if config.robot.estop == "external":
            return fail("no endpoint answers, so the motors stay off", "start the tablet, or another e-stop program")
        return warn("no endpoint answers; a run would make its own", "have somebody hold a tablet or e-stop program")
    others = pressed_estops(reader.state())
    if others:
        return fail(f"pressed: {', '.join(others)}", "release it")
    return ok(f"released; held by {', '.join(e.endpoint.name or 'unnamed' for e in alive)}")


def lease(reader: Reader, _: RunConfig) -> Finding:
    """The lease is free. It is looked at, never taken."""
    holders = {
        owner
        for resource in reader.leases()
        if (owner := resource.lease_owner.client_name or resource.lease_owner.user_name) and not resource.is_stale
    }
    if holders:
        return fail(f"held by {', '.join(sorted(holders))}", "release it there; a run never takes it by force")
    return ok("free")


def licence(reader: Reader, _: RunConfig) -> Finding:
    """Joint control is licensed."""
    try:
        info = reader.license_info()
    except NoServiceError:
        return warn("the robot offers no licence service", NO_FEATURE_ADVICE)
    named = info.id or "without a number"
    name = enum_word(license_pb2.LicenseInfo.Status, info.status, "STATUS_")
    if info.status != license_pb2.LicenseInfo.STATUS_VALID:
        return fail(f"licence {named}: {name}", "ask the vendor for a licence with joint control")
    features = ", ".join(info.licensed_features) or "none named"
    if not reader.has_feature(JOINT_CONTROL_FEATURE):
        return warn(f"licence {named} is valid, features: {features}", NO_FEATURE_ADVICE)
    return ok(f"licence {named} is valid and names joint control")


LOOKS: Final[dict[str, Callable[[Reader, RunConfig], Finding]]] = {
    "clock": clock,
    "joints": joints,
    "faults": faults,
    "battery": battery,
    "motors": motors,
    "e-stop": estop,
    "lease": lease,
    "licence": licence,
}
