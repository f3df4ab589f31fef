"""The layout names what is in logs, and the 3D model is Spot: its feet are where the kinematics say."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.timestamp_pb2 import Timestamp

from spot_log.format.codec import ALL_TOPICS
from spot_log.format.viewer import joint_transforms, spot_scene
from spot_model.robot import facts

LAYOUT = json.loads((Path(__file__).resolve().parents[3] / "deploy" / "spot-rl.foxglove.json").read_text("utf-8"))
TOPICS = {topic.name: topic.message_type.DESCRIPTOR for topic in ALL_TOPICS}


def paths() -> Iterator[str]:
    for panel in LAYOUT["configById"].values():
        yield from (entry["value"] for entry in panel.get("paths", []))
        yield from panel.get("topics", {})
        yield from (panel[key] for key in ("topicToRender", "topicPath") if key in panel)


def check_path(path: str) -> None:
    """A message path of Foxglove's: topic, then fields, each perhaps with an index. Raises KeyError."""
    topic, *fields = re.split(r"\.(?=[a-z])", path)
    message: Any = TOPICS[topic]
    for field in fields:
        name, _, index = field.partition("[")
        about = message.fields_by_name[name]
        assert bool(index) == about.is_repeated, f"{path}: {name} is{' not' if index else ''} repeated"
        message = about.message_type if about.type == FieldDescriptor.TYPE_MESSAGE else None


@pytest.mark.parametrize("path", sorted(set(paths())))
def test_the_layout_names_what_logs_have(path: str) -> None:
    check_path(path)


@pytest.mark.parametrize("path", ["/nothing", "/tick.nothing", "/tick.velocity_command", "/tick.mode[0]"])
def test_a_wrong_path_is_found(path: str) -> None:
    with pytest.raises((KeyError, AssertionError)):
        check_path(path)


PANEL_TYPES = {"3D", "Plot", "RawMessages", "RosOut", "StateTransitions"}
"""Of Foxglove's panels, by the names in its own catalogue; the panel titled Log there is called RosOut."""


def test_every_panel_is_one_of_foxglove_s() -> None:
    assert {name.partition("!")[0] for name in LAYOUT["configById"]} == PANEL_TYPES


def test_every_panel_has_its_place_and_its_settings() -> None:
    def leaves(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
        else:
            yield from leaves(node["first"])
            yield from leaves(node["second"])

    assert sorted(leaves(LAYOUT["layout"])) == sorted(LAYOUT["configById"])


def in_body(position_rad: np.ndarray) -> dict[str, np.ndarray]:
    """Each frame's pose in the body, 4 × 4, by chaining the transforms."""
    poses = {"body": np.eye(4)}
    for transform in joint_transforms(position_rad.tolist(), Timestamp()):
        t, q = transform.translation, transform.rotation
        w, x, y = q.w, q.x, q.y
        rotation = np.array(
            [
                [1 - 2 * y * y, 2 * x * y, 2 * w * y],
                [2 * x * y, 1 - 2 * x * x, -2 * w * x],
                [-2 * w * y, 2 * w * x, 1 - 2 * (x * x + y * y)],
            ]
        )
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, (t.x, t.y, t.z)
        poses[transform.child_frame_id] = poses[transform.parent_frame_id] @ pose
    return poses


def test_the_front_left_foot_by_hand() -> None:
    """Straight legs: the foot hangs below the hip by 0.3205 + 0.3365 m, 0.025 m ahead, 0.055 + 0.110945 m aside."""
    pose = in_body(np.zeros(12))["fl_kn"]
    foot = pose @ np.array([*facts.FOOT_FROM_KN_M, 1.0])
    assert foot[:3] == pytest.approx([0.29785 + 0.025, 0.165945, -0.657])


def test_a_bent_leg_by_hand() -> None:
    """hy = 0.9 leans the upper leg back; kn = −1.5 brings the lower leg forward again, by 0.6 rad from the vertical."""
    position = np.zeros(12)
    position[1], position[2] = 0.9, -1.5
    pose = in_body(position)["fl_kn"]
    knee_x = 0.29785 + 0.025 * math.cos(0.9) - 0.3205 * math.sin(0.9)
    knee_z = -0.025 * math.sin(0.9) - 0.3205 * math.cos(0.9)
    assert pose[:3, 3] == pytest.approx([knee_x, 0.165945, knee_z])
    foot = pose @ np.array([*facts.FOOT_FROM_KN_M, 1.0])
    assert foot[:3] == pytest.approx([knee_x + 0.3365 * math.sin(0.6), 0.165945, knee_z - 0.3365 * math.cos(0.6)])


def test_right_legs_mirror_left_ones() -> None:
    left = in_body(facts.DEFAULT_POSITION_RAD)
    for leg, other in (("fl", "fr"), ("hl", "hr")):
        for kind in ("hx", "hy", "kn"):
            a, b = left[f"{leg}_{kind}"][:3, 3], left[f"{other}_{kind}"][:3, 3]
            assert a * [1, -1, 1] == pytest.approx(b)


def test_every_shape_is_fixed_to_a_frame_that_moves() -> None:
    scene = spot_scene(0)
    assert {entity.frame_id for entity in scene.entities} == {"body", *facts.JOINT_NAMES}
    assert all(entity.frame_locked for entity in scene.entities)
    assert all(entity.cubes or entity.cylinders or entity.spheres for entity in scene.entities)
