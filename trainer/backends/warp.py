"""The GPU back end: ``mujoco_warp``, one physics step as a CUDA graph. Imported only when it is asked for.

Models, friction, mass and model effects come from the CPU plant, so both back ends simulate the same robots.
"""

from __future__ import annotations

from typing import Any

import mujoco
import mujoco_warp as mjw
import torch
import warp as wp

from spot_model.effects.base import Effect
from spot_model.plant.model_fields import FIRST_JOINT_COORDINATE, FIRST_JOINT_DOF
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.robot import facts
from spot_model.robot.control import saturate_setpoint
from spot_model.robot.rotation import rotate_wxyz
from trainer.backends.backend import InitialState, PlantState, SimulationDraws
from trainer.backends.cpu import mjcf_options, randomise
from trainer.backends.torch_servo import DelayedSetpoints, TorchTorqueChain, refuse_other_effects
from trainer.backends.warp_model import GroundContacts, put_plant
from trainer.config.task_config import TaskConfig

Tensor = torch.Tensor

SOLVER_ITERATIONS = 10
LINE_SEARCH_ITERATIONS = 20


class WarpBackend:
    """``n_envs`` robots on one GPU (or, slowly, on a CPU, for checks).

    Args:
        config: Physics rate and terrain are taken from it.
        effects: What acts in the robots.
        draws: Friction and mass of each simulation.
        device: "cuda:N", or "cpu" for checks.

    Raises:
        BadInputError: An effect acts where this back end has no place for it.
    """

    def __init__(self, config: TaskConfig, effects: tuple[Effect, ...], draws: SimulationDraws, device: str) -> None:
        refuse_other_effects(effects)
        self.n_envs = n = len(draws.foot_friction)
        self.device = torch.device(device)
        self._substeps = round(config.physics_rate_hz / facts.POLICY_RATE_HZ)
        self._timestep_s = 1.0 / config.physics_rate_hz
        plant = Plant(effects, n, PlantOptions(mjcf=mjcf_options(config)))
        randomise(plant, draws)
        plant.model.opt.iterations = SOLVER_ITERATIONS
        plant.model.opt.ls_iterations = LINE_SEARCH_ITERATIONS
        # Contacts are read from the contact list; the sensors would only cost time.
        plant.model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        is_rough = config.terrain.kind == "noise"
        wp.config.quiet = True
        self._wp_device = wp.get_device(device)
        if self._wp_device.is_cuda:
            # One stream for both libraries keeps physics and task in order without either waiting for the other.
            torch.cuda.set_stream(wp.stream_to_torch(self._wp_device))
        with wp.ScopedDevice(self._wp_device):
            self._model = put_plant(plant, n)
            self._data = mjw.make_data(
                plant.model, nworld=n, nconmax=48 if is_rough else 24, njmax=224 if is_rough else 128
            )
        self._qpos: Tensor = wp.to_torch(self._data.qpos)
        self._qvel: Tensor = wp.to_torch(self._data.qvel)
        self._ctrl: Tensor = wp.to_torch(self._data.ctrl)
        self._warmstart: Tensor = wp.to_torch(self._data.qacc_warmstart)
        rest = torch.tensor(facts.DEFAULT_POSITION_RAD, device=device, dtype=torch.float32).repeat(n, 1)
        self._stops_rad = tuple(
            torch.tensor(stop, device=device, dtype=torch.float32)
            for stop in (facts.POSITION_LOW_RAD, facts.POSITION_HIGH_RAD)
        )
        self._setpoints = DelayedSetpoints(effects, rest, self._timestep_s, self._substeps)
        self._torques = TorchTorqueChain(effects, rest)
        self._contacts = GroundContacts(plant.model, self._data, n, self.device)
        self._duty = torch.zeros(n, facts.N_LEGS, device=device) if config.counts_duty else None
        self._graph = self._capture()
        self._to_rest(plant)

    def step(self, setpoint_position_rad: Tensor) -> None:
        """Advance one policy period."""
        self._setpoints.issue(saturate_setpoint(setpoint_position_rad, *self._stops_rad))
        position = self._qpos[:, FIRST_JOINT_COORDINATE:]
        velocity = self._qvel[:, FIRST_JOINT_DOF:]
        if self._duty is not None:
            self._duty.zero_()
        for substep in range(self._substeps):
            torque = self._torques.torque_nm(self._setpoints.at(substep), position, velocity, self._timestep_s)
            self._ctrl.copy_(torque)
            self._advance()
            if self._duty is not None:
                standing = self._contacts.standing()
                self._duty += (self._contacts.read()[0] if standing is None else standing) / self._substeps

    def read(self) -> PlantState:
        """The state now; copies, apart from contacts."""
        quaternion = self._qpos[:, 3:7].clone()
        foot_contact, body_contact = self._contacts.read()
        return PlantState(
            position_rad=self._qpos[:, FIRST_JOINT_COORDINATE:].clone(),
            velocity_rad_s=self._qvel[:, FIRST_JOINT_DOF:].clone(),
            torque_nm=self._ctrl.clone(),
            body_position_m=self._qpos[:, :3].clone(),
            world_from_body_wxyz=quaternion,
            linear_vel_of_body_in_world_m_s=self._qvel[:, :3].clone(),
            angular_vel_of_body_in_world_rad_s=rotate_wxyz(quaternion, self._qvel[:, 3:6]),
            foot_contact=foot_contact,
            body_contact=body_contact,
            foot_duty=foot_contact.float() if self._duty is None else self._duty.clone(),
        )

    def read_reported(self, truth: PlantState) -> PlantState:
        """The truth: effects on sensors and estimator are refused."""
        return truth

    def reset(self, mask: Tensor, initial: InitialState) -> None:
        """Put the robots of ``mask`` into their initial state."""
        rows = mask[:, None]
        qpos = torch.cat([initial.body_position_m, initial.world_from_body_wxyz, initial.position_rad], dim=-1)
        qvel = torch.cat(
            [
                initial.linear_vel_of_body_in_world_m_s,
                initial.angular_vel_of_body_in_body_rad_s,
                initial.velocity_rad_s,
            ],
            dim=-1,
        )
        self._qpos.copy_(torch.where(rows, qpos, self._qpos))
        self._qvel.copy_(torch.where(rows, qvel, self._qvel))
        self._warmstart.masked_fill_(rows, 0.0)
        self._ctrl.masked_fill_(rows, 0.0)
        self._setpoints.reset(mask, initial.position_rad)
        self._torques.reset(mask)

    def add_velocity(self, delta_m_s: Tensor) -> None:
        """Push: change the body's linear velocity in the world."""
        self._qvel[:, :3] += delta_m_s

    def snapshot(self) -> dict[str, Any]:
        """State, set-points under way and effect memories."""
        return {
            "state": [t.clone() for t in self._state()],
            "setpoints": [t.clone() for t in self._setpoints.history],
        }

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot; the GPU's sums are not bit-exact from run to run."""
        for mine, kept in zip(self._state(), snapshot["state"], strict=True):
            mine.copy_(kept)
        for mine, kept in zip(self._setpoints.history, snapshot["setpoints"], strict=True):
            mine.copy_(kept)

    def _state(self) -> list[Tensor]:
        return [self._qpos, self._qvel, self._warmstart, self._ctrl]

    def _capture(self) -> Any:
        """Compile the kernels with one step, then record a step as a graph; none on a CPU."""
        with wp.ScopedDevice(self._wp_device):
            mjw.step(self._model, self._data)
            if not self._wp_device.is_cuda:
                return None
            with wp.ScopedCapture() as capture:
                mjw.step(self._model, self._data)
            wp.synchronize_device(self._wp_device)
        return capture.graph

    def _advance(self) -> None:
        with wp.ScopedDevice(self._wp_device):
            if self._graph is None:
                mjw.step(self._model, self._data)
            elif torch.cuda.is_current_stream_capturing():
                # The step becomes part of the graph that torch records.
                with wp.ScopedCapture(external=True):
                    mjw.step(self._model, self._data)
            else:
                wp.capture_launch(self._graph)

    def _to_rest(self, plant: Plant) -> None:
        key = torch.as_tensor(plant.model.key_qpos[0], device=self.device, dtype=torch.float32)
        self._qpos.copy_(key.expand_as(self._qpos))
        for tensor in (self._qvel, self._warmstart, self._ctrl):
            tensor.zero_()
