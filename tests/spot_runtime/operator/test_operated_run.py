"""One arming on the fake robot in lock-step: what an operator asks is done, and nobody who leaves leaves it moving."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import numpy as np
import pytest

from spot_log import Run, read_run
from spot_log.page.summary import detail_lines
from spot_log.tools.log_info import log_info
from spot_model.policy.contract import sha256_hex
from spot_protos import fake_admin_pb2, operator_pb2, run_link_pb2
from spot_runtime.hal.errors import MotionError
from spot_runtime.hal.spot.adapter import BosdynHal

from .conftest import POLICIES, Arming

CONTROL_S = 3.0
"""By then the hand-over, begun half a second after the robot stood, is done."""


def start(arming: Arming, at_s: float = 0.5) -> None:
    arming.operator.at(at_s, lambda: arming.operator.send(start=operator_pb2.StartRequest()))


def stop(arming: Arming, at_s: float, *, keep_standing: bool = False) -> None:
    arming.operator.at(at_s, lambda: arming.operator.send(stop=operator_pb2.StopRequest(keep_standing=keep_standing)))


def attend(arming: Arming, until_s: float = 1e9) -> None:
    arming.operator.every_tick(0.0, until_s, arming.operator.attend)


def log_of(outcome: operator_pb2.Outcome, which: int = 0) -> Run:
    return read_run(Path(outcome.log_paths[which]))


def speed_commands(log: Run) -> np.ndarray:
    return np.array(log.ticks.velocity_command)[:, 0]


def test_walk_stop_switch_the_policy_walk_again_and_sit(arming: Arming) -> None:
    operator = arming.operator
    attend(arming)
    start(arming)
    operator.every_tick(CONTROL_S, CONTROL_S + 1.0, lambda: operator.steer(0.5))
    operator.at(CONTROL_S, lambda: operator.send(label_log=operator_pb2.LabelLogRequest(labels={"surface": "grass"})))
    stop(arming, CONTROL_S + 1.5, keep_standing=True)
    baseline = POLICIES / "baseline.onnx"
    switch = run_link_pb2.SwitchPolicy(path=str(baseline), sha256=sha256_hex(baseline.read_bytes()))
    operator.at(9.0, lambda: operator.send(switch_policy=switch))
    start(arming, 9.5)
    stop(arming, 12.0)
    outcome = arming.drive()
    assert (outcome.outcome, outcome.exit_code) == ("operator_stop", 10), outcome.sentence
    assert arming.is_at_rest()
    assert [a.is_done for a in operator.answers.values()] == [True] * 6, operator.answers
    assert operator.states == ["armed", "running", "arming", "armed", "running", "ending"]
    first, second = log_of(outcome, 0), log_of(outcome, 1)
    assert speed_commands(first).max() == pytest.approx(0.5)
    assert (first.header.policy_name, second.header.policy_name) == ("walk", "baseline")
    assert first.header.labels["operator"] == "tester"
    assert [e.text for e in first.events if e.name == "label"] == ["surface=grass"]
    assert first.labels == {"operator": "tester", "surface": "grass"}
    assert ", operator tester, surface grass" in "\n".join(detail_lines(log_info(first)))
    assert second.labels == {"operator": "tester"}
    assert first.outcome == second.outcome == "operator_stop"
    for log in (first, second):
        assert (np.diff(log.commands.key) > 0).all()


def test_the_velocity_of_whoever_falls_silent_fades_to_zero(arming: Arming) -> None:
    operator = arming.operator
    attend(arming)
    start(arming)
    operator.every_tick(CONTROL_S, CONTROL_S + 1.0, lambda: operator.steer(0.5))
    stop(arming, CONTROL_S + 2.5)
    log = log_of(arming.drive())
    commands, stamps_s = speed_commands(log), np.array(log.ticks.robot_stamp_ns) / 1e9
    begin = stamps_s[np.flatnonzero(commands > 0.0)[0]]
    steered = commands[stamps_s < begin + 1.2]
    assert steered.max() == pytest.approx(0.5)
    # Silent from 1.0 s on: held for 0.25 s, then down to zero within 0.25 s, each to one tick and one message.
    late = commands[(stamps_s > begin + 1.0 + 0.25 + 0.25 + 0.06) & (stamps_s < begin + 2.4)]
    assert len(late) > 30
    assert (late == 0.0).all()
    assert arming.is_at_rest()


def test_a_client_that_is_gone_leaves_a_robot_that_sits_down(arming: Arming) -> None:
    operator = arming.operator
    start(arming)
    operator.every_tick(CONTROL_S, CONTROL_S + 0.5, lambda: operator.steer(0.5))
    outcome = arming.drive(attendance_s=2.0)
    assert outcome.outcome == "operator_gone", outcome.sentence
    assert "attends" in outcome.sentence
    assert arming.is_at_rest()


def test_nobody_leaves_it_standing_either(arming: Arming) -> None:
    outcome = arming.drive(attendance_s=2.0)
    assert outcome.outcome == "operator_gone"
    assert not outcome.log_paths
    assert arming.is_at_rest()


def test_a_service_that_is_gone_leaves_a_robot_that_sits_down(arming: Arming) -> None:
    operator = arming.operator
    attend(arming)
    start(arming)
    operator.every_tick(CONTROL_S, CONTROL_S + 0.5, lambda: operator.steer(0.5))

    def die() -> None:
        operator.repeats.clear()
        operator.ours.close()

    operator.at(CONTROL_S + 0.5, die)
    outcome = arming.drive()
    assert outcome.outcome == "service_lost"
    assert log_of(outcome).outcome == "service_lost"
    assert arming.is_at_rest()


def test_a_service_that_reads_nothing_and_floods_holds_up_nothing(arming: Arming) -> None:
    operator = arming.operator
    attend(arming)
    start(arming)
    operator.reads = False

    def flood() -> None:
        try:
            for _ in range(100):
                operator.steer(0.5)
                operator.ours.send(b"\xff\xff\xff")
        except BlockingIOError:
            pass

    label = {f"key{i}": "x" * 200 for i in range(30)}
    operator.every_tick(1.0, 6.0, lambda: operator.send(label_log=operator_pb2.LabelLogRequest(labels=label)))
    operator.every_tick(CONTROL_S, CONTROL_S + 1.0, flood)
    operator.every_tick(CONTROL_S + 4.0, CONTROL_S + 9.0, lambda: operator.send(stop=operator_pb2.StopRequest()))
    outcome = arming.drive()
    assert outcome.outcome == "operator_stop", outcome.sentence
    log = log_of(outcome)
    ticks = np.array(log.ticks.robot_stamp_ns)
    assert np.diff(ticks).max() <= 21_000_000  # no tick was late
    assert arming.is_at_rest()
    told = [m for m in operator.told if m.WhichOneof("what") == "event"]
    assert len(told) < len(log.events)  # the socket was full, and what did not fit was dropped


def test_damping(arming: Arming) -> None:
    operator = arming.operator
    attend(arming)
    start(arming)
    operator.at(CONTROL_S + 0.5, lambda: operator.send(damp=operator_pb2.DampRequest()))
    outcome = arming.drive()
    assert (outcome.outcome, outcome.exit_code) == ("operator_damp", 11)
    modes = [e.text for e in log_of(outcome).events if e.name == "mode"]
    assert modes[-2:] == ["active → damping", "damping → released"]
    assert arming.status().motor_power.lower().endswith("off")


@pytest.mark.parametrize("keep_standing", [False, True])
def test_a_log_of_a_robot_that_did_not_stand_up_again_does_not_say_that_all_went_well(
    arming: Arming, monkeypatch: pytest.MonkeyPatch, keep_standing: bool
) -> None:
    stood, original = [], BosdynHal.stand

    def fails_the_second_time(hal: BosdynHal) -> None:
        stood.append(1)
        if len(stood) > 1:
            raise MotionError("the robot does not stand: FAILED")
        original(hal)

    monkeypatch.setattr(BosdynHal, "stand", fails_the_second_time)
    attend(arming)
    start(arming)
    stop(arming, CONTROL_S + 0.3, keep_standing=keep_standing)
    outcome = arming.drive()
    log = log_of(outcome)
    assert log.outcome == outcome.outcome == "motion_failed"
    assert "does not stand" in "".join(event.text for event in log.events)
    assert arming.is_at_rest()


def test_what_does_not_fit_is_refused_in_words(arming: Arming) -> None:
    operator = arming.operator
    attend(arming)
    labels = operator_pb2.LabelLogRequest(labels={"a": "b"})
    requests = [
        (0.3, {"velocity": run_link_pb2.Velocity(v_x_m_s=0.3)}, "full control"),
        (0.35, {"label_log": labels}, "no log is being written"),
        (0.4, {"switch_policy": run_link_pb2.SwitchPolicy(path="/nowhere.onnx", sha256="0" * 64)}, "cannot be read"),
        (0.45, {}, "not known"),
        (CONTROL_S + 0.1, {"start": operator_pb2.StartRequest()}, "already"),
        (CONTROL_S + 0.2, {"switch_policy": run_link_pb2.SwitchPolicy()}, "stop with keep_standing"),
        (CONTROL_S + 0.3, {"start_log": operator_pb2.StartLogRequest()}, "written already"),
        (CONTROL_S + 0.4, {"velocity": run_link_pb2.Velocity(v_x_m_s=float("nan"))}, "no number"),
    ]
    for at_s, what, _ in requests:
        operator.at(at_s, lambda what=what: operator.send(**what))  # type: ignore[misc]
    start(arming)
    stop(arming, CONTROL_S + 0.6)
    outcome = arming.drive()
    assert outcome.outcome == "operator_stop"
    refused = [a.text for a in operator.answers.values() if not a.is_done]
    assert len(refused) == len(requests), refused
    for text, (_, _, words) in zip(refused, requests, strict=True):
        assert words in text
    assert arming.is_at_rest()


def test_the_e_stop_signal_counts_while_the_robot_only_stands_too(
    arming: Arming, monkeypatch: pytest.MonkeyPatch
) -> None:
    pressed = count_calls(monkeypatch, "estop")
    attend(arming)
    arming.operator.at(1.0, lambda: os.kill(os.getpid(), signal.SIGQUIT))
    outcome = arming.drive()
    assert (outcome.outcome, outcome.exit_code) == ("operator_estop", 12)
    assert len(pressed) == 1
    assert not arming.status().lease_owner
    assert arming.status().motor_power.lower().endswith("off")


def test_an_estop_beside_a_stop_is_pressed_while_the_robot_stands_by(
    arming: Arming, monkeypatch: pytest.MonkeyPatch
) -> None:
    pressed = count_calls(monkeypatch, "estop")

    def both() -> None:
        arming.operator.send(stop=operator_pb2.StopRequest())
        os.kill(os.getpid(), signal.SIGQUIT)

    arming.operator.at(1.0, both)
    assert arming.drive().outcome == "operator_estop"
    assert pressed


@pytest.mark.parametrize(("fault", "outcome", "stands"), [("low_battery", "battery_low", 1), ("", "operator_stop", 2)])
def test_an_urgent_end_sits_at_once_and_a_mild_one_stands_first(
    arming: Arming, monkeypatch: pytest.MonkeyPatch, fault: str, outcome: str, stands: int
) -> None:
    stood = count_calls(monkeypatch, "stand")
    attend(arming)
    start(arming)
    if fault:
        arming.operator.at(CONTROL_S + 0.2, lambda: arming.inject(fault))
    else:
        stop(arming, CONTROL_S + 0.2)
    assert arming.drive().outcome == outcome
    assert len(stood) == stands
    assert arming.is_at_rest()


def test_a_start_is_answered_when_the_robot_has_handed_the_joints_over(arming: Arming) -> None:
    operator = arming.operator
    attend(arming)
    start(arming)
    stop(arming, CONTROL_S + 0.3)
    assert arming.drive().outcome == "operator_stop"
    told = [m for m in operator.told if m.WhichOneof("what") in ("answer", "event")]
    at = next(i for i, m in enumerate(told) if m.answer.text == "the joints are handed over to the policy")
    assert "activating → ramping_in" in [m.event.text for m in told[:at]]


def test_a_robot_that_does_not_stand_though_it_says_so_is_never_armed(
    arming: Arming, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(BosdynHal, "stand", lambda _: None)  # it says that it stands, and lies where it lay
    outcome = arming.drive()
    assert outcome.outcome == "body_low", outcome.sentence
    assert arming.operator.states == ["ending"]


def test_a_start_that_a_stop_overtakes_is_refused(arming: Arming) -> None:
    operator = arming.operator
    attend(arming)
    start(arming)
    operator.at(0.51, lambda: operator.send(stop=operator_pb2.StopRequest(keep_standing=True)))
    stop(arming, 2.0)
    assert arming.drive().outcome == "operator_stop"
    first = operator.answers[1]
    assert (first.is_done, first.text.partition(";")[0]) == (False, "the policy did not get the joints")


def test_damp_says_what_became_of_the_joints(arming: Arming) -> None:
    operator = arming.operator
    attend(arming)
    start(arming)
    for at_s in (CONTROL_S, CONTROL_S + 0.1):
        operator.at(at_s, lambda: operator.send(damp=operator_pb2.DampRequest()))
    operator.at(CONTROL_S + 0.2, lambda: operator.send(stop=operator_pb2.StopRequest(keep_standing=True)))
    assert arming.drive().outcome == "operator_damp"
    words = [answer.text for answer in operator.answers.values()]
    damped = "the joints are damped, the robot sinks to the ground; then the motors lose their power"
    assert words[1:3] == [damped, damped]
    assert words[3].startswith("the run ends already: ")


def test_a_lease_that_is_lost_while_standing_by_ends_the_arming(arming: Arming) -> None:
    attend(arming)
    arming.operator.at(1.0, lambda: arming.inject("lease_stolen"))
    outcome = arming.drive()
    assert outcome.outcome == "lease_lost", outcome.sentence


def count_calls(monkeypatch: pytest.MonkeyPatch, name: str) -> list[str]:
    """Grows by one whenever the adapter's method is called, which does what it always does."""
    calls: list[str] = []
    original = getattr(BosdynHal, name)

    def counted(hal: BosdynHal) -> None:
        calls.append(name)
        original(hal)

    monkeypatch.setattr(BosdynHal, name, counted)
    return calls


def test_a_robot_that_is_turned_over_while_it_stands_by_ends_the_arming(spare_arming: Arming) -> None:
    arming, operator = spare_arming, spare_arming.operator
    attend(arming)
    over = fake_admin_pb2.InjectFaultRequest(name="push", numbers={"roll_rad_s": 12.0, "up_m_s": 2.5})
    operator.at(0.3, lambda: arming.admin.InjectFault(over))
    start(arming, 6.0)
    outcome = arming.drive()
    assert outcome.outcome == "tilt", outcome.sentence
    assert operator.states == ["armed", "ending"]
    assert not any(answer.is_done for answer in operator.answers.values())
