"""ROS 2 bags, written by rosbags' own writer, become logs: every message type, both storages, and what is no bag."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from spot_log import read_run
from spot_log.importing import import_log, load_mapping
from spot_log.importing.suggest import suggest
from spot_log.tools.export import write_rosbag2
from spot_model.errors import BadInputError

STORE = get_typestore(Stores.ROS2_HUMBLE)
START_NS = 1_700_000_000_000_000_000
N = 400
NAMES = ["knee", "hip"]
SWING = np.sin(np.arange(N)[:, None] / 200 * np.array([3.0, 4.0]))
RATE = np.gradient(SWING, 1 / 200, axis=0)


def make(kind: str, **fields):
    return STORE.types[kind.replace("/", "/msg/")](**fields)


def header(ns: int):
    return make(
        "std_msgs/Header", stamp=make("builtin_interfaces/Time", sec=ns // 10**9, nanosec=ns % 10**9), frame_id=""
    )


def vector(*xyz: float, kind: str = "Vector3"):
    return make(f"geometry_msgs/{kind}", **dict(zip("xyzw", xyz, strict=False)))


def messages():
    """States at 200 Hz, the joints in turns of order; commands at 50 Hz, received 1 ms later; others beside them."""
    layout = make("std_msgs/MultiArrayLayout", dim=[], data_offset=0)
    for k in range(N):
        ns, order = START_NS + k * 5_000_000, [0, 1] if k % 2 else [1, 0]
        names = [NAMES[i] for i in order]
        joints = {"position": SWING[k, order], "velocity": RATE[k, order], "effort": np.zeros(0)}
        yield "/joint_states", ns + 1000, make("sensor_msgs/JointState", header=header(ns), name=names, **joints)
        if k % 4 == 0:
            yield (
                "/targets",
                ns + 1_001_000,
                make("std_msgs/Float64MultiArray", layout=layout, data=SWING[k, ::-1] + 0.1),
            )
            twist = make("geometry_msgs/Twist", linear=vector(0.5, 0.0, 0.0), angular=vector(0.0, 0.0, 0.2))
            yield "/cmd_vel", ns + 1_001_000, twist
            turn = vector(0.0, 0.0, np.sin(k * 5e-4), np.cos(k * 5e-4), kind="Quaternion")
            pose = make("geometry_msgs/Pose", position=vector(k / 400, 0.0, 0.5, kind="Point"), orientation=turn)
            pose = make("geometry_msgs/PoseWithCovariance", pose=pose, covariance=np.zeros(36))
            twist = make("geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.zeros(36))
            odometry = make("nav_msgs/Odometry", header=header(ns), child_frame_id="body", pose=pose, twist=twist)
            yield "/odom", ns + 2000, odometry
            parts = {
                f"{name}_covariance": np.zeros(9) for name in ("orientation", "angular_velocity", "linear_acceleration")
            }
            parts |= {"linear_acceleration": vector(0.0, 0.0, 9.8), "angular_velocity": vector(0.0, 0.0, 0.2)}
            yield "/imu", ns + 3000, make("sensor_msgs/Imu", header=header(ns), orientation=turn, **parts)


def bag(path: Path, plugin: StoragePlugin) -> Path:
    with Writer(path, version=9, storage_plugin=plugin) as writer:
        connections = {}
        for topic, ns, message in sorted(messages(), key=lambda row: row[1]):
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=STORE)
            writer.write(connections[topic], ns, STORE.serialize_cdr(message, kind))
    return path


MAPPING = """
schema: spot-rl/import/1
joint_names: [hip, knee]
foot_names: []
names_in_source: {}
time: {from: /joint_states.stamp, unit: ns, clock: unix}
signals:
  position: {from: "/joint_states.position.{joint}", unit: rad}
  velocity: {from: "/joint_states.velocity.{joint}", unit: rad/s}
  setpoint_position: {from: /targets.data, unit: rad, scale: [1, 1]}
  odom_from_body: {from: /odom.pose.pose.orientation, order: xyzw}
  position_of_body_in_odom: {from: /odom.pose.pose.position, unit: m}
  angular_vel_of_body_in_body: {from: /odom.twist.twist.angular, unit: rad/s}
  acceleration_of_imu_in_link: {from: /imu.linear_acceleration, unit: m/s^2}
  velocity_command: {from: [/cmd_vel.linear.x, /cmd_vel.linear.y, /cmd_vel.angular.z]}
"""


@pytest.fixture
def take(tmp_path: Path):
    def call(path: Path, text: str = MAPPING):
        (tmp_path / "m.yaml").write_text(text)
        (tmp_path / "out.mcap").unlink(missing_ok=True)
        imported = import_log(load_mapping(tmp_path / "m.yaml"), path, tmp_path / "out.mcap")
        return read_run(tmp_path / "out.mcap"), imported

    return call


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("how", ["folder", "file"])
def test_every_message_type_is_read(take, tmp_path: Path, plugin, how) -> None:
    path = bag(tmp_path / "bag", plugin)
    if how == "file":
        path = next(p for p in path.iterdir() if p.suffix in (".mcap", ".db3"))
    run, imported = take(path)
    assert imported.doubts == ()
    assert imported.rate_hz == pytest.approx(200)
    np.testing.assert_array_equal(run.states.robot_stamp_ns, START_NS + np.arange(N) * 5_000_000)
    np.testing.assert_array_equal(run.states.position_rad, SWING[:, ::-1])
    np.testing.assert_array_equal(run.states.velocity_rad_s, RATE[:, ::-1])
    np.testing.assert_allclose(run.states.odom_from_body_wxyz[4:8, 3], np.sin(4 * 5e-4))
    # A command is a record of its own, at the first row after its message.
    np.testing.assert_array_equal(run.commands.position_rad[:-1], SWING[: N - 4 : 4, ::-1] + 0.1)
    np.testing.assert_array_equal(run.commands.robot_stamp_ns[:3] - START_NS, [5_000_000, 25_000_000, 45_000_000])
    np.testing.assert_allclose(run.ticks.velocity_command[0], [0.5, 0, 0.2])
    assert run.states.imu.acceleration_of_imu_in_link_m_s2[5].tolist() == [0, 0, 9.8]


def test_a_topic_that_falls_silent_is_blank(take, tmp_path: Path) -> None:
    path = tmp_path / "bag"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for topic, ns, message in sorted(messages(), key=lambda row: row[1]):
            if topic == "/odom" and ns > START_NS + 10**9:
                continue
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, message.__msgtype__, typestore=STORE)
            writer.write(connections[topic], ns, STORE.serialize_cdr(message, message.__msgtype__))
    run, imported = take(path)
    assert np.isfinite(run.states.odom_from_body_wxyz[:200]).all()
    assert np.isnan(run.states.odom_from_body_wxyz[250:]).all()
    assert any("odom_from_body is blank in" in doubt for doubt in imported.doubts)


def test_an_mcap_that_was_cut_is_refused_with_what_repairs_it(take, tmp_path: Path) -> None:
    source = next(bag(tmp_path / "bag", StoragePlugin.MCAP).glob("*.mcap"))
    (tmp_path / "cut.mcap").write_bytes(source.read_bytes()[:-3000])
    with pytest.raises(BadInputError, match=r"cut\.mcap cannot be read as a ROS 2 bag .*'mcap recover' repairs"):
        take(tmp_path / "cut.mcap")


def test_a_suggestion_imports_its_bag(take, tmp_path: Path) -> None:
    path = bag(tmp_path / "bag", StoragePlugin.SQLITE3)
    text = suggest(path)
    assert "joint_names: [hip, knee]" in text
    assert "/targets (std_msgs/msg/Float64MultiArray): time, layout.data_offset, data" in text
    run, imported = take(path, text)
    assert imported.doubts == ()
    np.testing.assert_array_equal(run.states.position_rad, SWING[:, ::-1])
    np.testing.assert_allclose(run.ticks.velocity_command[0], [0.5, 0, 0.2])


def test_a_log_goes_out_as_a_bag_and_comes_back(synthetic_log: Path, tmp_path: Path) -> None:
    old = read_run(synthetic_log)
    path = write_rosbag2(old, tmp_path / "bag")
    for mapping in ("ros2", "suggested"):
        if mapping == "suggested":
            (tmp_path / "m.yaml").write_text(suggest(path))
        imported = import_log(
            load_mapping(Path("ros2") if mapping == "ros2" else tmp_path / "m.yaml"), path, tmp_path / f"{mapping}.mcap"
        )
        new = read_run(imported.path)
        np.testing.assert_array_equal(new.states.position_rad, old.states.position_rad)
        np.testing.assert_allclose(new.states.odom_from_body_wxyz, old.states.odom_from_body_wxyz)
        assert abs(len(new.commands) - len(old.commands)) <= 1


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        (
            ("/joint_states.stamp", "/nothing.stamp"),
            r"'from: /nothing.stamp' is not TOPIC.stamp .*; the bag has .*/odom .nav_msgs",
        ),
        (("/targets.data", "/targets.date"), r"has no '/targets.date'; it has: /targets.data"),
        (("/targets.data", "/gone.data"), r"has no '/gone.data'"),
    ],
)
def test_what_is_not_in_the_bag_is_named(take, tmp_path: Path, changes, text) -> None:
    with pytest.raises(BadInputError, match=text):
        take(bag(tmp_path / "bag", StoragePlugin.MCAP), MAPPING.replace(*changes))


def test_what_is_no_bag_is_said(take, tmp_path: Path, synthetic_log: Path) -> None:
    with pytest.raises(
        BadInputError, match=r"as a ROS 2 bag \(a log of spot-rl needs no import, .*Profile is not ros2"
    ):
        take(synthetic_log)
    (tmp_path / "a.db3").write_bytes(b"no database")
    with pytest.raises(BadInputError, match=r"a\.db3 cannot be read as a ROS 2 bag"):
        take(tmp_path / "a.db3")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInputError, match=r"cannot be read as a ROS 2 bag .*metadata"):
        take(tmp_path / "empty")
    with pytest.raises(BadInputError, match=r"missing\.mcap.*does not exist"):
        take(tmp_path / "missing.mcap")
