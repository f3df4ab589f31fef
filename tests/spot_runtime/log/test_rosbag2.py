"""A log as a ROS 2 bag: what a reader of ROS bags finds in it is what the log holds."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from spot_log import read_run
from spot_log.tools.export import write_rosbag2
from spot_model.console.command_line import main
from spot_model.io.whole import OutputExistsError


def test_a_bag_holds_the_log(synthetic_log: Path, tmp_path: Path) -> None:
    run = read_run(synthetic_log)
    bag = write_rosbag2(run, tmp_path / "bags" / "walk")
    found: dict[str, list] = {}
    with AnyReader([bag], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        stamps = []
        for connection, stamp, raw in reader.messages():
            stamps.append(stamp)
            found.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    assert stamps == sorted(stamps)
    joints = found["/joint_states"]
    assert len(joints) == len(run.states)
    np.testing.assert_array_equal(np.array([m.effort for m in joints]), run.states.load_nm)
    assert list(joints[0].name) == list(run.header.joint_names)
    assert len(found["/joint_commands"]) == len(run.commands)
    odometry, i = found["/odom"], len(run.states) // 2
    w = run.states.odom_from_body_wxyz[i]
    assert odometry[i].pose.pose.orientation.w == w[0]
    # The speed is the same in both frames.
    twist = odometry[i].twist.twist.linear
    expected = np.linalg.norm(run.states.linear_vel_of_body_in_odom_m_s[i])
    assert math.hypot(twist.x, twist.y, twist.z) == pytest.approx(expected)
    assert max(m.twist.linear.x for m in found["/cmd_vel"]) == 1.0
    assert [m.name for m in found["/rosout"]] == [event.name for event in run.events]
    with pytest.raises(OutputExistsError, match="exists; nothing is overwritten"):
        write_rosbag2(run, bag)


def test_the_command_writes_a_bag(synthetic_log: Path, tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as left:
        main(["log", "export", str(synthetic_log), "--format", "rosbag2", "--out", str(tmp_path / "bag")])
    assert left.value.code in (0, None)
    assert (tmp_path / "bag" / "metadata.yaml").is_file()
