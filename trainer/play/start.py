"""A policy's walk, started as a film or in browsers; each ends with a sentence."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
import typer

from spot_model.effects.base import Effect
from spot_model.errors import BadInputError
from spot_model.io.model_file import load_model
from spot_model.io.whole import check_new
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.contract import PolicyContract
from spot_model.policy.policy import load_policy
from spot_model.robot.facts import Array
from trainer.play.switches import BUILT_IN
from trainer.play.walk import Walk, following

if TYPE_CHECKING:
    from trainer.play.scene import WebScene, WebServer


@dataclass(frozen=True)
class Started:
    """A robot that is ready to walk."""

    walk: Walk
    effects: tuple[Effect, ...]
    """Of its model."""
    wanted: Array | None
    """Velocity command that was asked for, V_x, V_y (m/s), ω_z (rad/s), shape (3,)."""

    @classmethod
    def of(cls, policy: Path, model: str, velocity: str | None, seed: int) -> Started:
        """Load a policy, or follow the folder of a training, on a model.

        Raises:
            BadInputError: A file or a value is not valid, or an extra is missing.
        """
        following = None
        if policy.is_dir():
            try:
                from trainer.ppo.checkpoint_policy import NewestPolicy
            except ModuleNotFoundError as error:
                raise missing(f"{policy} is a training's folder", error, "train") from error

            following = NewestPolicy(policy, lambda name: typer.echo(f"now {name}", err=True))
        loaded = load_policy(policy) if following is None else following.load()
        wanted = None if velocity is None else parse_velocity(velocity, loaded.contract)
        effects = load_model(model).effects
        plant, rng = Plant(effects, 1, PlantOptions(n_threads=1)), np.random.default_rng(seed)
        walk = Walk(loaded, plant, rng) if following is None else Walk(loaded, plant, rng, following.newer)
        return cls(walk, effects, wanted)

    def sentence(self) -> str:
        """How the walk ended."""
        walk = self.walk
        gait, forward_m_s = walk.gait, round(float(walk.velocity[0]), 2) + 0.0  # without a zero's sign
        return (
            f"{walk.time_s:.1f} s, {walk.falls} falls; at the end {forward_m_s:.2f} m/s forward, "
            f"gait: {'too short to say' if gait is None else gait.sentence()}"
        )


def parse_velocity(text: str, contract: PolicyContract) -> Array:
    """Read ``vx,vy,wz`` in m/s and rad/s.

    Raises:
        BadInputError: It is not three numbers, or outside the policy's range.
    """
    try:
        values = [float(part) for part in text.split(",")]
    except ValueError:
        values = []
    if len(values) != 3:
        raise BadInputError(f"--velocity {text!r} is not three numbers vx,vy,wz in m/s and rad/s, such as 1,0,0.5")
    ranges = zip(("vx", "vy", "wz"), values, contract.velocity_command_low, contract.velocity_command_high, strict=True)
    for name, value, low, high in ranges:
        if not low <= value <= high:
            raise BadInputError(f"--velocity: {name} = {value} is outside the policy's range of {low:g} to {high:g}")
    return np.array(values)


def film_it(started: Started, out: Path, seconds: float) -> str:
    """Write a film."""
    from trainer.play.film import check_film, top_speed_ramp, write_film

    check_new(out)
    check_film(out)
    walk, wanted = started.walk, started.wanted
    velocity_at = top_speed_ramp(walk.policy, seconds) if wanted is None else following(lambda: wanted)
    write_film(walk, velocity_at, out, seconds)
    return f"wrote {out}: {started.sentence()}"


class Page(Protocol):
    """What browsers show."""

    scene: WebScene

    def run(self, seconds: float | None) -> None:
        """Show it until ``seconds`` have passed, without them for ever."""
        ...


def in_browsers(started: Started, address: tuple[str, int], seconds: float | None) -> str:
    """Walk in browsers until the end or Ctrl-C."""
    contract = started.walk.policy.contract
    start = np.array([0.5, 0.0, 0.0]) if started.wanted is None else started.wanted
    start = np.clip(start, contract.velocity_command_low, contract.velocity_command_high)

    def page(server: WebServer) -> Page:
        from trainer.play.web import LivePage

        return LivePage(server, started.walk, started.effects, BUILT_IN, start)

    told = serve_page(page, address, seconds)
    return f"{started.sentence()}{told and f'; {told}'}"


def serve_page(page_on: Callable[[WebServer], Page], address: tuple[str, int], seconds: float | None) -> str:
    """Show a page in browsers until the end or Ctrl-C; say how many frames they got, if any came."""
    try:
        from trainer.play.scene import WebServer, address_lines
    except ModuleNotFoundError as error:
        raise missing("the page", error, "web") from error
    server = WebServer(*address)
    try:
        page = page_on(server)
        typer.echo(address_lines(address[0], server.get_port()))
        with contextlib.suppress(KeyboardInterrupt):
            page.run(seconds)
    finally:
        server.stop()
    return f"browsers got {page.scene.frame_rate_hz:.1f} frames a second" if page.scene.frame_rate_hz else ""


def missing(what: str, error: ModuleNotFoundError, extra: str) -> BadInputError:
    """The error that names the extra to install."""
    return BadInputError(
        f"{what}: the module {error.name} is not installed; install the extra: pip install 'spot-rl[{extra}]'"
    )
