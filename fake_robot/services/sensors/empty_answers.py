"""Point-cloud, local-grid and world-object services of a robot that senses nothing: empty, valid answers."""

from __future__ import annotations

import grpc
from bosdyn.api import (
    local_grid_pb2,
    local_grid_service_pb2_grpc,
    point_cloud_pb2,
    point_cloud_service_pb2_grpc,
    world_object_pb2,
    world_object_service_pb2_grpc,
)


class PointCloudService(point_cloud_service_pb2_grpc.PointCloudServiceServicer):  # type: ignore[misc]
    """The fake has no lidar."""

    def ListPointCloudSources(  # noqa: N802
        self, request: point_cloud_pb2.ListPointCloudSourcesRequest, context: grpc.ServicerContext
    ) -> point_cloud_pb2.ListPointCloudSourcesResponse:
        """No sources."""
        return point_cloud_pb2.ListPointCloudSourcesResponse()

    def GetPointCloud(  # noqa: N802
        self, request: point_cloud_pb2.GetPointCloudRequest, context: grpc.ServicerContext
    ) -> point_cloud_pb2.GetPointCloudResponse:
        """Every source is unknown."""
        unknown = point_cloud_pb2.PointCloudResponse(status=point_cloud_pb2.PointCloudResponse.STATUS_UNKNOWN_SOURCE)
        return point_cloud_pb2.GetPointCloudResponse(
            point_cloud_responses=[unknown for _ in request.point_cloud_requests]
        )


class LocalGridService(local_grid_service_pb2_grpc.LocalGridServiceServicer):  # type: ignore[misc]
    """The fake keeps no maps of its surroundings."""

    def GetLocalGridTypes(  # noqa: N802
        self, request: local_grid_pb2.GetLocalGridTypesRequest, context: grpc.ServicerContext
    ) -> local_grid_pb2.GetLocalGridTypesResponse:
        """No types."""
        return local_grid_pb2.GetLocalGridTypesResponse()

    def GetLocalGrids(  # noqa: N802
        self, request: local_grid_pb2.GetLocalGridsRequest, context: grpc.ServicerContext
    ) -> local_grid_pb2.GetLocalGridsResponse:
        """No grid exists."""
        response = local_grid_pb2.GetLocalGridsResponse(num_local_grid_errors=len(request.local_grid_requests))
        for wanted in request.local_grid_requests:
            response.local_grid_responses.add(
                local_grid_type_name=wanted.local_grid_type_name,
                status=local_grid_pb2.LocalGridResponse.STATUS_NO_SUCH_GRID,
            )
        return response


class WorldObjectService(world_object_service_pb2_grpc.WorldObjectServiceServicer):  # type: ignore[misc]
    """The fake perceives no objects and lets nobody add any."""

    def ListWorldObjects(  # noqa: N802
        self, request: world_object_pb2.ListWorldObjectRequest, context: grpc.ServicerContext
    ) -> world_object_pb2.ListWorldObjectResponse:
        """No objects."""
        return world_object_pb2.ListWorldObjectResponse()

    def MutateWorldObjects(  # noqa: N802
        self, request: world_object_pb2.MutateWorldObjectRequest, context: grpc.ServicerContext
    ) -> world_object_pb2.MutateWorldObjectResponse:
        """Not permitted."""
        response = world_object_pb2.MutateWorldObjectResponse()
        response.status = response.STATUS_NO_PERMISSION
        return response
