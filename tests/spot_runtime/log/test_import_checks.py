"""Doubts about a recording: a walk of Spot by formulas, told in wrong units, orders, signs and stamps."""

from __future__ import annotations

import numpy as np
import pytest
import yaml

from spot_log import read_run
from spot_log.importing import import_log, load_mapping
from spot_log.importing.mapping import shipped_names
from spot_log.page.page import page_html
from spot_model.console.command_line import main
from spot_model.errors import BadInputError
from spot_model.robot.facts import DEFAULT_POSITION_RAD, JOINT_NAMES

N, KP, KD = 2000, 60.0, 1.5
T = np.arange(N) / 200.0
BY_TYPE = [f"{leg}_{kind}" for kind in ("hx", "hy", "kn") for leg in ("fl", "fr", "hl", "hr")]


def walk() -> dict[str, np.ndarray]:
    """Trot at 2 Hz along a curve with a little roll and pitch; torques are the servo's."""
    phase = 2 * np.pi * 2 * T[:, None] + np.arange(12) * 0.7 + 0.3 * np.sin(np.outer(T, np.arange(1, 13)))
    q = DEFAULT_POSITION_RAD + 0.15 * np.sin(phase)
    qd = np.gradient(q, T, axis=0)
    wanted = DEFAULT_POSITION_RAD + 0.22 * np.sin(phase + 0.4)
    yaw, roll = 0.3 * T + 0.1, 0.05 * np.sin(3 * T)
    half = [np.cos(roll / 2) * np.cos(yaw / 2), np.sin(roll / 2) * np.cos(yaw / 2)]
    quat = np.column_stack([*half, np.sin(roll / 2) * np.sin(yaw / 2), np.cos(roll / 2) * np.sin(yaw / 2)])
    rates = np.column_stack([0.15 * np.cos(3 * T), 0.3 * np.sin(roll), 0.3 * np.cos(roll)])
    gravity = 9.81 * np.column_stack([np.zeros(N), np.sin(roll), np.cos(roll)])
    place = np.column_stack([np.cumsum(np.cos(yaw)), np.cumsum(np.sin(yaw)), np.zeros(N)]) * 0.5 / 200
    return {
        "t": T,
        "q": q,
        "qd": qd,
        "tau": KP * (wanted - q) - KD * qd,
        "set": wanted,
        "quat": quat,
        "w": rates,
        "acc": gravity,
        "place": place,
        "v": np.tile([0.5, 0.0, 0.0], (N, 1)),
    }


SIGNALS = {
    "position": {"from": "q", "unit": "rad"},
    "velocity": {"from": "qd", "unit": "rad/s"},
    "load": {"from": "tau", "unit": "N·m"},
    "setpoint_position": {"from": "set", "unit": "rad"},
    "kp": {"value": KP, "unit": "N·m/rad"},
    "kd": {"value": KD, "unit": "N·m·s/rad"},
    "odom_from_body": {"from": "quat", "order": "wxyz"},
    "angular_vel_of_body_in_body": {"from": "w", "unit": "rad/s"},
    "acceleration_of_imu_in_link": {"from": "acc", "unit": "m/s^2"},
    "position_of_body_in_odom": {"from": "place", "unit": "m"},
    "linear_vel_of_body_in_body": {"from": "v", "unit": "m/s"},
}


@pytest.fixture
def told(tmp_path):
    """Import the walk with changed arrays; return the run and the doubts."""

    def call(without=(), time=None, accept=False, **arrays):
        np.savez(tmp_path / "walk.npz", **{**walk(), **arrays})
        signals = {name: spec for name, spec in SIGNALS.items() if name not in without}
        data = {"schema": "spot-rl/import/1", "time": time or {"from": "t", "unit": "s"}, "signals": signals}
        (tmp_path / "m.yaml").write_text(yaml.safe_dump({**data, "accept_doubts": accept}, allow_unicode=True))
        out = tmp_path / "out.mcap"
        out.unlink(missing_ok=True)
        imported = import_log(load_mapping(tmp_path / "m.yaml"), tmp_path / "walk.npz", out)
        return read_run(out), imported.doubts

    return call


def columns(*names: str, of: str) -> np.ndarray:
    return walk()[of][:, [JOINT_NAMES.index(name) for name in names]]


def swapped(a: str, b: str, of: str) -> np.ndarray:
    order = [{a: b, b: a}.get(name, name) for name in JOINT_NAMES]
    return columns(*order, of=of)


def test_a_recording_that_is_what_it_says_has_no_doubts(told) -> None:
    run, doubts = told()
    assert doubts == ()
    assert "No fault" in page_html(run)


@pytest.mark.parametrize(
    ("arrays", "text"),
    [
        ({"q": np.degrees(walk()["q"]), "qd": np.degrees(walk()["qd"])}, r"beyond its stops .* fit with unit: deg"),
        ({"q": columns(*BY_TYPE, of="q")}, r"beyond its stops .* source_joint_names: .fl_hx, fr_hx, hl_hx"),
        ({"q": walk()["q"] - DEFAULT_POSITION_RAD}, r"beyond its stops .*check unit, order, sign and offset"),
        ({"qd": np.degrees(walk()["qd"])}, r"velocity is 57\.. of the change of position.*velocity in deg/s"),
        ({"qd": -walk()["qd"]}, r"velocity has the opposite sign of the change of position in fl_hx"),
        ({"qd": swapped("fl_hy", "fr_hy", of="qd")}, r"velocity is in another joint order.*fl_hy by fr_hy, fr_hy by"),
        ({"t": T * 1000}, r"it would fit with time in ms"),
        ({"tau": 1000 * walk()["tau"]}, r"load is 1e\+03 of the servo's law; it would fit with load in mN·m"),
        ({"tau": -walk()["tau"]}, r"load has the opposite sign of the servo's law"),
        ({"tau": swapped("fl_kn", "hr_hy", of="tau")}, r"load is in another joint order than the servo's law"),
        ({"quat": walk()["quat"][:, [1, 2, 3, 0]]}, r"odom_from_body does not agree with .*'order: xyzw' would fit"),
        ({"quat": walk()["quat"] * [1, -1, -1, -1]}, r"odom_from_body does not agree .*its inverse would fit"),
        ({"q": np.full((N, 12), np.nan)}, r"signal position has no number in any row"),
    ],
)
def test_what_cannot_be_is_refused(told, arrays, text) -> None:
    with pytest.raises(BadInputError, match=text):
        told(**arrays)


def test_what_is_refused_can_be_had_with_its_doubts(told) -> None:
    run, doubts = told(accept=True, qd=-walk()["qd"])
    assert "opposite sign" in doubts[0]
    assert [event.name for event in run.events] == ["import_doubted"] * len(doubts)
    page = page_html(run)
    assert "Import doubted" in page
    assert "No fault" not in page
    assert doubts[0].replace("'", "&#x27;") in page


BODY = ("angular_vel_of_body_in_body", "acceleration_of_imu_in_link", "linear_vel_of_body_in_body")
HOLES = walk()["q"].copy()
HOLES[::2] = np.nan


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"without": BODY, "quat": walk()["quat"][:, [1, 2, 3, 0]]}, "by 'order: xyzw' it stands"),
        ({"w": np.degrees(walk()["w"]), "quat": walk()["quat"]}, "does not agree with angular_vel_of_body_in_body"),
        ({"qd": 2 * walk()["qd"]}, "velocity is 2 of the change of position; check 'unit', 'scale' and the time"),
        ({"qd": np.random.default_rng(0).normal(size=(N, 12))}, "velocity does not follow the change of position"),
        ({"t": T + 0.5 * (T > 5) + 0.003 * (np.arange(N) % 50 == 0)}, "steps of the time are not the usual 0.005 s"),
        ({"q": HOLES}, "signal position is blank in 1000 of 2000 rows, first in row 0"),
        ({"without": ("velocity",), "time": {"rate_hz": 1}}, "the usual step of the time is 1 s; check the unit"),
    ],
)
def test_what_may_be_warns_and_is_repeated_by_the_page(told, given, text) -> None:
    run, doubts = told(**given)
    assert any(text in doubt for doubt in doubts), doubts
    assert "Import doubted" in page_html(run)


def test_a_robot_with_unknown_stops_is_doubted_where_it_turns_twice(tmp_path) -> None:
    np.savez(tmp_path / "arm.npz", q=90 * np.sin(T)[:, None])
    (tmp_path / "m.yaml").write_text(
        "schema: spot-rl/import/1\njoint_names: [hip]\nfoot_names: []\ntime: {rate_hz: 200}\n"
        "signals:\n  position: {from: q, unit: rad}\n"
    )
    imported = import_log(load_mapping(tmp_path / "m.yaml"), tmp_path / "arm.npz", tmp_path / "out.mcap")
    assert imported.doubts[0].startswith("signal position: hip is beyond two turns in 9")
    with (tmp_path / "m.yaml").open("a") as mapping:
        mapping.write("continuous_joints: [hip]\n")
    turning = import_log(load_mapping(tmp_path / "m.yaml"), tmp_path / "arm.npz", tmp_path / "turning.mcap")
    assert not turning.doubts


MAPPING = """
schema: spot-rl/import/1
joint_names: [hip]
foot_names: []
time: {from: t, unit: s}
signals:
  position: {from: [q_hip], unit: rad}
  setpoint_position: {from: [set_hip], unit: rad}
"""


def imported_csv(tmp_path, text: str):
    (tmp_path / "m.yaml").write_text(MAPPING)
    (tmp_path / "a.csv").write_text(text)
    imported = import_log(load_mapping(tmp_path / "m.yaml"), tmp_path / "a.csv", tmp_path / "out.mcap")
    return read_run(tmp_path / "out.mcap"), imported


def test_two_topics_in_one_table_are_each_at_their_own_rate(tmp_path) -> None:
    """Blanks stand where a topic has no value; the rows of both together would be twice the rate."""
    rows = [f"{k / 200},{np.sin(k / 50)}," for k in range(400)] + [
        f"{k / 200 + 0.0017},,{np.sin(k / 50)}" for k in range(400)
    ]
    run, imported = imported_csv(
        tmp_path, "\n".join(["t,q_hip,set_hip", *sorted(rows, key=lambda r: float(r.split(",")[0]))])
    )
    assert (imported.rows, imported.rate_hz) == (400, pytest.approx(200))
    assert (len(run.states), len(run.commands)) == (400, 400)
    assert np.isfinite(run.states.position_rad).all()
    assert np.isfinite(run.commands.position_rad).all()
    assert run.commands.key.tolist() == list(range(1, 401))


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_are_read(tmp_path, separator) -> None:
    rows = [separator.join(f"{value:.4f}".replace(".", ",") for value in (k / 200, k / 50, k / 40)) for k in range(30)]
    run, _ = imported_csv(tmp_path, "\n".join([separator.join(["t", "q_hip", "set_hip"]), *rows]) + "\n\n")
    np.testing.assert_allclose(run.states.position_rad[:, 0], np.arange(30) / 50)


def test_a_cell_that_is_no_number_is_named(tmp_path) -> None:
    with pytest.raises(
        BadInputError, match=r"'q_hip' in a\.csv holds no numbers: row 1 \(line 3 of a CSV\) has '1\.2\.3'"
    ):
        imported_csv(tmp_path, "t,q_hip,set_hip\n0,1,1\n1,1.2.3,1\n")


def test_a_comma_within_quotes_is_not_taken_for_a_decimal_one(tmp_path) -> None:
    with pytest.raises(BadInputError, match=r"'q_hip' .*: row 0 \(line 2 of a CSV\) has '1,234'"):
        imported_csv(tmp_path, 't,q_hip,set_hip\n0,"1,234",1\n1,"2,345",1\n')


def test_examples_are_in_the_package_by_name(tmp_path) -> None:
    assert {"pendulum", "ros2", "quadruped_chirps", "spot_observations"} <= set(shipped_names())
    for name in shipped_names():
        assert load_mapping(tmp_path.__class__(name)).time


def test_a_suggestion_imports_its_recording(tmp_path, capsys) -> None:
    names = [f"{word}_{joint}" for word in ("q", "dq", "tau", "set") for joint in ("hip", "knee")]
    swing = np.sin(T[:200, None] * [3, 4])
    data = np.hstack([np.degrees(swing), np.degrees(np.gradient(swing, T[:200], axis=0)), swing, np.degrees(swing)])
    rows = np.column_stack([T[:200] * 1000, data])
    np.savetxt(tmp_path / "a.csv", rows, delimiter=",", header=",".join(["t_ms", *names]), comments="")
    main_ok("log", "import", "--suggest", str(tmp_path / "a.csv"))
    text = capsys.readouterr().out
    assert "time: {from: t_ms, unit: ms}" in text
    assert "joint_names: [hip, knee]" in text
    assert "position: {from: [q_hip, q_knee], unit: deg}" in text
    main_ok("log", "import", "--suggest", str(tmp_path / "a.csv"), "--out", str(tmp_path / "m.yaml"))
    main_ok("log", "import", str(tmp_path / "m.yaml"), str(tmp_path / "a.csv"), "--out", str(tmp_path / "out.mcap"))
    np.testing.assert_allclose(read_run(tmp_path / "out.mcap").states.position_rad, swing, atol=1e-9)


@pytest.mark.parametrize("names", ["t,q0,q1", "t,joint 0: q,joint 1: q", "time stamp,q 0,q [1]"])
def test_a_suggestion_is_a_mapping_whatever_names_are_like(tmp_path, names) -> None:
    (tmp_path / "a.csv").write_text(f"{names}\n0,1,2\n5,1,2\n10,1,2\n")
    main_ok("log", "import", "--suggest", str(tmp_path / "a.csv"), "--out", str(tmp_path / "m.yaml"))
    assert import_log(load_mapping(tmp_path / "m.yaml"), tmp_path / "a.csv", tmp_path / "out.mcap").rows == 3


def test_a_suggestion_without_positions_leaves_a_place_for_their_names(tmp_path, capsys) -> None:
    (tmp_path / "a.csv").write_text("t,x\n0,1\n5,2\n")
    main_ok("log", "import", "--suggest", str(tmp_path / "a.csv"))
    text = capsys.readouterr().out
    assert "joint_names: [NAME]" in text
    assert "position: {from: [NAME], unit: rad}" in text
    assert "# The file has: t, x" in text


def main_ok(*words: str) -> None:
    with pytest.raises(SystemExit) as left:
        main(list(words))
    assert left.value.code in (0, None)


def test_import_says_what_it_needs(capsys) -> None:
    with pytest.raises(SystemExit):
        main(["log", "import"])
    assert "give MAPPING, FILE and --out, or --suggest FILE" in capsys.readouterr().err
