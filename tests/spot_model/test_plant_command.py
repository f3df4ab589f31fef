"""Commands on their way: late, in order, lost, and dropped by a reset."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, ClassVar

import numpy as np
import pytest

from spot_model.effects.base import CommandEffect, parameter
from spot_model.effects.commands import CommandDelay
from spot_model.plant.command_channel import CommandChannel, ServoCommand

DT = 0.005


@dataclasses.dataclass(frozen=True, kw_only=True)
class Schedule(CommandEffect):
    """Delays by issue time, one value a simulation; a test double."""

    name: ClassVar[str] = "schedule"
    delay_s: Any = parameter(null=0.0, low=0.0, high=1.0, unit="s", source="test")
    delays_s: dict[float, tuple[float, ...]] = dataclasses.field(default_factory=dict)

    def arrival_s(self, issued_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        delays: np.ndarray = np.array(self.delays_s[float(issued_s[0])])
        arrival: np.ndarray = issued_s + delays
        return arrival


def channel(n_sims: int, *effects: CommandEffect) -> CommandChannel:
    return CommandChannel(effects, at(n_sims, -1.0), DT, np.random.default_rng(0))


def at(n_sims: int, value: float, **more: Any) -> ServoCommand:
    return ServoCommand(position_rad=np.full((n_sims, 12), value), **more)


def values(channel: CommandChannel, now_s: float) -> list[float]:
    return [float(v) for v in channel.at(now_s).position_rad[:, 0]]


def test_without_effects_a_command_acts_at_once() -> None:
    link = channel(2)
    assert values(link, 0.0) == [-1.0, -1.0]
    link.issue(at(2, 1.0), 0.0)
    assert values(link, 0.0) == [1.0, 1.0]


def test_a_command_acts_from_the_first_step_at_or_after_its_arrival() -> None:
    link = channel(3, CommandDelay(delay_s=np.array([[0.0], [0.005], [0.012]])))
    link.issue(at(3, 1.0), 0.0)
    assert values(link, 0.0) == [1.0, -1.0, -1.0]
    assert values(link, 1 * DT) == [1.0, 1.0, -1.0]
    assert values(link, 2 * DT) == [1.0, 1.0, -1.0]
    assert values(link, 3 * DT) == [1.0, 1.0, 1.0]


def test_a_delay_of_many_steps_is_not_lengthened_by_rounding() -> None:
    link = channel(1, CommandDelay(delay_s=0.1))
    for i in range(300):
        link.issue(at(1, float(i)), i * DT)
        if i >= 20:
            assert values(link, i * DT) == [float(i - 20)]


def test_delays_add_up() -> None:
    link = channel(1, CommandDelay(delay_s=0.005), CommandDelay(delay_s=0.010))
    link.issue(at(1, 1.0), 0.0)
    assert values(link, 2 * DT) == [-1.0]
    assert values(link, 3 * DT) == [1.0]


def test_no_command_overtakes_an_earlier_one() -> None:
    link = channel(2, Schedule(delays_s={0.0: (0.02, 0.0), 0.005: (0.0, 0.0)}))
    link.issue(at(2, 1.0), 0.0)
    link.issue(at(2, 2.0), 0.005)
    assert values(link, 1 * DT) == [-1.0, 2.0]
    assert values(link, 3 * DT) == [-1.0, 2.0]
    assert values(link, 4 * DT) == [2.0, 2.0]


def test_a_lost_command_never_acts_and_holds_up_no_other() -> None:
    link = channel(2, Schedule(delays_s={0.0: (math.inf, 0.0), 0.005: (0.0, math.inf)}))
    link.issue(at(2, 1.0), 0.0)
    assert values(link, 0.0) == [-1.0, 1.0]
    link.issue(at(2, 2.0), 0.005)
    assert values(link, 1.0) == [2.0, 1.0]


def test_a_reset_drops_what_is_on_its_way_in_its_simulations_only() -> None:
    link = channel(3, CommandDelay(delay_s=0.01))
    link.issue(at(3, 1.0), 0.0)
    link.reset(np.array([False, True, False]), at(3, 7.0))
    assert values(link, 0.0) == [-1.0, 7.0, -1.0]
    assert values(link, 5 * DT) == [1.0, 7.0, 1.0]
    link.issue(at(3, 2.0), 5 * DT)
    assert values(link, 7 * DT) == [2.0, 2.0, 2.0]


def test_a_message_travels_whole() -> None:
    link = channel(2, CommandDelay(delay_s=np.array([[0.0], [0.01]])))
    link.issue(at(2, 1.0, velocity_rad_s=0.5, load_nm=3.0, kp_nm_per_rad=100.0, kd_nm_s_per_rad=4.0), 0.0)
    seen = link.at(0.0)
    for name, new, old in [
        ("velocity_rad_s", 0.5, 0.0),
        ("load_nm", 3.0, 0.0),
        ("kp_nm_per_rad", 100.0, 60.0),
        ("kd_nm_s_per_rad", 4.0, 1.5),
    ]:
        assert np.broadcast_to(getattr(seen, name), (2, 12))[:, 0].tolist() == [new, old]


def test_a_command_of_the_wrong_shape_is_refused() -> None:
    with pytest.raises(ValueError, match=r"ServoCommand.load_nm has shape \(3, 12\); it must broadcast to \(2, 12\)"):
        at(2, 0.0, load_nm=np.zeros((3, 12))).copied_for(2)
