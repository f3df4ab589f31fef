"""What moves simulated robots: MuJoCo on the cores, or on a GPU. The plant above it is the same for both."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, Union

import mujoco
import numpy as np
from mujoco.batch import Batch
from numpy.typing import NDArray

from spot_model.errors import BadInputError, SpotRlError
from spot_model.plant.model_fields import PlantFields
from spot_model.robot import facts
from spot_model.robot.mjcf import MjcfOptions

if TYPE_CHECKING:
    from spot_model.plant.warp_physics import WarpPhysics

FOOT_SENSOR_SIZE = 4
"""Number of contacts, then the force of the foot on the ground, three components in the world frame."""


class CorePhysics:
    """Many simulations of one MuJoCo model on the cores, by ``mujoco.batch``, bit-identical at any number of threads.

    Arrays are live: what is written into them is the next state. :class:`~spot_model.plant.warp_physics.WarpPhysics`
    has the same members on a GPU.
    """

    build = 0
    """Number of the model that is simulated; work of a GPU that was recorded with an earlier one is void."""

    def __init__(self, model: mujoco.MjModel, n_sims: int, n_threads: int) -> None:
        self.model = model
        self.batch = batch = Batch(model, n_sims, nthread=n_threads)
        """The simulations themselves; for a GPU it only holds the fields."""
        self.fields = PlantFields(batch)
        """Per-simulation fields of the model."""
        self.qpos: NDArray[np.float64] = batch.bind("qpos")
        """Shape (n_sims, 19)."""
        self.qvel: NDArray[np.float64] = batch.bind("qvel")
        """Shape (n_sims, 18)."""
        self.ctrl: NDArray[np.float64] = batch.bind("ctrl")
        """Motor torques, shape (n_sims, 12), N·m."""
        self.time: NDArray[np.float64] = batch.bind("time")
        """Since the last reset, shape (n_sims,), s."""
        self.sensordata: NDArray[np.float64] = batch.bind("sensordata")
        self._ncon: NDArray[np.int32] = batch.bind("ncon")
        self._foot_contacts = self.sensordata[:, : FOOT_SENSOR_SIZE * facts.N_LEGS : FOOT_SENSOR_SIZE]

    def live(self, name: str) -> NDArray[Any]:
        """An array of MuJoCo's data by its name, with the simulations as first axis."""
        found: NDArray[Any] = self.batch.bind(name)
        return found

    def gravity(self) -> NDArray[np.float64]:
        """Gravity in the frame of the ground, m/s², each simulation's own from then on; shape (n_sims, 3)."""
        return self.fields["opt.gravity"]

    def step(self) -> None:
        """Advance all simulations by one physics step."""
        self.batch.step()

    def state(self) -> list[Any]:
        """All that moves."""
        return [self.batch.state]

    def restart(self, mask: NDArray[np.bool_]) -> None:
        """Forget velocities, torques and the solver's last solution in the simulations of ``mask``, shape (n_sims,)."""
        self.batch.reset(np.flatnonzero(mask), stage=mujoco.mjtStage.mjSTAGE_NONE.value)

    def forward(self, mask: NDArray[np.bool_]) -> None:
        """Bring contacts, forces and sensors up to date with the state in the simulations of ``mask``."""
        self.batch.forward(np.flatnonzero(mask))

    def foot_contact(self) -> NDArray[np.bool_]:
        """Whether each foot touches the ground, shape (n_sims, 4)."""
        contact: NDArray[np.bool_] = self._foot_contacts > 0.0
        return contact

    def body_contact(self) -> NDArray[np.bool_]:
        """Whether anything but a foot touches the ground, shape (n_sims,)."""
        return np.asarray(self._ncon > self._foot_contacts.sum(axis=1))

    def contacts(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Contact flags of the feet and of the rest."""
        return self.foot_contact(), self.body_contact()

    def standing(self) -> NDArray[np.bool_]:
        """Feet on the ground, shape (n_sims, 4), by the cheapest means that there are."""
        return self.foot_contact()

    def contacts_lost(self) -> float:
        """None: on the cores, MuJoCo takes the memory that it needs."""
        return 0.0

    def is_recording(self) -> bool:
        """Whether a GPU's work is being recorded now, as part of something larger: never, on the cores."""
        return False

    def diverged(self) -> NDArray[np.bool_]:
        """Simulations that MuJoCo warned of, shape (n_sims,)."""
        return np.asarray(self._warning_counts().any(axis=1))

    def first_divergence(self) -> tuple[int, str]:
        """Number of the first such simulation, and MuJoCo's name of its first warning."""
        counts = self._warning_counts()
        sim = int(np.flatnonzero(counts.any(axis=1))[0])
        first = mujoco.mjtWarning.mjWARN_CONTACTFULL.value + int(np.argmax(counts[sim] > 0))
        return sim, mujoco.mjtWarning(first).name

    def _warning_counts(self) -> NDArray[Any]:
        """MuJoCo's warnings from a full contact list on, shape (n_sims, k)."""
        counts: NDArray[Any] = self.batch.warning[:, mujoco.mjtWarning.mjWARN_CONTACTFULL.value :, 1]
        return counts


Physics: TypeAlias = Union[CorePhysics, "WarpPhysics"]


class PlantDivergedError(SpotRlError):
    """A simulation left the range in which its numbers mean something."""


@dataclass(frozen=True)
class PlantOptions:
    """How the plant computes.

    Args:
        mjcf: Choices of the MuJoCo model: time step, integrator, contact, terrain.
        device: "cpu", or a GPU ("cuda", "cuda:N"; extra ``gpu``), where all arrays are torch tensors.
        n_threads: Threads that step simulations, 0 for all CPUs. The result is bit-identical at any number.
        on_divergence: "raise", or "flag" to leave it at :attr:`Plant.diverged`.
        seed: Seed of what effects draw, noise, jitter, drops.
        estimate_steps: Physics steps from one estimate of the body to the next; 1 on a GPU.
    """

    mjcf: MjcfOptions = field(default_factory=MjcfOptions)
    device: str = "cpu"
    n_threads: int = 0
    on_divergence: Literal["raise", "flag"] = "raise"
    seed: int = 0
    estimate_steps: int = 1


def make_physics(model: mujoco.MjModel, n_sims: int, options: PlantOptions) -> Physics:
    """The physics that the options name.

    Raises:
        BadInputError: A GPU is asked for, and the extra ``gpu`` is not installed or its memory is too small.
    """
    if options.device == "cpu":
        return CorePhysics(model, n_sims, _threads(options.n_threads, n_sims))
    try:
        from spot_model.plant.warp_physics import WarpPhysics
    except ModuleNotFoundError as error:
        raise BadInputError(
            f"device {options.device!r}: {error.name} is not installed; install the extra: pip install 'spot-rl[gpu]', "
            "or use --device cpu"
        ) from error
    return WarpPhysics(model, n_sims, options.device, has_sensors=options.mjcf.link_torque_sensors)


def _threads(n_threads: int, n_sims: int) -> int:
    available = len(os.sched_getaffinity(0)) if n_threads == 0 else n_threads
    return min(available, n_sims)
