"""Many simulated Spots on the CPU: servo law and effects at every physics step, on ``mujoco.batch``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike, NDArray

from spot_model.effects.base import (
    BodyEstimate,
    CommandEffect,
    Effect,
    EstimateEffect,
    JointReading,
    ModelEffect,
    Motion,
    SensorEffect,
    SoftwareEffect,
    TorqueEffect,
)
from spot_model.errors import SpotRlError
from spot_model.plant.command_channel import CommandChannel, ServoCommand
from spot_model.plant.memory import leaves, with_leaves
from spot_model.plant.model_fields import PlantFields
from spot_model.plant.plant_state import PlantState
from spot_model.plant.sensing import Sensing
from spot_model.plant.torque import TorqueChain
from spot_model.robot import facts
from spot_model.robot.control import saturate_setpoint
from spot_model.robot.mjcf import MjcfOptions, default_height_m, spot_mjcf

__all__ = ["Plant", "PlantDivergedError", "PlantOptions", "ServoCommand"]

DEFAULT_BODY_POSITION_M = (0.0, 0.0, default_height_m())
"""The lowest feet of the default pose just touch level ground."""

SimIds = ArrayLike | None
"""Sorted simulation numbers, a boolean mask of shape (n_sims,), or None for all."""


class PlantDivergedError(SpotRlError):
    """A simulation left the range in which its numbers mean something."""


@dataclass(frozen=True)
class PlantOptions:
    """How the plant computes.

    Args:
        mjcf: Choices of the MuJoCo model: time step, integrator, contact, terrain.
        n_threads: Threads that step simulations, 0 for all CPUs. The result is bit-identical at any number.
        on_divergence: "raise", or "flag" to leave it at :attr:`Plant.diverged`.
        seed: Seed of what effects draw, noise, jitter and drops, or what draws it.
    """

    mjcf: MjcfOptions = field(default_factory=MjcfOptions)
    n_threads: int = 0
    on_divergence: Literal["raise", "flag"] = "raise"
    seed: int | np.random.Generator = 0


class Plant(PlantState):
    """``n_sims`` simulations of one robot with effects, moving in step.

    A parameter of an effect may be an array of shape (n_sims, 1) or (n_sims, 12) and so differ between simulations.
    With null effects a step is bit-identical to one without effects.

    Args:
        effects: Effects of the robot, in the order in which they act (``RobotModel.effects``).
        n_sims: Number of simulations.
        options: How to compute.

    Raises:
        ValueError: An effect's parameter does not fit ``n_sims``.
        TypeError: An effect acts at no place that the plant has.
    """

    def __init__(self, effects: Sequence[Effect] = (), n_sims: int = 1, options: PlantOptions = PlantOptions()) -> None:
        _check_effects(effects, n_sims)
        acting = [effect for effect in effects if not effect.is_null]
        self.options = options
        self.model = mujoco.MjModel.from_xml_string(spot_mjcf(options.mjcf))
        batch = Batch(self.model, n_sims, nthread=_threads(options.n_threads, n_sims))
        super().__init__(batch, has_link_torque=options.mjcf.link_torque_sensors)
        self.fields = PlantFields(batch)
        """Per-simulation fields of the MuJoCo model, for randomisation; call ``fields.commit()`` after writing."""
        for effect in [e for e in acting if isinstance(e, ModelEffect)]:
            effect.edit(self.fields)
        self.fields.commit()
        self.timestep_s = options.mjcf.timestep_s
        self._n_steps = 0
        self._rng = np.random.default_rng(options.seed)
        self._software = [e for e in acting if isinstance(e, SoftwareEffect)]
        self._torques = TorqueChain([e for e in acting if isinstance(e, TorqueEffect)], n_sims)
        rest = np.tile(facts.DEFAULT_POSITION_RAD, (n_sims, 1))
        self._channel = CommandChannel(
            [e for e in acting if isinstance(e, CommandEffect)],
            n_sims,
            self.timestep_s,
            ServoCommand(position_rad=rest),
            self._rng,
        )
        sensors = [e for e in acting if isinstance(e, SensorEffect)]
        estimators = [e for e in acting if isinstance(e, EstimateEffect)]
        self._has_sensing = bool(sensors or estimators)
        self._sensing = Sensing(sensors, estimators, self.true_reading(), self.true_estimate())
        self.reset()

    @property
    def batch(self) -> Batch:
        """The MuJoCo batch beneath, for rendering (``get_model``, ``get_data``), rays or external forces."""
        return self._batch

    # What the robot reports; the truth is in PlantState --------------------------------------------------------------

    @property
    def reading(self) -> JointReading:
        """What the joints' sensors report, to the servos too."""
        return self._reading if self._has_sensing else self.true_reading()

    @property
    def estimate(self) -> BodyEstimate:
        """What the state estimator reports."""
        return self._estimate if self._has_sensing else self.true_estimate()

    # Moving ----------------------------------------------------------------------------------------------------------

    def step(self, position_rad: ArrayLike, n_substeps: int) -> None:
        """Issue position set-points under the policy's gains, then advance; one control period.

        Args:
            position_rad: Set-points, broadcast to (n_sims, 12), canonical order, rad.
            n_substeps: Physics steps, >= 1.

        Raises:
            PlantDivergedError: A simulation diverged, and the options say "raise".
        """
        self.command(ServoCommand(position_rad=np.asarray(position_rad, dtype=np.float64)))
        self.advance(n_substeps)

    def command(self, command: ServoCommand) -> None:
        """Issue a command now; the servos follow it when it arrives (at once without command effects).

        Position set-points saturate at the joints' stops, as the robot's servos take them.

        Raises:
            ValueError: An array does not broadcast to (n_sims, 12).
        """
        command = command.copied_for(self.n_sims)
        for effect in self._software:
            command = replace(command, position_rad=effect.setpoint_rad(command.position_rad))
        within_stops = saturate_setpoint(command.position_rad, facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
        command = replace(command, position_rad=within_stops)
        self._channel.issue(command, self._now_s)

    def advance(self, n_substeps: int = 1) -> None:
        """Advance all simulations by physics steps, with the servo law and the torque effects at each.

        Raises:
            PlantDivergedError: A simulation diverged, and the options say "raise".
        """
        for _ in range(n_substeps):
            # Fresh arrays: an effect may keep what it is shown until the next step.
            motion = Motion(self._joint_pos.copy(), self._joint_vel.copy(), self.timestep_s)
            believed = self._reading if self._has_sensing else motion
            self._ctrl[...] = self._torques.torque_nm(self._channel.at(self._now_s), motion, believed)
            self._batch.step()
            self._n_steps += 1
            if self._has_sensing:
                self._sense(self.timestep_s)
        if self.options.on_divergence == "raise" and self._warning_counts().any():
            self._raise_divergence()

    def push(
        self,
        ids: SimIds = None,
        *,
        linear_vel_in_world_m_s: ArrayLike = 0.0,
        angular_vel_in_body_rad_s: ArrayLike = 0.0,
    ) -> None:
        """Add to the body's velocity at once; each argument broadcasts to (len(ids), 3)."""
        rows = np.flatnonzero(self._mask(ids))
        self._qvel[rows, :3] += np.asarray(linear_vel_in_world_m_s, dtype=np.float64)
        self._qvel[rows, 3:6] += np.asarray(angular_vel_in_body_rad_s, dtype=np.float64)

    def reset(
        self,
        ids: SimIds = None,
        *,
        position_of_body_in_world_m: ArrayLike = DEFAULT_BODY_POSITION_M,
        world_from_body_wxyz: ArrayLike = (1.0, 0.0, 0.0, 0.0),
        joint_position_rad: ArrayLike = facts.DEFAULT_POSITION_RAD,
        linear_vel_of_body_in_world_m_s: ArrayLike = 0.0,
        angular_vel_of_body_in_body_rad_s: ArrayLike = 0.0,
        joint_velocity_rad_s: ArrayLike = 0.0,
    ) -> None:
        """Put simulations into a state; the default one has the front feet just on level ground, at rest.

        Commands on their way are dropped, the servos hold the joint positions under the policy's gains, and the
        effects' memories start afresh. Each argument broadcasts to (len(ids), its size).

        Raises:
            ValueError: An id is out of range, repeated or out of order; a shape does not fit; a quaternion has not
                length 1.
        """
        mask = self._mask(ids)
        rows = np.flatnonzero(mask)
        attitude = np.asarray(world_from_body_wxyz, dtype=np.float64)
        if np.any(np.abs(np.linalg.norm(attitude, axis=-1) - 1.0) > 1e-6):
            raise ValueError(f"world_from_body_wxyz = {attitude.tolist()} has not length 1; normalise it")
        self._batch.reset(rows, stage=mujoco.mjtStage.mjSTAGE_NONE.value)
        self._qpos[rows, :3] = position_of_body_in_world_m
        self._qpos[rows, 3:7] = attitude
        self._joint_pos[rows] = joint_position_rad
        self._qvel[rows, :3] = linear_vel_of_body_in_world_m_s
        self._qvel[rows, 3:6] = angular_vel_of_body_in_body_rad_s
        self._joint_vel[rows] = joint_velocity_rad_s
        self._torques.reset(mask)
        self._channel.reset(mask, ServoCommand(position_rad=self._joint_pos.copy()))
        self._batch.forward(rows)
        if self._has_sensing:
            self._sensing.reset(mask, self.true_reading(), self.true_estimate())
            self._sense(0.0)

    def snapshot(self) -> dict[str, Any]:
        """Everything that moves, as plain arrays and numbers: physics, commands on their way, effects' memories."""
        return {
            "state": self._batch.state.copy(),
            "n_steps": self._n_steps,
            "commands": self._channel.snapshot(),
            "memories": self._torques.snapshot(),
            "sensing": self._sensing.snapshot(),
            "reported": leaves((self.reading, self.estimate)),
            "rng": self._rng.bit_generator.state,
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue bit for bit from a snapshot of a plant of the same size, options, effects and fields.

        Until the next step, contacts, forces and accelerations are those of the restored state itself.

        Raises:
            ValueError: The snapshot is of another size, or of other effects.
        """
        state = np.asarray(snapshot["state"])
        if state.shape != self._batch.state.shape:
            raise ValueError(f"the snapshot has shape {state.shape}, the plant {self._batch.state.shape}")
        self._torques.restore(snapshot["memories"])
        self._channel.restore(snapshot["commands"])
        self._sensing.restore(snapshot["sensing"])
        self._reading, self._estimate = with_leaves((self.reading, self.estimate), snapshot["reported"])
        self._rng.bit_generator.state = snapshot["rng"]
        self._n_steps = int(snapshot["n_steps"])
        self._batch.state[...] = state
        self._batch.forward()
        # Forward moves the solver's starting point on; the next step must start from the saved one.
        self._batch.state[...] = state

    # Private ---------------------------------------------------------------------------------------------------------

    def _sense(self, dt_s: float) -> None:
        self._reading = self._sensing.read(self.true_reading(), dt_s, self._rng)
        self._estimate = self._sensing.estimate(self.true_estimate(), self._reading, dt_s, self._rng)

    @property
    def _now_s(self) -> float:
        return self._n_steps * self.timestep_s

    def _mask(self, ids: SimIds) -> NDArray[np.bool_]:
        if ids is None:
            return np.ones(self.n_sims, dtype=np.bool_)
        array = np.asarray(ids)
        if array.dtype == np.bool_ and array.shape != (self.n_sims,):
            raise ValueError(f"a mask of simulations has shape {array.shape}; it must be ({self.n_sims},)")
        numbers = np.flatnonzero(array) if array.dtype == np.bool_ else array.astype(np.intp, casting="safe").ravel()
        if numbers.size and (numbers[0] < 0 or numbers[-1] >= self.n_sims or np.any(np.diff(numbers) <= 0)):
            raise ValueError(f"simulation ids {numbers.tolist()} must rise within 0 to {self.n_sims - 1}")
        mask = np.zeros(self.n_sims, dtype=np.bool_)
        mask[numbers] = True
        return mask

    def _raise_divergence(self) -> None:
        counts = self._warning_counts()
        sim = int(np.flatnonzero(counts.any(axis=1))[0])
        warning = mujoco.mjtWarning(mujoco.mjtWarning.mjWARN_CONTACTFULL.value + int(np.argmax(counts[sim] > 0)))
        raise PlantDivergedError(
            f"simulation {sim} of {self.n_sims} diverged ({warning.name}) with physics steps of {self.timestep_s} s; "
            "use shorter steps, lower gains or smaller parameters, or reset it"
        )


PLACES = (ModelEffect, TorqueEffect, CommandEffect, SoftwareEffect, SensorEffect, EstimateEffect)
"""Kinds of effect that the plant has a place for."""


def _threads(n_threads: int, n_sims: int) -> int:
    available = len(os.sched_getaffinity(0)) if n_threads == 0 else n_threads
    return min(available, n_sims)


def _check_effects(effects: Sequence[Effect], n_sims: int) -> None:
    allowed = ((), (1, 1), (n_sims, 1), (1, facts.N_JOINTS), (n_sims, facts.N_JOINTS))
    for effect in effects:
        if not isinstance(effect, PLACES):
            raise TypeError(f"effect {effect.name} acts at {effect.hook.value}; the plant has no such place")
        for name, value in effect.values.items():
            if np.shape(value) not in allowed:
                raise ValueError(
                    f"{effect.name}.{name} has shape {np.shape(value)}; allowed for {n_sims} simulations: "
                    f"a number, ({n_sims}, 1) or ({n_sims}, {facts.N_JOINTS})"
                )
