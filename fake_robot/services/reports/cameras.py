"""The cameras of a base robot, which see the simulated scene or, where nothing draws it, a test card.

Their images are given out at once, or taken and listed; there is no plug-in, and no server to download from.
"""

from __future__ import annotations

import io
import math
from collections import OrderedDict
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from bosdyn.api import (
    data_acquisition_pb2,
    data_acquisition_service_pb2,
    data_acquisition_store_pb2,
    data_acquisition_store_service_pb2,
    image_pb2,
    image_service_pb2,
)
from bosdyn.client.math_helpers import Quat, SE3Pose
from numpy.typing import NDArray

from fake_robot.network.requests import CameraView
from fake_robot.network.status import Snapshot
from fake_robot.services.calls import Service, ns_of, refuse, timestamp_from_ns
from fake_robot.services.reports.state_message import ROOT_FRAME, frame_tree
from fake_robot.services.world import World
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.mjcf import BODY_HALF_SIZE_M

_FIELD = 8
"""Pixels of one side of a field."""
_DARK, _LIGHT, _RANGE = 40, 110, 100


@lru_cache(maxsize=4)
def card_pixels(cols: int, rows: int) -> NDArray[np.uint8]:
    """A grey chessboard that gets lighter to the right, inverted at the upper left; shape (rows, cols).

    Up, down, left and right differ.
    """
    width, height = -(-cols // _FIELD), -(-rows // _FIELD)
    y, x = np.mgrid[0:height, 0:width]
    card = np.where((x + y) % 2 == 0, _DARK, _LIGHT) + (x * _RANGE) // max(1, width - 1)
    card[: height // 4, : width // 4] = 255 - card[: height // 4, : width // 4]
    return np.kron(card.astype(np.uint8), np.ones((_FIELD, _FIELD), dtype=np.uint8))[:rows, :cols]


VISUAL_SIZE = (640, 480)
MAX_IMAGES = 30
"""In one answer: each source twice."""
DEPTH_SCALE = 1000.0
"""Counts of a depth image a metre."""
_PERIOD_NS = NS_PER_S // 15
"""A camera takes a picture no sooner than this after its last one; a request in between gets that one again."""
_LONG_M, _WIDE_M, _ = BODY_HALF_SIZE_M
_HEADINGS_RAD = {
    "frontleft": (0.1, (_LONG_M, 0.04)),
    "frontright": (-0.1, (_LONG_M, -0.04)),
    "left": (math.pi / 2, (0.0, _WIDE_M)),
    "right": (-math.pi / 2, (0.0, -_WIDE_M)),
    "back": (math.pi, (-_LONG_M, 0.0)),
}
"""Where each pair of cameras looks, and where on the body it sits (x, y): roughly as on the robot."""
_LENS_FROM_LEVEL = Quat(0.5, -0.5, 0.5, -0.5)
"""A camera's z looks ahead, its x to the right and its y down."""

Image = image_pb2.Image


@dataclass(frozen=True)
class Camera:
    """One image source: its size in pixels, its sensor's frame, and how its images may be had."""

    name: str
    is_depth: bool
    size: tuple[int, int]
    frame: str
    body_from_lens: SE3Pose

    @property
    def formats(self) -> tuple[int, ...]:
        """Encodings, the best one first."""
        return (Image.FORMAT_RAW,) if self.is_depth else (Image.FORMAT_JPEG, Image.FORMAT_RAW)

    @property
    def pixel_format(self) -> int:
        """The one kind of pixels that it has."""
        return int(Image.PIXEL_FORMAT_DEPTH_U16 if self.is_depth else Image.PIXEL_FORMAT_GREYSCALE_U8)

    @property
    def view(self) -> CameraView:
        """What it looks at."""
        at, turn = self.body_from_lens, self.body_from_lens.rot
        return CameraView((at.x, at.y, at.z), (turn.w, turn.x, turn.y, turn.z), *self.size, self.is_depth)


@dataclass(frozen=True)
class Capture:
    """What a camera saw, and how the robot reported itself then."""

    snapshot: Snapshot
    pixels: NDArray[Any]


def _cameras() -> dict[str, Camera]:
    cameras = []
    for place, (heading_rad, (x_m, y_m)) in _HEADINGS_RAD.items():
        pose = SE3Pose(x_m, y_m, 0.0, Quat.from_yaw(heading_rad) * _LENS_FROM_LEVEL)
        fisheye = f"{place}_fisheye"
        cameras += [
            Camera(f"{place}_fisheye_image", is_depth=False, size=VISUAL_SIZE, frame=fisheye, body_from_lens=pose),
            Camera(f"{place}_depth", is_depth=True, size=(424, 240), frame=place, body_from_lens=pose),
            Camera(
                f"{place}_depth_in_visual_frame", is_depth=True, size=VISUAL_SIZE, frame=fisheye, body_from_lens=pose
            ),
        ]
    return {camera.name: camera for camera in sorted(cameras, key=lambda camera: camera.name)}


class ImageService(Service):
    """Lists the cameras and gives out their images; none of them where the configuration says so."""

    modules = (image_service_pb2,)

    def __init__(self, world: World) -> None:
        super().__init__()
        self._world = world
        self.cameras = _cameras() if world.config.cameras != "none" else {}
        self._sees_scene = world.config.cameras == "scene"
        self._captures: dict[str, Capture] = {}

    def ListImageSources(self, request: Any, response: Any) -> None:  # noqa: N802
        """Every camera."""
        response.image_sources.extend(_source(camera, camera.size) for camera in self.cameras.values())

    def GetImage(self, request: Any, response: Any) -> None:  # noqa: N802
        """An image for each request, in their order."""
        if len(request.image_requests) > MAX_IMAGES:
            refuse(response, f"{len(request.image_requests)} images in one request; allowed: {MAX_IMAGES}")
            return
        for wanted in request.image_requests:
            self._answer(wanted, response.image_responses.add())

    def _answer(self, wanted: image_pb2.ImageRequest, answer: image_pb2.ImageResponse) -> None:
        camera = self.cameras.get(wanted.image_source_name)
        if camera is None:
            answer.status, answer.source.name = answer.STATUS_UNKNOWN_CAMERA, wanted.image_source_name
            return
        answer.source.CopyFrom(_source(camera, camera.size))
        ratio = wanted.resize_ratio or 1.0
        asked = [wanted.image_format or camera.formats[0], *wanted.fallback_formats]
        encoding = next((kind for kind in asked if kind in camera.formats), None)
        if not 0.0 < ratio <= 1.0:
            answer.status = answer.STATUS_UNSUPPORTED_RESIZE_RATIO_REQUESTED
        elif wanted.pixel_format not in {Image.PIXEL_FORMAT_UNKNOWN, camera.pixel_format}:
            answer.status = answer.STATUS_UNSUPPORTED_PIXEL_FORMAT_REQUESTED
        elif encoding is None:
            answer.status = answer.STATUS_UNSUPPORTED_IMAGE_FORMAT_REQUESTED
        else:
            size = (max(1, round(camera.size[0] * ratio)), max(1, round(camera.size[1] * ratio)))
            answer.status = answer.STATUS_OK
            answer.source.CopyFrom(_source(camera, size))
            self._fill(answer.shot, camera, size, encoding)

    def _capture(self, camera: Camera) -> Capture:
        """The camera's newest picture; a new one if that is old."""
        snapshot = self._world.robot.snapshot()
        last = self._captures.get(camera.name)
        if last is not None and 0 <= snapshot.robot_stamp_ns - last.snapshot.robot_stamp_ns < _PERIOD_NS:
            return last
        pixels = self._world.robot.see(camera.view) if self._sees_scene else None
        if pixels is None:
            cols, rows = camera.size
            pixels = np.zeros((rows, cols), np.uint16) if camera.is_depth else card_pixels(cols, rows)
        self._captures[camera.name] = Capture(snapshot, pixels)
        return self._captures[camera.name]

    def _fill(self, shot: image_pb2.ImageCapture, camera: Camera, size: tuple[int, int], encoding: int) -> None:
        capture = self._capture(camera)
        snapshot = capture.snapshot
        shot.acquisition_time.CopyFrom(timestamp_from_ns(snapshot.robot_stamp_ns))
        shot.transforms_snapshot.CopyFrom(frame_tree(snapshot))
        edge = shot.transforms_snapshot.child_to_parent_edge_map[camera.frame]
        edge.parent_frame_name = ROOT_FRAME
        edge.parent_tform_child.CopyFrom(camera.body_from_lens.to_proto())
        shot.frame_name_image_sensor = camera.frame
        shot.image.cols, shot.image.rows = size
        shot.image.format, shot.image.pixel_format = encoding, camera.pixel_format
        shot.image.data = _encoded(capture.pixels, size, is_jpeg=encoding == Image.FORMAT_JPEG)


def _source(camera: Camera, size: tuple[int, int]) -> image_pb2.ImageSource:
    source = image_pb2.ImageSource(name=camera.name, cols=size[0], rows=size[1])
    source.image_formats.extend(camera.formats)
    source.pixel_formats.append(camera.pixel_format)
    if camera.is_depth:
        source.image_type, source.depth_scale = source.IMAGE_TYPE_DEPTH, DEPTH_SCALE
    else:
        source.image_type = source.IMAGE_TYPE_VISUAL
    # A lens that sees 90 degrees across: the fake's own, not the robot's.
    lens = source.pinhole.intrinsics
    lens.focal_length.x = lens.focal_length.y = lens.principal_point.x = size[0] / 2
    lens.principal_point.y = size[1] / 2
    return source


def _encoded(pixels: NDArray[Any], size: tuple[int, int], *, is_jpeg: bool) -> bytes:
    from PIL import Image as Picture  # a robot that shows no image starts without it

    picture = Picture.fromarray(pixels)
    if picture.size != size:
        # A mean of depths would lie where nothing is.
        picture = picture.resize(size, Picture.Resampling.NEAREST)
    if not is_jpeg:
        return picture.tobytes()
    file = io.BytesIO()
    picture.save(file, "JPEG", quality=90)
    return file.getvalue()


IMAGE_SERVICE: Final = "image"


class DataAcquisitionService(Service):
    """Takes images and lists what was taken, by request."""

    modules = (data_acquisition_service_pb2, data_acquisition_store_service_pb2)

    def __init__(self, world: World, images: ImageService) -> None:
        super().__init__()
        self._now_ns, self._images = world.now_ns, images
        self._by_request: OrderedDict[int, list[data_acquisition_pb2.DataIdentifier]] = OrderedDict()
        self._last_request, self._last_id = 0, 0

    def GetServiceInfo(self, request: Any, response: Any) -> None:  # noqa: N802
        """What a base robot can capture: the images of its cameras."""
        if names := list(self._images.cameras):
            response.capabilities.image_sources.add(service_name=IMAGE_SERVICE, image_source_names=names)

    def AcquireData(self, request: Any, response: Any) -> None:  # noqa: N802
        """Take the asked images; whatever needs a plug-in is of an unknown type."""
        wanted = request.acquisition_requests
        sources = [c.image_request.image_source_name or c.image_source for c in wanted.image_captures]
        is_known = len(sources) <= MAX_IMAGES and set(sources) <= set(self._images.cameras)
        others = wanted.data_captures or wanted.network_compute_captures
        if others or not is_known or any(c.image_service != IMAGE_SERVICE for c in wanted.image_captures):
            response.status = response.STATUS_UNKNOWN_CAPTURE_TYPE
            return
        action = request.action_id
        if not action.HasField("timestamp"):
            action.timestamp.CopyFrom(timestamp_from_ns(self._now_ns()))
        first, self._last_id = self._last_id + 1, self._last_id + len(sources)
        self._last_request += 1
        self._by_request[self._last_request] = [
            data_acquisition_pb2.DataIdentifier(action_id=action, channel=channel, id=number)
            for number, channel in enumerate(sources, first)
        ]
        if len(self._by_request) > 256:
            self._by_request.popitem(last=False)
        response.status, response.request_id = response.STATUS_OK, self._last_request

    def GetStatus(self, request: Any, response: Any) -> None:  # noqa: N802
        """Complete, for images are taken at once."""
        kept = self._by_request.get(request.request_id)
        response.status = response.STATUS_REQUEST_ID_DOES_NOT_EXIST if kept is None else response.STATUS_COMPLETE
        response.data_saved.extend(kept or ())

    def CancelAcquisition(self, request: Any, response: Any) -> None:  # noqa: N802
        """Too late for whatever was asked for."""
        is_known = request.request_id in self._by_request
        response.status = response.STATUS_FAILED_TO_CANCEL if is_known else response.STATUS_REQUEST_ID_DOES_NOT_EXIST

    def ListCaptureActions(self, request: Any, response: Any) -> None:  # noqa: N802
        """The actions of all data, once each."""
        found = {data.action_id.SerializeToString(): data.action_id for data in self._matching(request.query)}
        response.action_ids.extend(found.values())

    def ListStoredImages(self, request: Any, response: Any) -> None:  # noqa: N802
        """The images."""
        response.data_ids.extend(self._matching(request.query))

    def QueryMaxCaptureId(self, request: Any, response: Any) -> None:  # noqa: N802
        """The newest image's number."""
        response.max_capture_id = self._last_id

    def _matching(self, query: data_acquisition_store_pb2.DataQueryParams) -> list[data_acquisition_pb2.DataIdentifier]:
        """All data of the asked actions, or of the asked time; without a question, all."""
        found = [data for kept in self._by_request.values() for data in kept]
        return [data for data in found if _is_asked_for(data.action_id, query)]


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
        begin, end = query.time_range.from_timestamp, query.time_range.to_timestamp
        at_ns = ns_of(action.timestamp)
        return ns_of(begin) <= at_ns <= (ns_of(end) or at_ns)
    return True
