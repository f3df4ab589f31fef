"""Recordings of others: every format and option, worked out by hand, and refusals that name key, value and choice."""

from __future__ import annotations

import math

import numpy as np
import pyarrow as pa
import pytest
import yaml
from pyarrow import parquet

from spot_log import read_run
from spot_log.errors import LogExistsError
from spot_log.importing import import_log, load_mapping
from spot_log.importing.suggest import suggest
from spot_log.page.page import page_html
from spot_log.page.summary import summarise
from spot_log.tools.log_info import log_info
from spot_model.errors import BadInputError
from spot_model.robot.arm import ARM_JOINT_NAMES, STOWED_RAD
from spot_model.robot.facts import DEFAULT_POSITION_RAD, JOINT_NAMES

N = 50
TIME_S = np.arange(N) * 0.005
HIP = np.linspace(-1, 1, N)
KNEE = np.linspace(2, 3, N)

BASE = {
    "schema": "spot-rl/import/1",
    "joint_names": ["hip", "knee"],
    "foot_names": [],
    "time": {"from": "t", "unit": "s"},
    "signals": {"position": {"from": "q", "unit": "rad"}},
}


@pytest.fixture
def do(tmp_path):
    """Import ``arrays`` with a mapping made of BASE and changes; return run and result."""

    def call(arrays=None, *, signals=None, source=None, **changes):
        path = source or tmp_path / "data.npz"
        if source is None:
            np.savez(path, **{"t": TIME_S, "q": np.column_stack([HIP, KNEE]), **(arrays or {})})
        data = {**BASE, **changes}
        data["signals"] = {**BASE["signals"], **(signals or {})}
        mapping = tmp_path / "mapping.yaml"
        mapping.write_text(yaml.safe_dump(data, allow_unicode=True))
        imported = import_log(load_mapping(mapping), path, tmp_path / "out.mcap")
        return read_run(tmp_path / "out.mcap"), imported

    return call


def test_the_least_there_is(do):
    run, imported = do(robot="arm-7", labels={"surface": "bench"}, command_sequence="chirp", repeat=2)
    assert (imported.rows, imported.rate_hz) == (N, pytest.approx(200.0))
    assert {"load", "kp", "foot_contact", "linear_vel_of_body_in_odom", "echoed command keys"} <= set(imported.missing)
    assert run.outcome == "imported"
    assert not run.truncated
    assert run.header.joint_names == ("hip", "knee")
    assert run.header.foot_names == ()
    assert (run.header.robot_id, run.header.command_sequence, run.header.repeat) == ("arm-7", "chirp", 2)
    np.testing.assert_array_equal(run.states.position_rad, np.column_stack([HIP, KNEE]))
    np.testing.assert_allclose(np.diff(run.states.robot_stamp_ns), 5_000_000)
    assert run.states.robot_stamp_ns[0] == 1_000_000_000
    assert np.isnan(run.states.load_nm).all()
    assert run.states.foot_contact.shape == (N, 0)
    assert len(run.commands) == len(run.ticks) == len(run.slow_states) == 0
    text = summarise(run)
    assert "not known: the log has no pose of the body" in text
    assert "not known: the log has no joint loads" in text
    assert "not known: the log has neither orientation nor contacts" in text
    assert log_info(run).to_json()["motion"]["falls"] is None
    assert "The log has no data for this." in page_html(run)


def test_units_scale_sign_offset_and_joint_order(do):
    """Source: knee first, degrees; the hip's sign turned, the knee's zero at +0.1 rad."""
    run, _ = do(
        {"q": np.degrees(np.column_stack([KNEE, HIP])), "qd": np.column_stack([KNEE, HIP]) * 60 / (2 * math.pi)},
        source_joint_names=["knee", "hip"],
        signals={
            "position": {"from": "q", "unit": "deg", "scale": [1, -1], "offset": [0.1, 0]},
            "velocity": {"from": "qd", "unit": "rpm"},
        },
    )
    np.testing.assert_allclose(run.states.position_rad, np.column_stack([-HIP, KNEE + 0.1]))
    np.testing.assert_allclose(run.states.velocity_rad_s, np.column_stack([HIP, KNEE]))


def test_joints_of_an_arm_are_left_out_and_a_mapping_is_suggested_for_them(do, tmp_path):
    names = [*JOINT_NAMES, *ARM_JOINT_NAMES]
    q = DEFAULT_POSITION_RAD + 0.01 * HIP[:, np.newaxis]
    arrays = {"q": np.column_stack([q, np.tile(STOWED_RAD, (N, 1))])}
    run, _ = do(arrays, source_joint_names=names, joint_names=list(JOINT_NAMES))
    np.testing.assert_allclose(run.states.position_rad, q)
    np.savez(tmp_path / "arm.npz", time=TIME_S, joint_position=arrays["q"])
    assert yaml.safe_load(suggest(tmp_path / "arm.npz"))["source_joint_names"] == names


def test_columns_constants_and_another_file(do, tmp_path):
    np.savez(tmp_path / "wanted.npz", hip=HIP + 1, knee=KNEE + 1)
    run, imported = do(
        {"tau_hip": HIP, "tau_knee": KNEE},
        signals={
            "load": {"from": "tau_{joint}", "unit": "mN·m"},
            "setpoint_position": {"from": ["{joint}"], "unit": "rad", "file": "wanted.npz"},
            "kp": {"value": 20, "unit": "N·m/rad"},
            "kd": {"value": [1, 2], "unit": "N·m·s/rad"},
        },
    )
    np.testing.assert_allclose(run.states.load_nm, np.column_stack([HIP, KNEE]) * 1e-3)
    np.testing.assert_array_equal(run.commands.position_rad, np.column_stack([HIP + 1, KNEE + 1]))
    np.testing.assert_array_equal(run.commands.kp_nm_per_rad, np.full((N, 2), 20.0))
    np.testing.assert_array_equal(run.commands.kd_nm_s_per_rad, np.tile([1.0, 2.0], (N, 1)))
    np.testing.assert_array_equal(run.commands.robot_stamp_ns, run.states.robot_stamp_ns)
    assert np.isnan(run.commands.velocity_rad_s).all()
    assert not {"load", "kp", "setpoint_position"} & set(imported.missing)


def test_a_body_with_velocities_in_its_own_frame(do):
    """Yaw of 90°: forward for the body is odom's y."""
    half = math.sqrt(0.5)
    run, _ = do(
        {"quat": np.tile([0, 0, half, half], (N, 1)), "v": np.tile([1.0, 0, 0], (N, 1)), "c": np.eye(2)[[0, 1] * 25]},
        foot_names=["left", "right"],
        signals={
            "odom_from_body": {"from": "quat", "order": "xyzw"},
            "linear_vel_of_body_in_body": {"from": "v", "unit": "m/s"},
            "foot_contact": {"from": "c"},
        },
    )
    np.testing.assert_allclose(run.states.odom_from_body_wxyz[0], [half, 0, 0, half])
    np.testing.assert_allclose(run.states.linear_vel_of_body_in_odom_m_s[0], [0, 1, 0], atol=1e-12)
    assert run.states.foot_contact[:2].tolist() == [[True, False], [False, True]]


def test_ticks_power_imu_select_and_rate(do):
    history = np.zeros((N, 5, 2))
    history[:, 4] = np.column_stack([HIP, KNEE])
    run, imported = do(
        {
            "h": history,
            "a": np.full((N, 2), 0.5),
            "cmd": np.tile([1, 0, 0.2], (N, 1)),
            "volt": np.full(N, 54.0),
            "w": np.tile([0, 0, 90.0], (N, 1)),
            "temp": np.full((N, 2), 41.0),
        },
        time={"rate_hz": 50},
        signals={
            "position": {"from": "h", "select": [4, None], "unit": "rad"},
            "action": {"from": "a"},
            "velocity_command": {"from": "cmd"},
            "battery_voltage": {"from": "volt", "unit": "V"},
            "motor_temperature": {"from": "temp", "unit": "°C"},
            "angular_vel_of_link_in_link": {"from": "w", "unit": "deg/s"},
        },
    )
    assert imported.rate_hz == pytest.approx(50.0)
    np.testing.assert_array_equal(run.states.position_rad[:, 1], KNEE)
    np.testing.assert_array_equal(run.ticks.action, 0.5)
    np.testing.assert_allclose(run.ticks.velocity_command[0], [1, 0, 0.2])
    assert np.isnan(run.ticks.compute_s).all()
    # 50 rows at 50 Hz: one second, a poll every 0.1 s.
    assert len(run.slow_states) == 10
    np.testing.assert_array_equal(run.slow_states.battery_voltage_v, 54.0)
    assert np.isnan(run.slow_states.battery_current_a).all()
    np.testing.assert_array_equal(run.slow_states.motor_temperature_c, 41.0)
    np.testing.assert_allclose(run.states.imu.angular_vel_of_link_in_link_rad_s[:, 2], math.pi / 2)


def test_csv_parquet_and_unix_clock(do, tmp_path):
    stamps_ns = 1_700_000_000_000_000_000 + np.arange(N) * 5_000_000
    signals = {"position": {"from": ["q.{joint}"], "unit": "rad"}}
    time = {"from": "stamp", "unit": "ns", "clock": "unix"}
    table = pa.table({"stamp": stamps_ns, "q.hip": HIP, "q.knee": KNEE, "note": ["x"] * N})
    parquet.write_table(table, tmp_path / "data.parquet")
    run, _ = do(source=tmp_path / "data.parquet", signals=signals, time=time)
    np.testing.assert_array_equal(run.states.robot_stamp_ns, stamps_ns)
    np.testing.assert_array_equal(run.states.position_rad[:, 0], HIP)
    (tmp_path / "out.mcap").unlink()
    rows = np.column_stack([TIME_S, HIP, KNEE]).tolist()
    lines = ["t,q.hip,q.knee", *(",".join(map(repr, row)) for row in rows)]
    (tmp_path / "data.csv").write_text("\n".join(lines))
    run, _ = do(source=tmp_path / "data.csv", signals=signals)
    np.testing.assert_array_equal(run.states.position_rad[:, 1], KNEE)


def test_a_log_exported_and_imported_again_is_the_same(synthetic_run, synthetic_log, tmp_path, do):
    """Our own tables are one more recording: positions, loads and set-points survive the round."""
    from spot_log.tools.export import export_run
    from spot_model.robot.facts import JOINT_NAMES, LEG_NAMES

    run = read_run(synthetic_log)
    export_run(run, tmp_path / "tables", "parquet", ["state"])
    again, _ = do(
        source=tmp_path / "tables" / "state.parquet",
        joint_names=list(JOINT_NAMES),
        foot_names=list(LEG_NAMES),
        time={"from": "robot_stamp_ns", "unit": "ns", "clock": "unix"},
        signals={
            "position": {"from": "position_rad.{joint}", "unit": "rad"},
            "load": {"from": "load_nm.{joint}", "unit": "N·m"},
            "odom_from_body": {"from": [f"odom_from_body_wxyz.{axis}" for axis in "wxyz"], "order": "wxyz"},
            "foot_contact": {"from": "foot_contact.{foot}"},
        },
    )
    np.testing.assert_array_equal(again.states.robot_stamp_ns, run.states.robot_stamp_ns)
    np.testing.assert_array_equal(again.states.position_rad, run.states.position_rad)
    np.testing.assert_array_equal(again.states.load_nm, run.states.load_nm)
    np.testing.assert_array_equal(again.states.odom_from_body_wxyz, run.states.odom_from_body_wxyz)
    np.testing.assert_array_equal(again.states.foot_contact, run.states.foot_contact)


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"signals": {"lidar": {"from": "x"}}}, r"unknown signal 'lidar'; allowed: position, velocity"),
        ({"signals": {"position": {"from": "nope", "unit": "rad"}}}, r"data\.npz has no 'nope'; it has: q, t"),
        ({"signals": {"position": {"from": "q"}}}, r"signal position: has no unit; allowed: rad, deg, turn"),
        ({"signals": {"position": {"from": "q", "unit": "mm"}}}, r"unit 'mm' is not one of angle; allowed: rad"),
        ({"signals": {"position": {"from": "t", "unit": "rad"}}}, r"signal position has 1 columns; expected 2"),
        ({"signals": {"position": {"unit": "rad"}}}, r"give either 'from'"),
        ({"signals": {"position": {"from": "q", "unit": "rad", "colour": 1}}}, r"unknown key"),
        ({"signals": {"load": {"value": [1, 2, 3], "unit": "Nm"}}}, r"signal load has 3 columns; expected 2"),
        ({"signals": {"position": {"from": "q", "unit": "rad", "scale": [1, 2, 3]}}}, r"scale has 3 values"),
        ({"signals": {"odom_from_body": {"value": [1, 0, 0, 0]}}}, r"'order' is missing; allowed: wxyz, xyzw"),
        ({"signals": {"odom_from_body": {"value": [2, 0, 0, 0], "order": "wxyz"}}}, r"row 0 has norm 2; expected 1"),
        ({"signals": {"linear_vel_of_body_in_body": {"value": [1, 0, 0], "unit": "m/s"}}}, r"needs .*odom_from_body"),
        ({"signals": {"action": {"from": "q", "select": [1, None]}}}, r"select has 2 entries, the array has 1 axes"),
        ({"signals": {"action": {"from": "q", "select": [7]}}}, r"select \[7\] is out of shape \(50, 2\)"),
        ({"time": {"from": "t", "unit": "h"}}, r"unit 'h' is not one of time; allowed: s, ms"),
        ({"time": {"unit": "s"}}, r"give either 'from' \(a column of stamps\) or 'rate_hz'"),
        ({"source_joint_names": ["hip", "ankle"]}, r"source_joint_names must hold the names of joint_names"),
        ({"schema": "spot-rl/import/9"}, r"schema = 'spot-rl/import/9'"),
    ],
)
def test_refusals(do, tmp_path, changes, text):
    with pytest.raises(BadInputError, match=text):
        do(**changes)
    assert not (tmp_path / "out.mcap").exists()
    assert not (tmp_path / "out.mcap.active").exists()


def test_stamps_must_rise_and_be_numbers(do):
    backward, broken = TIME_S.copy(), TIME_S.copy()
    backward[20] = backward[19]
    broken[7] = np.nan
    with pytest.raises(BadInputError, match="row 20 is not after the one before; stamps must rise"):
        do({"t": backward})
    with pytest.raises(BadInputError, match="row 7 is not a number"):
        do({"t": broken})


def test_files_that_are_not_what_they_say(do, tmp_path):
    for name, text in (
        ("a.npz", "cannot be read as NPZ"),
        ("a.parquet", "cannot be read as Parquet"),
        ("a.csv", "has no rows"),
        ("a.mat", "is no known format; allowed: .npz, .csv, .parquet, .h5, .hdf5"),
    ):
        (tmp_path / name).write_bytes(b"hello")
        with pytest.raises(BadInputError, match=text):
            do(source=tmp_path / name)
    with pytest.raises(BadInputError, match="does not exist"):
        do(source=tmp_path / "nothing.npz")
    (tmp_path / "b.csv").write_text("t,q\n1,2\n3\n")
    with pytest.raises(BadInputError, match="line 3 has 1 values, the first line names 2"):
        do(source=tmp_path / "b.csv")


def test_a_pickle_in_an_npz_is_not_opened(do, tmp_path):
    path = tmp_path / "evil.npz"
    np.savez(path, t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(BadInputError, match="cannot be read as NPZ"):
        do(source=path)


def test_hdf5(do, tmp_path):
    h5py = pytest.importorskip("h5py", reason="h5py is not installed")
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["robot/t"] = TIME_S
        file["robot/q"] = np.column_stack([HIP, KNEE])
    run, _ = do(
        source=tmp_path / "data.h5",
        time={"from": "robot/t", "unit": "s"},
        signals={"position": {"from": "robot/q", "unit": "rad"}},
    )
    np.testing.assert_array_equal(run.states.position_rad[:, 0], HIP)


def test_never_overwrites(do):
    do()
    with pytest.raises(LogExistsError):
        do()
