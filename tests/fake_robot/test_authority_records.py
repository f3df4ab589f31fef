"""The bookkeeping behind lease, e-stop, time-sync and tokens: laws and hand-worked cases, no network."""

from __future__ import annotations

from typing import Any

import pytest
from bosdyn.api import estop_pb2, lease_pb2
from bosdyn.client.estop import response_from_challenge
from bosdyn.client.lease import Lease
from hypothesis import given
from hypothesis import strategies as st

from fake_robot.services.authority.estop_endpoints import CUT, NONE, REQUIRED_ROLE, SETTLE_THEN_CUT, EstopEndpoints
from fake_robot.services.authority.lease_records import LeaseRecords, Recency, compare_sequences
from fake_robot.services.authority.liveness import LivenessClock
from fake_robot.services.calls.stamps import duration_from_ns, ns_from_duration, ns_from_timestamp, timestamp_from_ns
from fake_robot.services.identity.time_sync_clients import TimeSyncClients, sample_from_round_trip
from fake_robot.services.identity.tokens import Credentials, LoginResult, TokenMint

ME, OTHER = (lease_pb2.LeaseOwner(client_name=name) for name in ("me", "other"))
Use = lease_pb2.LeaseUseResult


class TwoClocks:
    """Robot and host clock, set by hand."""

    def __init__(self, *, needs_both: bool = False) -> None:
        self.robot_ns = self.host_ns = 0
        self.clock = LivenessClock(lambda: self.robot_ns, lambda: self.robot_ns, needs_both, lambda: self.host_ns)

    def pass_s(self, robot_s: float, host_s: float | None = None) -> None:
        self.robot_ns += round(robot_s * 1e9)
        self.host_ns += round((robot_s if host_s is None else host_s) * 1e9)


@pytest.fixture
def clocks() -> TwoClocks:
    return TwoClocks()


@pytest.fixture
def leases(clocks: TwoClocks) -> LeaseRecords:
    return LeaseRecords(clocks.clock, epoch="epoch", timeout_s=6.0)


sequences = st.lists(st.integers(0, 3), min_size=1, max_size=4).map(tuple)


@given(sequences, sequences)
def test_recency_agrees_with_the_sdk(mine: tuple[int, ...], theirs: tuple[int, ...]) -> None:
    leases = [Lease(lease_pb2.Lease(resource="body", epoch="e", sequence=s)) for s in (mine, theirs)]
    names = {
        Lease.CompareResult.SAME: Recency.SAME,
        Lease.CompareResult.SUPER_LEASE: Recency.SUPER,
        Lease.CompareResult.SUB_LEASE: Recency.SUB,
        Lease.CompareResult.OLDER: Recency.OLDER,
        Lease.CompareResult.NEWER: Recency.NEWER,
    }
    assert compare_sequences(mine, theirs) is names[leases[0].compare(leases[1])]


@given(st.integers(-(2**60), 2**60))
def test_stamps_survive_the_wire(stamp_ns: int) -> None:
    duration = duration_from_ns(stamp_ns)
    assert ns_from_duration(duration) == stamp_ns
    assert duration.seconds * duration.nanos >= 0
    assert ns_from_timestamp(timestamp_from_ns(stamp_ns)) == stamp_ns


def granted(leases: LeaseRecords, owner: Any = ME) -> lease_pb2.Lease:
    status, lease = leases.acquire("body", owner)
    assert status == lease_pb2.AcquireLeaseResponse.STATUS_OK
    assert lease is not None
    return lease


def sub_lease(lease: lease_pb2.Lease, *more: int) -> lease_pb2.Lease:
    return lease_pb2.Lease(resource=lease.resource, epoch=lease.epoch, sequence=[*lease.sequence, *more])


def test_a_lease_is_granted_once_and_taken_by_force(leases: LeaseRecords) -> None:
    first = granted(leases)
    assert leases.acquire("body", OTHER)[0] == lease_pb2.AcquireLeaseResponse.STATUS_RESOURCE_ALREADY_CLAIMED
    assert leases.acquire("arm", OTHER)[0] == lease_pb2.AcquireLeaseResponse.STATUS_INVALID_RESOURCE
    _, second = leases.take("body", OTHER)
    assert second is not None
    assert second.sequence[0] > first.sequence[0]
    assert leases.use(first).status == Use.STATUS_OLDER
    assert leases.use(first).owner.client_name == "other"
    assert leases.use(second).status == Use.STATUS_OK
    assert leases.give_back(first) == lease_pb2.ReturnLeaseResponse.STATUS_NOT_ACTIVE_LEASE
    assert leases.give_back(second) == lease_pb2.ReturnLeaseResponse.STATUS_OK
    assert leases.use(second).status == Use.STATUS_REVOKED


def test_commands_need_the_newest_sub_lease_but_retaining_does_not(leases: LeaseRecords) -> None:
    root = granted(leases)
    assert leases.use(sub_lease(root, 1)).status == Use.STATUS_OK
    assert leases.use(sub_lease(root, 3)).status == Use.STATUS_OK
    assert leases.use(sub_lease(root, 2)).status == Use.STATUS_OLDER
    assert leases.use(root).status == Use.STATUS_OLDER
    assert leases.use(root, is_retain=True).status == Use.STATUS_OK
    assert leases.use(sub_lease(root, 2), is_retain=True).status == Use.STATUS_OK
    assert leases.use(sub_lease(root, 3)).latest_known_lease.sequence == [*root.sequence, 3]
    assert leases.give_back(root) == lease_pb2.ReturnLeaseResponse.STATUS_OK


@pytest.mark.parametrize(
    ("lease", "status"),
    [
        (lease_pb2.Lease(), Use.STATUS_INVALID_LEASE),
        (lease_pb2.Lease(resource="body", epoch="epoch"), Use.STATUS_INVALID_LEASE),
        (lease_pb2.Lease(resource="arm", epoch="epoch", sequence=[1]), Use.STATUS_UNMANAGED),
        (lease_pb2.Lease(resource="body", epoch="yesterday", sequence=[1]), Use.STATUS_WRONG_EPOCH),
    ],
)
def test_leases_that_cannot_be_good(leases: LeaseRecords, lease: lease_pb2.Lease, status: int) -> None:
    granted(leases)
    assert leases.use(lease).status == status


def test_a_silent_holder_loses_the_lease_once(leases: LeaseRecords, clocks: TwoClocks) -> None:
    lease = granted(leases)
    clocks.pass_s(5.9)
    assert not leases.expire()
    assert leases.use(lease, is_retain=True).status == Use.STATUS_OK
    clocks.pass_s(5.9)
    assert not leases.expire()
    clocks.pass_s(0.2)
    assert leases.expire()
    assert not leases.expire()
    assert leases.use(lease).status == Use.STATUS_REVOKED
    assert leases.resources(is_full=False)[0].is_stale
    assert granted(leases, OTHER).sequence[0] > lease.sequence[0]


def test_in_lock_step_both_clocks_must_call_a_client_silent() -> None:
    clocks = TwoClocks(needs_both=True)
    leases = LeaseRecords(clocks.clock, epoch="epoch", timeout_s=6.0)
    granted(leases)
    clocks.pass_s(100.0, host_s=1.0)
    assert not leases.expire()
    clocks.pass_s(0.0, host_s=5.1)
    assert leases.expire()


# ---------------------------------------------------------------------------------------------------------- e-stop


class EstopBench:
    """An e-stop book with one endpoint that can check in."""

    def __init__(self, *, has_operator: bool = False) -> None:
        self.clocks = TwoClocks()
        self.are_motors_on = False
        self.book = EstopEndpoints(
            self.clocks.clock,
            cut_after_settle_s=4.0,
            are_motors_on=lambda: self.are_motors_on,
            has_operator=has_operator,
        )
        self.endpoint = estop_pb2.EstopEndpoint(role=REQUIRED_ROLE, name="bench")
        self.endpoint.timeout.CopyFrom(duration_from_ns(9_000_000_000))
        self.challenge = 0

    def configure(self) -> None:
        config = estop_pb2.EstopConfig(endpoints=[self.endpoint])
        status = self.book.set_config(config, self.book.config().unique_id)
        assert status == estop_pb2.SetEstopConfigResponse.STATUS_SUCCESS

    def register(self) -> None:
        status, registered = self.book.register(
            self.book.config().unique_id, estop_pb2.EstopEndpoint(role=REQUIRED_ROLE), self.endpoint
        )
        assert status == estop_pb2.RegisterEstopEndpointResponse.STATUS_SUCCESS
        self.endpoint = registered
        self.check_in(CUT)

    def check_in(self, level: int) -> int:
        response = response_from_challenge(self.challenge)
        status, self.challenge = self.book.check_in(self.endpoint, self.challenge, response, level)
        return int(status)


def test_without_an_endpoint_the_robot_is_stopped() -> None:
    bench = EstopBench()
    assert bench.book.level() == CUT
    assert "no e-stop endpoint" in bench.book.status().stop_level_details
    assert EstopBench(has_operator=True).book.level() == NONE


def test_an_endpoint_must_register_and_answer_the_challenge() -> None:
    bench = EstopBench()
    bench.configure()
    assert "not registered" in bench.book.status().stop_level_details
    bench.register()
    assert bench.book.level() == CUT
    assert bench.check_in(NONE) == estop_pb2.EstopCheckInResponse.STATUS_OK
    assert bench.book.level() == NONE
    bench.challenge ^= 1
    assert bench.check_in(NONE) == estop_pb2.EstopCheckInResponse.STATUS_INCORRECT_CHALLENGE_RESPONSE
    assert bench.book.level() == NONE
    bench.challenge ^= 1
    assert bench.check_in(CUT) == estop_pb2.EstopCheckInResponse.STATUS_INCORRECT_CHALLENGE_RESPONSE
    assert bench.book.level() == CUT, "a wrong answer may stop the robot"
    bench.challenge ^= 1
    bench.check_in(NONE)
    assert bench.book.level() == CUT, "a wrong answer never releases it"


def test_silence_settles_and_then_cuts() -> None:
    bench = EstopBench()
    bench.configure()
    bench.register()
    bench.check_in(NONE)
    bench.clocks.pass_s(8.9)
    assert bench.book.level() == NONE
    bench.clocks.pass_s(0.2)
    assert bench.book.level() == SETTLE_THEN_CUT
    assert "silent for 9.1 s" in bench.book.status().stop_level_details
    bench.clocks.pass_s(4.0)
    assert bench.book.level() == CUT
    bench.check_in(NONE)
    assert bench.book.level() == NONE


def test_refusals_of_the_estop_name_their_reason() -> None:
    bench = EstopBench()
    bench.configure()
    config_id = bench.book.config().unique_id
    target = estop_pb2.EstopEndpoint(role=REQUIRED_ROLE)
    register = estop_pb2.RegisterEstopEndpointResponse
    assert bench.book.register("other", target, bench.endpoint)[0] == register.STATUS_CONFIG_MISMATCH
    wrong = estop_pb2.EstopEndpoint(role="other")
    assert bench.book.register(config_id, wrong, bench.endpoint)[0] == register.STATUS_ENDPOINT_MISMATCH
    nameless = estop_pb2.EstopEndpoint(role=REQUIRED_ROLE, timeout=bench.endpoint.timeout)
    assert bench.book.register(config_id, target, nameless)[0] == register.STATUS_INVALID_ENDPOINT
    set_config = estop_pb2.SetEstopConfigResponse
    assert bench.book.set_config(estop_pb2.EstopConfig(), "other") == set_config.STATUS_INVALID_ID
    bench.register()
    bench.are_motors_on = True
    assert bench.book.set_config(estop_pb2.EstopConfig(), config_id) == set_config.STATUS_MOTORS_ON
    deregister = estop_pb2.DeregisterEstopEndpointResponse
    assert bench.book.deregister(config_id, bench.endpoint) == deregister.STATUS_MOTORS_ON
    bench.are_motors_on = False
    assert bench.book.deregister("other", bench.endpoint) == deregister.STATUS_CONFIG_MISMATCH
    assert bench.book.deregister(config_id, bench.endpoint) == deregister.STATUS_SUCCESS
    assert bench.book.deregister(config_id, bench.endpoint) == deregister.STATUS_ENDPOINT_MISMATCH
    assert bench.check_in(NONE) == estop_pb2.EstopCheckInResponse.STATUS_ENDPOINT_UNKNOWN


# ------------------------------------------------------------------------------------------------------- time-sync


def test_skew_and_round_trip_by_hand() -> None:
    # There 2 ms, 1 ms in the robot, back 4 ms; the robot's clock is 100 ms ahead.
    sample = sample_from_round_trip(0, 102_000_000, 103_000_000, 7_000_000)
    assert sample.round_trip_ns == 6_000_000
    assert sample.clock_skew_ns == 99_000_000, "off by half the difference of the two ways, 1 ms"


def test_the_shortest_round_trip_wins_in_real_time_and_the_newest_in_lock_step() -> None:
    for uses_newest, expected_ns in ((False, 50), (True, 70)):
        book = TimeSyncClients(needed_samples=3, uses_newest=uses_newest)
        client = book.client("")
        for round_trip_ns, skew_ns in ((9, 60), (1, 50), (5, 70)):
            assert book.best(client) is None
            book.add(client, sample_from_round_trip(0, skew_ns, skew_ns, round_trip_ns))
        book.add(client, sample_from_round_trip(10, 0, 0, 5))  # a negative round trip is dropped
        best = book.best(client)
        assert best is not None
        assert abs(best.clock_skew_ns - expected_ns) <= 5


# ---------------------------------------------------------------------------------------------------------- tokens


class Mint:
    """A token mint with a clock set by hand."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.tokens = TokenMint(Credentials("u", "p"), "serial", 60.0, 3, 10.0, lambda: self.now_s)


def test_tokens_are_good_until_they_expire_are_forged_or_revoked() -> None:
    mint, other = Mint(), Mint()
    token = mint.tokens.mint("u")
    assert mint.tokens.user_of(token) == "u"
    assert other.tokens.user_of(token) is None, "signed by another robot"
    assert mint.tokens.user_of(token[:-4] + "AAAA") is None
    assert mint.tokens.user_of("None") is None
    assert mint.tokens.renew(token) != token
    mint.now_s += 61
    assert mint.tokens.user_of(token) is None
    assert mint.tokens.renew(token) is None
    fresh = mint.tokens.mint("u")
    mint.tokens.revoke_all()
    assert mint.tokens.user_of(fresh) is None


def test_wrong_passwords_lock_the_door_for_a_while() -> None:
    mint = Mint()
    for _ in range(3):
        assert mint.tokens.log_in("u", "wrong")[0] is LoginResult.INVALID
    assert mint.tokens.log_in("u", "p")[0] is LoginResult.LOCKED_OUT
    mint.now_s += 10
    assert mint.tokens.log_in("u", "p")[0] is LoginResult.OK


def test_a_password_never_shows() -> None:
    mint = Mint()
    mint.tokens.credentials = Credentials("u", "hunter2")
    assert "hunter2" not in repr(mint.tokens)
