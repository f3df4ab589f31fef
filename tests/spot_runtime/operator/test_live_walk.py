"""A walk as Foxglove sees it, live and from its log: every panel of the layout finds values, and Spot moves."""

from __future__ import annotations

import json
import re
import threading
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap.reader import make_reader
from websockets.exceptions import ConnectionClosed

from spot_log.format.codec import ALL_TOPICS
from spot_log.write.live_process import LiveProcess
from spot_model.robot.facts import JOINT_NAMES
from spot_protos import operator_pb2
from tests.spot_runtime.live.viewer import Viewer

from .conftest import Arming

LAYOUT = json.loads((Path(__file__).resolve().parents[3] / "deploy" / "spot-rl.foxglove.json").read_text("utf-8"))
TYPES = {topic.name: topic.message_type for topic in ALL_TOPICS}
Messages = dict[str, list[Any]]


def layout_paths() -> set[str]:
    found: set[str] = set()
    for panel in LAYOUT["configById"].values():
        found |= {entry["value"] for entry in panel.get("paths", [])} | set(panel.get("topics", {}))
        found |= {panel[key] for key in ("topicToRender", "topicPath") if key in panel}
    return found


def values(messages: Messages, path: str) -> list[Any]:
    """What a message path of Foxglove's gives for each message."""
    topic, *fields = re.split(r"\.(?=[a-z])", path)
    found = []
    for message in messages[topic]:
        value = message
        for field in fields:
            name, _, index = field.rstrip("]").partition("[")
            value = getattr(value, name)
            value = value[int(index)] if index and int(index) < len(value) else value
        found.append(value)
    return found


class Watcher:
    """Takes all that the live view serves, in a thread, until the view ends."""

    def __init__(self, url: str) -> None:
        self.messages: Messages = defaultdict(list)
        self._viewer = Viewer(url)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            for topic, _, data in self._viewer.messages():
                self.messages[topic].append(TYPES[topic].FromString(data))
        except ConnectionClosed:
            return

    def close(self) -> None:
        self._viewer.close()
        self._thread.join()


def recorded(path: Path) -> Messages:
    messages: Messages = defaultdict(list)
    with path.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages():
            messages[channel.topic].append(TYPES[channel.topic].FromString(message.data))
    return messages


def positions_in_odom(frames: FrameTransforms) -> Iterator[tuple[str, np.ndarray]]:
    """Each frame's origin, by chaining the transforms up to odom."""
    parents = {t.child_frame_id: t for t in frames.transforms}
    for name in parents:
        point, frame = np.zeros(3), name
        while frame != "odom":
            t = parents[frame]
            q = np.array([t.rotation.x, t.rotation.y, t.rotation.z])
            point = point + 2.0 * np.cross(q, np.cross(q, point) + t.rotation.w * point)
            point = point + np.array([t.translation.x, t.translation.y, t.translation.z])
            frame = t.parent_frame_id
        yield name, point


def test_every_panel_finds_values_live_and_in_the_log_and_spot_walks(arming: Arming) -> None:
    operator = arming.operator
    operator.every_tick(0.0, 1e9, operator.attend)
    operator.at(0.5, lambda: operator.send(start=operator_pb2.StartRequest()))
    operator.every_tick(3.0, 5.0, lambda: operator.steer(0.6))
    operator.at(5.0, lambda: operator.send(stop=operator_pb2.StopRequest()))
    with LiveProcess(0) as live:
        watcher = Watcher(live.url)
        outcome = arming.drive()
        watcher.close()
    assert outcome.outcome == "operator_stop", outcome.sentence
    log = recorded(Path(outcome.log_paths[0]))
    for name, messages in (("live", watcher.messages), ("log", log)):
        for path in sorted(layout_paths()):
            found = values(messages, path)
            assert found, f"{name}: no message for {path}"
            if isinstance(found[0], float):
                assert np.isfinite(np.array(found, dtype=float)).any(), f"{name}: {path} has no value"
        assert max(values(messages, "/tick.velocity_command[0]")) == pytest.approx(0.6)
        # The log says it once, the live view again and again for whoever comes later.
        scene = messages["/scene"][0]
        assert isinstance(scene, SceneUpdate)
        shapes = sum(len(e.cubes) + len(e.cylinders) + len(e.spheres) for e in scene.entities)
        assert shapes >= 13
        first, last = (dict(positions_in_odom(messages["/tf"][i])) for i in (0, -1))
        # Every shape's frame leads up to odom.
        assert {e.frame_id for e in scene.entities} <= set(first) == {"body", *JOINT_NAMES}
        assert last["body"][0] - first["body"][0] > 0.5, name  # 2 s at 0.6 m/s, less the way up to speed
        heights = [dict(positions_in_odom(m))["body"][2] for m in messages["/tf"]]
        assert max(heights) - min(heights) < 0.6
    assert len(watcher.messages["/tf"]) > 0.5 * len(log["/tf"])
