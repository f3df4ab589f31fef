"""The robots that a policy is evaluated on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from spot_model.effects.base import Effect
from spot_model.effects.side_by_side import side_by_side
from spot_model.io.model_file import RobotModel, load_model
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.leg_kinematics import foot_position_in_body_m
from spot_model.robot.mjcf import MjcfOptions
from trainer.config.task_config import FREE_HEIGHT_M, NoiseConfig, RandomisationConfig

FOOT_GEOMS = tuple(f"{leg}_foot" for leg in facts.LEG_NAMES)


@dataclass(frozen=True)
class Setting:
    """What all trials of an evaluation share.

    Args:
        policy: The policy.
        model: The robot with its effects.
        possible: Robots that are as possible as that one; trials of their own show what the policy does on them.
        mjcf: The physics; another step and integrator than training's shows what depends on them.
        seed: Of everything that is drawn.
        randomisation: Ranges for the trials under randomisation.
        n_threads: CPU threads, 0 for all.
        device: What simulates: "cpu" or a GPU.
    """

    policy: Policy
    model: RobotModel = field(default_factory=lambda: load_model("paper_identified"))
    possible: tuple[RobotModel, ...] = ()
    mjcf: MjcfOptions = field(default_factory=MjcfOptions)
    seed: int = 0
    randomisation: RandomisationConfig = RandomisationConfig()
    n_threads: int = 0
    device: str = "cpu"

    def plant(self, n: int, models: Sequence[RobotModel] = (), added: tuple[Effect, ...] = ()) -> Plant:
        """Robots at rest in the default pose, of :attr:`model`, or of several models by turns, with effects added."""
        options = PlantOptions(mjcf=self.mjcf, n_threads=self.n_threads, device=self.device)
        return Plant(side_by_side([m.effects for m in models or (self.model,)], n) + added, n, options)

    def grip(self) -> Array:
        """Factors by which the model's effects change the friction of each foot, shape (1, 4)."""
        return self._grip_of(self.plant(1))

    def _grip_of(self, plant: Plant) -> Array:
        feet = [plant.model.geom(name).id for name in FOOT_GEOMS]
        return np.asarray(plant.fields["geom_friction"][:, feet, 0] / self.mjcf.foot_friction)

    def random_plant(self, n: int, rng: np.random.Generator, models: Sequence[RobotModel] = ()) -> Plant:
        """Robots with drawn friction (times the factors of their models), mass and initial state."""
        plant, r = self.plant(n, models), self.randomisation
        set_friction(plant, rng.uniform(*r.foot_friction, n)[:, None] * self._grip_of(plant))
        body = plant.model.body("body").id
        mass, inertia = plant.fields["body_mass"], plant.fields["body_inertia"]
        ratio = 1.0 + rng.uniform(*r.added_body_mass_kg, n) / mass[:, body]
        mass[:, body] *= ratio
        inertia[:, body] *= ratio[:, None]
        plant.fields.commit()
        half_yaw = 0.5 * rng.uniform(*r.initial_yaw_rad, n)
        zero = np.zeros(n)
        joints, height = self.drawn_joints(n, rng)
        plant.reset(
            position_of_body_in_world_m=np.stack([zero, zero, height], axis=-1),
            world_from_body_wxyz=np.stack([np.cos(half_yaw), zero, zero, np.sin(half_yaw)], axis=-1),
            joint_position_rad=joints,
            linear_vel_of_body_in_world_m_s=_columns(rng, n, r.initial_v_x_m_s, r.initial_v_y_m_s, r.initial_v_z_m_s),
            angular_vel_of_body_in_body_rad_s=_columns(
                rng, n, r.initial_roll_rate_rad_s, r.initial_pitch_rate_rad_s, r.initial_yaw_rate_rad_s
            ),
            joint_velocity_rad_s=rng.uniform(*r.initial_velocity_rad_s, (n, facts.N_JOINTS)),
        )
        return plant

    def drawn_joints(self, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
        """Joints around the default pose, rad, shape (n, 12), and the height of the body then, m, shape (n,)."""
        around = rng.uniform(*self.randomisation.initial_position_rad, (n, facts.N_JOINTS))
        joints = np.clip(facts.DEFAULT_POSITION_RAD + around, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
        return joints, facts.FOOT_RADIUS_M + FREE_HEIGHT_M - foot_position_in_body_m(joints)[..., 2].min(axis=-1)

    def noise_sigma(self) -> Array:
        """Noise of each observation feature in the policy's joint order, shape (48,)."""
        return self.policy.with_joints_in_policy_order(NoiseConfig().sigmas().astype(np.float64))


def set_friction(plant: Plant, friction: Array) -> None:
    """Give the feet of each simulation their sliding friction, shape (n, 4)."""
    feet = [plant.model.geom(name).id for name in FOOT_GEOMS]
    plant.fields["geom_friction"][:, feet, 0] = friction
    plant.fields.commit()


def _columns(rng: np.random.Generator, n: int, *ranges: tuple[float, float]) -> Array:
    return np.stack([rng.uniform(*bounds, n) for bounds in ranges], axis=-1)
