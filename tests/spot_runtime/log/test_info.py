"""The figures of a log, worked out by hand on the made-up run."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from spot_log import read_run
from spot_log.page.summary import histogram_lines, summarise
from spot_log.tools import measures
from spot_log.tools.log_info import histogram, log_info


@pytest.fixture(scope="module")
def run(synthetic_log):
    return read_run(synthetic_log)


def test_states(run):
    info = log_info(run)
    # 667 states 3 ms apart.
    assert info.state_count == 667
    assert info.duration_s == pytest.approx(1.998)
    assert info.states.rate_hz == pytest.approx(1000 / 3)
    assert info.states.period_ms.largest == pytest.approx(3.0)
    assert (info.states.gaps, info.states.backward) == (0, 0)
    assert info.receive_ms.p50 == pytest.approx(3.0)


def test_ticks(run):
    ticks = log_info(run).ticks
    # Ticks 7, 7, 6 states apart, three in 20 states: the hundredth on state 660.
    last_state = 33 * 20
    assert ticks.count == 100
    assert ticks.rate_hz == pytest.approx(99 / (last_state * 0.003))
    assert ticks.rate_hz == pytest.approx(50.0)
    assert ticks.skipped == 1
    assert ticks.state_age_ms.p50 == pytest.approx(0.5)
    assert ticks.inference_us.p99 == pytest.approx(100)
    assert ticks.compute_us.largest == pytest.approx(300)
    assert ticks.modes_s == {"active": pytest.approx(last_state * 0.003)}


def test_commands(run):
    commands = log_info(run).commands
    # Sent 1 ms after the receipt of the state, 4 ms on the way; the echo of tick 0: sent at 2 ms, there at 6 ms, so in
    # the state of 6 ms, received at 7 ms. The last command (state 660, sent at 1982 ms) is echoed at 1986 ms.
    assert commands.count == 100
    assert commands.echoed == 100
    assert commands.clamped == 10
    assert commands.delay_ms.p50 == commands.delay_ms.largest == pytest.approx(4.0)
    assert commands.state_to_command_ms.p99 == pytest.approx(1.0)
    assert commands.acknowledge_lag_ms.p50 == pytest.approx(5.0)
    assert sum(commands.delay_histogram.counts) == 100


def test_power(run):
    power = log_info(run).power
    # Ten polls: charge 80.0 to 79.1 %, voltage 54.00 to 53.91 V at −8 A, the last joint at 51.9 °C.
    assert power.polls == 10
    assert power.charge_start_percent == 80.0
    assert power.charge_end_percent == pytest.approx(79.1)
    assert power.voltage_min_v == pytest.approx(53.91)
    assert power.current_peak_a == -8.0
    assert power.energy_j == pytest.approx(8.0 * (54.0 + 53.91) / 2 * 1.8)
    assert (power.motor_temperature_joint, power.motor_temperature_max_c) == ("hr_kn", pytest.approx(51.9))
    assert power.faults == ["fall"]


def test_motion(run):
    motion = log_info(run).motion
    assert motion.control_s == pytest.approx(1.98)
    assert motion.distance_m == pytest.approx(0.8 * 1.98)
    assert motion.mean_speed_m_s == pytest.approx(0.8)
    # Command (1, 0, 0.1) against (0.8, 0, 0.05), but for a tilt of 0.02 rad.
    assert motion.tracking_rms == pytest.approx([0.2, 0.0, 0.05], abs=2e-3)
    assert motion.tilt_max_rad == pytest.approx(0.02, abs=1e-6)
    assert motion.falls == []
    assert motion.load_peak_nm["fl_hx"] == pytest.approx(20.0, abs=0.01)


def test_speed_counts_neither_standing_up_nor_sitting_down(run):
    """A second of ticks within two seconds of log; without ticks the whole log."""
    part = replace(run, ticks=run.ticks.rows(slice(25, 76)))
    motion = log_info(part).motion
    assert motion.control_s == pytest.approx(1.0, abs=0.002)
    assert motion.mean_speed_m_s == pytest.approx(0.8)
    assert "0.80 m walked in 1.0 s" in summarise(part)
    whole = log_info(replace(run, ticks=run.ticks.rows(slice(0)))).motion
    assert whole.control_s == pytest.approx(run.duration_s)
    assert whole.distance_m == pytest.approx(0.8 * 1.998)


def test_a_fall_by_tilt(synthetic_run, tmp_path):
    # 0.02 rad + 5 rad/s from 1.0 s: 60° after (1.0472 − 0.02)/5 = 0.2054 s.
    run = read_run(synthetic_run(fall_at_s=1.0).write(tmp_path / "run.mcap"))
    [fall] = log_info(run).motion.falls
    assert fall.cause == "tilt"
    assert fall.start_s == pytest.approx(1.2054, abs=0.004)
    assert fall.start_s + fall.duration_s == pytest.approx(1.998, abs=0.004)
    assert fall.tilt_rad == pytest.approx(1.5, abs=1e-6)
    assert "falls     1: at 1.2" in summarise(run)


def test_a_fall_by_lost_contact(run):
    contact = run.states.foot_contact.copy()
    contact[100:300] = False
    [fall] = measures.falls(replace(run, states=replace(run.states, foot_contact=contact)))
    assert fall.cause == "no foot on the ground"
    assert fall.start_s == pytest.approx(0.3)
    assert fall.duration_s == pytest.approx(0.597)
    contact[150] = True
    [fall] = measures.falls(replace(run, states=replace(run.states, foot_contact=contact)))
    assert fall.start_s == pytest.approx(0.453)
    contact[100:300:90] = True
    assert measures.falls(replace(run, states=replace(run.states, foot_contact=contact))) == ()


def test_a_robot_that_sits_before_its_first_command_has_not_fallen(run):
    contact = run.states.foot_contact.copy()
    contact[:300] = False
    late = run.commands.rows(slice(60, None))
    sitting = replace(run, states=replace(run.states, foot_contact=contact), commands=late)
    assert measures.falls(sitting) == ()
    assert len(measures.falls(replace(sitting, commands=run.commands))) == 1


def test_steps_by_hand():
    # Periods 3, 3, 9, 3, 0, −3 ms: median 3, one gap, two that do not go forward.
    found = measures.steps(np.cumsum(np.array([0, 3, 3, 9, 3, 0, -3])) * 1_000_000)
    assert (found.gaps, found.backward) == (1, 2)
    assert found.period_ms.largest == 9.0
    assert found.rate_hz == pytest.approx(6 / 0.015)
    assert np.isnan(measures.steps(np.array([5])).rate_hz)


def test_lost_messages_show_as_gaps(synthetic_run, tmp_path, run):
    keep = np.ones(667, dtype=bool)
    keep[[50, 51, 200]] = False
    states = run.states.rows(keep)
    thinned = replace(run, states=states, footer=None)
    assert measures.steps(states.robot_stamp_ns).gaps == 2
    assert measures.dropped(thinned) == {"state": 3}


def test_command_delay_counts_each_key_once_and_only_known_ones(run):
    time_s, delay_s = measures.command_delay_s(run)
    assert len(delay_s) == len(time_s) == 100
    # Without the first 10 commands in the log their echoes tell nothing.
    for first, known in ((10, 90), (100, 0)):
        fewer = run.commands.rows(slice(first, None))
        assert len(measures.command_delay_s(replace(run, commands=fewer))[1]) == known


def test_an_empty_log_has_a_summary(synthetic_run, tmp_path):
    from spot_log.write.run_writer import RunWriter

    RunWriter(tmp_path / "run.mcap", synthetic_run().header).close({}, "lease held by another client")
    run = read_run(tmp_path / "run.mcap")
    text = summarise(run)
    assert "outcome   lease held by another client" in text
    assert "states    0 at – Hz" in text
    json.dumps(log_info(run).to_json(), allow_nan=False)


def test_summary_names_what_matters(run):
    text = summarise(run)
    assert "2.0 s on fake-spot, policy walk, sequence forward, repeat 3, payload none, surface lab floor" in text
    assert "ticks     100 at 50.00 Hz, 1 skipped" in text
    assert "100 echoed, 10 clamped" in text
    assert "command to robot p50 4.00, p99 4.00, max 4.00 ms" in text
    assert "falls     none" in text
    assert "nothing dropped" in text
    assert "0.50 s warning: a state was late age_ms=12.5 bound_ms=10" in text


def test_json_is_plain_and_complete(run):
    told = log_info(run).to_json()
    text = json.dumps(told, allow_nan=False)
    assert json.loads(text)["header"]["labels"] == {"payload": "none", "surface": "lab floor"}
    assert [event["name"] for event in told["events"]] == ["mode", "state_age", "limit"]
    assert told["event_counts"] == {"mode": 1, "state_age": 1, "limit": 1}
    assert told["dropped"] == {}


def test_histogram_counts_everything_once():
    values = np.concatenate([np.full(99, 4.0), [50.0]])
    found = histogram(values)
    assert sum(found.counts) == 100
    assert found.edges_ms[0] == 4.0
    assert found.edges_ms[-1] == 50.0
    lines = histogram_lines(found)
    assert len(lines) == 21
    assert lines[0].endswith("█" * 40)
    assert histogram_lines(histogram(np.zeros(0))) == []
