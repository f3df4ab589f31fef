"""The memories of lease, e-stop, time sync and tokens: laws and hand-worked cases, no network."""

from __future__ import annotations

from typing import Any

import pytest
from bosdyn.api import auth_pb2, estop_pb2, lease_pb2, time_sync_pb2
from bosdyn.client.estop import response_from_challenge
from bosdyn.client.lease import Lease
from hypothesis import given
from hypothesis import strategies as st

from fake_robot.scenario.parts import ServicesConfig
from fake_robot.services.auth import AuthService, Credentials
from fake_robot.services.authority.estop import CUT, NONE, REQUIRED_ROLE, SETTLE_THEN_CUT, EstopService
from fake_robot.services.authority.lease import LeaseService
from fake_robot.services.authority.liveness import LivenessClock
from fake_robot.services.calls import duration_from_ns, ns_of, timestamp_from_ns
from fake_robot.services.time_sync import TimeSyncService, round_trip

Use = lease_pb2.LeaseUseResult


class TwoClocks:
    """Robot and host clock, set by hand."""

    def __init__(self, *, needs_both: bool = False) -> None:
        self.robot_ns = self.host_ns = 0
        self.clock = LivenessClock(lambda: self.robot_ns, lambda: self.robot_ns, needs_both, lambda: self.host_ns)

    def pass_s(self, robot_s: float, host_s: float | None = None) -> None:
        self.robot_ns += round(robot_s * 1e9)
        self.host_ns += round((robot_s if host_s is None else host_s) * 1e9)


def status_name(response: Any) -> str:
    return str(response.Status.Name(response.status)).removeprefix("STATUS_")


class LeaseBench:
    """A lease service that one process asks in the name of several clients."""

    def __init__(self, *, needs_both: bool = False) -> None:
        self.clocks = TwoClocks(needs_both=needs_both)
        self.service = LeaseService(self.clocks.clock, epoch="epoch", timeout_s=6.0, user_name="user")
        self.use, self.expire = self.service.use, self.service.expire

    def acquire(self, resource: str = "body", client: str = "me", *, by_force: bool = False) -> tuple[str, Any]:
        kind = "Take" if by_force else "Acquire"
        request = getattr(lease_pb2, f"{kind}LeaseRequest")(resource=resource)
        request.header.client_name = client
        response = getattr(lease_pb2, f"{kind}LeaseResponse")()
        getattr(self.service, f"{kind}Lease")(request, response)
        return status_name(response), response.lease

    def give_back(self, lease: Any) -> str:
        response = lease_pb2.ReturnLeaseResponse()
        self.service.ReturnLease(lease_pb2.ReturnLeaseRequest(lease=lease), response)
        return status_name(response)

    def granted(self, client: str = "me") -> Any:
        status, lease = self.acquire(client=client)
        assert status == "OK"
        return lease


@pytest.fixture
def leases() -> LeaseBench:
    return LeaseBench()


sequences = st.lists(st.integers(0, 3), min_size=1, max_size=4).map(tuple)


@given(sequences, sequences)
def test_a_lease_is_as_recent_as_the_sdk_says(mine: tuple[int, ...], latest: tuple[int, ...]) -> None:
    leases = LeaseBench()
    granted = leases.granted()
    used, mine = (granted.sequence[0], *latest), (granted.sequence[0], *mine)
    assert leases.use(sub_lease(granted, *latest)).status == Use.STATUS_OK
    one, other = (Lease(lease_pb2.Lease(resource="body", epoch="e", sequence=s)) for s in (mine, used))
    is_recent = one.compare(other) not in {Lease.CompareResult.OLDER, Lease.CompareResult.SUPER_LEASE}
    result = leases.use(sub_lease(granted, *mine[1:]))
    assert result.status == (Use.STATUS_OK if is_recent else Use.STATUS_OLDER)
    assert tuple(result.latest_known_lease.sequence) == (mine if is_recent else used)


@given(st.integers(-(2**60), 2**60))
def test_stamps_survive_the_wire(stamp_ns: int) -> None:
    duration = duration_from_ns(stamp_ns)
    assert ns_of(duration) == stamp_ns
    assert duration.seconds * duration.nanos >= 0
    assert ns_of(timestamp_from_ns(stamp_ns)) == stamp_ns


def sub_lease(lease: lease_pb2.Lease, *more: int) -> lease_pb2.Lease:
    return lease_pb2.Lease(resource=lease.resource, epoch=lease.epoch, sequence=[*lease.sequence, *more])


def test_a_lease_is_granted_once_and_taken_by_force(leases: LeaseBench) -> None:
    first = leases.granted()
    assert leases.acquire(client="other")[0] == "RESOURCE_ALREADY_CLAIMED"
    assert leases.acquire("arm", "other")[0] == "INVALID_RESOURCE"
    _, second = leases.acquire(client="other", by_force=True)
    assert second.sequence[0] > first.sequence[0]
    assert leases.use(first).status == Use.STATUS_OLDER
    assert leases.use(first).owner.client_name == "other"
    assert leases.use(second).status == Use.STATUS_OK
    assert leases.give_back(first) == "NOT_ACTIVE_LEASE"
    assert leases.give_back(second) == "OK"
    assert leases.use(second).status == Use.STATUS_REVOKED


def test_commands_need_the_newest_sub_lease_but_retaining_does_not(leases: LeaseBench) -> None:
    root = leases.granted()
    assert leases.use(sub_lease(root, 1)).status == Use.STATUS_OK
    assert leases.use(sub_lease(root, 3)).status == Use.STATUS_OK
    assert leases.use(sub_lease(root, 2)).status == Use.STATUS_OLDER
    assert leases.use(root).status == Use.STATUS_OLDER
    assert leases.use(root, is_retain=True).status == Use.STATUS_OK
    assert leases.use(sub_lease(root, 2), is_retain=True).status == Use.STATUS_OK
    assert leases.use(sub_lease(root, 3)).latest_known_lease.sequence == [*root.sequence, 3]
    assert leases.give_back(root) == "OK"


@pytest.mark.parametrize(
    ("lease", "status"),
    [
        (lease_pb2.Lease(), Use.STATUS_INVALID_LEASE),
        (lease_pb2.Lease(resource="body", epoch="epoch"), Use.STATUS_INVALID_LEASE),
        (lease_pb2.Lease(resource="arm", epoch="epoch", sequence=[1]), Use.STATUS_UNMANAGED),
        (lease_pb2.Lease(resource="body", epoch="yesterday", sequence=[1]), Use.STATUS_WRONG_EPOCH),
    ],
)
def test_leases_that_cannot_be_good(leases: LeaseBench, lease: lease_pb2.Lease, status: int) -> None:
    leases.granted()
    assert leases.use(lease).status == status


def test_a_silent_holder_loses_the_lease_once(leases: LeaseBench) -> None:
    lease = leases.granted()
    leases.clocks.pass_s(5.9)
    assert not leases.expire()
    assert leases.use(lease, is_retain=True).status == Use.STATUS_OK
    leases.clocks.pass_s(5.9)
    assert not leases.expire()
    leases.clocks.pass_s(0.2)
    assert leases.expire()
    assert not leases.expire()
    assert leases.use(lease).status == Use.STATUS_REVOKED
    listed = lease_pb2.ListLeasesResponse()
    leases.service.ListLeases(lease_pb2.ListLeasesRequest(), listed)
    assert listed.resources[0].is_stale
    assert leases.granted("other").sequence[0] > lease.sequence[0]


def test_in_lock_step_both_clocks_must_call_a_client_silent() -> None:
    leases = LeaseBench(needs_both=True)
    leases.granted()
    leases.clocks.pass_s(100.0, host_s=1.0)
    assert not leases.expire()
    leases.clocks.pass_s(0.0, host_s=5.1)
    assert leases.expire()


# ---------------------------------------------------------------------------------------------------------- e-stop


class EstopBench:
    """An e-stop service with one endpoint that can check in; the levels that reached the robot are kept."""

    def __init__(self, *, has_operator: bool = False) -> None:
        self.clocks = TwoClocks()
        self.are_motors_on = False
        self.applied: list[Any] = []
        self.service = EstopService(
            self.clocks.clock,
            cut_after_settle_s=4.0,
            are_motors_on=lambda: self.are_motors_on,
            apply_level=self.applied.append,
            has_operator=has_operator,
        )
        self.target = estop_pb2.EstopEndpoint(role=REQUIRED_ROLE)
        self.endpoint = estop_pb2.EstopEndpoint(role=REQUIRED_ROLE, name="bench")
        self.endpoint.timeout.CopyFrom(duration_from_ns(9_000_000_000))
        self.challenge = 0

    def ask(self, method: str, **fields: Any) -> Any:
        response = getattr(estop_pb2, f"{method}Response")()
        getattr(self.service, method)(getattr(estop_pb2, f"{method}Request")(**fields), response)
        return response

    def seen(self, method: str, **fields: Any) -> str:
        """The status of an answer; without a configuration, of a request to the active one."""
        fields.setdefault("target_config_id", self.config_id)
        return status_name(self.ask(method, **fields))

    @property
    def config_id(self) -> str:
        return str(self.ask("GetEstopConfig").active_config.unique_id)

    @property
    def details(self) -> str:
        return str(self.ask("GetEstopSystemStatus").status.stop_level_details)

    def register(self) -> None:
        """Configure the endpoint, take it over, and check in once."""
        assert self.seen("SetEstopConfig", config=estop_pb2.EstopConfig(endpoints=[self.endpoint])) == "SUCCESS"
        assert "not registered" in self.details
        told = self.ask(
            "RegisterEstopEndpoint",
            target_config_id=self.config_id,
            target_endpoint=self.target,
            new_endpoint=self.endpoint,
        )
        assert status_name(told) == "SUCCESS"
        self.endpoint = told.new_endpoint
        self.check_in(CUT)

    def check_in(self, level: int) -> str:
        told = self.ask(
            "EstopCheckIn",
            endpoint=self.endpoint,
            challenge=self.challenge,
            response=response_from_challenge(self.challenge),
            stop_level=level,
        )
        self.challenge = told.challenge
        return status_name(told)


def test_without_an_endpoint_the_robot_is_stopped() -> None:
    bench = EstopBench()
    assert bench.service.level() == CUT
    assert "no e-stop endpoint" in bench.details
    assert EstopBench(has_operator=True).service.level() == NONE


def test_an_endpoint_must_register_and_answer_the_challenge() -> None:
    bench = EstopBench()
    bench.register()
    assert bench.service.level() == CUT
    assert bench.check_in(NONE) == "OK"
    assert bench.service.level() == NONE
    assert [level.value for level in bench.applied[-2:]] == ["cut", "none"], "each change reaches the robot at once"
    bench.challenge ^= 1
    assert bench.check_in(NONE) == "INCORRECT_CHALLENGE_RESPONSE"
    assert bench.service.level() == NONE
    bench.challenge ^= 1
    assert bench.check_in(CUT) == "INCORRECT_CHALLENGE_RESPONSE"
    assert bench.service.level() == CUT, "a wrong answer may stop the robot"
    bench.challenge ^= 1
    bench.check_in(NONE)
    assert bench.service.level() == CUT, "a wrong answer never releases it"


def test_silence_settles_and_then_cuts() -> None:
    bench = EstopBench()
    bench.register()
    bench.check_in(NONE)
    bench.clocks.pass_s(8.9)
    assert bench.service.level() == NONE
    bench.clocks.pass_s(0.2)
    assert bench.service.level() == SETTLE_THEN_CUT
    assert "silent for 9.1 s" in bench.details
    bench.clocks.pass_s(4.0)
    assert bench.service.level() == CUT
    bench.check_in(NONE)
    assert bench.service.level() == NONE


def test_refusals_of_the_estop_name_their_reason() -> None:
    bench = EstopBench()
    bench.register()
    register = {"target_endpoint": bench.target, "new_endpoint": bench.endpoint}
    assert bench.seen("RegisterEstopEndpoint", **register, target_config_id="other") == "CONFIG_MISMATCH"
    wrong = estop_pb2.EstopEndpoint(role="other")
    assert bench.seen("RegisterEstopEndpoint", **register | {"target_endpoint": wrong}) == "ENDPOINT_MISMATCH"
    nameless = estop_pb2.EstopEndpoint(role=REQUIRED_ROLE, timeout=bench.endpoint.timeout)
    assert bench.seen("RegisterEstopEndpoint", **register | {"new_endpoint": nameless}) == "INVALID_ENDPOINT"
    assert bench.seen("SetEstopConfig", target_config_id="other") == "INVALID_ID"
    bench.are_motors_on = True
    assert bench.seen("SetEstopConfig") == "MOTORS_ON"
    assert bench.seen("DeregisterEstopEndpoint", target_endpoint=bench.endpoint) == "MOTORS_ON"
    bench.are_motors_on = False
    other = {"target_endpoint": bench.endpoint, "target_config_id": "other"}
    assert bench.seen("DeregisterEstopEndpoint", **other) == "CONFIG_MISMATCH"
    assert bench.seen("DeregisterEstopEndpoint", target_endpoint=bench.endpoint) == "SUCCESS"
    assert bench.seen("DeregisterEstopEndpoint", target_endpoint=bench.endpoint) == "ENDPOINT_MISMATCH"
    assert bench.check_in(NONE) == "ENDPOINT_UNKNOWN"


# ------------------------------------------------------------------------------------------------------- time-sync


def trip(*stamps_ns: int) -> time_sync_pb2.TimeSyncRoundTrip:
    names = ("client_tx", "server_rx", "server_tx", "client_rx")
    stamps = {name: timestamp_from_ns(ns) for name, ns in zip(names, stamps_ns, strict=True)}
    return time_sync_pb2.TimeSyncRoundTrip(**stamps)


def test_skew_and_round_trip_by_hand() -> None:
    # There 2 ms, 1 ms in the robot, back 4 ms; the robot's clock is 100 ms ahead.
    sample = round_trip(trip(0, 102_000_000, 103_000_000, 7_000_000))
    assert sample.round_trip_ns == 6_000_000
    assert sample.clock_skew_ns == 99_000_000, "off by half the difference of the two ways, 1 ms"


@pytest.mark.parametrize(("uses_newest", "expected_ns"), [(False, 50), (True, 70)])
def test_the_shortest_round_trip_wins_in_real_time_and_the_newest_in_lock_step(
    uses_newest: bool, expected_ns: int
) -> None:
    service = TimeSyncService(3, uses_newest=uses_newest)

    def update(*stamps_ns: int, client: str) -> Any:
        told = time_sync_pb2.TimeSyncUpdateResponse()
        request = time_sync_pb2.TimeSyncUpdateRequest(clock_identifier=client)
        if stamps_ns:
            request.previous_round_trip.CopyFrom(trip(*stamps_ns))
        service.TimeSyncUpdate(request, told)
        return told

    client = update(client="").clock_identifier
    for round_trip_ns, skew_ns in ((9, 60), (1, 50), (5, 70)):
        assert not service.is_established(client)
        update(0, skew_ns, skew_ns, round_trip_ns, client=client)
    assert service.is_established(client)
    told = update(10, 0, 0, 5, client=client)  # a negative round trip is dropped
    assert abs(ns_of(told.state.best_estimate.clock_skew) - expected_ns) <= 5


# ---------------------------------------------------------------------------------------------------------- tokens


class Login:
    """A login service with a clock set by hand."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        config = ServicesConfig(serial_number="serial", token_lifetime_s=60.0, max_failed_logins=3, lockout_s=10.0)
        self.service = AuthService(Credentials("u", "p"), config, lambda: self.now_s)

    def ask(self, request: auth_pb2.GetAuthTokenRequest) -> Any:
        told = auth_pb2.GetAuthTokenResponse()
        self.service.GetAuthToken(request, told)
        return told

    def seen(self, word: str) -> str:
        return status_name(self.ask(auth_pb2.GetAuthTokenRequest(username="u", password=word)))


def test_tokens_are_good_until_they_expire_are_forged_or_revoked() -> None:
    login, other = Login(), Login()
    token = login.service.mint("u")
    renewal = auth_pb2.GetAuthTokenRequest(token=token)
    assert login.service.user_of(token) == "u"
    assert other.service.user_of(token) is None, "signed by another robot"
    assert login.service.user_of(token[:-4] + "AAAA") is None
    assert login.service.user_of("None") is None
    assert login.ask(renewal).token not in {token, ""}
    login.now_s += 61
    assert login.service.user_of(token) is None
    assert status_name(login.ask(renewal)) == "INVALID_TOKEN"
    fresh = login.service.mint("u")
    login.service.revoke_all()
    assert login.service.user_of(fresh) is None


def test_wrong_passwords_lock_the_door_for_a_while() -> None:
    login = Login()
    for _ in range(3):
        assert login.seen("wrong") == "INVALID_LOGIN"
    assert login.seen("p") == "TEMPORARILY_LOCKED_OUT"
    login.now_s += 10
    assert login.seen("p") == "OK"


def test_a_password_never_shows() -> None:
    assert "hunter2" not in repr(Credentials("u", "hunter2"))
