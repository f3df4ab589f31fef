"""LeaseService: who may command the robot."""

from __future__ import annotations

import grpc
from bosdyn.api import header_pb2, lease_pb2, lease_service_pb2_grpc

from fake_robot.services.authority.lease_records import LEAF_RESOURCE, ROOT_RESOURCE, LeaseRecords


class LeaseService(lease_service_pb2_grpc.LeaseServiceServicer):  # type: ignore[misc]
    """Grants, retains, lists and takes back the lease of the body."""

    def __init__(self, leases: LeaseRecords, user_name: str) -> None:
        self._leases = leases
        self._user_name = user_name

    def AcquireLease(  # noqa: N802
        self, request: lease_pb2.AcquireLeaseRequest, context: grpc.ServicerContext
    ) -> lease_pb2.AcquireLeaseResponse:
        """Grant the lease unless somebody holds it; the refusal names who."""
        status, lease = self._leases.acquire(request.resource, self._owner(request.header))
        return lease_pb2.AcquireLeaseResponse(status=status, lease=lease, lease_owner=self._leases.owner())

    def TakeLease(  # noqa: N802
        self, request: lease_pb2.TakeLeaseRequest, context: grpc.ServicerContext
    ) -> lease_pb2.TakeLeaseResponse:
        """Grant the lease whoever holds it."""
        status, lease = self._leases.take(request.resource, self._owner(request.header))
        return lease_pb2.TakeLeaseResponse(status=status, lease=lease, lease_owner=self._leases.owner())

    def ReturnLease(  # noqa: N802
        self, request: lease_pb2.ReturnLeaseRequest, context: grpc.ServicerContext
    ) -> lease_pb2.ReturnLeaseResponse:
        """Take the lease back."""
        return lease_pb2.ReturnLeaseResponse(status=self._leases.give_back(request.lease))

    def RetainLease(  # noqa: N802
        self, request: lease_pb2.RetainLeaseRequest, context: grpc.ServicerContext
    ) -> lease_pb2.RetainLeaseResponse:
        """Keep the lease from going stale."""
        return lease_pb2.RetainLeaseResponse(lease_use_result=self._leases.use(request.lease, is_retain=True))

    def ListLeases(  # noqa: N802
        self, request: lease_pb2.ListLeasesRequest, context: grpc.ServicerContext
    ) -> lease_pb2.ListLeasesResponse:
        """List the resources, their owners and the tree that they form."""
        tree = lease_pb2.ResourceTree(
            resource=ROOT_RESOURCE, sub_resources=[lease_pb2.ResourceTree(resource=LEAF_RESOURCE)]
        )
        resources = self._leases.resources(is_full=request.include_full_lease_info)
        return lease_pb2.ListLeasesResponse(resources=resources, resource_tree=tree)

    def _owner(self, header: header_pb2.RequestHeader) -> lease_pb2.LeaseOwner:
        return lease_pb2.LeaseOwner(client_name=header.client_name, user_name=self._user_name)
