"""The image service: the cameras of a base robot, the test card before them, and the SDK's own errors."""

from __future__ import annotations

import io
import logging
import sys
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bosdyn.api import image_pb2
from bosdyn.client.exceptions import InvalidRequestError
from bosdyn.client.frame_helpers import get_a_tform_b
from bosdyn.client.image import (
    ImageClient,
    UnknownImageSourceError,
    UnsupportedImageFormatRequestedError,
    UnsupportedPixelFormatRequestedError,
    UnsupportedResizeRatioRequestedError,
    build_image_request,
    pixel_to_camera_space,
)
from PIL import Image

from fake_robot.eyes.eyes import Eyes
from fake_robot.network.requests import CameraView
from fake_robot.scenario.scenario import Scenario
from fake_robot.services.reports.cameras import card_pixels

PLACES = ("back", "frontleft", "frontright", "left", "right")


@pytest.fixture
def images(stub: Any) -> Any:
    """The SDK's image client in front of the stub."""
    return stub.sdk_robot().ensure_client(ImageClient.default_service_name)


def test_a_base_robots_cameras_are_there(images: Any) -> None:
    sources = {source.name: source for source in images.list_image_sources()}
    kinds = ("depth", "depth_in_visual_frame", "fisheye_image")
    assert list(sources) == [f"{place}_{kind}" for place in PLACES for kind in kinds]
    assert sources["left_fisheye_image"].image_type == image_pb2.ImageSource.IMAGE_TYPE_VISUAL
    assert sources["left_depth"].image_type == image_pb2.ImageSource.IMAGE_TYPE_DEPTH
    assert [s.name for s in images.list_image_sources_async().result()] == list(sources)


def test_an_image_is_the_test_card_in_both_forms(images: Any) -> None:
    (shot,) = images.get_image_from_sources(["frontleft_fisheye_image"])
    assert shot.shot.image.format == image_pb2.Image.FORMAT_JPEG
    request = build_image_request("frontleft_fisheye_image", image_format=image_pb2.Image.FORMAT_RAW)
    (pixels,) = images.get_image([request])
    assert (pixels.source.cols, pixels.source.rows) == (pixels.shot.image.cols, pixels.shot.image.rows) == (640, 480)
    with Image.open(io.BytesIO(shot.shot.image.data)) as opened:
        assert (opened.mode, opened.size) == ("L", (640, 480))
        raw = np.frombuffer(pixels.shot.image.data, np.uint8).reshape(480, 640)
        np.testing.assert_array_equal(raw, card_pixels(640, 480))
        assert np.abs(np.asarray(opened).astype(int) - raw).mean() < 2.0


def test_a_camera_stands_in_the_tree_of_frames_and_has_a_lens(images: Any) -> None:
    for place, ahead in (("frontleft", (0.42, 0.04)), ("left", (0.0, 0.12)), ("back", (-0.42, 0.0))):
        (shot,) = images.get_image_from_sources([f"{place}_fisheye_image"])
        capture = shot.shot
        body_from_lens = get_a_tform_b(capture.transforms_snapshot, "body", capture.frame_name_image_sensor)
        np.testing.assert_allclose((body_from_lens.x, body_from_lens.y), ahead)
        # Its axis leads away from the body, and down in the image is down.
        x, y, z = body_from_lens.rot.transform_point(0.0, 0.0, 1.0)
        assert x * ahead[0] + y * ahead[1] > 0.0
        assert abs(z) < 1e-9
        assert body_from_lens.rot.transform_point(0.0, 1.0, 0.0)[2] == pytest.approx(-1.0)
        assert get_a_tform_b(capture.transforms_snapshot, "vision", capture.frame_name_image_sensor) is not None
    assert pixel_to_camera_space(shot.source, 640, 240, depth=2.0) == pytest.approx((2.0, 0.0, 2.0))


def test_depth_is_without_a_return_and_images_can_be_smaller(images: Any) -> None:
    depth = build_image_request("back_depth", resize_ratio=0.5)
    small = build_image_request("back_fisheye_image", resize_ratio=0.25)
    first, second = images.get_image([depth, small])
    assert first.shot.image.pixel_format == image_pb2.Image.PIXEL_FORMAT_DEPTH_U16
    assert first.shot.image.data == bytes(2 * 212 * 120)
    with Image.open(io.BytesIO(second.shot.image.data)) as opened:
        assert opened.size == (160, 120)


@pytest.mark.parametrize(
    ("request_of", "error"),
    [
        (lambda: build_image_request("hand_color_image"), UnknownImageSourceError),
        (lambda: build_image_request("left_depth", image_format=1), UnsupportedImageFormatRequestedError),
        (lambda: build_image_request("left_fisheye_image", pixel_format=3), UnsupportedPixelFormatRequestedError),
        (lambda: build_image_request("left_fisheye_image", resize_ratio=1.5), UnsupportedResizeRatioRequestedError),
    ],
    ids=["no such camera", "depth as JPEG", "grey as colour", "larger"],
)
def test_what_a_camera_cannot_do_is_the_sdks_error(
    images: Any, request_of: Callable[[], Any], error: type[Exception]
) -> None:
    with pytest.raises(error):
        images.get_image([request_of()])


def test_no_request_asks_for_more_images_than_an_answer_holds(images: Any) -> None:
    with pytest.raises(InvalidRequestError, match="31 images in one request; allowed: 30"):
        images.get_image_from_sources(["back_depth"] * 31)


def test_a_scenario_can_do_without_cameras(serve_stub: Callable[..., Any]) -> None:
    images = serve_stub(cameras="none").sdk_robot().ensure_client(ImageClient.default_service_name)
    assert list(images.list_image_sources()) == []
    with pytest.raises(UnknownImageSourceError):
        images.get_image_from_sources(["frontleft_fisheye_image"])


def test_a_camera_takes_no_more_than_fifteen_pictures_a_second(images: Any, stub: Any) -> None:
    for _ in range(3):
        (first,) = images.get_image_from_sources(["left_depth"])
    assert [view.is_depth for view in stub.robot.views] == [True]
    stub.robot.advance(70_000_000)
    (second,) = images.get_image_from_sources(["left_depth"])
    assert len(stub.robot.views) == 2
    assert second.shot.acquisition_time.ToNanoseconds() - first.shot.acquisition_time.ToNanoseconds() == 70_000_000


# The scene, and what draws it -----------------------------------------------------------------------------------------

AHEAD = CameraView((0.42, 0.0, 0.0), (0.5, -0.5, 0.5, -0.5), 64, 48, is_depth=False)
STANDING = np.array([0.0, 0.0, 0.6, 1.0, 0.0, 0.0, 0.0, *[0.1, 0.9, -1.5] * 4])
ONE_BACKEND = """
import os, sys
from multiprocessing.connection import Connection
end = Connection(int(sys.argv[1]))
end.recv()
end.send(None if os.environ["MUJOCO_GL"] == "osmesa" else "no such library")
end.recv()
end.send(os.environ["MUJOCO_GL"])
end.recv()
"""


def test_the_scene_is_the_ground_below_and_the_sky_above() -> None:
    eyes = Eyes(Scenario())
    try:
        grey = eyes.look(STANDING, AHEAD)
        if grey is None:
            pytest.skip("MuJoCo cannot draw here without a display")
        depth = eyes.look(STANDING, CameraView(AHEAD.position_in_body_m, AHEAD.body_from_lens_wxyz, 64, 48, True))
    finally:
        eyes.close()
    assert (grey.shape, grey.dtype, depth.shape, depth.dtype) == ((48, 64), np.uint8, (48, 64), np.uint16)
    assert grey[:16].mean() > grey[32:].mean() + 20
    assert not depth[:24].any()
    # 0.6 m over flat ground, a ray through the centre of row r sinks by (r + 0.5 - 24) / 32 a metre ahead.
    for row in (35, 40, 47):
        np.testing.assert_allclose(depth[row], 1000 * 0.6 / ((row + 0.5 - 24) / 32), rtol=0.01)


def test_what_draws_is_the_first_that_can() -> None:
    eyes = Eyes(Scenario(), backends=("egl", "osmesa"), program=(sys.executable, "-c", ONE_BACKEND))
    try:
        assert eyes.look(STANDING, AHEAD) == "osmesa"
        assert eyes.backend == "osmesa"
    finally:
        eyes.close()


@pytest.mark.parametrize(
    ("program", "reason"),
    [
        ((sys.executable, "-c", "raise SystemExit"), "its process ended"),
        ((sys.executable, "-c", ONE_BACKEND), "no such library"),
    ],
    ids=["ends", "says why"],
)
def test_a_computer_that_cannot_draw_says_so_once(
    caplog: pytest.LogCaptureFixture, program: tuple[str, ...], reason: str
) -> None:
    eyes = Eyes(Scenario(), backends=("egl",), program=program)
    with caplog.at_level(logging.WARNING):
        assert eyes.look(STANDING, AHEAD) is None
        assert eyes.look(STANDING, AHEAD) is None
    (record,) = caplog.records
    assert "the cameras show a test card" in record.getMessage()
    assert f"egl: {reason}" in record.getMessage()
    eyes.close()


def test_what_dies_while_it_draws_leaves_the_test_card(caplog: pytest.LogCaptureFixture) -> None:
    eyes = Eyes(Scenario(), backends=("osmesa",), program=(sys.executable, "-c", ONE_BACKEND))
    with caplog.at_level(logging.WARNING):
        assert eyes.look(STANDING, AHEAD) == "osmesa"
        assert eyes.look(STANDING, AHEAD) is None
    assert "what draws them failed" in caplog.text
    eyes.close()
