"""DataAcquisitionService and its store: images of the cameras, taken at once and listed; there is no plug-in."""

from __future__ import annotations

import threading
from collections import OrderedDict
from typing import Any, Final, TypeAlias

from bosdyn.api import data_acquisition_pb2, data_acquisition_store_pb2, image_pb2

from fake_robot.services.calls.stamps import ns_from_timestamp, timestamp_from_ns
from fake_robot.services.sensors.cameras import ImageService
from fake_robot.services.sensors.world import World

IMAGE_SERVICE: Final = "image"
MAX_REQUESTS: Final = 256
"""Whose images are kept; the oldest give way."""

Identifier: TypeAlias = data_acquisition_pb2.DataIdentifier


class Captures:
    """What was taken, by request. Thread-safe."""

    def __init__(self) -> None:
        self._by_request: OrderedDict[int, list[Identifier]] = OrderedDict()
        self._last_request, self._last_id = 0, 0
        self._lock = threading.Lock()

    def keep(self, action: data_acquisition_pb2.CaptureActionId, channels: list[str]) -> int:
        """Number the data of one request; returns the request's number."""
        with self._lock:
            kept = []
            for channel in channels:
                self._last_id += 1
                kept.append(Identifier(action_id=action, channel=channel, id=self._last_id))
            self._last_request += 1
            self._by_request[self._last_request] = kept
            while len(self._by_request) > MAX_REQUESTS:
                self._by_request.popitem(last=False)
            return self._last_request

    def of(self, request_id: int) -> list[Identifier] | None:
        """The data of one request; None if there is none of that number."""
        with self._lock:
            return self._by_request.get(request_id)

    def matching(self, query: data_acquisition_store_pb2.DataQueryParams) -> list[Identifier]:
        """All data of the asked actions, or of the asked time; without a question, all."""
        with self._lock:
            found = [data for kept in self._by_request.values() for data in kept]
        return [data for data in found if _is_asked_for(data.action_id, query)]

    @property
    def last_id(self) -> int:
        """Number of the newest."""
        return self._last_id


class DataAcquisitionService:
    """Takes images."""

    def __init__(self, world: World, images: ImageService, captures: Captures) -> None:
        self._now_ns, self._images, self._captures = world.now_ns, images, captures

    def GetServiceInfo(self, request: Any) -> Any:  # noqa: N802
        """What a base robot can capture: the images of its cameras."""
        response = data_acquisition_pb2.GetServiceInfoResponse()
        names = [s.name for s in self._images.ListImageSources(image_pb2.ListImageSourcesRequest()).image_sources]
        if names:
            response.capabilities.image_sources.add(service_name=IMAGE_SERVICE, image_source_names=names)
        return response

    def AcquireData(self, request: Any) -> Any:  # noqa: N802
        """Take the asked images; whatever needs a plug-in is of an unknown type."""
        response = data_acquisition_pb2.AcquireDataResponse()
        wanted = request.acquisition_requests
        sources = [c.image_request.image_source_name or c.image_source for c in wanted.image_captures]
        asked = [image_pb2.ImageRequest(image_source_name=name) for name in sources]
        taken = self._images.GetImage(image_pb2.GetImageRequest(image_requests=asked)).image_responses
        is_known = all(shot.status == shot.STATUS_OK for shot in taken) and len(taken) == len(asked)
        others = wanted.data_captures or wanted.network_compute_captures
        if others or not is_known or any(c.image_service != IMAGE_SERVICE for c in wanted.image_captures):
            response.status = response.STATUS_UNKNOWN_CAPTURE_TYPE
            return response
        action = data_acquisition_pb2.CaptureActionId.FromString(request.action_id.SerializeToString())
        if not action.HasField("timestamp"):
            action.timestamp.CopyFrom(timestamp_from_ns(self._now_ns()))
        response.status, response.request_id = response.STATUS_OK, self._captures.keep(action, sources)
        return response

    def GetStatus(self, request: Any) -> Any:  # noqa: N802
        """Complete, for images are taken at once."""
        response, kept = data_acquisition_pb2.GetStatusResponse(), self._captures.of(request.request_id)
        response.status = response.STATUS_REQUEST_ID_DOES_NOT_EXIST if kept is None else response.STATUS_COMPLETE
        response.data_saved.extend(kept or ())
        return response

    def CancelAcquisition(self, request: Any) -> Any:  # noqa: N802
        """Too late for whatever was asked for."""
        response = data_acquisition_pb2.CancelAcquisitionResponse()
        is_known = self._captures.of(request.request_id) is not None
        response.status = response.STATUS_FAILED_TO_CANCEL if is_known else response.STATUS_REQUEST_ID_DOES_NOT_EXIST
        return response


class DataAcquisitionStoreService:
    """Lists what was taken; it is downloaded over HTTPS, for which there is no server here."""

    def __init__(self, captures: Captures) -> None:
        self._captures = captures

    def ListCaptureActions(self, request: Any) -> Any:  # noqa: N802
        """The actions of all data, once each."""
        found = {data.action_id.SerializeToString(): data.action_id for data in self._captures.matching(request.query)}
        return data_acquisition_store_pb2.ListCaptureActionsResponse(action_ids=found.values())

    def ListStoredImages(self, request: Any) -> Any:  # noqa: N802
        """The images."""
        return data_acquisition_store_pb2.ListStoredImagesResponse(data_ids=self._captures.matching(request.query))

    def QueryMaxCaptureId(self, request: Any) -> Any:  # noqa: N802
        """The newest image's number."""
        return data_acquisition_store_pb2.QueryMaxCaptureIdResponse(max_capture_id=self._captures.last_id)


def _is_asked_for(
    action: data_acquisition_pb2.CaptureActionId, query: data_acquisition_store_pb2.DataQueryParams
) -> bool:
    kind = query.WhichOneof("query")
    if kind == "action_ids":
        wanted = query.action_ids.action_ids
        return any(
            w.action_name in ("", action.action_name) and w.group_name in ("", action.group_name) for w in wanted
        )
    if kind == "time_range":
        begin, end, at_ns = (
            query.time_range.from_timestamp,
            query.time_range.to_timestamp,
            ns_from_timestamp(action.timestamp),
        )
        return ns_from_timestamp(begin) <= at_ns <= (ns_from_timestamp(end) or at_ns)
    return True
