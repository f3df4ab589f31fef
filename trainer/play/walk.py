"""One simulated robot that walks under a policy for as long as it is asked to."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from spot_model.plant.closed_loop import ClosedLoop, schedule_by_rate
from spot_model.plant.plant import Plant
from spot_model.policy.policy import Policy
from spot_model.robot.facts import Array
from spot_model.robot.gait import Gait, measure_gait
from spot_runtime.sources import Shaper

VelocityAt = Callable[[float], Array]
"""The velocity command V_x, V_y (m/s), ω_z (rad/s), shape (3,), at a time in s since the start."""

SEEN_S = 3.0
"""How far back the gait is measured and its diagram reaches, s."""
AVERAGED_S = 0.5
"""Time over which the shown velocity is averaged, about a stride, s."""
LIES_S = 1.0
"""Time that a robot lies after a fall before it is put back on its feet, s."""
PUSH_M_S = 1.0
"""Horizontal velocity that a push adds to the body, m/s."""
ACCELERATION_M_S2 = 2.0
"""Rise of a command towards what is wanted; rad/s² for turns."""


def following(wanted: Callable[[], Array]) -> VelocityAt:
    """A command that goes evenly to what is wanted just then: V_x, V_y (m/s), ω_z (rad/s), shape (3,)."""
    shaper = Shaper(ACCELERATION_M_S2, release_s=1.0)
    return lambda time_s: shaper.follow(wanted(), round(time_s * 1e9))


class Walk:
    """A robot in closed loop, and what it did in the last moments."""

    def __init__(
        self, policy: Policy, plant: Plant, rng: np.random.Generator, newer: Callable[[], Policy | None] = lambda: None
    ) -> None:
        self.policy, self.plant = policy, plant
        self.command: Array = np.zeros(3)
        self.time_s = 0.0
        """Simulated time since the start."""
        self.falls = 0
        self._rng, self._newer = rng, newer
        self._goes_back = False
        self._contact: deque[NDArray[np.bool_]] = deque(maxlen=round(SEEN_S / plant.timestep_s))
        self._velocity: deque[Array] = deque(maxlen=round(AVERAGED_S * policy.contract.rate_hz))

    def ticks(self, velocity_at: VelocityAt) -> Iterator[None]:
        """Walk for ever, one policy period at a time; a robot that fell is put back on its feet."""

        def ask(_: int) -> Array:
            self.command = velocity_at(self.time_s)
            return self.command[None]

        rate = self.policy.contract.rate_hz
        one_second = schedule_by_rate(round(rate), rate, self.plant.timestep_s)
        while True:
            loop = ClosedLoop(self.plant, self.policy, after_step=self._watch)
            fell_at_s: float | None = None
            for _ in loop.run(ask, itertools.chain.from_iterable(itertools.repeat(one_second))):
                self.time_s += 1.0 / rate
                linear = self.plant.linear_vel_of_body_in_body_m_s[0, :2]
                self._velocity.append(np.append(linear, self.plant.angular_vel_of_body_in_body_rad_s[0, 2]))
                if fell_at_s is None and self.plant.body_contact[0]:
                    self.falls, fell_at_s = self.falls + 1, self.time_s
                yield
                if fell_at_s is not None and self.time_s - fell_at_s > LIES_S:
                    break
                fresh = self._newer()
                self.policy = self.policy if fresh is None else fresh
                if self._goes_back or fresh is not None:
                    break
            self._goes_back = False
            self.plant.reset()
            self._contact.clear()
            self._velocity.clear()

    def put_back(self) -> None:
        """Put the robot back at the start, on its feet, before the next tick."""
        self._goes_back = True

    def push(self) -> None:
        """Add :data:`PUSH_M_S` to the body's velocity in a drawn horizontal direction."""
        angle = self._rng.uniform(-np.pi, np.pi)
        self.plant.push(linear_vel_in_world_m_s=PUSH_M_S * np.array([np.cos(angle), np.sin(angle), 0.0]))

    @property
    def qpos(self) -> Array:
        """MuJoCo's generalised position now, a copy."""
        return np.array(self.plant.batch.bind("qpos")[0])

    @property
    def velocity(self) -> Array:
        """Mean V_x, V_y (m/s), ω_z (rad/s) in the body's frame over the last moments, shape (3,)."""
        return np.mean(self._velocity, axis=0) if self._velocity else np.zeros(3)

    @property
    def contact(self) -> NDArray[np.bool_]:
        """Feet on the ground at the last physics steps, oldest first, shape (up to 3 s, 4), legs fl, fr, hl, hr."""
        return np.array(self._contact, dtype=np.bool_).reshape(-1, 4)

    @property
    def gait(self) -> Gait | None:
        """The gait of the last moments; None before there is a second of them."""
        contact = self.contact
        if len(contact) < round(1.0 / self.plant.timestep_s):
            return None
        return measure_gait(np.arange(len(contact)) * self.plant.timestep_s, contact)

    def _watch(self) -> None:
        self._contact.append(self.plant.foot_contact[0])
