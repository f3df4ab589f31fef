"""The incident file: the seconds around a stop, whatever becomes of the log."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from spot_log import read_run
from spot_log.format.events import EventName
from spot_log.format.records import CommandRecord, EventRecord, RunHeader, Severity, TickRecord, WireState
from spot_log.write.flight_recorder import KEPT, FlightRecorder, flight_record_path
from spot_log.write.sink import MemorySink
from spot_model.robot.state import Gains, JointCommand, RobotState, SlowState
from spot_runtime.stops import WANTED_ENDS

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000
HEADER = RunHeader("run-1", START_NS, policy_name="walk")
MakeState = Callable[..., RobotState]
MakeSlow = Callable[..., SlowState]


def stop(text: str, at_ns: int = START_NS) -> EventRecord:
    return EventRecord(at_ns, at_ns, Severity.ERROR, "stop", text)


def command(key: int, at_ns: int) -> CommandRecord:
    pose, zeros = np.full(12, 0.1), np.zeros(12)
    sent = JointCommand(key, pose, zeros, zeros, Gains.policy(), at_ns + 50 * MS)
    return CommandRecord(sent, pose, at_ns, at_ns, at_ns)


def feed(recorder: FlightRecorder, make_state: MakeState, first: int, count: int) -> None:
    for i in range(first, first + count):
        at_ns = START_NS + 3 * i * MS
        recorder.put(make_state(at_ns))
        recorder.put(command(i + 1, at_ns))


def test_everything_reaches_the_log_behind(make_state: MakeState, make_slow: MakeSlow) -> None:
    sink = MemorySink()
    recorder = FlightRecorder(sink, WANTED_ENDS)
    recorder.put(WireState(b"wire", START_NS))
    feed(recorder, make_state, 0, 2)
    recorder.put(make_slow())
    recorder.put(stop("tilt: too far"))
    recorder.close("tilt")
    assert sink.states == [(b"wire", START_NS)]
    assert (len(sink.decoded_states), len(sink.commands), len(sink.slow_states), len(sink.events)) == (2, 2, 1, 1)
    assert (sink.outcome, recorder.dropped, recorder.health().is_alive) == ("tilt", sink.dropped, False)


def test_two_seconds_before_and_after_the_stop(make_state: MakeState, make_slow: MakeSlow, tmp_path: Path) -> None:
    recorder = FlightRecorder(MemorySink(), WANTED_ENDS)
    feed(recorder, make_state, 0, 2000)
    small = np.zeros(12, dtype=np.float32)
    at_ns = START_NS + 6000 * MS
    recorder.put(TickRecord(1, at_ns, at_ns, "active", np.zeros(48, np.float32), small, np.zeros(3), 0, 0, 0, 1, 0))
    recorder.put(make_slow(at_ns))
    recorder.put(stop("tilt: the body tilts too far", at_ns))
    feed(recorder, make_state, 2000, 2000)
    log = tmp_path / "logs" / "run.mcap"
    path = flight_record_path(log)
    assert path == tmp_path / "logs" / "incidents" / "run.mcap"
    told = recorder.write(log, HEADER, "tilt")
    assert told == (EventName.INCIDENT, f"the seconds around the stop are in {path}")
    assert recorder.write(log, HEADER, "tilt") is None, "once is enough"
    run = read_run(path)
    assert not run.damage
    assert (run.header.run_id, run.outcome) == ("run-1", "tilt")
    keys = run.commands.key.tolist()
    assert keys == list(range(2000 - KEPT["command"] + 1, 2000 + KEPT["command"] + 1))
    assert len(run.states) == 2 * KEPT["state"]
    assert (np.diff(run.states.robot_stamp_ns) == 3 * MS).all()
    assert [event.name for event in run.events] == ["stop"]
    assert (len(run.ticks.index), len(run.slow_states.robot_stamp_ns)) == (1, 1)


def test_the_operators_stop_and_a_good_end_are_no_incidents(make_state: MakeState, tmp_path: Path) -> None:
    recorder = FlightRecorder(MemorySink(), WANTED_ENDS)
    feed(recorder, make_state, 0, 5)
    recorder.put(stop("operator_stop: the operator asked"))
    recorder.put(EventRecord(START_NS, START_NS, Severity.INFO, "completed", "completed: done"))
    assert recorder.write(tmp_path / "a.mcap", HEADER, "operator_stop") is None
    assert list(tmp_path.iterdir()) == []
    # What goes wrong afterwards is one, and of several the first counts.
    recorder.put(stop("state_stale: old"))
    recorder.put(stop("state_lost: gone"))
    assert recorder.cause == "state_stale"
    assert recorder.write(tmp_path / "a.mcap", HEADER, "state_stale") is not None


def test_a_broken_record_costs_itself_alone(make_state: MakeState, tmp_path: Path) -> None:
    recorder = FlightRecorder(MemorySink(), WANTED_ENDS)
    recorder.put(WireState(b"\xff\xff no state", START_NS))
    feed(recorder, make_state, 0, 3)
    recorder.put(stop("state_lost: no state of Spot's"))
    assert recorder.write(tmp_path / "run.mcap", HEADER, "state_lost") is not None
    assert len(read_run(flight_record_path(tmp_path / "run.mcap")).states) == 3


def test_what_is_there_already_is_not_overwritten(make_state: MakeState, tmp_path: Path) -> None:
    recorder = FlightRecorder(MemorySink(), WANTED_ENDS)
    feed(recorder, make_state, 0, 1)
    recorder.put(stop("tilt: x"))
    log = tmp_path / "run.mcap"
    flight_record_path(log).parent.mkdir()
    flight_record_path(log).write_text("precious")
    name, words = recorder.write(log, HEADER, "tilt") or (None, "")
    assert name is EventName.INCIDENT_FAILED
    assert "exists already" in words
    assert flight_record_path(log).read_text() == "precious"


def test_a_folder_that_cannot_be_made_is_said(make_state: MakeState, tmp_path: Path) -> None:
    recorder = FlightRecorder(MemorySink(), WANTED_ENDS)
    feed(recorder, make_state, 0, 1)
    recorder.put(stop("tilt: x"))
    (tmp_path / "incidents").write_text("in the way")
    name, words = recorder.write(tmp_path / "run.mcap", HEADER, "tilt") or (None, "")
    assert name is EventName.INCIDENT_FAILED
    assert "incidents/run.mcap cannot be written" in words
