"""Many simulated Spots: servo law and effects at every physics step, over MuJoCo on the cores or on a GPU."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import ArrayLike

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
from spot_model.plant.command_channel import CommandChannel, ServoCommand
from spot_model.plant.effect_chains import EstimateChain, OutsideChain, SensorChain, TorqueChain, check_effects, of_kind
from spot_model.plant.memory import kept_memory, leaves, own_tensors, tensors_of, with_leaves
from spot_model.plant.physics import PlantDivergedError, PlantOptions, make_physics
from spot_model.plant.plant_state import PlantState
from spot_model.policy.policy import Policy
from spot_model.robot import facts
from spot_model.robot.arrays import copy_of, like, namespace_of
from spot_model.robot.control import saturate_setpoint
from spot_model.robot.mjcf import default_height_m, spot_mjcf
from spot_model.robot.rotation import AnyArray

__all__ = ["Plant", "PlantDivergedError", "PlantOptions", "ServoCommand"]

DEFAULT_BODY_POSITION_M = (0.0, 0.0, default_height_m())
"""The lowest feet of the default pose just touch level ground."""

USUAL = PlantOptions()

SimIds = ArrayLike | None
"""Sorted simulation numbers, a boolean mask of shape (n_sims,), or None for all."""


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

    def __init__(self, effects: Sequence[Effect] = (), n_sims: int = 1, options: PlantOptions = USUAL) -> None:
        check_effects(effects, n_sims)
        self.options = options
        model = mujoco.MjModel.from_xml_string(spot_mjcf(options.mjcf))
        super().__init__(make_physics(model, n_sims, options), has_link_torque=options.mjcf.link_torque_sensors)
        self._is_on_host, self._senses = options.device == "cpu", False
        self._records: dict[tuple[int, int], Any] = {}
        self.fields = self.physics.fields
        """Per-simulation fields of the MuJoCo model, for randomisation; call ``fields.commit()`` after writing."""
        self.timestep_s, self._n_steps = options.mjcf.timestep_s, 0
        self._rest = like(self._qpos, np.tile(facts.DEFAULT_POSITION_RAD, (n_sims, 1)))
        self._stops_rad = tuple(like(self._qpos, stop) for stop in (facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD))
        self._rng: Any = np.random.default_rng(options.seed)
        self._now_s: Any = 0.0
        if not self._is_on_host:
            from spot_model.plant.captured import TorchDraws

            xp = namespace_of(self._rest)
            self._rng = TorchDraws(options.seed, self._rest.device)
            self._now_s = xp.zeros(1, dtype=xp.float64, device=self._rest.device)
        self._let_act(effects)
        self.reset()

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled MuJoCo model."""
        return self.physics.model

    @property
    def batch(self) -> Batch:
        """The MuJoCo batch beneath, for rendering (``get_model``, ``get_data``), rays or external forces."""
        return self.physics.batch

    # What the robot reports; the truth is in PlantState --------------------------------------------------------------

    @property
    def reading(self) -> JointReading:
        """What the joints' sensors report, to the servos too."""
        return self._reading if self._has_sensing else self.true_reading()

    @property
    def estimate(self) -> BodyEstimate:
        """What the state estimator reports."""
        return self._estimate if self._has_sensing else self.true_estimate()

    def policy_here(self, policy: Policy) -> Any:
        """A policy that works on this plant's arrays."""
        if self._is_on_host:
            return policy
        from spot_model.plant.torch_policy import TorchPolicy

        return TorchPolicy(policy, self._qpos.device)

    def draws(self, rng: np.random.Generator) -> Any:
        """A source of random numbers as arrays of this plant, seeded by ``rng``; itself on the cores."""
        if self._is_on_host:
            return rng
        from spot_model.plant.captured import TorchDraws

        return TorchDraws(int(rng.integers(2**31)), self._qpos.device)

    # Moving ----------------------------------------------------------------------------------------------------------

    def step(self, position_rad: ArrayLike, n_substeps: int) -> None:
        """Issue position set-points under the policy's gains, then advance; one control period.

        Args:
            position_rad: Set-points, broadcast to (n_sims, 12), canonical order, rad.
            n_substeps: Physics steps, >= 1.

        Raises:
            PlantDivergedError: A simulation diverged, and the options say "raise" (on a GPU see :meth:`check_finite`).
        """
        self.command(ServoCommand(position_rad=self._here(position_rad)))
        self.advance(n_substeps)

    def command(self, command: ServoCommand) -> None:
        """Issue a command now; the servos follow it when it arrives (at once without command effects).

        Position set-points saturate at the joints' stops, as the robot's servos take them.

        Raises:
            ValueError: An array does not broadcast to (n_sims, 12).
        """
        if self._is_on_host:
            command = command.copied_for(self.n_sims)
        position = command.position_rad
        for effect in self._software:
            position = effect.setpoint_rad(position)
        self._channel.issue(replace(command, position_rad=saturate_setpoint(position, *self._stops_rad)), self._now_s)

    def advance(self, n_substeps: int = 1) -> None:
        """Advance all simulations by physics steps, with the servo law and the torque effects at each.

        Raises:
            PlantDivergedError: A simulation diverged, and the options say "raise" (on a GPU see :meth:`check_finite`).
        """
        if self._is_on_host or self.physics.is_recording():
            self._advance(n_substeps)
        else:
            self._recorded(n_substeps)()
        if self._is_on_host:
            self.check_finite()

    def check_finite(self) -> None:
        """Look whether a simulation diverged; on a GPU no step looks, as the host would have to wait.

        Raises:
            PlantDivergedError: One did, and the options say "raise".
        """
        if self.options.on_divergence == "raise" and self.diverged.any():
            sim, why = self.physics.first_divergence()
            raise PlantDivergedError(
                f"simulation {sim} of {self.n_sims} diverged ({why}) with physics steps of {self.timestep_s} s; "
                "use shorter steps, lower gains or smaller parameters, or reset it"
            )

    def _advance(self, n_substeps: int) -> None:
        for _ in range(n_substeps):
            # Fresh arrays: an effect may keep what it is shown until the next step.
            motion = Motion(copy_of(self._joint_pos), copy_of(self._joint_vel), self.timestep_s)
            believed = self._reading if self._has_sensing else motion
            self._ctrl[...] = self._torques.torque_nm(self._channel.at(self._now_s), motion, believed)
            self.outside.act(self.physics.time)
            self.physics.step()
            self._pass_step()
            if self._has_sensing:
                self._sense(self.timestep_s)

    def generators(self) -> list[Any]:
        """On a GPU, what its effects draw from."""
        return [self._rng.generator]

    def recorded(self, work: Callable[[], Any], draws: Any) -> Callable[[], Any]:
        """Work on this plant's arrays; on a GPU it is recorded once and then replayed.

        Args:
            work: It changes arrays in place and returns the same ones each time; no value decides what it does.
            draws: What it draws from, of :meth:`draws`.
        """
        if self._is_on_host:
            return work
        from spot_model.plant.captured import Captured

        return Captured(work, list({*self.generators(), draws.generator}), is_recorded=self._qpos.is_cuda)

    def _recorded(self, n_substeps: int) -> Any:
        """Record this many steps on a GPU as one piece of work."""
        key = (self.physics.build, n_substeps)
        if key not in self._records:
            self._records[key] = self.recorded(lambda: self._advance(n_substeps), self._rng)
        return self._records[key]

    def push(self, ids: SimIds = None, *, linear_vel_in_world_m_s: ArrayLike) -> None:
        """Add to the body's velocity at once; it broadcasts to (len(ids), 3)."""
        mask, velocity = self._mask(ids), self._qvel[:, :3]
        rows = velocity[np.flatnonzero(mask)] if self._is_on_host else velocity
        self._write(velocity, mask, rows + self._here(linear_vel_in_world_m_s))

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

        On a GPU ``ids`` is a mask, and arguments broadcast to (n_sims, its size); contacts of some robots that are put
        back are those of the last step.

        Raises:
            ValueError: An id is out of range, repeated or out of order; a shape does not fit; a quaternion has not
                length 1.
        """
        mask = self._mask(ids)
        attitude = world_from_body_wxyz
        if self._is_on_host and np.any(np.abs(np.linalg.norm(np.asarray(attitude), axis=-1) - 1.0) > 1e-6):
            raise ValueError(f"world_from_body_wxyz = {np.asarray(attitude).tolist()} has not length 1; normalise it")
        self.physics.restart(mask)
        self._write(self._qpos[:, :3], mask, position_of_body_in_world_m)
        self._write(self._qpos[:, 3:7], mask, attitude)
        self._write(self._joint_pos, mask, joint_position_rad)
        self._write(self._qvel[:, :3], mask, linear_vel_of_body_in_world_m_s)
        self._write(self._qvel[:, 3:6], mask, angular_vel_of_body_in_body_rad_s)
        self._write(self._joint_vel, mask, joint_velocity_rad_s)
        self._torques.reset_from_rest(mask)
        self._channel.reset(mask, ServoCommand(position_rad=copy_of(self._joint_pos)))
        if self._is_on_host or ids is None:
            self.physics.forward(mask)
        if self._has_sensing:
            self._sensors.reset(mask, self.true_reading())
            self._estimators.reset(mask, self.true_estimate())
            self._sense(0.0)

    def snapshot(self) -> dict[str, Any]:
        """Everything that moves, as plain arrays and numbers: physics, commands on their way, effects' memories."""
        if not self._is_on_host:
            return {"buffers": [buffer.clone() for buffer in self._buffers()], "rng": self._rng.generator.get_state()}
        return {
            "state": self.batch.state.copy(),
            "n_steps": self._n_steps,
            "commands": self._channel.snapshot(),
            "memories": self._torques.snapshot(),
            "sensors": self._sensors.snapshot(),
            "estimators": self._estimators.snapshot(),
            "reported": leaves((self.reading, self.estimate)),
            "rng": self._rng.bit_generator.state,
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue bit for bit from a snapshot of a plant of the same size, options, effects and fields.

        Until the next step, contacts, forces and accelerations are those of the restored state itself.

        Raises:
            ValueError: The snapshot is of another size, or of other effects.
        """
        if not self._is_on_host:
            for buffer, kept in zip(self._buffers(), snapshot["buffers"], strict=True):
                buffer.copy_(kept)
            self._rng.generator.set_state(snapshot["rng"].cpu())
            return
        state = np.asarray(snapshot["state"])
        if state.shape != self.batch.state.shape:
            raise ValueError(f"the snapshot has shape {state.shape}, the plant {self.batch.state.shape}")
        self._torques.restore(snapshot["memories"])
        self._channel.restore(snapshot["commands"])
        self._sensors.restore(snapshot["sensors"])
        self._estimators.restore(snapshot["estimators"])
        self._reading, self._estimate = with_leaves((self.reading, self.estimate), snapshot["reported"])
        self._rng.bit_generator.state = snapshot["rng"]
        self._n_steps = int(snapshot["n_steps"])
        self._now_s = self._n_steps * self.timestep_s
        self.batch.state[...] = state
        self.batch.forward()
        # Forward moves the solver's starting point on; the next step must start from the saved one.
        self.batch.state[...] = state

    def change_effects(self, effects: Sequence[Effect]) -> None:
        """Let these effects act from the next step on, in place of those until now; on the cores only.

        Motion, time and the command in effect stay, torque effects that were there before keep their memories, and
        what was written into :attr:`fields` is taken back.
        """
        check_effects(effects, self.n_sims)
        before, commands = self._torques, self._channel.snapshot()
        self.fields.restart()
        self._let_act(effects)
        self._torques.remember(before)
        self._channel.restore(commands)
        if self._has_sensing:
            self._sense(0.0)

    # Private ---------------------------------------------------------------------------------------------------------

    def _let_act(self, effects: Sequence[Effect]) -> None:
        """Start the effects afresh, from the state that the robots are in."""
        acting, rest, physics = [effect for effect in effects if not effect.is_null], self._rest, self.physics
        for edits in of_kind(acting, ModelEffect):
            edits.edit(self.fields)
        self.fields.commit()
        self.outside = OutsideChain(acting, self.model, physics.live, physics.gravity)
        self._software = [e.arrays_like(rest) for e in of_kind(acting, SoftwareEffect)]
        self._torques = TorqueChain(of_kind(acting, TorqueEffect), rest)
        still = ServoCommand(position_rad=rest)
        self._channel = CommandChannel(of_kind(acting, CommandEffect), still, self.timestep_s, self._rng)
        self._has_sensing = any(isinstance(e, (SensorEffect, EstimateEffect)) for e in acting)
        self._sensors = SensorChain(of_kind(acting, SensorEffect), rest, self.true_reading())
        self._estimators = EstimateChain(of_kind(acting, EstimateEffect), rest, self.true_estimate())

    def _sense(self, dt_s: float) -> None:
        reading = self._sensors.read(self.true_reading(), dt_s, self._rng)
        if dt_s > 0.0 and self._n_steps % self.options.estimate_steps:
            self._reading = reading
            return
        dt_s *= self.options.estimate_steps
        estimate = self._estimators.estimate(self.true_estimate(), reading, dt_s, self._rng)
        if self._is_on_host:
            self._reading, self._estimate = reading, estimate
        elif not self._senses:
            self._reading, self._estimate, self._senses = own_tensors(reading), own_tensors(estimate), True
        else:
            self._reading, self._estimate = kept_memory((self._reading, self._estimate), (reading, estimate))

    def _pass_step(self) -> None:
        if self._is_on_host:
            self._n_steps += 1
            self._now_s = self._n_steps * self.timestep_s
        else:
            self._now_s += self.timestep_s

    def _buffers(self) -> list[Any]:
        """On a GPU, all that moves."""
        reported = tensors_of((self._reading, self._estimate)) if self._has_sensing else []
        memories = [*self._torques.leaves(), *self._sensors.leaves(), *self._estimators.leaves()]
        return [*self.physics.state(), self._now_s, *self._channel.buffers(), *memories, *reported]

    def _write(self, target: AnyArray, mask: AnyArray, values: Any) -> None:
        """Write into the rows of ``mask``: values of those rows on the cores, of all rows on a GPU."""
        if self._is_on_host:
            target[np.flatnonzero(mask)] = values
        else:
            target.copy_(namespace_of(target).where(mask[:, None], self._here(values), target))

    def _here(self, values: Any) -> Any:
        """Values as an array of this plant; a number and what is on the device already is not copied to it."""
        return values if isinstance(values, float) or type(values) is type(self._qvel) else like(self._qvel, values)

    def _mask(self, ids: Any) -> AnyArray:
        if ids is None:
            return namespace_of(self._qpos).ones_like(self._qpos[:, 0], dtype=bool)
        if not self._is_on_host:
            return ids
        array = np.asarray(ids)
        if array.dtype == np.bool_ and array.shape != (self.n_sims,):
            raise ValueError(f"a mask of simulations has shape {array.shape}; it must be ({self.n_sims},)")
        numbers = np.flatnonzero(array) if array.dtype == np.bool_ else array.astype(np.intp, casting="safe").ravel()
        if numbers.size and (numbers[0] < 0 or numbers[-1] >= self.n_sims or np.any(np.diff(numbers) <= 0)):
            raise ValueError(f"simulation ids {numbers.tolist()} must rise within 0 to {self.n_sims - 1}")
        return np.isin(np.arange(self.n_sims), numbers)
