"""A joint experiment in the loop: the same modes, safety core and log as a policy's."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fake_robot.start.process import FakeProcess
from spot_log import read_run
from spot_log.write.sink import MemorySink
from spot_model.errors import BadInputError
from spot_model.io.joint_experiment import Squat, Standing
from spot_model.policy.contract import PolicyError
from spot_model.policy.joint_script import joint_script
from spot_model.robot import facts
from spot_model.robot.state import RobotState
from spot_runtime.admission import check_scripts_allowed
from spot_runtime.config import RunConfig, ServiceConfig
from spot_runtime.control.loop import ControlLoop
from spot_runtime.control.modes import Mode
from spot_runtime.control.safety.body_height import with_speed_limit
from spot_runtime.control.safety.signals.answer import torque_nm
from spot_runtime.safety_limits import SafetyLimits
from spot_runtime.stops import Stop, StopReason
from spot_tools.run import run as run_command
from spot_tools.sources import JointScriptSource
from tests.spot_runtime.test_loop import drive, drive_until, modes_of

SCRIPT = joint_script(Standing(name="sway", duration_s=4.0))


def _loop(robot: Any) -> tuple[ControlLoop, MemorySink]:
    def answering(state: RobotState) -> list[RobotState]:
        """The robot stands however it is pulled, and its loads are what its servos pull with."""
        if not robot.sent:
            return [state]
        return [replace(state, load_nm=torque_nm(robot.sent[-1], state.position_rad, state.velocity_rad_s))]

    robot.mutate = answering
    sink = MemorySink()
    return ControlLoop(robot, SCRIPT, JointScriptSource(SCRIPT), RunConfig(), sink, wall_s=lambda: 0.0), sink


def test_an_experiment_runs_from_stand_to_stand_and_its_set_points_are_the_motions(robot: Any) -> None:
    loop, sink = _loop(robot)
    drive(loop)
    assert modes_of(sink) == ["activating", "ramping_in", "active", "soft_stop", "ramping_out", "standing"]
    assert loop.stop is not None
    assert loop.stop.reason is StopReason.COMPLETED
    active = {t.command_key for t in sink.ticks if t.mode == "active"}
    sent = np.array([c.command.position_rad for c in sink.commands if c.command.key in active])
    offset = sent - SCRIPT.motion.rest_rad
    reach = SCRIPT.experiment.torque_nm / SCRIPT.experiment.kp_nm_per_rad
    assert 0.01 < np.abs(offset).max() < reach + 0.5
    assert np.abs(np.diff(sent, axis=0)).max() <= 6.0 / 50.0


def test_its_ticks_hold_no_network_and_no_velocity(robot: Any) -> None:
    loop, sink = _loop(robot)
    drive(loop)
    assert {t.observation.size for t in sink.ticks} == {0}
    assert {t.action.size for t in sink.ticks} == {0}
    assert all(t.velocity_command.tolist() == [0.0, 0.0, 0.0] for t in sink.ticks)


def test_a_stop_fades_the_motion_before_the_hand_back(robot: Any) -> None:
    loop, sink = _loop(robot)
    drive_until(loop, Mode.ACTIVE)
    for _ in range(700):
        loop.cycle()
    before = loop.memory.drive.command.copy()
    assert np.abs(before).max() > 0.0
    loop.ask_stop(Stop(StopReason.OPERATOR_STOP))
    drive(loop)
    assert modes_of(sink)[-3:] == ["soft_stop", "ramping_out", "standing"]
    faded = [c.command.position_rad for c in sink.commands]
    assert np.abs(np.diff(np.array(faded), axis=0)).max() <= 6.0 / 50.0


def test_a_robot_that_is_held_fast_is_not_forced(robot: Any) -> None:
    """No servo is asked for more than the experiment's torque, wherever the joints are."""
    loop, sink = _loop(robot)  # its joints never leave the default pose
    drive(loop)
    active = {t.command_key for t in sink.ticks if t.mode == "active"}
    for record in sink.commands:
        if record.command.key in active:
            asked = record.command.gains.kp_nm_per_rad * (record.command.position_rad - facts.DEFAULT_POSITION_RAD)
            assert np.abs(asked).max() <= SCRIPT.experiment.torque_nm + 1e-6


def test_its_set_points_move_no_faster_than_its_own_speed() -> None:
    """6 rad/s at 50 Hz are 0.12 rad a tick; without a speed of its own a policy keeps the core's 1.5 rad."""
    assert with_speed_limit(SafetyLimits(), 50.0, SCRIPT.setpoint_speed_rad_s).setpoint_step_rad == pytest.approx(0.12)
    assert with_speed_limit(SafetyLimits(), 50.0).setpoint_step_rad == 1.5


def test_where_policies_are_chosen_or_signed_no_experiment_runs() -> None:
    check_scripts_allowed(ServiceConfig())
    with pytest.raises(PolicyError, match="a joint experiment is none"):
        check_scripts_allowed(ServiceConfig(policy_sha256=("0" * 64,)))


def test_a_run_needs_something_to_run(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="nothing to run"):
        run_command(robot="127.0.0.1:1", log_dir=tmp_path)


@pytest.mark.timeout(120)
def test_an_experiment_on_the_fake_robot_ends_well_and_leaves_a_log(tmp_path: Path) -> None:
    file = tmp_path / "squat.yaml"
    file.write_text(Squat(name="squat", duration_s=4.0).model_dump_json(by_alias=True))  # JSON is YAML
    scenario = tmp_path / "brisk.yaml"
    scenario.write_text("power: {power_on_s: 0.2}\nmotion: {stand_s: 0.8, sit_s: 0.8}\n")
    with FakeProcess(is_lock_step=True, scenario=str(scenario)) as fake:
        words = ["run", "--robot", fake.address.robot, "--experiment", str(file), "--log-dir", str(tmp_path)]
        words += ["--lock-step", fake.address.admin]
        code = "from spot_model.console.command_line import main; main()"
        told = subprocess.run(
            [sys.executable, "-c", code, *words],
            env={**os.environ, **fake.address.environment},
            capture_output=True,
            text=True,
            check=False,
        )
    assert told.returncode == 0, told.stderr
    run = read_run(next(tmp_path.glob("*.mcap")))
    assert run.header.policy_sha256 == ""
    assert run.header.command_sequence == "squat"
    assert len(run.policy_rows) == 0
    assert np.ptp(run.states.position_rad[:, 2]) > 0.1
