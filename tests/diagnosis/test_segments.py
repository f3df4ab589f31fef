import dataclasses

import numpy as np
import pytest

from diagnosis.read.segments import cut
from diagnosis.verdict.explanation import evidence_of
from spot_model.effects.drivetrain import TorqueGain
from spot_model.errors import BadInputError
from spot_model.io.velocity_sequence import standing_sequence
from trainer.signals.recording import record

from .cases import NOMINAL
from .planted import Truth, planted_runs, walk_sequence


@pytest.fixture(scope="module")
def recording():
    return record(planted_runs(Truth(), 1, sequence=walk_sequence(2.0))[0])


def kinds(segmentation):
    return [s.kind for s in segmentation.segments]


def test_a_good_log_loses_its_start_alone(recording):
    found = cut(recording)
    assert kinds(found) == ["no_command", "start"]
    assert found.used.mean() > 0.85


def test_a_load_that_ignores_the_commands_is_cut_where_it_does(recording):
    load = recording.load_nm.copy()
    load[300:400] = 1.5 * np.random.default_rng(0).standard_normal((100, 12))
    found = cut(dataclasses.replace(recording, load_nm=load))
    (segment,) = [s for s in found.segments if s.kind == "not_following"]
    assert abs(segment.first - 300) < 45
    assert abs(segment.last - 399) < 45
    assert not found.used[310:390].any()
    assert "not in control" in segment.reason


def test_half_the_torque_is_an_effect_and_no_loss_of_control():
    weak = record(
        planted_runs(Truth(effects=(TorqueGain(joints=("fl",), gain=0.5),)), 1, sequence=walk_sequence(1.0))[0]
    )
    assert "not_following" not in kinds(cut(weak))


def test_an_expired_command_is_cut(recording):
    commands = dataclasses.replace(recording.commands, end_robot_stamp_ns=recording.commands.end_robot_stamp_ns.copy())
    last = len(commands) - 20
    commands.end_robot_stamp_ns[last:] = recording.command_ns[last]
    found = cut(dataclasses.replace(recording, commands=commands))
    (segment,) = [s for s in found.segments if s.kind == "expired"]
    assert segment.last == len(recording) - 1


def test_a_fall_ends_the_log(recording):
    attitude = recording.odom_from_body_wxyz.copy()
    attitude[500:] = (0.0, 1.0, 0.0, 0.0)
    found = cut(dataclasses.replace(recording, odom_from_body_wxyz=attitude))
    (segment,) = [s for s in found.segments if s.kind == "fallen"]
    assert segment.first == 400
    assert not found.used[400:].any()


def test_standing_is_kept():
    still = cut(record(planted_runs(Truth(), 1, sequence=standing_sequence(2.0))[0]))
    assert still.used[400:].all()


def test_lost_states_are_cut(recording):
    present = recording.present.copy()
    present[200:210] = False
    found = cut(dataclasses.replace(recording, present=present))
    assert [(s.first, s.last) for s in found.segments if s.kind == "lost"] == [(200, 209)]


def test_logs_of_a_robot_that_lies_on_its_back_are_refused_with_the_reason():
    run = planted_runs(Truth(), 1, sequence=walk_sequence(1.0))[0]
    lies = np.tile([0.0, 1.0, 0.0, 0.0], (len(run.states.robot_stamp_ns), 1))
    fallen = dataclasses.replace(run, states=dataclasses.replace(run.states, odom_from_body_wxyz=lies))
    with pytest.raises(BadInputError, match=r"nothing of these logs can be used: .*the robot has fallen; .*"):
        evidence_of([fallen], NOMINAL, None, {})
