"""Tables: every signal comes back from Parquet and CSV, nothing is overwritten, refusals name what is allowed."""

from __future__ import annotations

import csv
import json
import sys

import numpy as np
import pytest
from pyarrow import parquet

from spot_log import read_run
from spot_log.tools.export import ExportError, export_run
from spot_model.io.whole import OutputExistsError
from spot_model.robot.facts import JOINT_NAMES


@pytest.fixture(scope="module")
def run(synthetic_log):
    return read_run(synthetic_log)


def column(values: list[str], dtype: type) -> np.ndarray:
    return np.array([dtype(value) for value in values])


@pytest.mark.parametrize("file_format", ["parquet", "csv"])
def test_round_trip(run, tmp_path, file_format):
    files = export_run(run, tmp_path / "tables", file_format)
    names = ["command", "event", "imu", "slow_state", "state", "tick"]
    assert sorted(path.stem for path in files if path.stem != "header") == names

    def read(topic: str) -> dict[str, list]:
        path = tmp_path / "tables" / f"{topic}.{file_format}"
        if file_format == "parquet":
            return parquet.read_table(path).to_pydict()
        with path.open(newline="", encoding="utf-8") as file:
            rows = list(csv.reader(file))
        return dict(zip(rows[0], map(list, zip(*rows[1:], strict=True)), strict=True))

    state = read("state")
    for j, joint in enumerate(JOINT_NAMES):
        np.testing.assert_array_equal(column(state[f"load_nm.{joint}"], float), run.states.load_nm[:, j])
    np.testing.assert_array_equal(column(state["robot_stamp_ns"], int), run.states.robot_stamp_ns)
    np.testing.assert_array_equal(column(state["foot_contact.hl"], int), run.states.foot_contact[:, 2])
    np.testing.assert_array_equal(column(state["odom_from_body_wxyz.x"], float), run.states.odom_from_body_wxyz[:, 1])
    command = read("command")
    sent = column(command["position_rad.fl_kn"], float)
    np.testing.assert_array_equal(sent, run.commands.position_rad[:, 2])
    tick = read("tick")
    np.testing.assert_array_equal(column(tick["action.hr_kn"], float), run.ticks.action[:, 11])
    np.testing.assert_array_equal(column(tick["velocity_command.x_m_s"], float), 1.0)
    assert set(tick["mode"]) == {"active"}
    assert "observation.47" in tick
    imu = read("imu")
    angular = column(imu["angular_vel_of_link_in_link_rad_s.x"], float)
    np.testing.assert_array_equal(angular, run.states.imu.angular_vel_of_link_in_link_rad_s[:, 0])
    slow = read("slow_state")
    np.testing.assert_array_equal(column(slow["battery_temperature_c.1"], float), 32.0)
    assert slow["behavior_faults"][3] == "fall"
    assert read("event")["values"][1] == "age_ms=12.5; bound_ms=10.0"
    header = json.loads((tmp_path / "tables" / "header.json").read_text(encoding="utf-8"))
    assert header["labels"]["surface"] == "lab floor"


def test_topics_are_chosen_by_name(run, tmp_path):
    files = export_run(run, tmp_path, "csv", ["tick", "event"])
    assert sorted(path.name for path in files) == ["event.csv", "header.json", "tick.csv"]


def test_refusals(run, tmp_path):
    with pytest.raises(ExportError, match="format 'xls' is not known; allowed: parquet, csv"):
        export_run(run, tmp_path, "xls")
    with pytest.raises(ExportError, match="topic 'lidar' is not in a log; allowed: state, imu, arm, command"):
        export_run(run, tmp_path, "csv", ["lidar"])
    (tmp_path / "tick.csv").write_text("precious")
    with pytest.raises(OutputExistsError, match=r"tick\.csv exists; nothing is overwritten"):
        export_run(run, tmp_path, "csv")
    assert [path.name for path in tmp_path.iterdir()] == ["tick.csv"]


def test_parquet_without_pyarrow_says_what_to_install(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ExportError, match=r"needs pyarrow: pip install 'spot-rl\[report\]', or use --format csv"):
        export_run(run, tmp_path / "tables", "parquet")
    assert not (tmp_path / "tables").exists()
