from pathlib import Path

import numpy as np
import pytest

from spot_model.policy.policy import load_policy
from spot_model.robot.mjcf import default_height_m
from trainer.evaluate.setting import Setting
from trainer.simulate.walks import TrialFall, record_walks, touching_ground

POLICY = Path(__file__).parents[2] / "policies" / "walk.onnx"


def test_a_robot_that_is_tipped_over_is_told_of_with_time_and_command() -> None:
    setting = Setting(load_policy(POLICY), n_threads=1)
    plant = setting.plant(2)

    def tip(robots: object, tick: int) -> None:
        if tick == 50:
            plant.push(np.array([False, True]), linear_vel_in_world_m_s=np.array([[0.0, 12.0, 3.0]]))

    commands = np.array([[0.0, 0.0, 0.0], [0.5, 0.0, 0.0]])
    recording = record_walks(setting.policy, plant, lambda tick: commands * (tick >= 25), 150, disturb=tip)
    assert recording.survived.tolist() == [True, False]
    (fall,) = recording.falls
    first = int(np.argmin(recording.alive[:, 1]))
    assert fall.robot == 1
    assert fall.time_s == pytest.approx((first + 1) / 50.0)
    assert fall.time_s > 1.0
    assert fall.command == (0.5, 0.0, 0.0)
    assert fall.command_age_s == pytest.approx(fall.time_s - 0.5)
    assert fall.touched
    assert set(fall.figures()) >= {"time_s", "command", "tilt_deg", "touched", "at_stop", "why"}


def test_what_touches_the_ground_is_named() -> None:
    model = Setting(load_policy(POLICY), n_threads=1).plant(1).model
    standing = np.array(model.key_qpos[0])
    assert touching_ground(model, standing) == ()
    on_its_side = standing.copy()
    on_its_side[2], on_its_side[3:7] = 0.1, [np.sqrt(0.5), np.sqrt(0.5), 0.0, 0.0]
    assert "body" in touching_ground(model, on_its_side)
    kneeling = standing.copy()
    kneeling[2] = default_height_m() - 0.25
    assert {"fl lower leg", "hr lower leg"} <= set(touching_ground(model, kneeling))


def test_the_sentence_says_when_and_why() -> None:
    fall = TrialFall(3, 10.4, (0.5, 0.0, -0.2), 0.4, (0.1, 0.6, 0.0), np.radians(12.0), ("hl lower leg",), ("hl_kn",))
    assert fall.sentence() == (
        "robot 3 falls upright at 10.40 s, 0.4 s into the command (0.50, 0.00 m/s, -0.20 rad/s), moving at "
        "(0.10, 0.60 m/s, 0.00 rad/s): hl lower leg on the ground first, tilt 12°; at a joint stop: hl_kn"
    )
    tipped = TrialFall(0, 2.0, (0.0, 0.0, 0.0), 2.0, (0.0, 0.0, 0.0), 1.4, ("body", "hr upper leg"), ())
    assert "tips over" in tipped.sentence()
    assert tipped.sentence().endswith("body and hr upper leg on the ground first, tilt 80°")
