"""Checks of a robot: the link first, then what it says of itself. A step that cannot be made skips those after it."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

from bosdyn.api import estop_pb2, license_pb2, robot_state_pb2

from spot_model.errors import SpotRlError
from spot_runtime.config import RunConfig
from spot_runtime.hal.connection.address import parse_address
from spot_runtime.hal.errors import HalError, NoServiceError
from spot_runtime.hal.spot.estop import is_alive
from spot_runtime.hal.spot.slow_state import (
    charge_percent,
    pressed_estops,
    refuse_arm,
    reporting_battery,
    slow_state_from_message,
)
from spot_runtime.hal.spot.vendor_errors import enum_word
from spot_runtime.stops import CRITICAL
from spot_tools.doctor.check import Check, Finding, Verdict, fail, ok, skipped, warn
from spot_tools.doctor.link import Link
from spot_tools.doctor.reader import Reader

SKEW_WARN_S = 1.0
ROUND_TRIP_WARN_S = 0.010
JOINT_CONTROL_FEATURE = "joint_control"
"""The feature's code in the licence as the fake robot knows it; the vendor publishes no list."""
NO_FEATURE_ADVICE = "if a run is refused joint control, ask the vendor for a licence with it"
BATTERY_WARN_PERCENT = 30.0
MOTOR_MARGIN_C = 10.0


class RobotDoctor:
    """Looks at one robot."""

    def __init__(self, text: str, config: RunConfig) -> None:
        self._config = config
        self._text = text
        self._link: Link | None = None
        self._reader: Reader | None = None

    def checks(self) -> list[Check]:
        """All of them, in the order of a run."""
        steps: dict[str, Callable[[], Finding]] = {
            "route": self.route,
            "certificate": self.certificate,
            "account": self.account,
        }
        of_the_robot = (
            ("clock", self.clock),
            ("joints", self.joints),
            ("faults", self.faults),
            ("battery", self.battery),
            ("motors", self.motors),
            ("e-stop", self.estop),
            ("lease", self.lease),
            ("licence", self.license),
        )
        steps |= {name: partial(self._if_logged_in, look) for name, look in of_the_robot}
        return [Check(f"{self._text} {name}", look) for name, look in steps.items()]

    def close(self) -> None:
        """Hang up."""
        if self._reader is not None:
            self._reader.close()

    # The link --------------------------------------------------------------------------------------------------------

    def route(self) -> Finding:
        """The address is one, and somebody answers there."""
        link = Link(parse_address(self._text), self._config.robot)
        finding = link.route()
        if finding.verdict is not Verdict.FAIL:
            self._link = link
        return finding

    def certificate(self) -> Finding:
        """Who answers is a robot that we trust."""
        if self._link is None:
            return skipped("no route")
        try:
            return self._link.certificate()
        except SpotRlError:
            self._link = None
            raise

    def account(self) -> Finding:
        """User name and password are right."""
        if self._link is None:
            return skipped("no trusted connection")
        reader = Reader(self._link.address, self._config.robot)
        try:
            robot_id = reader.log_in()
        except SpotRlError:
            reader.close()
            raise
        self._reader = reader
        return ok(f"logged in to {robot_id}")

    def _if_logged_in(self, look: Callable[[Reader], Finding]) -> Finding:
        return skipped("not logged in") if self._reader is None else look(self._reader)

    # What the robot says ---------------------------------------------------------------------------------------------

    def clock(self, reader: Reader) -> Finding:
        """The clocks can be brought together; how far they are apart matters to people alone."""
        skew_s, round_trip_s = reader.clock()
        found = f"robot {skew_s:+.3f} s from this computer, round trip {round_trip_s * 1e3:.1f} ms"
        if round_trip_s > ROUND_TRIP_WARN_S:
            return warn(found, "the link is slow or busy; use a cable")
        if abs(skew_s) > SKEW_WARN_S:
            return warn(found, "a run allows for it, but stamps of two logs will not agree: set both clocks by NTP")
        return ok(found)

    def joints(self, reader: Reader) -> Finding:
        """Those that policies drive, and no arm's."""
        message = reader.state()
        try:
            refuse_arm(message)
        except HalError as error:
            return fail(*str(error).rsplit("; ", 1))
        return ok(f"{len(message.kinematic_state.joint_states)}, no arm")

    def faults(self, reader: Reader) -> Finding:
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

    def battery(self, reader: Reader) -> Finding:
        """Enough charge for a run."""
        message, bound = reader.state(), self._config.safety.battery_percent
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

    def motors(self, reader: Reader) -> Finding:
        """No motor so hot that a run would end."""
        temperatures = slow_state_from_message(reader.state(), 0).motor_temperature_c
        if not temperatures:
            return skipped("the robot reports no motor temperatures")
        name, hottest_c = max(temperatures.items(), key=lambda item: item[1])
        bound_c = self._config.safety.motor_temperature_c
        found = f"hottest {name}, {hottest_c:.0f} °C; a run ends at {bound_c:g} °C"
        if hottest_c >= bound_c:
            return fail(found, "let the robot cool down")
        if hottest_c >= bound_c - MOTOR_MARGIN_C:
            return warn(found, "let the robot cool down, or keep the run short")
        return ok(found)

    def estop(self, reader: Reader) -> Finding:
        """Nothing holds the robot stopped, and somebody other than us can stop it."""
        status = reader.estop_status()
        alive = [endpoint for endpoint in status.endpoints if is_alive(endpoint)]
        pressed = [e.endpoint.name or "unnamed" for e in alive if e.stop_level != estop_pb2.ESTOP_LEVEL_NONE]
        if pressed:
            return fail(f"pressed: {', '.join(pressed)}", "release it")
        # An endpoint with our name belongs to an earlier run, and nobody holds it.
        alive = [endpoint for endpoint in alive if endpoint.endpoint.name != self._config.robot.client_name]
        if not alive:
            if self._config.robot.estop == "external":
                return fail(
                    "no endpoint answers, so the motors stay off", "start the tablet, or another e-stop program"
                )
            return warn(
                "no endpoint answers; a run would make its own", "have somebody hold a tablet or e-stop program"
            )
        others = pressed_estops(reader.state())
        if others:
            return fail(f"pressed: {', '.join(others)}", "release it")
        return ok(f"released; held by {', '.join(e.endpoint.name or 'unnamed' for e in alive)}")

    def lease(self, reader: Reader) -> Finding:
        """The lease is free. It is looked at, never taken."""
        holders = {
            owner
            for resource in reader.leases()
            if (owner := resource.lease_owner.client_name or resource.lease_owner.user_name) and not resource.is_stale
        }
        if holders:
            return fail(f"held by {', '.join(sorted(holders))}", "release it there; a run never takes it by force")
        return ok("free")

    def license(self, reader: Reader) -> Finding:
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
