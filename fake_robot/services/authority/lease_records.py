"""Who owns the robot's lease: epochs, sequences, staleness. Pure bookkeeping, no gRPC.

A lease is "more recent" than another by its sequence, compared element by element; a longer sequence with the same
beginning is a sub-lease of the shorter one. A command needs a lease that is at least as recent as the newest one that
the robot has seen. [sdk]
"""

from __future__ import annotations

import enum
import threading
from dataclasses import dataclass, field

from bosdyn.api import lease_pb2

from fake_robot.services.authority.liveness import Heartbeat, LivenessClock
from fake_robot.services.calls.stamps import StatusValue, timestamp_from_ns

ROOT_RESOURCE = "body"
LEAF_RESOURCE = "mobility"
RESOURCES = (ROOT_RESOURCE, LEAF_RESOURCE)
LISTED_RESOURCES = ("all-leases", *RESOURCES)
"""As a base robot lists them. Source: the vendor's "Understanding Spot Programming"."""

NOBODY = "root"
"""Client name in the lease of a resource that nobody has acquired."""

UseStatus = lease_pb2.LeaseUseResult


class Recency(enum.Enum):
    """How one sequence compares with another."""

    OLDER = "older"
    SUPER = "super"
    SAME = "same"
    SUB = "sub"
    NEWER = "newer"


def compare_sequences(sequence: tuple[int, ...], other: tuple[int, ...]) -> Recency:
    """Compare two lease sequences; both must have at least one element."""
    for mine, theirs in zip(sequence, other, strict=False):
        if mine != theirs:
            return Recency.OLDER if mine < theirs else Recency.NEWER
    if len(sequence) == len(other):
        return Recency.SAME
    return Recency.SUPER if len(sequence) < len(other) else Recency.SUB


@dataclass
class Claim:
    """A granted lease: its owner, what was granted, the newest sub-lease seen, and when it was last heard of."""

    resource: str
    sequence: tuple[int, ...]
    owner: lease_pb2.LeaseOwner
    heartbeat: Heartbeat
    latest: tuple[int, ...]
    latest_client_names: tuple[str, ...] = ()
    is_revoked: bool = False


@dataclass
class LeaseRecords:
    """The lease service's memory. Thread-safe.

    One claim covers the robot: a base Spot has a single leaf (``mobility``) under its root (``body``).
    """

    clock: LivenessClock
    epoch: str
    timeout_s: float
    _claim: Claim | None = None
    _root: int = 1
    _lock: threading.RLock = field(default_factory=threading.RLock)

    def acquire(self, resource: str, owner: lease_pb2.LeaseOwner) -> tuple[StatusValue, lease_pb2.Lease | None]:
        """Grant the lease if nobody holds a live one; returns ``AcquireLeaseResponse`` status and the lease."""
        with self._lock:
            if resource not in RESOURCES:
                return lease_pb2.AcquireLeaseResponse.STATUS_INVALID_RESOURCE, None
            if self._live_claim() is not None:
                return lease_pb2.AcquireLeaseResponse.STATUS_RESOURCE_ALREADY_CLAIMED, None
            return lease_pb2.AcquireLeaseResponse.STATUS_OK, self._grant(resource, owner)

    def take(self, resource: str, owner: lease_pb2.LeaseOwner) -> tuple[StatusValue, lease_pb2.Lease | None]:
        """Grant the lease whoever holds it; returns ``TakeLeaseResponse`` status and the lease."""
        with self._lock:
            if resource not in RESOURCES:
                return lease_pb2.TakeLeaseResponse.STATUS_INVALID_RESOURCE, None
            return lease_pb2.TakeLeaseResponse.STATUS_OK, self._grant(resource, owner)

    def give_back(self, lease: lease_pb2.Lease) -> StatusValue:
        """End the claim; returns ``ReturnLeaseResponse`` status."""
        with self._lock:
            if lease.resource not in RESOURCES:
                return lease_pb2.ReturnLeaseResponse.STATUS_INVALID_RESOURCE
            claim = self._live_claim()
            is_mine = claim is not None and lease.epoch == self.epoch and claim.resource == lease.resource
            if claim is None or not is_mine or tuple(lease.sequence)[:1] != claim.latest[:1]:
                return lease_pb2.ReturnLeaseResponse.STATUS_NOT_ACTIVE_LEASE
            self._claim = None
            return lease_pb2.ReturnLeaseResponse.STATUS_OK

    def use(self, lease: lease_pb2.Lease, *, is_retain: bool = False) -> lease_pb2.LeaseUseResult:
        """Judge a lease that came with a request, and remember it if it is good.

        A retain accepts the lease that was granted even when sub-leases of it have been used since; a command does
        not.
        """
        with self._lock:
            claim = self._claim
            result = lease_pb2.LeaseUseResult(attempted_lease=lease)
            if claim is not None:
                result.owner.CopyFrom(claim.owner)
                result.previous_lease.CopyFrom(self._latest(claim))
            result.status = self._judge(lease, is_retain)
            if claim is not None and result.status == UseStatus.STATUS_OK:
                claim.heartbeat = self.clock.beat()
                if compare_sequences(tuple(lease.sequence), claim.latest) is not Recency.SUPER:
                    claim.latest, claim.latest_client_names = tuple(lease.sequence), tuple(lease.client_names)
            if claim is not None:
                result.latest_known_lease.CopyFrom(self._latest(claim, lease.resource or ROOT_RESOURCE))
                result.latest_resources.add().CopyFrom(self._latest(claim, LEAF_RESOURCE))
            return result

    def resources(self, *, is_full: bool) -> list[lease_pb2.LeaseResource]:
        """Every resource with its lease and owner, as ``ListLeases`` tells them."""
        with self._lock:
            listed = []
            for resource in LISTED_RESOURCES:
                entry = lease_pb2.LeaseResource(resource=resource)
                entry.lease.CopyFrom(
                    lease_pb2.Lease(resource=resource, epoch=self.epoch, sequence=[self._root], client_names=[NOBODY])
                )
                entry.lease_owner.SetInParent()
                claim = self._claim
                if claim is not None and (claim.resource in {resource, ROOT_RESOURCE}):
                    entry.lease.CopyFrom(self._latest(claim, resource))
                    if not is_full:
                        del entry.lease.sequence[1:]
                        del entry.lease.client_names[1:]
                    entry.lease_owner.CopyFrom(claim.owner)
                    stale_ns = claim.heartbeat.robot_stamp_ns + round(self.timeout_s * 1e9)
                    entry.stale_time.CopyFrom(timestamp_from_ns(stale_ns))
                    entry.is_stale = self._live_claim() is None
                listed.append(entry)
            return listed

    def owner(self) -> lease_pb2.LeaseOwner:
        """The owner of the live claim; empty where there is none."""
        with self._lock:
            claim = self._live_claim()
            return lease_pb2.LeaseOwner() if claim is None else claim.owner

    def expire(self) -> bool:
        """Revoke the claim if its holder fell silent; True exactly once a claim, when that happens."""
        with self._lock:
            claim = self._claim
            if claim is None or claim.is_revoked or self.clock.elapsed_s(claim.heartbeat) <= self.timeout_s:
                return False
            claim.is_revoked = True
            return True

    def revoke(self) -> None:
        """Take the lease from its holder, as if it had expired."""
        with self._lock:
            if self._claim is not None:
                self._claim.is_revoked = True

    def reset(self, epoch: str) -> None:
        """Forget everything and start a new epoch, as a reboot does."""
        with self._lock:
            self.epoch, self._claim, self._root = epoch, None, 1

    def _judge(self, lease: lease_pb2.Lease, is_retain: bool) -> StatusValue:
        if not lease.resource or not lease.sequence:
            return UseStatus.STATUS_INVALID_LEASE
        if lease.resource not in RESOURCES:
            return UseStatus.STATUS_UNMANAGED
        if lease.epoch != self.epoch:
            return UseStatus.STATUS_WRONG_EPOCH
        claim = self._claim
        if claim is None:
            return UseStatus.STATUS_REVOKED
        recency = compare_sequences(tuple(lease.sequence), claim.latest)
        is_allowed = recency in {Recency.SAME, Recency.SUB, Recency.NEWER} or (is_retain and recency is Recency.SUPER)
        is_granted_root = lease.sequence[0] == claim.sequence[0]
        if not is_allowed and not (is_retain and is_granted_root):
            return UseStatus.STATUS_OLDER
        if self._live_claim() is None:
            return UseStatus.STATUS_REVOKED
        if claim.resource == LEAF_RESOURCE and lease.resource == ROOT_RESOURCE:
            return UseStatus.STATUS_INVALID_LEASE
        return UseStatus.STATUS_OK

    def _grant(self, resource: str, owner: lease_pb2.LeaseOwner) -> lease_pb2.Lease:
        newest = self._claim.latest[0] if self._claim is not None else 0
        self._root = max(self._root, newest) + 1
        sequence = (self._root,)
        kept_owner = lease_pb2.LeaseOwner()
        kept_owner.CopyFrom(owner)
        self._claim = Claim(resource, sequence, kept_owner, self.clock.beat(), sequence, (owner.client_name,))
        return self._latest(self._claim)

    def _live_claim(self) -> Claim | None:
        claim = self._claim
        if claim is None or claim.is_revoked or self.clock.elapsed_s(claim.heartbeat) > self.timeout_s:
            return None
        return claim

    def _latest(self, claim: Claim, resource: str | None = None) -> lease_pb2.Lease:
        return lease_pb2.Lease(
            resource=resource or claim.resource,
            epoch=self.epoch,
            sequence=claim.latest,
            client_names=claim.latest_client_names,
        )
