"""MuJoCo on an NVIDIA GPU, by ``mujoco_warp``; its arrays are torch tensors. Imported only when it is asked for."""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import mujoco
import mujoco_warp as mjw
import numpy as np
import torch
import warp as wp
from mujoco.batch import MODEL_FIELDS, Batch
from numpy.typing import NDArray
from torch import Tensor

from spot_model.errors import BadInputError
from spot_model.plant.model_fields import PlantFields
from spot_model.robot import facts

SOLVER_ITERATIONS: Final = 10
LINE_SEARCH_ITERATIONS: Final = 20
CONTACTS: Final = 24
"""Room for contacts of a simulation; on rough ground twice as much."""
CONSTRAINTS: Final = 128
TRIED: Final = 64
"""Robots by which it is estimated how many fit."""
_CONSTRAINTS_FULL: Final = mjw.OverflowType.NEFC | mjw.OverflowType.NJMAX_NNZ
UNUSED: Final = ("dof_M0", "dof_length", "bvh_aabb")
"""Derived fields that ``mujoco_warp`` has not and does not use."""
_BODY: Final = facts.N_LEGS
"""Column of everything that is not a foot."""


class WarpPhysics:
    """Many simulations on one GPU; on a CPU, slowly, for checks.

    Args:
        model: MuJoCo's model; without sensors of the links' torques, all sensors are left out.
        n_sims: Number of simulations.
        device: "cuda", "cuda:N", or "warp-cpu" for checks.
        has_sensors: Whether sensors are computed.
    """

    def __init__(self, model: mujoco.MjModel, n_sims: int, device: str, *, has_sensors: bool) -> None:
        self.model, self.n_sims = model, n_sims
        model.opt.iterations, model.opt.ls_iterations = SOLVER_ITERATIONS, LINE_SEARCH_ITERATIONS
        if not has_sensors:
            model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_SENSOR)
        self.batch = Batch(model, n_sims, nthread=1)
        self.fields = PlantFields(self.batch, self._copy_fields)
        wp.config.quiet = True  # type: ignore[attr-defined]
        self._wp_device = wp.get_device("cpu" if device == "warp-cpu" else device)
        self.device = torch.device("cpu" if device == "warp-cpu" else device)
        if self._wp_device.is_cuda:
            # One stream for both libraries keeps physics and torques in order without either waiting for the other.
            torch.cuda.set_stream(wp.stream_to_torch(self._wp_device))  # type: ignore[no-untyped-call]
        factor = 2 if model.nhfield else 1
        with wp.ScopedDevice(self._wp_device):
            room = {"nconmax": factor * CONTACTS, "njmax": 96 * (factor - 1) + CONSTRAINTS}
            self._data = self._make_data(room)
        self.qpos: Tensor = wp.to_torch(self._data.qpos)
        self.qvel: Tensor = wp.to_torch(self._data.qvel)
        self.ctrl: Tensor = wp.to_torch(self._data.ctrl)
        self._gravity = torch.tensor(model.opt.gravity, dtype=self.qpos.dtype, device=self.device).repeat(n_sims, 1)
        self.time: Tensor = wp.to_torch(self._data.time)
        self.sensordata: Tensor = wp.to_torch(self._data.sensordata)
        self._warmstart: Tensor = wp.to_torch(self._data.qacc_warmstart)
        self._contacts = _GroundContacts(model, self._data, n_sims, self.device)
        # Contacts and pairs that may touch, with those beyond the room that all simulations share.
        self._counts: list[Tensor] = [wp.to_torch(self._data.nacon), wp.to_torch(self._data.ncollision)]
        self._fullest = torch.zeros_like(self._counts[0])
        self._overflow: Tensor = wp.to_torch(self._data.overflow)
        self._model: Any = None
        self._graph: Any = None
        self.build = 0
        """Number of the model on the device; recorded work of an earlier one is void."""

    def _make_data(self, room: dict[str, int]) -> Any:
        try:
            return mjw.make_data(self.model, nworld=self.n_sims, **room)
        except (RuntimeError, MemoryError) as error:
            if not self._wp_device.is_cuda:
                raise
            free, _ = torch.cuda.mem_get_info(self.device)
            some = mjw.make_data(self.model, nworld=TRIED, **room)
            used = free - torch.cuda.mem_get_info(self.device)[0]
            del some
            fit = int(0.8 * TRIED * free / max(1, used))
            raise BadInputError(
                f"{self.n_sims} robots do not fit into the {free / 2**30:.1f} GiB that are free on {self.device}; "
                f"about {fit} do: simulate fewer at once, or free the GPU"
            ) from error

    def live(self, name: str) -> Tensor:
        """An array of MuJoCo's data by its name."""
        found: Tensor = wp.to_torch(getattr(self._data, name))
        return found

    def gravity(self) -> Tensor:
        """Gravity in the frame of the ground, shape (n_sims, 3)."""
        return self._gravity

    def step(self) -> None:
        """Advance all simulations by one physics step; the first one compiles the kernels and records them."""
        if self._model is None:
            self._build()
        with wp.ScopedDevice(self._wp_device):
            if self._graph is None:
                mjw.step(self._model, self._data)
            elif torch.cuda.is_current_stream_capturing():
                # The step becomes part of the graph that torch records.
                with wp.ScopedCapture(external=True):
                    mjw.step(self._model, self._data)
            else:
                wp.capture_launch(self._graph)
        for count in self._counts:
            self._fullest.copy_(torch.maximum(self._fullest, count))

    def contacts_lost(self) -> float:
        """Share of contacts, or of simulations' constraints, without room at the fullest step since the last call."""
        found, narrow = int(self._fullest), (self._overflow & int(_CONSTRAINTS_FULL)) != 0
        lost = max(1.0 - self._data.naconmax / max(found, 1), float(narrow.float().mean()))
        self._fullest.zero_()
        self._overflow.zero_()
        return float(max(0.0, lost))

    def restart(self, mask: Tensor) -> None:
        """Forget velocities, torques and the solver's last solution."""
        rows = mask[:, None]
        for array in (self.qvel, self.ctrl, self._warmstart):
            array.masked_fill_(rows, 0.0)
        self.time.masked_fill_(mask, 0.0)

    def forward(self, mask: Tensor) -> None:
        """Bring contacts, forces and sensors up to date with the state, in all simulations."""
        if self._model is None:
            self._build()
        kept = self._warmstart.clone()
        with wp.ScopedDevice(self._wp_device):
            mjw.forward(self._model, self._data)
        self._warmstart.copy_(kept)

    def foot_contact(self) -> Tensor:
        """Whether each foot touches the ground, shape (n_sims, 4)."""
        return self._contacts.read()[0]

    def body_contact(self) -> Tensor:
        """Whether anything but a foot touches the ground, shape (n_sims,)."""
        return self._contacts.read()[1]

    def contacts(self) -> tuple[Tensor, Tensor]:
        """Contact flags of the feet and of the rest."""
        return self._contacts.read()

    def standing(self) -> Tensor:
        """Feet on the ground, shape (n_sims, 4): where it is level by their height, which takes few operations."""
        standing = self._contacts.standing()
        return self._contacts.read()[0] if standing is None else standing

    def is_recording(self) -> bool:
        """Whether torch records a graph now."""
        return self._wp_device.is_cuda and torch.cuda.is_current_stream_capturing()

    def diverged(self) -> Tensor:
        """Simulations with a number that is not finite, shape (n_sims,)."""
        return ~(torch.isfinite(self.qpos).all(dim=-1) & torch.isfinite(self.qvel).all(dim=-1))

    def first_divergence(self) -> tuple[int, str]:
        """Number of the first such simulation, and what is wrong with it."""
        return int(self.diverged().long().argmax()), "a number is not finite"

    def state(self) -> list[Tensor]:
        """All that moves."""
        return [self.qpos, self.qvel, self.ctrl, self.time, self._warmstart]

    def _build(self) -> None:
        """Model with the fields as they stand, and on a GPU one step as a graph."""
        with wp.ScopedDevice(self._wp_device):
            own = self._own_fields()
            self._model = mjw.put_model(self.model, batch_sizes=dict.fromkeys(own, self.n_sims))
            self._model.opt.warn_overflow = 0
            self._model.opt.gravity = wp.from_torch(self._gravity, dtype=wp.vec3)
            self._copy_fields()
            if not self._wp_device.is_cuda:
                return
            kept = [array.clone() for array in self.state()]
            mjw.step(self._model, self._data)
            with wp.ScopedCapture() as capture:
                mjw.step(self._model, self._data)
            wp.synchronize_device(self._wp_device)
            self._graph = capture.graph
            for array, value in zip(self.state(), kept, strict=True):
                array.copy_(value)

    def _copy_fields(self) -> None:
        """Write the fields that differ between simulations into the model on the device."""
        if self._model is None:
            return
        for name, values in self._own_fields().items():
            target = wp.to_torch(getattr(self._model, name))
            if target.shape[0] != self.n_sims:
                # A field differs between simulations from now on: the model is built anew.
                self._model = self._graph = None
                self.build += 1
                return
            target.copy_(torch.tensor(values, dtype=target.dtype).reshape(target.shape))

    def _own_fields(self) -> dict[str, NDArray[Any]]:
        """Fields of which each simulation has its own value.

        Raises:
            BadInputError: ``mujoco_warp`` cannot give each simulation its own value of a field that differs.
        """
        arrays = {f.name: getattr(f.type, "shape", ()) for f in dataclasses.fields(mjw.Model)}
        own: dict[str, NDArray[Any]] = {}
        for name in sorted(MODEL_FIELDS):
            values = self.batch.expanded(name)
            if values is None:
                continue
            shape = arrays.get(name, ())
            if shape and shape[0] == "*":
                own[name] = values
            elif name not in UNUSED and not np.all(values == values[:1]):
                raise BadInputError(
                    f"model field {name!r} cannot differ between simulations on a GPU; use --device cpu"
                )
        return own


class _GroundContacts:
    """Contact flags of n simulations, computed from the contacts of the last physics step."""

    def __init__(self, model: mujoco.MjModel, data: Any, n: int, device: torch.device) -> None:
        self._n = n
        self._geoms: Tensor = wp.to_torch(data.contact.geom)
        self._world: Tensor = wp.to_torch(data.contact.worldid)
        self._count: Tensor = wp.to_torch(data.nacon)
        column = torch.full((model.ngeom,), _BODY, dtype=torch.long)
        for i, leg in enumerate(facts.LEG_NAMES):
            column[model.geom(f"{leg}_foot").id] = i
        self._column = column.to(device)
        feet = [int(model.geom(f"{leg}_foot").id) for leg in facts.LEG_NAMES]
        spacing = feet[1] - feet[0]
        is_regular = feet == [feet[0] + spacing * i for i in range(facts.N_LEGS)]
        heights: Tensor = wp.to_torch(data.geom_xpos)[:, feet[0] :: spacing, 2]
        self._foot_height_m = heights[:, : facts.N_LEGS] if model.nhfield == 0 and is_regular else None
        self._number = torch.arange(len(self._world), device=device)
        self._flags = torch.zeros((n + 1) * (_BODY + 1), dtype=torch.bool, device=device)
        self._true = torch.ones(len(self._world), dtype=torch.bool, device=device)

    def standing(self) -> Tensor | None:
        """Feet on the ground (bool, (n, 4)) by their height, where the ground is level: few operations."""
        return None if self._foot_height_m is None else self._foot_height_m <= facts.FOOT_RADIUS_M

    def read(self) -> tuple[Tensor, Tensor]:
        """Feet (bool, (n, 4)), and any other part of the robot (bool, (n,))."""
        geoms = self._geoms.long().clamp(min=0)
        # The ground is never a foot, so the smaller column of the two names the part that touches it.
        column = self._column[geoms].amin(dim=-1)
        is_real = self._number < self._count
        row = torch.where(is_real, self._world.long(), self._n)
        self._flags.zero_()
        self._flags.scatter_(0, row * (_BODY + 1) + column, self._true)
        flags = self._flags.view(self._n + 1, _BODY + 1)[: self._n]
        return flags[:, :_BODY].clone(), flags[:, _BODY].clone()
