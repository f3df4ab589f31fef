"""A control process that reads nothing: a stop still reaches it, soon, whatever else waits."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

import pytest

from spot_protos import operator_pb2, run_link_pb2
from spot_runtime.config import RunConfig
from spot_runtime.control.modes import Mode
from spot_runtime.host.service_manager import ServiceManager
from spot_runtime.operator.door.access import Refusal
from spot_runtime.operator.server.armed_run import PendingRequests
from spot_runtime.operator.server.service_state import State
from spot_runtime.operator.server.supervisor import MAX_WAITING, STOP_TIMEOUT_S, Supervisor

from .conftest import wait_until


class DeafProcess:
    """Its socket takes what is said, and nothing answers; signals are counted."""

    def __init__(self) -> None:
        self.signals: list[str] = []
        self.told: list[str | None] = []

    def tell(self, message: run_link_pb2.ToRun) -> bool:
        self.told.append(message.WhichOneof("what"))
        return True

    def ask_to_stop(self) -> None:
        self.signals.append("stop")

    def ask_to_damp(self) -> None:
        self.signals.append("damp")


def waiting_of(supervisor: Supervisor) -> PendingRequests:
    assert supervisor._run is not None
    return supervisor._run.waiting


@pytest.fixture
def deaf() -> Iterator[tuple[Supervisor, DeafProcess]]:
    supervisor = Supervisor("127.0.0.1:1", RunConfig(), manager=ServiceManager(), tell=lambda _: None)
    process = DeafProcess()
    supervisor.adopt(process, State.RUNNING)  # type: ignore[arg-type]
    yield supervisor, process
    waiting_of(supervisor).let_all_go()  # whoever still waits is let go, as when the process ends


@pytest.mark.parametrize(
    ("message", "is_damping", "sent"),
    [
        (run_link_pb2.ToRun(stop=operator_pb2.StopRequest()), False, "stop"),
        (run_link_pb2.ToRun(damp=operator_pb2.DampRequest()), True, "damp"),
    ],
)
def test_it_is_sent_a_signal_though_others_wait(
    deaf: tuple[Supervisor, DeafProcess], message: run_link_pb2.ToRun, is_damping: bool, sent: str
) -> None:
    supervisor, process = deaf
    refused: list[str] = []

    def label() -> None:
        try:
            labels = operator_pb2.LabelLogRequest(labels={"a": "b"})
            supervisor.ask("LabelLog", run_link_pb2.ToRun(label_log=labels), State.RUNNING)
        except Refusal as refusal:
            refused.append(refusal.text)

    others = [threading.Thread(target=label) for _ in range(MAX_WAITING + 3)]
    for other in others:
        other.start()
    wait_until(lambda: len(waiting_of(supervisor)) >= MAX_WAITING and len(refused) >= 3, "all wait or are refused")
    assert refused == [f"LabelLog: {MAX_WAITING} requests wait for their answers already; wait for one"] * 3
    began_s = time.monotonic()
    said = supervisor.end("Stop", message, "otto", is_damping=is_damping)
    assert "was sent a signal" in said
    assert process.signals == [sent]
    assert process.told[-1] == sent
    assert time.monotonic() - began_s >= STOP_TIMEOUT_S  # it was given the time to answer
    assert [e.text for e in supervisor.events.after(0) if e.name == "service_asked"] == ["Stop, by otto"]
    waiting_of(supervisor).let_all_go()
    for other in others:
        other.join()


def test_a_stop_that_is_asked_for_again_is_not_sent_as_the_signal_that_damps(
    deaf: tuple[Supervisor, DeafProcess],
) -> None:
    supervisor, process = deaf
    for _ in range(3):
        message = run_link_pb2.ToRun(stop=operator_pb2.StopRequest())
        assert "was sent a signal" in supervisor.end("stop", message, "", is_damping=False)
    assert process.signals == ["stop"]


def test_a_robot_that_is_brought_to_rest_is_stopped_already_and_cannot_be_damped(
    deaf: tuple[Supervisor, DeafProcess],
) -> None:
    supervisor, process = deaf
    supervisor._take(run_link_pb2.FromRun(state="ending"))
    stop, damp = (
        run_link_pb2.ToRun(stop=operator_pb2.StopRequest()),
        run_link_pb2.ToRun(damp=operator_pb2.DampRequest()),
    )
    assert "already" in supervisor.end("stop", stop, "", is_damping=False)
    with pytest.raises(Refusal, match="which the e-stop alone does sooner"):
        supervisor.end("damp", damp, "", is_damping=True)
    assert (process.signals, process.told) == ([], [])


@pytest.mark.parametrize("mode", [mode.value for mode in Mode if mode is not Mode.ACTIVE])
def test_nobody_is_told_to_steer_in_a_mode_in_which_no_velocity_is_followed(
    deaf: tuple[Supervisor, DeafProcess], mode: str
) -> None:
    supervisor, process = deaf
    velocity = run_link_pb2.ToRun(velocity=run_link_pb2.Velocity(v_x_m_s=0.3))
    supervisor._take(run_link_pb2.FromRun(status=operator_pb2.RunStatus(mode=mode)))
    with pytest.raises(Refusal, match=f"the mode is {mode}"):
        supervisor.steer(velocity, "user 1", "anna")
    assert process.told == []
    supervisor._take(run_link_pb2.FromRun(status=operator_pb2.RunStatus(mode="active")))
    supervisor.steer(velocity, "user 1", "anna")
    assert process.told == ["velocity"]
