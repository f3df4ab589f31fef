"""A withheld robot follows a joint experiment: no policy ran, and the body went down and up."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from spot_log import read_run
from spot_model.io.joint_experiment import Squat
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from withheld.realities.reality import make
from withheld.realities.source import CATALOGUES


def test_a_squat_lowers_the_body_and_its_log_names_no_policy(tmp_path: Path) -> None:
    make((), 3, CATALOGUES["judging"]).perform(
        Squat(name="squat", duration_s=4.0, depth_m=0.08, frequency_hz=0.5), 5, tmp_path
    )
    run = read_run(next(tmp_path.glob("*.mcap")))
    assert (run.header.command_sequence, run.header.policy_sha256, len(run.policy_rows)) == ("squat", "", 0)
    height_m = -np.asarray(foot_position_in_body_m(run.states.position_rad))[..., 2].mean(axis=1)
    assert 0.05 < np.ptp(height_m) < 0.11
    assert set(run.commands.kp_nm_per_rad[0]) == {250.0}
