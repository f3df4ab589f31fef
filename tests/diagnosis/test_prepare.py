"""Other people's logs: what cannot be right is refused by name, what is missing is completed, and said."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from diagnosis.read.prepare import _after_steps, prepared, rows_apart
from diagnosis.read.robot_file import SPOT, RobotFile, load_robot
from diagnosis.read.signal_checks import plausible
from spot_log import read_run
from spot_log.importing import Mapping, import_log
from spot_log.read.run import Run
from spot_model.effects.friction import ViscousFriction
from spot_model.errors import BadInputError
from spot_model.plant.delay import ConstantDelay

from .planted import Truth, planted_runs, walk_sequence

N = 2000
PERIOD_S = 0.005
TIME_S = np.arange(N) * PERIOD_S
POSITION = np.stack([0.8 * np.sin(3.0 * TIME_S), 0.5 * np.cos(7.0 * TIME_S) - 1.2], axis=1)
VELOCITY = np.stack([2.4 * np.cos(3.0 * TIME_S), -3.5 * np.sin(7.0 * TIME_S)], axis=1)
ASKED = np.stack([3.0 * np.sign(np.sin(11.0 * TIME_S)), 2.0 * np.sign(np.sin(5.0 * TIME_S))], axis=1)
ARM: dict[str, object] = {"schema": "spot-rl/robot/1", "name": "arm", "joint_names": ["hip", "knee"]}
MJCF = """<mujoco><option gravity="0 0 -9.81"/><worldbody><body>
<joint name="hip" type="hinge" axis="0 1 0" damping="3" armature="1"/>
<geom type="sphere" size="0.01" mass="2" pos="0 0 -0.5"/>
</body></worldbody></mujoco>"""


def _robot(folder: Path, **changes: object) -> RobotFile:
    file = folder / "arm.yaml"
    file.write_text(yaml.safe_dump(ARM | changes))
    return load_robot(file)


def _log(folder: Path, **changes: np.ndarray) -> Run:
    arrays = {"t": TIME_S, "q": POSITION, "qd": VELOCITY, "tau": ASKED, "ff": ASKED} | changes
    np.savez(folder / "data.npz", **arrays)
    units = {"position": ("q", "rad"), "velocity": ("qd", "rad/s"), "load": ("tau", "N·m")}
    units["feedforward"] = ("ff", "N·m")
    mapping = Mapping.model_validate(
        {
            "schema": "spot-rl/import/1",
            "accept_doubts": True,
            "joint_names": ["hip", "knee"],
            "foot_names": [],
            "time": {"from": "t"},
            "signals": {n: {"from": a, "unit": u} for n, (a, u) in units.items()},
        }
    )
    out = folder / "log.mcap"
    out.unlink(missing_ok=True)
    import_log(mapping, folder / "data.npz", out)
    return read_run(out)


def test_a_sound_log_passes_and_is_left_alone(tmp_path: Path) -> None:
    run = _log(tmp_path)
    robot = _robot(tmp_path, position_low_rad=-2, position_high_rad=[1, 0], torque_limit_nm=5)
    plausible([run], robot)
    (same,), notes = prepared([run], robot)
    assert notes == ()
    np.testing.assert_array_equal(same.states.load_nm, run.states.load_nm)
    np.testing.assert_array_equal(same.commands.robot_stamp_ns, run.commands.robot_stamp_ns)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"q": np.degrees(POSITION)}, r"position of knee is -40.1 rad in row 0, beyond its stops .*-2.00 to 0.00 rad"),
        ({"qd": np.degrees(VELOCITY)}, r"velocity of hip is 57.3 times the slope .*allowed: 0.5 to 2.0"),
        ({"qd": -VELOCITY}, r"velocity of hip has the opposite sign"),
        ({"qd": VELOCITY[:, ::-1]}, r"velocity of hip follows the position of knee .*one joint order"),
        ({"tau": 1e3 * ASKED}, r"load of hip reaches 3e\+03 N·m; allowed: 15 N·m"),
        ({"tau": np.where(TIME_S[:, None] > 4.0, np.nan, ASKED)}, r"load_nm of hip is not a number in 60 % .*row 801"),
    ],
)
def test_what_cannot_be_right_is_refused_by_name(tmp_path: Path, changes: dict[str, np.ndarray], words: str) -> None:
    robot = _robot(tmp_path, position_low_rad=-2, position_high_rad=[1, 0], torque_limit_nm=5)
    with pytest.raises(BadInputError, match=words):
        plausible([_log(tmp_path, **changes)], robot)


BEYOND = np.where(TIME_S[:, None] > 9.5, [0.0, 2.0], POSITION)
"""The knee ends beyond its stop."""


@pytest.mark.parametrize(
    ("changes", "note", "left"),
    [
        ({"q": BEYOND}, r"log.mcap: 9.2 to 10.0 s set aside: position of knee is 2 rad in row 1901", 1841),
        (
            {"tau": np.where(np.abs(TIME_S[:, None] - 5.0) < 0.5, np.nan, ASKED)},
            r"log.mcap: 4.2 to 5.8 s set aside: load_nm of hip is not a number in 10 %",
            N - 319,
        ),
    ],
)
def test_a_stretch_that_cannot_be_right_is_set_aside(
    tmp_path: Path, changes: dict[str, np.ndarray], note: str, left: int
) -> None:
    robot = _robot(tmp_path, position_low_rad=-2, position_high_rad=[1, 0], torque_limit_nm=5)
    sound, bad = _log(tmp_path), _log(tmp_path, **changes)
    (first, second), notes = plausible([sound, bad], robot)
    assert first is sound
    assert len(second.states) == left
    assert np.isfinite(second.states.load_nm).all()
    assert [re.match(note, n) is not None for n in notes] == [True]


def test_one_log_in_degrees_among_fourteen_right_ones_is_set_aside(tmp_path: Path) -> None:
    robot = _robot(tmp_path, position_low_rad=-2, position_high_rad=[1, 0])
    sound, bad = _log(tmp_path), _log(tmp_path, q=np.degrees(POSITION))
    bad = replace(bad, path=tmp_path / "degrees.mcap")
    kept, notes = plausible([sound] * 7 + [bad] + [sound] * 7, robot)
    assert len(kept) == 14
    assert [n.startswith("degrees.mcap: set aside: position of knee is -40.1 rad") for n in notes] == [True]
    # What most logs have is no slip of one.
    with pytest.raises(BadInputError, match=r"degrees.mcap: position of knee is -40.1 rad"):
        plausible([sound, bad, bad], robot)


def test_a_wrong_value_again_and_again_is_no_stretch(tmp_path: Path) -> None:
    robot = _robot(tmp_path, torque_limit_nm=5)
    load = np.where(np.sin(TIME_S * 2.0 * np.pi)[:, None] > 0.99, 100.0, ASKED)
    with pytest.raises(BadInputError, match=r"load of hip reaches 100 N·m"):
        plausible([_log(tmp_path, tau=load)], robot)


def test_logs_of_two_robots_and_of_another_one(tmp_path: Path) -> None:
    run = _log(tmp_path)
    robot = _robot(tmp_path)
    one, two = (replace(run, header=replace(run.header, robot_id=name)) for name in ("left", "right"))
    with pytest.raises(BadInputError, match=r"logs of 2 robots: .*left; .*right; diagnose logs of one robot"):
        plausible([one, two], robot)
    there, here = (replace(run, header=replace(run.header, robot_id=name)) for name in ("10.0.0.3", "spot.local:443"))
    handed = replace(run, header=replace(run.header, robot_id="ipv4:127.0.0.1:36977,127.0.0.1"))
    plausible([run, there, here, handed], robot)
    with pytest.raises(BadInputError, match=r"has joints hip, knee; robot spot has fl_hx.*--robot FILE"):
        plausible([run], SPOT)


def test_a_few_states_that_are_no_numbers_are_left_out(tmp_path: Path) -> None:
    tau = ASKED.copy()
    tau[[40, 41, 700], 0] = np.nan
    run = _log(tmp_path, tau=tau)
    plausible([run], _robot(tmp_path))
    (mended,), notes = prepared([run], _robot(tmp_path))
    assert len(mended.states) == N - 3
    assert "3 states with a signal that is not a number are left out" in notes[0]


@pytest.mark.parametrize("rows", [-4, 3])
def test_loads_of_other_rows_are_put_in_step(tmp_path: Path, rows: int) -> None:
    run = _log(tmp_path, tau=np.roll(ASKED, rows, axis=0))
    (moved,), notes = prepared([run], _robot(tmp_path, kp_nm_per_rad=0, kd_nm_s_per_rad=0))
    shift_ns = moved.commands.robot_stamp_ns - run.commands.robot_stamp_ns
    np.testing.assert_allclose(shift_ns, rows * PERIOD_S * 1e9, atol=0.3 * PERIOD_S * 1e9)
    assert f"by {rows * 5:.1f} ms" in notes[0]


def test_gains_come_from_the_robot_where_the_log_has_none(tmp_path: Path) -> None:
    run = _log(tmp_path)
    assert np.isnan(run.commands.kp_nm_per_rad).all()
    (filled,), _ = prepared([run], _robot(tmp_path, kp_nm_per_rad=[20, 30], kd_nm_s_per_rad=0.5))
    np.testing.assert_array_equal(filled.commands.kp_nm_per_rad[5], [20.0, 30.0])
    np.testing.assert_array_equal(filled.commands.kd_nm_s_per_rad[5], [0.5, 0.5])


def test_loads_from_motion_are_those_of_a_pendulum(tmp_path: Path) -> None:
    """A point mass of 2 kg at 0.5 m: τ = m·l²·q̈ + m·g·l·sin q by hand; no friction, no armature."""
    (tmp_path / "arm.xml").write_text(MJCF)
    file = tmp_path / "arm.yaml"
    file.write_text(yaml.safe_dump(ARM | {"joint_names": ["hip"], "mjcf": "arm.xml", "load": "from_motion"}))
    run = _log(tmp_path)
    one = replace(
        run,
        header=replace(run.header, joint_names=("hip",)),
        states=replace(
            run.states,
            position_rad=POSITION[:, :1],
            velocity_rad_s=VELOCITY[:, :1],
            load_nm=np.full((N, 1), np.nan),
        ),
        commands=replace(
            run.commands,
            **{
                n: getattr(run.commands, n)[:, :1]
                for n in (
                    "requested_position_rad",
                    "position_rad",
                    "velocity_rad_s",
                    "load_nm",
                    "kp_nm_per_rad",
                    "kd_nm_s_per_rad",
                )
            },
        ),
    )
    expected = 2.0 * 0.25 * -9.0 * POSITION[:, 0] + 2.0 * 9.81 * 0.5 * np.sin(POSITION[:, 0])
    asked = replace(one, commands=replace(one.commands, load_nm=1.1 * expected[:, None]))
    (made,), notes = prepared([asked], load_robot(file))
    np.testing.assert_allclose(made.states.load_nm[10:-10, 0], expected[10:-10], atol=0.03)
    assert "computed from the motion" in " ".join(notes)
    # As far apart as a policy's ticks: differences of velocities are no accelerations.
    stamps = asked.states.robot_stamp_ns
    slow = replace(asked, states=replace(asked.states, robot_stamp_ns=stamps[0] + 7 * (stamps - stamps[0])))
    (coarse,), notes = prepared([slow], load_robot(file))
    assert np.isnan(coarse.states.load_nm).all()
    assert "says too little of accelerations: loads computed from its motion are not used" in " ".join(notes)
    (unrelated,), notes = prepared([one], load_robot(file))
    assert np.isnan(unrelated.states.load_nm).all()
    assert "do not follow the set-points" in " ".join(notes)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"gear": 2}, r"gear = 2: unknown key; allowed: schema, name, joint_names"),
        ({"joint_names": ["a", "a"]}, "joint_names has a name twice"),
        ({"kp_nm_per_rad": [1, 2, 3]}, "kp_nm_per_rad has 3 values; allowed: 1, or one for each joint"),
        ({"position_low_rad": 0}, "come together"),
        ({"load": "from_motion"}, "needs the key mjcf"),
        ({"mjcf": "missing.xml"}, "missing.xml is not a file"),
    ],
)
def test_a_wrong_robot_file_is_refused_by_name(tmp_path: Path, changes: dict[str, object], words: str) -> None:
    with pytest.raises(BadInputError, match=words):
        _robot(tmp_path, **changes)


def test_an_mjcf_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    (tmp_path / "arm.xml").write_text(MJCF)
    robot = _robot(tmp_path, mjcf="arm.xml", load="from_motion")
    with pytest.raises(BadInputError, match=r"has no joint 'knee'; it has: hip"):
        prepared([_log(tmp_path)], robot)


def _without_receipts(run: Run) -> Run:
    return replace(run, states=replace(run.states, last_command_key=np.zeros_like(run.states.last_command_key)))


@pytest.mark.parametrize("delay_ms", [3.0, 10.0])
@pytest.mark.parametrize("damping_nm_s_per_rad", [0.0, 1.0])
def test_a_delay_is_found_and_friction_is_not_taken_for_one(delay_ms: float, damping_nm_s_per_rad: float) -> None:
    truth = Truth(transport=ConstantDelay(delay_s=delay_ms * 1e-3))
    if damping_nm_s_per_rad:
        truth = replace(truth, effects=(ViscousFriction(damping_nm_s_per_rad=damping_nm_s_per_rad),))
    runs = [_without_receipts(run) for run in planted_runs(truth, 1, sequence=walk_sequence(3.0))]
    period_ms = 1e-6 * float(np.median(np.diff(runs[0].states.robot_stamp_ns)))
    # Half a state for a load that lags here by nothing, and a third for the grid of the states.
    assert abs(rows_apart(runs) * period_ms - delay_ms) < 0.85 * period_ms


def test_a_load_that_never_changes_answers_no_step() -> None:
    run = _without_receipts(planted_runs(Truth(), 1, sequence=walk_sequence(1.5))[0])
    dead = replace(run, states=replace(run.states, load_nm=np.ones_like(run.states.load_nm)))
    assert _after_steps([dead]) is None
