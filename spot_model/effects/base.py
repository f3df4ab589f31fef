"""What an unmodelled effect is, and the places in the plant where one can act.

An effect is a frozen dataclass. At its null value a parameter's effect vanishes bit for bit. A formula is written once,
against the array-API standard, for NumPy and torch.
"""

from __future__ import annotations

import dataclasses
import enum
import functools
import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import numpy as np
from array_api_compat import device
from numpy.typing import NDArray
from typing_extensions import Self

from spot_model.errors import BadInputError
from spot_model.robot.arrays import namespace_of
from spot_model.robot.facts import LEG_NAMES, N_JOINTS
from spot_model.robot.joints import select_joints
from spot_model.robot.rotation import AnyArray

Memory = Any
"""What an effect carries from one physics step to the next; made by ``start``, returned by ``torque``."""


class Hook(enum.Enum):
    """Where an effect acts."""

    MODEL = "model"
    """Fields of the physics model, once, before the first step."""
    TORQUE = "torque"
    """The motor torque, at every physics step."""
    SOFTWARE = "software"
    """What the program sends in place of the set-point that it should."""
    COMMAND = "command"
    """The way of a set-point from the policy to the servo."""
    SENSOR = "sensor"
    """What the joints' sensors report: to the servo, the log and the policy."""
    ESTIMATE = "estimate"
    """What the state estimator reports of the body: to the log and the policy."""
    OUTSIDE = "outside"
    """Gravity and forces on the feet, at every physics step."""


class Draws(Protocol):
    """Random numbers for an effect, as arrays of the simulations' library; NumPy's generator is one such source."""

    def random(self, size: tuple[int, ...]) -> AnyArray:
        """Evenly drawn in [0, 1)."""
        ...

    def standard_normal(self, size: tuple[int, ...]) -> AnyArray:
        """Mean 0, standard deviation 1."""
        ...

    def standard_exponential(self, size: tuple[int, ...]) -> AnyArray:
        """Mean 1."""
        ...


@dataclass(frozen=True)
class Parameter:
    """One physical number of an effect."""

    name: str
    null: float
    low: float
    high: float
    unit: str
    source: str


def parameter(*, null: float, low: float, high: float, unit: str, source: str) -> Any:
    """Declare a dataclass field as a parameter: its null value (the default), bounds, unit and source."""
    return dataclasses.field(
        default=null, metadata={"null": null, "low": low, "high": high, "unit": unit, "source": source}
    )


class ModelFields(Protocol):
    """Live per-simulation values of a MuJoCo model's fields."""

    def __getitem__(self, name: str) -> AnyArray:
        """The field ``name``, shape (n_sims, ...); writing into it edits the model."""
        ...

    @property
    def joint_dofs(self) -> NDArray[np.intp]:
        """Degrees of freedom of the twelve joints, canonical order, shape (12,)."""
        ...

    def body_id(self, name: str) -> int:
        """Number of the body ``name`` in the model."""
        ...

    def geom_id(self, name: str) -> int:
        """Number of the geom ``name`` in the model."""
        ...


@dataclass(frozen=True)
class Motion:
    """What a torque effect may look at: the joints at this physics step."""

    position_rad: AnyArray
    """Joint positions, shape (n, 12), canonical joint order."""
    velocity_rad_s: AnyArray
    """Joint velocities, shape (n, 12)."""
    dt_s: float
    """Length of the physics step, s."""


@dataclass(frozen=True)
class IdleBox:
    """Bounds within which a torque effect certainly does nothing, each low and high."""

    torque_nm: tuple[float, float] = (-math.inf, math.inf)
    velocity_rad_s: tuple[float, float] = (-math.inf, math.inf)
    position_rad: tuple[float, float] = (-math.inf, math.inf)


@dataclass(frozen=True, kw_only=True)
class Effect(ABC):
    """Base of all effects; ``joints`` says where it acts.

    A parameter is a float, or an array that broadcasts to (n_sims, 12) and so gives each simulation its own value.
    """

    name: ClassVar[str]
    hook: ClassVar[Hook]
    by_joint: ClassVar[bool] = False
    """Whether what it does at a joint depends on that joint and its own numbers alone."""

    joints: tuple[str, ...] = ("all",)

    def __post_init__(self) -> None:
        select_joints(self.joints)
        for p in self.parameters():
            _check_bounds(self.name, p, getattr(self, p.name))
        self.check()

    def check(self) -> None:  # noqa: B027 - optional for subclasses
        """Check relations between parameters; raises :class:`BadInputError`."""

    @classmethod
    def parameters(cls) -> tuple[Parameter, ...]:
        """The effect's parameters, in the order of its fields."""
        return tuple(Parameter(f.name, **f.metadata) for f in dataclasses.fields(cls) if "null" in f.metadata)

    @property
    def values(self) -> Mapping[str, Any]:
        """Parameter values by name."""
        return {p.name: getattr(self, p.name) for p in self.parameters()}

    @property
    def is_null(self) -> bool:
        """Whether every parameter has its null value."""
        return all(bool(np.all(np.asarray(getattr(self, p.name)) == p.null)) for p in self.parameters())

    @functools.cached_property
    def mask(self) -> NDArray[np.bool_]:
        """Joints on which the effect acts, shape (12,)."""
        return select_joints(self.joints)

    def mask_like(self, like: AnyArray) -> AnyArray:
        """:attr:`mask` as an array of ``like``'s library, on its device."""
        return self.mask if type(like) is np.ndarray else _mask_on(self.joints, namespace_of(like), device(like))

    def arrays_like(self, like: AnyArray) -> Self:
        """The same effect with every parameter as an array of ``like``'s kind; a float becomes shape (1, 1)."""
        xp = namespace_of(like)

        def as_array(value: Any) -> AnyArray:
            array = xp.asarray(value, dtype=like.dtype, device=device(like))
            return xp.reshape(array, (1, 1)) if array.ndim == 0 else array

        return dataclasses.replace(self, **{p.name: as_array(getattr(self, p.name)) for p in self.parameters()})


class ModelEffect(Effect):
    """An effect that edits the physics model."""

    hook: ClassVar[Hook] = Hook.MODEL

    @abstractmethod
    def edit(self, fields: ModelFields) -> None:
        """Edit the model in place, at the joints of :attr:`mask`; add to its values instead of replacing them."""


class TorqueEffect(Effect):
    """An effect that changes the motor torque at every physics step."""

    hook: ClassVar[Hook] = Hook.TORQUE
    by_joint: ClassVar[bool] = True

    def start(self, torque_nm: AnyArray) -> Memory:
        """Memory before the first step, for arrays like ``torque_nm``, shape (n, 12)."""
        return None

    def idle_box(self) -> IdleBox | None:
        """Where :meth:`torque` returns its input bit for bit and leaves its memory unchanged; None if nowhere.

        While all joints of a single simulation stay inside, the call can be left out. For plain numbers alone.
        """
        return None

    @property
    def is_memoryless(self) -> bool:
        """Whether :meth:`torque` hands its memory on unchanged, so that a step needs nothing from the one before."""
        probe = np.full((1, N_JOINTS), 30.0)
        ready = self.arrays_like(probe)
        memory = ready.start(probe)
        return ready.torque(probe, Motion(0.0 * probe, 0.1 * probe, 0.003), memory)[1] is memory

    @abstractmethod
    def torque(self, torque_nm: AnyArray, motion: Motion, memory: Memory) -> tuple[AnyArray, Memory]:
        """Change the torque of all twelve joints; joints outside :attr:`mask` are restored by the caller.

        The effect's parameters are arrays here (see :meth:`arrays_like`).

        Args:
            torque_nm: The torque so far. Shape (n, 12), N·m.
            motion: The joints at this step.
            memory: What :meth:`start` (None by default) or the previous step returned.

        Returns:
            The changed torque, and the memory for the next step.
        """

    def apply(
        self, torque_nm: AnyArray, motion: Motion, memory: Memory, mask: AnyArray | None
    ) -> tuple[AnyArray, Memory]:
        """:meth:`torque` on the joints of ``mask`` (shape (12,), None for all), the input on the others."""
        changed, memory = self.torque(torque_nm, motion, memory)
        if mask is None:
            return changed, memory
        return namespace_of(torque_nm).where(mask, changed, torque_nm), memory


class CommandEffect(Effect):
    """An effect on the way of a command from the policy to the servo."""

    hook: ClassVar[Hook] = Hook.COMMAND

    @abstractmethod
    def arrival_s(self, issued_s: AnyArray, rng: Draws) -> AnyArray:
        """Time at which commands take effect that were issued at ``issued_s``, shape (n,), s; infinity if lost.

        The channel keeps the order: no command takes effect before one that was issued earlier.
        """


class SoftwareEffect(Effect):
    """An effect of the program that drives the robot."""

    hook: ClassVar[Hook] = Hook.SOFTWARE

    @abstractmethod
    def setpoint_rad(self, position_rad: AnyArray) -> AnyArray:
        """Change the position set-points that the program sends, shape (n, 12), canonical order, rad."""


@dataclass(frozen=True)
class JointReading:
    """What the joints' sensors report, each of shape (n, 12)."""

    position_rad: AnyArray
    """Joint positions."""
    velocity_rad_s: AnyArray
    """Joint velocities."""
    load_nm: AnyArray
    """Joint loads."""
    servo_velocity_rad_s: AnyArray | None = None
    """The velocity that the servos damp, if it is not the reported one."""


class SensorEffect(Effect):
    """An effect on the joints' sensors."""

    hook: ClassVar[Hook] = Hook.SENSOR
    by_joint: ClassVar[bool] = True

    def start(self, reading: JointReading) -> Memory:
        """Memory before the first reading."""
        return None

    @abstractmethod
    def read(self, reading: JointReading, dt_s: float, memory: Memory, rng: Draws) -> tuple[JointReading, Memory]:
        """Change the reading of all twelve joints. The effect's parameters are arrays here.

        Args:
            reading: The reading without the effect, at this instant.
            dt_s: Time since the previous reading.
            memory: What :meth:`start` (None by default) or the previous reading returned.
            rng: For random effects.

        Returns:
            The changed reading, and the memory for the next one.
        """


@dataclass(frozen=True)
class BodyEstimate:
    """What the state estimator reports."""

    linear_vel_of_body_in_body_m_s: AnyArray
    """Velocity of the body in its own frame, shape (n, 3)."""
    angular_vel_of_body_in_body_rad_s: AnyArray
    """Turn rate of the body in its own frame, shape (n, 3)."""
    world_from_body_wxyz: AnyArray
    """Orientation of the body, scalar first, shape (n, 4)."""
    foot_contact: AnyArray
    """1 where a foot is reported to touch the ground, else 0; floating point, shape (n, 4)."""


class EstimateEffect(Effect):
    """An effect on the state estimator."""

    hook: ClassVar[Hook] = Hook.ESTIMATE

    def start(self, estimate: BodyEstimate) -> Memory:
        """Memory before the first estimate."""
        return None

    @abstractmethod
    def estimate(
        self, estimate: BodyEstimate, joints: JointReading, dt_s: float, memory: Memory, rng: Draws
    ) -> tuple[BodyEstimate, Memory]:
        """Change the estimate; returns it with the new memory. Arguments as in :meth:`SensorEffect.read`.

        ``joints`` holds the reading of the joints' sensors at this instant.
        """


@dataclass(frozen=True)
class Outside:
    """What surrounds robots at a physics step, for an effect to write into, and the robots' state."""

    gravity_m_s2: AnyArray
    """In the frame of the ground, shape (n, 3)."""
    foot_force_n: AnyArray
    """On the centre of each foot, in the frame of the ground, shape (n, 4, 3)."""
    qpos: AnyArray
    """MuJoCo's, shape (n, 19)."""
    qvel: AnyArray
    """MuJoCo's, shape (n, 18)."""
    time_s: AnyArray
    """Since the start, shape (n, 1)."""


class OutsideEffect(Effect):
    """An effect of the surroundings, on gravity and the feet at every physics step."""

    hook: ClassVar[Hook] = Hook.OUTSIDE

    @property
    def is_steady(self) -> bool:
        """Whether what it does depends neither on the time nor on the robot, so that once is enough."""
        return False

    @abstractmethod
    def surround(self, outside: Outside) -> None:
        """Turn gravity, or add to the forces, in place. The effect's parameters are arrays here."""


@functools.lru_cache(maxsize=256)
def _mask_on(joints: tuple[str, ...], xp: Any, on_device: Any) -> AnyArray:
    """Kept, because a copy to a GPU would make every caller wait."""
    return xp.asarray(select_joints(joints), device=on_device)


def per_sim(value: Any) -> Any:
    """A parameter that is one number a simulation: a float as it is, an array of shape (n_sims, 1) as (n_sims,)."""
    return value[:, 0] if getattr(value, "ndim", 0) == 2 else value


def legs_of(mask: NDArray[np.bool_]) -> tuple[str, ...]:
    """Legs with at least one joint in ``mask``, shape (12,)."""
    return tuple(leg for leg, joints in zip(LEG_NAMES, mask.reshape(-1, 3), strict=True) if joints.any())


def _check_bounds(effect: str, p: Parameter, value: Any) -> None:
    # Torch tensors on a GPU arrive here only from arrays_like, whose values were checked as floats.
    if not isinstance(value, (int, float, np.ndarray, np.floating)):
        return
    array = np.asarray(value, dtype=np.float64)
    ok = (array == p.null) | ((array >= p.low) & (array <= p.high))
    if not bool(np.all(ok)):
        bad = array[~ok].flat[0] if array.ndim else float(array)
        null = "" if p.low <= p.null <= p.high else f" or {p.null:g} for none"
        what = "is not a number" if math.isnan(bad) else f"= {bad:g}"
        raise BadInputError(f"{effect}.{p.name} {what}; allowed: {p.low:g} to {p.high:g} {p.unit}{null}")
