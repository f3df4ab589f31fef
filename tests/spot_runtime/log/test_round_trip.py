"""What goes into a log comes out of it, through our reader and through MCAP's own."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from operator import attrgetter
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from spot_log import read_run
from spot_log.errors import DiskSpaceError, LogExistsError
from spot_log.format import codec
from spot_log.format.records import WireState
from spot_log.format.vendor_state import robot_state_from_wire
from spot_log.write import hand_off
from spot_log.write.run_writer import RunWriter, active_path
from spot_model.robot.facts import JOINT_NAMES
from spot_model.robot.state import ImuPacket, RobotState


def test_header_and_footer(synthetic_run, synthetic_log):
    run = read_run(synthetic_log)
    assert run.header == synthetic_run().header
    assert run.footer is not None
    assert run.footer.outcome == run.outcome == "completed"
    assert run.footer.messages == {"state": 667, "command": 100, "tick": 100, "slow_state": 10, "event": 3}
    assert not run.truncated
    assert run.duration_s == pytest.approx(666 * 0.003)


def test_every_record_comes_back(synthetic_run, synthetic_log):
    made_up, run = synthetic_run(), read_run(synthetic_log)
    states = [
        robot_state_from_wire(made_up.message(i).SerializeToString(), made_up.received_ns(i))
        for i in range(made_up.n_states)
    ]
    commands = [made_up.command(k, state) for k, state in enumerate(made_up.tick_states)]
    ticks = [made_up.tick(k, state) for k, state in enumerate(made_up.tick_states)]
    polls = [made_up.slow_state(j) for j in range(10)]
    of_command = dict.fromkeys(
        ("key", "end_robot_stamp_ns", "position_rad", "velocity_rad_s", "load_nm"), "command."
    ) | dict.fromkeys(("kp_nm_per_rad", "kd_nm_s_per_rad"), "command.gains.")
    for table, records, places in (
        (run.states, states, {}),
        (run.commands, commands, of_command),
        (run.ticks, ticks, {}),
        (run.slow_states, polls, {}),
    ):
        assert len(table) == len(records)
        for name in set(table.columns()) - {"sequence", "motor_temperature_c"}:
            wanted = [attrgetter(places.get(name, "") + name)(record) for record in records]
            np.testing.assert_array_equal(getattr(table, name), wanted, err_msg=name)
    assert run.states.sequence.tolist() == list(range(made_up.n_states))
    slow = run.slow_states
    temperatures = [[poll.motor_temperature_c[name] for name in JOINT_NAMES] for poll in polls]
    np.testing.assert_array_equal(slow.motor_temperature_c, temperatures)
    assert slow.battery_temperature_c == tuple(poll.battery_temperature_c for poll in polls)
    assert slow.behavior_faults == tuple(poll.behavior_faults for poll in polls)
    assert run.events == tuple(made_up.events)


def test_every_packet_of_the_inertial_unit(synthetic_run, synthetic_log):
    made_up, imu = synthetic_run(), read_run(synthetic_log).states.imu
    assert imu.state_index.tolist() == np.repeat(np.arange(made_up.n_states), 3).tolist()
    assert imu.robot_stamp_ns[5] == made_up.robot_ns(1)
    np.testing.assert_allclose(imu.angular_vel_of_link_in_link_rad_s[:3, 0], [0.0, 0.1, 0.2])
    np.testing.assert_allclose(imu.acceleration_of_imu_in_link_m_s2[7], [0, 0, 9.81])
    np.testing.assert_array_equal(imu.odom_from_link_wxyz[7], [1, 0, 0, 0])


def test_ticks_without_a_policy_are_rows_of_nan(synthetic_run, tmp_path):
    writer = RunWriter(tmp_path / "run.mcap", synthetic_run().header)
    tick = synthetic_run().tick(0, 0)
    empty = np.zeros(0, dtype=np.float32)
    for number, record in enumerate((tick, replace(tick, mode="standing", observation=empty, action=empty))):
        writer.add(hand_off.unpack(hand_off.pack(number, record)).message, number)
    writer.close({}, "completed")
    ticks = read_run(tmp_path / "run.mcap").ticks
    assert ticks.mode.tolist() == ["active", "standing"]
    assert np.isfinite(ticks.action[0]).all()
    assert np.isnan(ticks.action[1]).all()
    assert np.isnan(ticks.observation[1]).all()


def test_a_decoded_state_is_the_same_as_its_wire_bytes(synthetic_run):
    wire = synthetic_run().message(7).SerializeToString()
    state = robot_state_from_wire(wire, 5)
    a = hand_off.unpack(hand_off.pack(0, WireState(wire, 5))).message
    b = hand_off.unpack(hand_off.pack(0, state)).message
    assert a == b


def test_an_arm_is_left_out(synthetic_run):
    with_arm = robot_state_from_wire(synthetic_run(has_arm=True).message(3).SerializeToString(), 1)
    without = robot_state_from_wire(synthetic_run().message(3).SerializeToString(), 1)
    np.testing.assert_array_equal(with_arm.position_rad, without.position_rad)


def test_mcaps_own_reader_finds_every_message_with_index_and_check_sums(synthetic_run, synthetic_log):
    with synthetic_log.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        summary = reader.get_summary()
        assert summary is not None
        assert summary.statistics is not None
        counts: Counter[str] = Counter()
        first = {}
        for _, channel, message, decoded in reader.iter_decoded_messages():
            counts[channel.topic] += 1
            first.setdefault(channel.topic, (message, decoded))
        attachments = list(reader.iter_attachments())
    assert counts["/state"] == 667
    assert (
        counts["/joint_states"] == counts["/tf"] == counts["/odometry"] == 101
    )  # the first slot of 20 ms is half full
    assert sum(counts.values()) == summary.statistics.message_count
    assert attachments[0].data == codec.header_to_proto(synthetic_run().header).SerializeToString()
    message, joints = first["/joint_states"]
    assert [joint.name for joint in joints.joints] == list(JOINT_NAMES)
    assert joints.joints[4].position == synthetic_run().position_rad(0)[4]
    # Published when the robot sampled it, by the host's clock; logged when it was received, 1 ms later.
    assert message.log_time - message.publish_time == 1_000_000


def test_the_viewers_odometry_is_in_the_body_frame(tmp_path, synthetic_run):
    """Yaw of 90°: 1 m/s along odom's y is 1 m/s forward for the body."""
    half = np.sqrt(0.5)
    state = RobotState(
        robot_stamp_ns=20_000_000,
        host_stamp_ns=21_000_000,
        position_rad=np.zeros(12),
        velocity_rad_s=np.zeros(12),
        load_nm=np.zeros(12),
        position_of_body_in_odom_m=np.array([1.0, 2.0, 3.0]),
        odom_from_body_wxyz=np.array([half, 0, 0, half]),
        linear_vel_of_body_in_odom_m_s=np.array([0.0, 1.0, 0.0]),
        angular_vel_of_body_in_odom_rad_s=np.array([0.0, 0.0, 0.3]),
        foot_contact=np.ones(4, dtype=bool),
        last_command_key=0,
        last_command_robot_stamp_ns=0,
        imu=(ImuPacket(20_000_000, np.zeros(3), np.zeros(3), np.array([1.0, 0, 0, 0])),),
    )
    writer = RunWriter(tmp_path / "run.mcap", synthetic_run().header)
    writer.add(codec.state_to_proto(state), 0)
    writer.close({}, "completed")
    with (tmp_path / "run.mcap").open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        [(_, _, _, odometry)] = reader.iter_decoded_messages(topics=["/odometry"])
    assert odometry.linear_velocity.x == pytest.approx(1.0)
    assert odometry.linear_velocity.y == pytest.approx(0.0)
    assert odometry.angular_velocity.z == pytest.approx(0.3)
    assert (odometry.frame_id, odometry.body_frame_id) == ("odom", "body")


def test_a_log_is_active_until_closed_and_never_overwritten(synthetic_run, tmp_path):
    path = tmp_path / "run.mcap"
    writer = RunWriter(path, synthetic_run().header)
    assert active_path(path).name == "run.mcap.active"
    assert active_path(path).exists()
    assert not path.exists()
    with pytest.raises(LogExistsError, match=r"run\.mcap\.active exists already; logs are never overwritten"):
        RunWriter(path, synthetic_run().header)
    writer.close({}, "completed")
    assert not active_path(path).exists()
    before = path.read_bytes()
    with pytest.raises(LogExistsError, match="choose another name"):
        RunWriter(path, synthetic_run().header)
    assert path.read_bytes() == before


def test_a_file_that_appears_meanwhile_is_not_overwritten(synthetic_run, tmp_path):
    path = tmp_path / "run.mcap"
    writer = RunWriter(path, synthetic_run().header)
    path.write_text("precious")
    with pytest.raises(FileExistsError):
        writer.close({}, "completed")
    assert path.read_text() == "precious"
    assert read_run(active_path(path)).outcome == "completed"


def test_too_little_room_is_said_with_figures(synthetic_run, tmp_path):
    with pytest.raises(DiskSpaceError, match=r"MB free; a log needs at least 1000000000000 MB"):
        RunWriter(tmp_path / "run.mcap", synthetic_run().header, min_free_bytes=10**18)
    assert not list(Path(tmp_path).iterdir())


def test_publish_times_never_go_back_when_the_clocks_difference_becomes_better_known(synthetic_run, tmp_path):
    run = synthetic_run()
    path = tmp_path / "clocks.mcap"
    writer = RunWriter(path, run.header)
    command = run.command(0, 0)
    for i in range(6):
        wire = hand_off.pack(i, WireState(run.message(i).SerializeToString(), run.received_ns(i)))
        writer.add(hand_off.unpack(wire).message, i)
        if i == 2:
            # The robot's clock turns out to be 1 s further ahead of the host's than the first state let one think.
            later = command._replace(robot_stamp_ns=command.robot_stamp_ns + 1_000_000_000)
            writer.add(hand_off.unpack(hand_off.pack(0, later)).message, 0)
    writer.close({}, "completed")
    newest: dict[str, int] = {}
    with path.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert message.publish_time >= newest.get(channel.topic, 0), channel.topic
            newest[channel.topic] = message.publish_time
    assert "/state" in newest
