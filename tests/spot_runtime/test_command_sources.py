"""Sources of velocity commands, and the dead-man."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from spot_model.io.velocity_sequence import VelocitySequence, Waypoint
from spot_runtime.config import OperatorConfig
from spot_runtime.sources import Shaper
from spot_tools.sources import GamepadSource, KeyboardSource, PadReading, ScriptedSource

MS = 1_000_000
CONFIG = OperatorConfig()


class Keys:
    """A keyboard written by hand."""

    def __init__(self) -> None:
        self.pressed = ""

    def read(self) -> str:
        pressed, self.pressed = self.pressed, ""
        return pressed


class Pad:
    """A gamepad written by hand: dead-man held, stick forward."""

    def __init__(self) -> None:
        self.axes, self.is_held, self.is_attached, self.is_closed = (0.0, -1.0, 0.0, 0.5), True, True, False

    def read(self) -> PadReading:
        buttons = tuple(self.is_held if i == CONFIG.gamepad_deadman_button else False for i in range(8))
        return PadReading(self.axes, buttons, self.is_attached)

    def close(self) -> None:
        self.is_closed = True


def test_a_sequence_plays_once_and_says_when_it_is_over() -> None:
    points = (Waypoint(time_s=0.0), Waypoint(time_s=1.0, v_x_m_s=0.5))
    source = ScriptedSource(VelocitySequence(name="s", duration_s=2.0, waypoints=points))
    assert source.sample(0.5, 0).command.tolist() == [0.0, 0.0, 0.0]
    assert source.sample(1.99, 0).command.tolist() == [0.5, 0.0, 0.0]
    assert not source.sample(1.99, 0).is_finished
    assert source.sample(2.0, 0).is_finished


def test_a_sequence_repeats_until_the_given_time() -> None:
    points = (Waypoint(time_s=0.0), Waypoint(time_s=1.0, v_x_m_s=0.5))
    source = ScriptedSource(VelocitySequence(name="s", duration_s=2.0, waypoints=points), duration_s=5.0)
    assert source.sample(3.5, 0).command.tolist() == [0.5, 0.0, 0.0]
    assert not source.sample(4.99, 0).is_finished
    assert source.sample(5.0, 0).is_finished


def test_a_held_key_ramps_up_to_the_top_speed() -> None:
    keys = Keys()
    source = KeyboardSource(CONFIG, keys.read)
    speeds = []
    for i in range(60):
        keys.pressed = "w" if i % 2 == 0 else ""
        speeds.append(source.sample(0.0, i * 20 * MS).command[0])
    assert speeds[0] == 0.0
    assert np.diff(speeds).max() <= CONFIG.acceleration_m_s2 * 0.02 + 1e-12
    assert speeds[-1] == CONFIG.top_v_x_m_s


def test_silence_is_release_and_the_command_fades_to_zero() -> None:
    keys = Keys()
    source = KeyboardSource(CONFIG, keys.read)
    for i in range(60):
        keys.pressed = "q"
        source.sample(0.0, i * 20 * MS)
    last_ns = 59 * 20 * MS
    later = {ms: source.sample(0.0, last_ns + ms * MS).command[2] for ms in range(20, 1000, 20)}
    assert later[580] == CONFIG.top_yaw_rate_rad_s
    fading = [value for ms, value in later.items() if 620 <= ms <= 880]
    assert fading == sorted(fading, reverse=True)
    assert later[900] == 0.0


@pytest.mark.parametrize(
    ("key", "axis", "sign"), [("w", 0, 1), ("s", 0, -1), ("a", 1, 1), ("d", 1, -1), ("q", 2, 1), ("e", 2, -1)]
)
def test_each_key_drives_its_own_axis(key: str, axis: int, sign: int) -> None:
    keys = Keys()
    source = KeyboardSource(CONFIG, keys.read)
    for i in range(10):
        keys.pressed = key
        command = source.sample(0.0, i * 20 * MS).command
    assert np.sign(command).tolist() == [float(sign) if i == axis else 0.0 for i in range(3)]


def test_space_releases_and_x_ends_the_run() -> None:
    keys = Keys()
    source = KeyboardSource(CONFIG, keys.read)
    for i in range(30):
        keys.pressed = "w"
        source.sample(0.0, i * 20 * MS)
    keys.pressed = " "
    source.sample(0.0, 600 * MS)
    assert source.sample(0.0, 860 * MS).command[0] == 0.0
    keys.pressed = "x"
    assert source.sample(0.0, 880 * MS).is_finished


@pytest.mark.parametrize("loss", ["button", "cable", "axes"])
def test_a_gamepad_without_its_dead_man_means_zero(loss: str) -> None:
    pad = Pad()
    source = GamepadSource(CONFIG, pad)
    for i in range(100):
        command = source.sample(0.0, i * 20 * MS).command
    assert command.tolist() == [CONFIG.top_v_x_m_s, 0.0, -0.5 * CONFIG.top_yaw_rate_rad_s]
    pad.is_held, pad.is_attached = loss != "button", loss != "cable"
    pad.axes = () if loss == "axes" else pad.axes
    source.sample(0.0, 2000 * MS)
    assert source.sample(0.0, 2260 * MS).command.tolist() == [0.0, 0.0, 0.0]
    source.close()
    assert pad.is_closed


def test_a_stick_near_its_middle_is_still() -> None:
    pad = Pad()
    pad.axes = (0.09, -0.09, 0.0, 0.05)
    source = GamepadSource(CONFIG, pad)
    for i in range(10):
        command = source.sample(0.0, i * 20 * MS).command
    assert command.tolist() == [0.0, 0.0, 0.0]


@given(st.lists(st.tuples(st.integers(0, 500), st.one_of(st.none(), st.floats(-2.0, 2.0))), max_size=60))
def test_a_shaped_command_never_exceeds_a_wish_and_never_rises_faster_than_allowed(
    steps: list[tuple[int, float | None]],
) -> None:
    shaper, now_ns, before = Shaper(2.0, 0.25), 0, np.zeros(3)
    for wait_ms, wish in steps:
        now_ns += wait_ms * MS
        command = shaper.follow(None if wish is None else np.full(3, wish), now_ns)
        assert np.abs(command).max() <= 2.0
        rise = np.abs(command) - np.abs(before)
        assert rise.max() <= 2.0 * min(wait_ms / 1e3, 0.1) + 1e-9
        before = command


def test_a_gamepad_of_sdl_s_own() -> None:
    """Through pygame and SDL, as a plugged-in one goes; only the kernel's device is missing."""
    told = subprocess.run(
        [sys.executable, str(Path(__file__).with_name("virtual_pad.py"))], capture_output=True, text=True
    )
    assert told.returncode == 0, told.stderr
    still = [0.0, 0.0, 0.0]
    assert json.loads(told.stdout) == {
        "stick without the dead-man": still,
        "forward": [1.0, 0.0, 0.0],
        "within the dead zone": still,
        "right, turning left": [0.0, -0.5, pytest.approx(0.5, abs=0.001)],
        "let go": still,
        "held again": [0.0, -0.5, pytest.approx(0.5, abs=0.001)],
        "unplugged": still,
    }
