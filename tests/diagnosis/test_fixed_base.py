"""Another robot on a fixed base: its drives come from the motion, and its corrected files predict new commands."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
import yaml

from diagnosis.read import fixed_base, read_logs
from diagnosis.read.robot_file import load_robot
from diagnosis.session import DiagnosisProgress, DiagnosisRequest, run_session
from spot_log.importing import import_log, load_mapping

MJCF = """<mujoco><worldbody><body><joint name="l_hip_joint" axis="0 1 0"/>
<inertial pos="0 0 -.1" mass="{mass}" diaginertia=".004 .004 .001"/><body pos="0 0 -.2">
<joint name="l_calf_joint" axis="0 1 0"/><inertial pos="0 0 -.08" mass=".2" diaginertia=".001 .001 .0002"/>
</body></body></worldbody></mujoco>"""
JOINTS = ["l_hip_joint", "l_calf_joint"]
INERTIA, FRICTION, DAMPING, DELAY_S = (0.02, 0.03), (0.3, 0.9), (0.25, 0.1), 0.01
KP, KD, PERIOD_S, SUBSTEPS = 20.0, 1.0, 0.005, 20


def chirps(seconds: float) -> dict[str, np.ndarray]:
    """What such a robot's joints do under chirps at 200 Hz; semi-implicit Euler at 0.25 ms, friction by a steep tanh.

    As in recordings of such robots, only every third row brings another set-point.
    """
    model = mujoco.MjModel.from_xml_string(MJCF.format(mass=1.0))
    data, rng = mujoco.MjData(model), np.random.default_rng(1)
    model.dof_armature[:] = INERTIA
    model.opt.timestep = PERIOD_S / SUBSTEPS
    time_s = np.arange(round(seconds / PERIOD_S)) * PERIOD_S
    phase = 2 * np.pi * (0.2 * time_s + 0.5 * (4.0 / seconds) * time_s**2)
    asked = np.stack([0.3 * np.sin(phase), -0.8 + 0.4 * np.sin(1.3 * phase)], axis=1)[np.arange(len(time_s)) // 3 * 3]
    late = round(DELAY_S / PERIOD_S)
    data.qpos[:] = asked[0]
    rows = []
    for i in range(len(time_s)):
        rows.append(np.concatenate([data.qpos, data.qvel]))
        for _ in range(SUBSTEPS):
            lost = np.array(FRICTION) * np.tanh(data.qvel / 0.01) + np.array(DAMPING) * data.qvel
            data.qfrc_applied[:] = KP * (asked[max(0, i - late)] - data.qpos) - KD * data.qvel - lost
            mujoco.mj_step(model, data)
    made = np.array(rows) + rng.normal(size=(len(rows), 4)) * [1e-4, 1e-4, 5e-3, 5e-3]
    return {"t": time_s, "q": made[:, :2], "dq": made[:, 2:], "goal": asked}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A robot file, its MJCF and a log."""
    folder = tmp_path_factory.mktemp("leg")
    np.savez(folder / "leg.npz", **chirps(12.0))
    signals = {
        "position": {"from": "q", "unit": "rad"},
        "velocity": {"from": "dq", "unit": "rad/s"},
        "setpoint_position": {"from": "goal", "unit": "rad"},
        "setpoint_velocity": {"value": 0, "unit": "rad/s"},
        "kp": {"value": KP, "unit": "N·m/rad"},
        "kd": {"value": KD, "unit": "N·m·s/rad"},
    }
    mapping = {"schema": "spot-rl/import/1", "robot": "leg", "joint_names": JOINTS, "foot_names": []}
    mapping |= {"command_sequence": "chirp", "time": {"from": "t", "unit": "s"}, "signals": signals}
    (folder / "map.yaml").write_text(yaml.safe_dump(mapping, allow_unicode=True))
    import_log(load_mapping(folder / "map.yaml"), folder / "leg.npz", folder / "leg.mcap")
    (folder / "leg.xml").write_text(MJCF.format(mass=1.0))
    (folder / "other.xml").write_text(MJCF.format(mass=40.0))
    robot = {"schema": "spot-rl/robot/1", "name": "leg", "joint_names": JOINTS, "load": "from_motion"}
    for name in ("leg", "other"):
        (folder / f"{name}.yaml").write_text(yaml.safe_dump(robot | {"mjcf": f"{name}.xml"}))
    return folder


def test_drives_that_take_most_of_the_torque_are_found_and_predict(place: Path) -> None:
    """Friction and rotors take twenty times what the links do: loads have little in common with the servo's torque."""
    inputs = DiagnosisRequest(logs=(str(place / "leg.mcap"),), nominal="ideal")
    with DiagnosisProgress() as progress:
        result, paths = run_session(inputs, place / "found", progress, robot_file=place / "leg.yaml")
    verdict = result.verdict
    assert verdict.channels["set_point_to_load"] == "used"
    assert not verdict.differences
    told = {(n.effect, n.where): n for n in verdict.calibration.units}
    for j, joint in enumerate(JOINTS):
        for effect, true in (("coulomb_friction", FRICTION), ("viscous_friction", DAMPING), ("armature", INERTIA)):
            assert told[effect, joint].low <= true[j] <= told[effect, joint].high, (effect, joint)
    robot = load_robot(paths["robot"])
    drives = fixed_base.Drives.of(robot)
    assert drives.delay_s == pytest.approx(DELAY_S, abs=PERIOD_S)
    np.testing.assert_allclose(drives.friction_nm, FRICTION, rtol=0.15)
    np.testing.assert_allclose(drives.inertia_kg_m2, INERTIA, rtol=0.25)
    model = mujoco.MjModel.from_xml_path(str(paths["mjcf"]))
    np.testing.assert_allclose(model.dof_frictionloss, drives.friction_nm, rtol=1e-3)
    np.testing.assert_allclose(model.dof_damping, drives.damping_nm_s_per_rad, rtol=1e-3, atol=1e-6)
    (run,), _ = read_logs([place / "leg.mcap"], load_robot(place / "leg.yaml"))
    zero = fixed_base.Drives.of(load_robot(place / "leg.yaml"))
    # The commands of a log that was read for a diagnosis are late already.
    here = replace(drives, delay_s=0.0)
    assert fixed_base.error_rad(robot, run, here).max() < 0.2 * fixed_base.error_rad(robot, run, zero).max()
    assert any("mrad off, and" in note for note in verdict.notes)


def test_bodies_of_another_robot_are_not_used(place: Path) -> None:
    _, notes = read_logs([place / "leg.mcap"], load_robot(place / "other.yaml"))
    assert "do not follow the set-points" in " ".join(notes)
