"""DirectoryService and DirectoryRegistrationService: which services there are, and adding one's own."""

from __future__ import annotations

from typing import Any

from bosdyn.api import (
    directory_pb2,
    directory_registration_pb2,
)

from fake_robot.services.identity.directory_entries import DirectoryEntries


class DirectoryService:
    """Lists the services."""

    def __init__(self, directory: DirectoryEntries) -> None:
        self._directory = directory

    def ListServiceEntries(self, request: Any) -> Any:  # noqa: N802
        """List every entry."""
        return directory_pb2.ListServiceEntriesResponse(service_entries=self._directory.entries())

    def GetServiceEntry(self, request: Any) -> Any:  # noqa: N802
        """Look one entry up by name."""
        entry = self._directory.entry(request.service_name)
        if entry is None:
            return directory_pb2.GetServiceEntryResponse(
                status=directory_pb2.GetServiceEntryResponse.STATUS_NONEXISTENT_SERVICE
            )
        return directory_pb2.GetServiceEntryResponse(
            status=directory_pb2.GetServiceEntryResponse.STATUS_OK, service_entry=entry
        )


class DirectoryRegistrationService:
    """Lets clients list services of their own; calls of types that the robot does not serve itself are passed on."""

    def __init__(self, directory: DirectoryEntries) -> None:
        self._directory = directory

    def RegisterService(self, request: Any) -> Any:  # noqa: N802
        """Add an entry."""
        response = directory_registration_pb2.RegisterServiceResponse()
        is_new = self._directory.register(request.service_entry, _address(request.endpoint))
        response.status = response.STATUS_OK if is_new else response.STATUS_ALREADY_EXISTS
        return response

    def UpdateService(self, request: Any) -> Any:  # noqa: N802
        """Replace an entry that a client added."""
        response = directory_registration_pb2.UpdateServiceResponse()
        is_known = self._directory.update(request.service_entry, _address(request.endpoint))
        response.status = response.STATUS_OK if is_known else response.STATUS_NONEXISTENT_SERVICE
        return response

    def UnregisterService(self, request: Any) -> Any:  # noqa: N802
        """Drop an entry that a client added."""
        response = directory_registration_pb2.UnregisterServiceResponse()
        is_known = self._directory.unregister(request.service_name)
        response.status = response.STATUS_OK if is_known else response.STATUS_NONEXISTENT_SERVICE
        return response


def _address(endpoint: Any) -> str:
    return f"{endpoint.host_ip}:{endpoint.port}" if endpoint.host_ip and endpoint.port else ""
