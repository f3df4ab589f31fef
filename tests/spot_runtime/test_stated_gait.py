"""What a run says of a policy's gait before the robot moves."""

from __future__ import annotations

from pathlib import Path

import pytest

from spot_log.format.events import EventName
from spot_model.policy.contract import PolicyContract, StatedGait, gait_sentence
from spot_model.policy.policy import load_policy
from spot_runtime.admission import gait_event

POLICIES = Path(__file__).parents[2] / "policies"


def contract(*gaits: tuple[float, str]) -> PolicyContract:
    stated = tuple(
        StatedGait(
            v_x_m_s=speed,
            name=name,
            clarity=1.0,
            stride_hz=2.0,
            diagonals_agree=0.9,
            others_agree=0.1,
            flight_share=0.0,
        )
        for speed, name in gaits
    )
    return load_policy(POLICIES / "walk.onnx").contract.model_copy(update={"gait": stated})


def test_speeds_of_one_gait_are_told_together() -> None:
    told = gait_sentence(contract((0.5, "trot"), (1.0, "trot"), (3.0, "flying trot")))
    assert told.endswith("trot at 0.5 to 1 m/s, flying trot at 3 m/s")
    assert "warning" not in told


def test_it_is_told_where_a_policy_turns_less_than_commanded_or_falls() -> None:
    stated = contract((1.0, "trot"), (2.0, "trot"), (3.0, "trot"))
    turns = ((1.0, 0.95), (1.0, 0.724), (1.0, None))
    gait = tuple(
        g.model_copy(update={"turn_commanded_rad_s": asked, "turn_held_rad_s": held})
        for g, (asked, held) in zip(stated.gait, turns, strict=True)
    )
    told = gait_sentence(stated.model_copy(update={"gait": gait}))
    assert told.endswith(
        "trot at 1 to 3 m/s; commanded to turn at 1 rad/s, it turns at 0.72 rad/s at 2 m/s, falls at 3 m/s"
    )


@pytest.mark.parametrize("hop", ["pronk", "bound"])
def test_a_hop_is_a_warning_that_names_it(hop: str) -> None:
    event, told = gait_event(contract((0.5, "trot"), (1.0, hop)))
    assert event is EventName.GAIT_DOUBTFUL
    assert told.startswith("policy walk hops")
    assert f"({hop})" in told


def test_a_fall_and_no_statement_are_doubtful_and_a_trot_is_not() -> None:
    assert gait_event(contract((0.5, "fall")))[0] is EventName.GAIT_DOUBTFUL
    event, told = gait_event(contract())
    assert event is EventName.GAIT_DOUBTFUL
    assert "states no gait" in told
    assert told.endswith("export the checkpoint or import the policy again")
    assert gait_event(contract((0.5, "trot")))[0] is EventName.GAIT


def test_a_policy_that_does_not_walk_is_a_warning_that_names_the_speeds() -> None:
    event, told = gait_event(contract((0.5, "stand"), (1.0, "fall")))
    assert event is EventName.GAIT_DOUBTFUL
    assert told.startswith("policy walk falls at 1 m/s, does not walk at 0.5 m/s; measured in simulation: ")
    shuffles = contract((0.5, "trot"), (1.0, "trot"))
    held = [g.model_copy(update={"v_x_held_m_s": v}) for g, v in zip(shuffles.gait, (0.24, 0.6), strict=True)]
    event, told = gait_event(shuffles.model_copy(update={"gait": tuple(held)}))
    assert event is EventName.GAIT_DOUBTFUL
    assert "does not walk at 0.5 m/s; measured" in told


@pytest.mark.parametrize("name", ["walk", "fast", "baseline"])
def test_our_policies_state_a_trot_up_to_one_metre_a_second(name: str) -> None:
    stated = {g.v_x_m_s: g for g in load_policy(POLICIES / f"{name}.onnx").contract.gait}
    for speed in (0.5, 1.0):
        assert stated[speed].name == "trot"
        assert stated[speed].diagonals_agree >= 0.85
        assert stated[speed].others_agree <= 0.35


def test_the_policy_that_hops_says_so() -> None:
    assert "hops" in gait_sentence(load_policy(POLICIES / "bound.onnx").contract)
