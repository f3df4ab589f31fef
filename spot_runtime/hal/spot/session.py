"""A session with a robot over the vendor's SDK: trust, login, clocks, faults, e-stop, lease, polls."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Callable
from typing import Any, Final

import grpc
from bosdyn.api import power_pb2, robot_state_pb2, time_sync_pb2
from bosdyn.client.auth import AuthClient, InvalidTokenError
from bosdyn.client.directory import DirectoryClient
from bosdyn.client.estop import EstopClient
from bosdyn.client.exceptions import UnauthenticatedError
from bosdyn.client.keepalive import KeepaliveClient
from bosdyn.client.lease import Lease, LeaseClient
from bosdyn.client.license import LicenseClient
from bosdyn.client.power import PowerClient
from bosdyn.client.processors import AddRequestHeader
from bosdyn.client.robot_command import RobotCommandStreamingClient
from bosdyn.client.robot_id import RobotIdClient
from bosdyn.client.robot_state import RobotStateClient, RobotStateStreamingClient
from bosdyn.client.sdk import Sdk, generate_client_name
from bosdyn.client.time_sync import TimeSyncClient

from spot_model.robot.state import SlowState
from spot_runtime.config import RobotConfig
from spot_runtime.hal.address import Address, explain_no_connection
from spot_runtime.hal.credentials import Credentials, find_credentials, trusted_certificates
from spot_runtime.hal.errors import ClockError, CredentialsError, EstopError, FaultError, HalError
from spot_runtime.hal.spot.arm import polled_arm_rad, refuse_arm_out
from spot_runtime.hal.spot.calls import BODY, Acquisition, Calls, newest_lease, patiently, retain
from spot_runtime.hal.spot.estop import OwnEstop, needs_own_endpoint
from spot_runtime.hal.spot.motions import POLL_S, Helm, Motions, Wait
from spot_runtime.hal.spot.slow_state import pressed_estops, slow_state_from_message
from spot_runtime.hal.spot.vendor_errors import SDK_ERRORS, enum_word, translate
from spot_runtime.hal.time_sync import ATTEMPTS, SyncedCommandClient, TimeSync
from spot_runtime.host.clock import HostClock, RobotClockEstimate
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import CRITICAL, Stop, StopReason

SYNC_ROUND_TRIPS: Final = 12
LATER_SYNC_TIMEOUT_S: Final = 1.0
"""A slower answer is useless for a clock, and the lease and the polls wait for it."""

SERVICES: Final = (
    AuthClient,
    DirectoryClient,
    EstopClient,
    LeaseClient,
    LicenseClient,
    PowerClient,
    SyncedCommandClient,
    RobotCommandStreamingClient,
    RobotIdClient,
    RobotStateClient,
    RobotStateStreamingClient,
    TimeSyncClient,
)
"""The vendor's services that a run needs."""

ESTOP_RELEASE_S: Final = 1.0
ONE_THREAD_A_STREAM: Final = "SingleThreadedUnaryStream"
"""gRPC's option by which the thread that reads a stream also waits for it: one thread switch less for each state."""


class RobotCalls:
    """Everything of one robot that goes by single calls. Every method raises HalError and nothing else."""

    def __init__(
        self,
        address: Address,
        config: RobotConfig,
        clock: HostClock,
        estimate: RobotClockEstimate,
        host_now_ns: Callable[[], int],
    ) -> None:
        """Prepare; nothing is sent yet. ``clock`` is for time sync, and ``estimate`` takes its round trips.

        ``host_now_ns`` stamps what is received; in lock-step, host time passes with robot time.
        """
        self._host_now_ns = host_now_ns
        self._address, self._config, self._clock, self._estimate = address, config, clock, estimate
        self._robot: Any = None
        self.calls = Calls()
        self._time_sync: TimeSync | None = None
        self._own_estop: OwnEstop | None = None
        self._lease: Any = None
        self.has_lease = False
        self._client_name = ""
        self._connected: set[grpc.Channel] = set()
        self._helm = Helm(lambda: self._robot.lease_wallet.advance(BODY).lease_proto)

    # Connecting ------------------------------------------------------------------------------------------------------

    def log_in(self, token: str = "") -> str:
        """Reach the robot and log in. Returns its serial number and nickname.

        With a token of an earlier login no password is needed, as long as the robot takes it.
        """
        if token:
            try:
                return self._reach(lambda: self._robot.authenticate_with_token(token, timeout=self._timeout_s))
            except CredentialsError as error:
                if not isinstance(error.__cause__, (InvalidTokenError, UnauthenticatedError)):
                    raise
                logging.getLogger(__name__).debug("the token was not taken", exc_info=error)
                self.close()
        credentials = find_credentials(self._config.credentials_file, os.environ)
        return self._reach(lambda: self._authenticate(credentials))

    def sync_clocks(self) -> None:
        """Bring the estimate of the robot's clock about, and the clock identifier that commands carry from now on."""
        self._time_sync = TimeSync(self.calls.client(TimeSyncClient), self._clock, self._config.rpc_timeout_s)
        self.calls.client(SyncedCommandClient).use(self._time_sync)
        for attempt in range(ATTEMPTS):
            self.sync_once()
            if attempt + 1 >= SYNC_ROUND_TRIPS and self._time_sync.is_established:
                self._time_sync.timeout_s = min(LATER_SYNC_TIMEOUT_S, self._config.rpc_timeout_s)
                return
        status = enum_word(time_sync_pb2.TimeSyncState.Status, self._time_sync.status)
        raise ClockError(f"time sync was not established in {ATTEMPTS} round trips ({status}); try again later")

    def sync_once(self) -> int:
        """One round trip. Returns how far it lies from the estimate, ns."""
        if self._time_sync is None:
            raise ClockError("time sync has not begun; connect first")
        return self._estimate.add(self.calls.make("syncing clocks", self._time_sync.round_trip))

    def check_faults(self, limits: SafetyLimits, pause: Wait) -> SlowState:
        """Refuse a robot that must not move, whose arm is out, or with too little charge. Returns its slow state.

        A charge that is missing is asked for again, as long as it may be missing later.
        """
        waited_s = 0.0
        while math.isnan((slow := self._slow_without_faults()).battery_charge_percent):
            if waited_s >= limits.slow_state_age_s:
                raise FaultError("the robot does not report its battery's charge; see the robot's own page")
            pause(POLL_S)
            waited_s += POLL_S
        if slow.battery_charge_percent < limits.battery_percent:
            holds, needed = f"{slow.battery_charge_percent:.0f} %", f"{limits.battery_percent:g} %"
            raise FaultError(f"the battery holds {holds}; needed: {needed}; charge it")
        return slow

    def _slow_without_faults(self) -> SlowState:
        state = self._state()
        refuse_arm_out(polled_arm_rad(state))
        slow = slow_state_from_message(state, self._host_now_ns())
        critical = [fault.removeprefix(CRITICAL) for fault in slow.system_faults if fault.startswith(CRITICAL)]
        if critical:
            raise FaultError(f"the robot reports a system fault: {', '.join(critical)}; see the robot's own page")
        if slow.behavior_faults:
            raise FaultError(
                f"the robot reports a behaviour fault: {', '.join(slow.behavior_faults)}; clear it on the tablet, "
                f"it is never cleared by this program"
            )
        return slow

    def why_refused(self, verdict: str, clock_skew_s: float) -> Stop:
        """The cause behind the end of the command stream, which the robot's state tells best."""
        try:
            slow = self.poll()
        except HalError:
            slow = None
        if slow is not None and slow.estopped:
            return Stop(StopReason.ESTOPPED, verdict)
        if slow is not None and slow.behavior_faults:
            return Stop(StopReason.BEHAVIOR_FAULT, f"{', '.join(slow.behavior_faults)}: {verdict}")
        if slow is not None and not slow.motors_powered:
            return Stop(StopReason.MOTORS_OFF, verdict)
        return Stop(StopReason.COMMAND_REFUSED, verdict, {"clock_skew_s": clock_skew_s})

    def set_up_estop(self) -> bool:
        """Make sure that an e-stop endpoint answers. Returns whether it is our own, which then needs check-ins."""
        client, name, doing = self.calls.client(EstopClient), self._config.client_name, "setting up the e-stop"
        status = self.calls.make(doing, lambda: client.get_status(timeout=self._timeout_s))
        if not needs_own_endpoint(status, self._config.estop, name):
            return False
        self._own_estop = self.calls.make(
            doing, lambda: OwnEstop(client, name, self._config.estop_timeout_s, self._timeout_s)
        )
        return True

    def check_estop(self, pause: Callable[[float], None]) -> None:
        """Refuse a robot that stays stopped, by whatever button; one that was just released gets a second."""
        waited_s = 0.0
        while True:
            pressed = pressed_estops(self._state())
            if not pressed:
                return
            if waited_s >= ESTOP_RELEASE_S:
                raise EstopError(f"an e-stop is pressed: {', '.join(pressed)}; release it, then start again")
            pause(POLL_S)
            waited_s += POLL_S

    def check_in_estop(self) -> None:
        """Keep our own endpoint alive."""
        own = self._own_estop  # another thread may press it
        if own is not None:
            self.calls.make("checking in to the e-stop", own.check_in)

    def cut_power(self) -> None:
        """Press our own e-stop, or where another endpoint holds it, have the motors' power cut."""
        if self._own_estop is not None:
            own = self._own_estop
            self._own_estop = None  # a check-in would release it again
            self.calls.make("pressing the e-stop", own.press)
            return
        client, request = self.calls.client(PowerClient), power_pb2.PowerCommandRequest.REQUEST_OFF_MOTORS
        self.calls.make("cutting power", lambda: client.power_command(request, timeout=self._timeout_s))

    def acquire_lease(self) -> None:
        """Take the lease if it is free."""
        acquisition = Acquisition(self.calls.client(LeaseClient), self._client_name, self._timeout_s)
        self.adopt_lease(self.calls.make("taking the lease", acquisition.ask))

    def retain_lease(self) -> None:
        """Keep the lease alive."""
        client, wallet = self.calls.client(LeaseClient), self._robot.lease_wallet
        self.calls.make("keeping the lease", lambda: retain(client, wallet, self._timeout_s))

    @property
    def token(self) -> str:
        """What the robot gave for the password; it stands for the password for some hours."""
        return str(self._robot.user_token or "")

    @property
    def lease(self) -> Any:
        """The lease that is or was held, in the vendor's message; None before there was one."""
        return None if self._lease is None else self._lease.lease_proto

    def newest_lease(self, resource: str) -> Any:
        """The newest lease of a resource that the robot knows of, whoever holds it; None if there is none."""
        client = self.calls.client(LeaseClient)
        return self.calls.make("listing leases", lambda: newest_lease(client, resource, self._timeout_s))

    def adopt_lease(self, lease: Any) -> None:
        """Go on with a lease that another process of ours held, given in the vendor's message."""
        self._lease = Lease(lease)
        self._robot.lease_wallet.add(self._lease)
        self.has_lease = True

    def poll(self) -> SlowState:
        """Battery, temperatures, power and faults, now; an answer that does not tell of the power is none."""
        state = self._state()
        if not state.power_state.motor_power_state:
            raise HalError("the robot does not say whether its motors have power; see the robot's own page")
        return slow_state_from_message(state, self._host_now_ns())

    def is_without_power(self) -> bool:
        """Whether the motors are off, now; while they are being powered on or off, they are not."""
        off = robot_state_pb2.PowerState.MOTOR_POWER_STATE_OFF
        return bool(self._state().power_state.motor_power_state == off)

    def motions(self, pause: Wait) -> Motions:
        """The vendor's motions, between whose looks at the robot ``pause`` lets time pass.

        Nothing that was asked for by an earlier one is asked for again.
        """
        return Motions(
            self.calls,
            self._config,
            helm=self._helm,
            is_powered=lambda: self.poll().motors_powered,
            is_without_power=self.is_without_power,
            pause=pause,
        )

    def end_motions(self) -> None:
        """Ask for nothing again that was asked for by any :meth:`motions`."""
        self._helm.hand_to(None)

    # Channels and the end --------------------------------------------------------------------------------------------

    def streaming_channel(self, service: type[RobotStateStreamingClient | RobotCommandStreamingClient]) -> Any:
        """The secure channel of a streaming service, connected."""
        name = service.default_service_name
        options = [(ONE_THREAD_A_STREAM, 1)]
        channel = self.calls.make(f"finding {name}", lambda: self._robot.ensure_channel(name, options=options))
        if channel in self._connected:  # asked twice, gRPC's thread fails where the channel is closed soon after
            return channel
        try:
            grpc.channel_ready_future(channel).result(timeout=self._timeout_s)
        except grpc.FutureTimeoutError as error:
            raise HalError(f"the service {name} did not answer within {self._timeout_s:g} s; check the link") from error
        self._connected.add(channel)
        return channel

    def close(self) -> None:
        """Let our e-stop endpoint go, return the lease and end the SDK's threads.

        Errors are ignored: nothing could act on them. While the motors have power, the robot keeps our e-stop
        endpoint, and stops once that has been silent for its time.
        """
        if self._robot is None:
            return
        if self._own_estop is not None:
            own, self._own_estop = self._own_estop, None
            try:
                patiently(own.let_go)
            except SDK_ERRORS:
                logging.getLogger(__name__).debug("the e-stop endpoint was not taken back", exc_info=True)
        if self.has_lease:
            client = self.calls.client(LeaseClient)
            try:
                patiently(lambda: client.return_lease(self._lease, timeout=self._timeout_s))
            except SDK_ERRORS:
                logging.getLogger(__name__).debug("the lease was not returned", exc_info=True)
            self.has_lease = False
        self._robot._shutdown()
        self._robot.shutdown()
        self._robot, self.calls = None, Calls()

    # Details ---------------------------------------------------------------------------------------------------------

    def _state(self) -> Any:
        client = self.calls.client(RobotStateClient)
        return self.calls.make("polling the robot's state", lambda: client.get_robot_state(timeout=self._timeout_s))

    @property
    def _timeout_s(self) -> float:
        return self._config.rpc_timeout_s

    def _reach(self, log_in: Callable[[], None]) -> str:
        trusted_pem = self._make_robot()

        def explain(reason: str) -> HalError:
            return explain_no_connection(self._address, trusted_pem, reason, self._timeout_s)

        try:
            patiently(log_in)
            robot_id = patiently(lambda: self._robot.get_cached_robot_id(timeout=self._timeout_s))
            patiently(self._robot.sync_with_directory)
        except SDK_ERRORS as error:
            raise translate(error, f"logging in to {self._address}", explain) from error
        return f"{robot_id.serial_number} {robot_id.nickname}".strip()

    def _make_robot(self) -> bytes:
        # The SDK logs to the root logger by default; what matters reaches the user as our own errors.
        for name in ("bosdyn", self._config.client_name):
            logging.getLogger(name).addHandler(logging.NullHandler())
            logging.getLogger(name).propagate = False
        # Built by hand: the SDK's own function registers forty services and warns of deprecated calls.
        sdk = Sdk(self._config.client_name)
        name = self._client_name = generate_client_name(self._config.client_name)
        sdk.request_processors.append(AddRequestHeader(lambda: name))
        sdk.cert = trusted_certificates(self._config.ca_file)
        for service in (*SERVICES, KeepaliveClient):
            sdk.register_service_client(service)
        self._robot = sdk.create_robot(self._address.sdk_host)
        self._robot.update_secure_channel_port(self._address.port)
        self.calls = Calls(self._robot, self._log_in_again)
        return bytes(sdk.cert)

    def _log_in_again(self) -> None:
        """A token that the robot no longer takes is replaced. Raises the SDK's errors, and CredentialsError."""
        credentials = find_credentials(self._config.credentials_file, os.environ)
        patiently(lambda: self._authenticate(credentials))

    def _authenticate(self, by: Credentials) -> None:
        self._robot.authenticate(by.username, by.password, timeout=self._timeout_s)
