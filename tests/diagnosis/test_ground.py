"""A slope and a tilted unit, by the feet's places alone: one where the robot kept its heading, two where it turned."""

from dataclasses import replace

import numpy as np
import pytest

from diagnosis.channels import Channel
from diagnosis.channels.build import build_views
from diagnosis.channels.stack import stacked
from diagnosis.decision_constants import ERROR_SCALES, FORMULA_ERROR, GROUP_ODDS, LEAST_NATS
from diagnosis.library import JointGroups
from diagnosis.library.ground import HEIGHTS
from diagnosis.library.registry import LIBRARY
from diagnosis.selection.evidence import lay_out
from diagnosis.selection.faultless import FAULTLESS
from diagnosis.selection.scoring import Scorer
from spot_model.effects.estimator import ImuTilt
from spot_model.effects.ground import GroundSlope
from spot_model.io.velocity_sequence import sequence_of
from trainer.signals.recording import record

from .cases import NOMINAL
from .planted import Truth, planted_runs

TRUTHS = {"ground_slope": GroundSlope(rise_x_rad=0.07), "imu_tilt": ImuTilt(pitch_rad=0.07)}


def nats(truth: str, turn_rad_s: float) -> dict[str, float]:
    """What each explains of the standing feet's heights, before any price."""
    walk = sequence_of("walk", 4.0, (0, 0.6, 0, turn_rad_s), (2, 0.9, 0, turn_rad_s))
    logs = stacked([record(run) for run in planted_runs(Truth((TRUTHS[truth],)), 1, sequence=walk)])
    view = build_views(logs, NOMINAL)[0][Channel.STANCE_KINEMATICS]
    usable = view.usable.copy()
    usable[:, : HEIGHTS.start] = False
    scales = {name: ERROR_SCALES[name] for name in TRUTHS}
    views, robot = {view.name: replace(view, usable=usable)}, JointGroups(logs.joint_names, logs.legs)
    board = lay_out(views, robot, [0], ["0"], library=LIBRARY, scales=scales)
    scorer = Scorer(board)
    return {
        name: FAULTLESS.price(name)
        + max(scorer.scored(LIBRARY[name], shape, np.ones(1)).value for shape in board.shapes(LIBRARY[name]))
        for name in TRUTHS
    }


def is_grouped(found: dict[str, float], truth: str) -> bool:
    """Whether the other one is as likely as :mod:`diagnosis.verdict.belief` asks of a group."""
    other = next(name for name in TRUTHS if name != truth)
    return np.exp((found[other] - found[truth]) / (1.0 + FORMULA_ERROR * found[truth])) >= GROUP_ODDS


@pytest.mark.parametrize("truth", TRUTHS)
def test_where_a_robot_turned_only_the_true_one_explains_its_feet(truth: str) -> None:
    found = nats(truth, 1.0)
    assert found[truth] > LEAST_NATS
    assert not is_grouped(found, truth)


@pytest.mark.parametrize("truth", TRUTHS)
def test_where_a_robot_kept_its_heading_each_explains_its_feet(truth: str) -> None:
    found = nats(truth, 0.0)
    assert found[truth] > LEAST_NATS
    assert is_grouped(found, truth)


def test_effects_that_were_not_learned_cost_what_their_like_does() -> None:
    assert FAULTLESS.price("ground_slope") == FAULTLESS.price("imu_tilt") > LEAST_NATS
    assert FAULTLESS.price("foot_drag") == FAULTLESS.price("viscous_friction") > LEAST_NATS
