"""The plant on mujoco_warp, which computes on the cores here, against the plant on MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pytest

from spot_model.effects.base import CommandEffect, Effect, ModelEffect, parameter
from spot_model.effects.commands import CommandDelay, CommandDrop, CommandJitter
from spot_model.effects.joint_sensors import SensorNoise
from spot_model.effects.leg_odometry import LegOdometry
from spot_model.effects.side_by_side import side_by_side
from spot_model.errors import BadInputError
from spot_model.io.model_file import load_model
from spot_model.plant.closed_loop import ClosedLoop
from spot_model.plant.plant import DEFAULT_BODY_POSITION_M, Plant, PlantDivergedError, PlantOptions
from spot_model.policy.policy import load_policy
from spot_model.robot import facts
from spot_model.robot.arrays import on_host
from spot_model.robot.mjcf import MjcfOptions

from .test_effects import ACTIVE

torch = pytest.importorskip("torch")
pytestmark = pytest.mark.skipif(find_spec("mujoco_warp") is None, reason="mujoco_warp is not installed (extra gpu)")

MJCF = MjcfOptions(timestep_s=0.0015, cone="elliptic", link_torque_sensors=True, visuals=False)
PERIODS, STEPS = 5, 13
SAME_RAD = 1e-5
RANDOM = (CommandJitter, CommandDrop, SensorNoise)
POLICY = Path(__file__).parents[2] / "policies" / "baseline.onnx"


def plants(effects: tuple[Effect, ...], n: int = 2) -> tuple[Plant, Plant]:
    """On MuJoCo and on mujoco_warp, the feet 4 mm above the ground: at 0 mm, rounding decides who touches it."""
    x, y, z = DEFAULT_BODY_POSITION_M
    made = [
        Plant(effects, n, PlantOptions(mjcf=MJCF, device=device, on_divergence="flag", n_threads=1))
        for device in ("cpu", "warp-cpu")
    ]
    for plant in made:
        plant.reset(position_of_body_in_world_m=(x, y, z + 0.004))
    return made[0], made[1]


def walk(plant: Plant, seed: int = 0) -> np.ndarray:
    """Joint positions after some periods of drawn set-points."""
    rng = np.random.default_rng(seed)
    for _ in range(PERIODS):
        plant.step(facts.DEFAULT_POSITION_RAD + 0.15 * rng.standard_normal((plant.n_sims, 12)), STEPS)
    return on_host(plant.joint_position_rad)


def assert_it_looks_at_no_value(plant: Plant) -> None:
    """On a GPU a step is recorded, and whoever asks for a value while it is recorded voids the recording."""

    def looked_at(*_: object) -> None:
        raise AssertionError("a step on a GPU must not look at a value")

    setpoint = plant.joint_position_rad.clone()
    with pytest.MonkeyPatch.context() as patch:
        for name in ("__bool__", "__float__", "__int__", "item", "tolist", "nonzero"):
            patch.setattr(torch.Tensor, name, looked_at)
        plant.step(setpoint, STEPS)


@pytest.mark.parametrize("effect", [e for e in ACTIVE if not isinstance(e, RANDOM)], ids=lambda e: e.name)
def test_every_effect_acts_alike_and_looks_at_no_value(effect: Effect) -> None:
    """One of the model acts on the first of two robots alone, also in what MuJoCo derives from what it writes."""
    is_of_model = isinstance(effect, ModelEffect)
    cores, warp = plants(side_by_side(((effect,), ()), 2) if is_of_model else (effect,))
    np.testing.assert_allclose(walk(warp), walk(cores), atol=SAME_RAD)
    for reported in ("position_rad", "velocity_rad_s", "load_nm"):
        np.testing.assert_allclose(
            on_host(getattr(warp.reading, reported)), getattr(cores.reading, reported), atol=2e-2, err_msg=reported
        )
    for reported in vars(cores.estimate):
        np.testing.assert_allclose(
            on_host(getattr(warp.estimate, reported)), getattr(cores.estimate, reported), atol=1e-4, err_msg=reported
        )
    assert_it_looks_at_no_value(warp)


def test_a_value_for_each_simulation() -> None:
    delays_s = np.array([[0.0], [0.004], [0.021], [0.0405]])
    cores, warp = plants((CommandDelay(delay_s=delays_s), *load_model("paper_identified").effects), 4)
    here, there = walk(cores), walk(warp)
    np.testing.assert_allclose(there, here, atol=SAME_RAD)
    assert np.ptp(here, axis=0).max() > 1e-2


@pytest.mark.parametrize("effect", [e for e in ACTIVE if isinstance(e, RANDOM)], ids=lambda e: e.name)
def test_a_random_effect_acts_and_its_seed_repeats_it(effect: Effect) -> None:
    made = [plants(effects)[1] for effects in ((effect,), (effect,), ())]
    first, again, without = map(walk, made)
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - without).max() > 1e-4
    assert_it_looks_at_no_value(made[0])


def test_a_field_that_changes_under_way_acts() -> None:
    """As a slippery patch does; what was recorded with the model before is not played again."""
    cores, warp = plants(())
    walk(cores), walk(warp)
    before = warp._recorded(1)
    for plant in (cores, warp):
        plant.fields["dof_damping"][1, 6:] = 5.0
        plant.fields.commit()
    assert warp._recorded(1) is not before
    here, there = walk(cores, seed=1), walk(warp, seed=1)
    np.testing.assert_allclose(there, here, atol=10 * SAME_RAD)
    assert np.abs(here[1] - here[0]).max() > 0.05


@dataclass(frozen=True, kw_only=True)
class Wandering(CommandEffect):
    """A stranger's effect with drawn delays."""

    name: ClassVar[str] = "wandering"

    longest_s: Any = parameter(null=0.0, low=0.0, high=1.0, unit="s", source="a test")

    def arrival_s(self, issued_s: Any, rng: Any) -> Any:
        return issued_s + self.longest_s * rng.random(tuple(issued_s.shape))


def test_drawn_delays_that_have_no_bound_are_refused_by_name() -> None:
    with pytest.raises(BadInputError, match=r"wandering: its delay changes.*--device cpu"):
        plants((Wandering(longest_s=0.05),))


def test_a_snapshot_continues_where_it_was_taken() -> None:
    effects = (CommandDelay(delay_s=0.03), LegOdometry(time_s=0.1), *load_model("paper_identified").effects)
    _, plant = plants(effects)
    walk(plant)
    kept = plant.snapshot()
    first = walk(plant, seed=1)
    plant.restore(kept)
    np.testing.assert_allclose(walk(plant, seed=1), first, atol=1e-6)


def test_some_robots_are_put_back_alone() -> None:
    _, plant = plants((CommandDelay(delay_s=0.03),))
    walk(plant)
    before = on_host(plant.joint_position_rad)
    plant.reset(torch.tensor([True, False]))
    after = on_host(plant.joint_position_rad)
    np.testing.assert_allclose(after[0], facts.DEFAULT_POSITION_RAD, atol=1e-6)
    np.testing.assert_array_equal(after[1], before[1])


def test_a_policy_walks_alike() -> None:
    policy = load_policy(POLICY)
    seen = []
    for plant in plants(load_model("paper_identified").effects):
        loop = ClosedLoop(plant, policy)
        ticks = list(loop.run(lambda _: np.array([[0.8, 0.0, 0.0]]), [(STEPS,)] * 10))
        seen.append((on_host(ticks[-1].action), on_host(plant.joint_position_rad)))
    np.testing.assert_allclose(seen[1][0], seen[0][0], atol=1e-4)
    np.testing.assert_allclose(seen[1][1], seen[0][1], atol=SAME_RAD)


@pytest.mark.parametrize("device", ["cpu", "warp-cpu"])
def test_no_contact_is_lost_where_there_is_room(device: str) -> None:
    plant = Plant((), 2, PlantOptions(mjcf=MJCF, device=device, n_threads=1))
    walk(plant)
    assert plant.check_room() == 0.0


@pytest.mark.parametrize("room", [("CONTACTS", 1), ("CONSTRAINTS", 4)])
def test_contacts_that_find_no_room_are_told_once_and_refused(
    room: tuple[str, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two robots on eight feet, with room for two contacts, or for four constraints each."""
    monkeypatch.setattr(f"spot_model.plant.warp_physics.{room[0]}", room[1])
    plant = Plant((), 2, PlantOptions(mjcf=MJCF, device="warp-cpu", n_threads=1))
    walk(plant)
    with pytest.raises(PlantDivergedError, match=r"of the contacts of 2 robots found no room \(allowed: 1%\)"):
        plant.check_room()
    assert plant.check_room() == 0.0  # nothing came since


@pytest.mark.parametrize("device", ["cpu", "warp-cpu"])
def test_a_simulation_that_diverges_is_named(device: str) -> None:
    plant = Plant((), 2, PlantOptions(mjcf=MJCF, device=device, n_threads=1))
    plant.check_finite()
    plant.physics.qvel[1, 3] = np.nan

    def go_on() -> None:
        plant.advance(2)
        plant.check_finite()

    with pytest.raises(PlantDivergedError, match="simulation 1 of 2 diverged"):
        go_on()
