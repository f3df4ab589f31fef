"""LeaseService: who may command the robot, by epochs, sequences and signs of life.

A lease is "more recent" than another by its sequence, compared element by element; a longer sequence with the same
beginning is a sub-lease of the shorter one. A command needs a lease that is at least as recent as the newest one that
the robot has seen. [sdk]
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from bosdyn.api import header_pb2, lease_pb2, lease_service_pb2

from fake_robot.services.authority.liveness import Heartbeat, LivenessClock
from fake_robot.services.calls import Service, timestamp_from_ns

ROOT_RESOURCE = "body"
LEAF_RESOURCE = "mobility"
RESOURCES = (ROOT_RESOURCE, LEAF_RESOURCE)
LISTED_RESOURCES = ("all-leases", *RESOURCES)
"""Resources that a base robot lists. Source: the vendor's "Understanding Spot Programming"."""


Use = lease_pb2.LeaseUseResult


@dataclass
class Claim:
    """A granted lease: its owner, its root, the newest sub-lease seen, and when it was last heard of."""

    owner: lease_pb2.LeaseOwner
    root: int
    latest: lease_pb2.Lease
    heartbeat: Heartbeat
    is_revoked: bool = False


class LeaseService(Service):
    """Grants, retains, lists and takes back the lease of the body.

    One claim covers the robot: a base Spot has a single leaf (``mobility``) under its root (``body``).
    """

    modules = (lease_service_pb2,)

    def __init__(self, clock: LivenessClock, *, epoch: str, timeout_s: float, user_name: str) -> None:
        super().__init__()
        self._clock, self._epoch, self._timeout_s, self._user_name = clock, epoch, timeout_s, user_name
        self._claim: Claim | None = None
        self._root = 1

    def AcquireLease(self, request: Any, response: Any) -> None:  # noqa: N802
        """Grant the lease unless somebody holds it; the refusal names who."""
        if request.resource in RESOURCES and self._live_claim() is not None:
            response.status = response.STATUS_RESOURCE_ALREADY_CLAIMED
            response.lease_owner.CopyFrom(self.owner())
        else:
            self.TakeLease(request, response)

    def TakeLease(self, request: Any, response: Any) -> None:  # noqa: N802
        """Grant the lease whoever holds it."""
        if request.resource in RESOURCES:
            response.status = response.STATUS_OK
            response.lease.CopyFrom(self.grant(request.resource, self._requester(request.header)))
        else:
            response.status = response.STATUS_INVALID_RESOURCE
        response.lease_owner.CopyFrom(self.owner())

    def ReturnLease(self, request: Any, response: Any) -> None:  # noqa: N802
        """End the claim."""
        lease, claim = request.lease, self._live_claim()
        if lease.resource not in RESOURCES:
            response.status = response.STATUS_INVALID_RESOURCE
        elif (
            claim is None
            or (lease.epoch, lease.resource) != (self._epoch, claim.latest.resource)
            or lease.sequence[:1] != claim.latest.sequence[:1]
        ):
            response.status = response.STATUS_NOT_ACTIVE_LEASE
        else:
            self._claim, response.status = None, response.STATUS_OK

    def RetainLease(self, request: Any, response: Any) -> None:  # noqa: N802
        """Keep the lease from going stale."""
        response.lease_use_result.CopyFrom(self.use(request.lease, is_retain=True))

    def ListLeases(self, request: Any, response: Any) -> None:  # noqa: N802
        """List the resources, their owners and the tree that they form."""
        response.resource_tree.resource = ROOT_RESOURCE
        response.resource_tree.sub_resources.add(resource=LEAF_RESOURCE)
        claim = self._claim
        for resource in LISTED_RESOURCES:
            entry = response.resources.add(resource=resource)
            entry.lease_owner.SetInParent()
            if claim is None or claim.latest.resource not in {resource, ROOT_RESOURCE}:
                # Client name in the lease of a resource that nobody has acquired.
                unclaimed = {"epoch": self._epoch, "sequence": [self._root], "client_names": ["root"]}
                entry.lease.CopyFrom(lease_pb2.Lease(resource=resource, **unclaimed))
                continue
            entry.lease.CopyFrom(_of_resource(claim.latest, resource))
            if not request.include_full_lease_info:
                del entry.lease.sequence[1:]
                del entry.lease.client_names[1:]
            entry.lease_owner.CopyFrom(claim.owner)
            entry.stale_time.CopyFrom(timestamp_from_ns(claim.heartbeat.robot_stamp_ns + round(self._timeout_s * 1e9)))
            entry.is_stale = self._live_claim() is None

    def grant(self, resource: str, owner: lease_pb2.LeaseOwner) -> lease_pb2.Lease:
        """Give the lease to somebody, whoever holds it."""
        with self.lock:
            newest = self._claim.latest.sequence[0] if self._claim is not None else 0
            self._root = max(self._root, newest) + 1
            names = {"sequence": [self._root], "client_names": [owner.client_name]}
            lease = lease_pb2.Lease(resource=resource, epoch=self._epoch, **names)
            self._claim = Claim(owner, self._root, lease, self._clock.beat())
            return lease

    def use(self, lease: lease_pb2.Lease, *, is_retain: bool = False) -> lease_pb2.LeaseUseResult:
        """Judge a lease that came with a request, and remember it if it is good.

        A retain accepts the lease that was granted even when sub-leases of it have been used since; a command does
        not.
        """
        with self.lock:
            claim = self._claim
            if claim is None:
                return Use(attempted_lease=lease, status=self._judge(lease, is_retain))
            result = Use(attempted_lease=lease, owner=claim.owner, previous_lease=claim.latest)
            result.status = self._judge(lease, is_retain)
            if result.status == Use.STATUS_OK:
                claim.heartbeat = self._clock.beat()
                if not _is_above(lease, claim.latest):
                    kept = {"sequence": lease.sequence, "client_names": lease.client_names}
                    claim.latest = lease_pb2.Lease(resource=claim.latest.resource, epoch=self._epoch, **kept)
            result.latest_known_lease.CopyFrom(_of_resource(claim.latest, lease.resource or ROOT_RESOURCE))
            result.latest_resources.add().CopyFrom(_of_resource(claim.latest, LEAF_RESOURCE))
            return result

    def admits(self, request: Any, response: Any) -> bool:
        """Judge the lease of a request, say so in the answer's ``lease_use_result``, and whether it is good."""
        response.lease_use_result.CopyFrom(self.use(request.lease))
        return bool(response.lease_use_result.status == Use.STATUS_OK)

    def owner(self) -> lease_pb2.LeaseOwner:
        """The owner of the live claim; empty where there is none."""
        with self.lock:
            claim = self._live_claim()
            return lease_pb2.LeaseOwner() if claim is None else claim.owner

    def owns(self, lease: lease_pb2.Lease) -> bool:
        """Whether a lease, or a part of it, is the newest that was granted; one that went stale still is."""
        with self.lock:
            claim = self._claim
            return claim is not None and (lease.epoch, list(lease.sequence[:1])) == (self._epoch, [claim.root])

    def expire(self) -> bool:
        """Revoke the claim if its holder fell silent; True exactly once a claim, when that happens."""
        with self.lock:
            is_due = self._claim is not None and not self._claim.is_revoked and self._live_claim() is None
            if is_due:
                self.revoke()
            return is_due

    def revoke(self) -> None:
        """Take the lease from its holder, as if it had expired."""
        with self.lock:
            if self._claim is not None:
                self._claim.is_revoked = True

    def reset(self, epoch: str) -> None:
        """Forget everything and start a new epoch, as a reboot does."""
        with self.lock:
            self._epoch, self._claim, self._root = epoch, None, 1

    def _judge(self, lease: lease_pb2.Lease, is_retain: bool) -> int:
        """The status of a lease, in the order in which a robot looks."""
        claim = self._claim
        if not lease.resource or not lease.sequence:
            status = Use.STATUS_INVALID_LEASE
        elif lease.resource not in RESOURCES:
            status = Use.STATUS_UNMANAGED
        elif lease.epoch != self._epoch:
            status = Use.STATUS_WRONG_EPOCH
        elif claim is None:
            status = Use.STATUS_REVOKED
        elif list(lease.sequence) < list(claim.latest.sequence) and not (
            is_retain and (lease.sequence[0] == claim.root or _is_above(lease, claim.latest))
        ):
            status = Use.STATUS_OLDER
        elif self._live_claim() is None:
            status = Use.STATUS_REVOKED
        elif (claim.latest.resource, lease.resource) == (LEAF_RESOURCE, ROOT_RESOURCE):
            status = Use.STATUS_INVALID_LEASE
        else:
            status = Use.STATUS_OK
        return int(status)

    def _live_claim(self) -> Claim | None:
        claim = self._claim
        if claim is None or claim.is_revoked or self._clock.elapsed_s(claim.heartbeat) > self._timeout_s:
            return None
        return claim

    def _requester(self, header: header_pb2.RequestHeader) -> lease_pb2.LeaseOwner:
        return lease_pb2.LeaseOwner(client_name=header.client_name, user_name=self._user_name)


def _is_above(lease: lease_pb2.Lease, other: lease_pb2.Lease) -> bool:
    """Whether the other one is a sub-lease of it."""
    length = len(lease.sequence)
    return length < len(other.sequence) and list(lease.sequence) == list(other.sequence[:length])


def _of_resource(lease: lease_pb2.Lease, resource: str) -> lease_pb2.Lease:
    """The same lease, of a resource that it covers."""
    named = lease_pb2.Lease()
    named.CopyFrom(lease)
    named.resource = resource
    return named
