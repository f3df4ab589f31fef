"""LeaseService: who may command the robot."""

from __future__ import annotations

from typing import Any

from bosdyn.api import header_pb2, lease_pb2

from fake_robot.services.authority.lease_records import LEAF_RESOURCE, ROOT_RESOURCE, LeaseRecords


class LeaseService:
    """Grants, retains, lists and takes back the lease of the body."""

    def __init__(self, leases: LeaseRecords, user_name: str) -> None:
        self._leases = leases
        self._user_name = user_name

    def AcquireLease(self, request: Any) -> Any:  # noqa: N802
        """Grant the lease unless somebody holds it; the refusal names who."""
        status, lease = self._leases.acquire(request.resource, self._owner(request.header))
        return lease_pb2.AcquireLeaseResponse(status=status, lease=lease, lease_owner=self._leases.owner())

    def TakeLease(self, request: Any) -> Any:  # noqa: N802
        """Grant the lease whoever holds it."""
        status, lease = self._leases.take(request.resource, self._owner(request.header))
        return lease_pb2.TakeLeaseResponse(status=status, lease=lease, lease_owner=self._leases.owner())

    def ReturnLease(self, request: Any) -> Any:  # noqa: N802
        """Take the lease back."""
        return lease_pb2.ReturnLeaseResponse(status=self._leases.give_back(request.lease))

    def RetainLease(self, request: Any) -> Any:  # noqa: N802
        """Keep the lease from going stale."""
        return lease_pb2.RetainLeaseResponse(lease_use_result=self._leases.use(request.lease, is_retain=True))

    def ListLeases(self, request: Any) -> Any:  # noqa: N802
        """List the resources, their owners and the tree that they form."""
        tree = lease_pb2.ResourceTree(
            resource=ROOT_RESOURCE, sub_resources=[lease_pb2.ResourceTree(resource=LEAF_RESOURCE)]
        )
        resources = self._leases.resources(is_full=request.include_full_lease_info)
        return lease_pb2.ListLeasesResponse(resources=resources, resource_tree=tree)

    def _owner(self, header: header_pb2.RequestHeader) -> lease_pb2.LeaseOwner:
        return lease_pb2.LeaseOwner(client_name=header.client_name, user_name=self._user_name)
