"""The contract of a policy file: JSON inside the ONNX file, checked before the file is used."""

from __future__ import annotations

import hashlib
from typing import Final, Literal

from pydantic import Field, ValidationError, field_validator, model_validator

from spot_model.errors import SpotRlError
from spot_model.io.settings import Settings, explain
from spot_model.policy.observation import N_OBSERVATION, OBSERVATION_LAYOUT
from spot_model.policy.onnx_head import OnnxHeadError, read_head
from spot_model.robot import facts
from spot_model.robot.gait import HOPS

METADATA_KEY: Final = "spot_rl.contract"
"""Key of the contract in the ONNX file's metadata."""

INPUT_NAME: Final = "observation"
OUTPUT_NAME: Final = "action"
MAX_POLICY_BYTES: Final = 16 * 1024 * 1024
MAX_HISTORY: Final = 50
"""Ticks of observations that a network may see."""
MAX_KP_NM_PER_RAD: Final = 1000.0
MAX_KD_NM_S_PER_RAD: Final = 50.0


class PolicyError(SpotRlError):
    """A policy file does not hold what it must; the message says what is wrong and what was expected."""

    exit_code = 3


class TrainingRecord(Settings):
    """Where the policy came from."""

    run: str = ""
    """Name of the run folder."""
    revision: str = ""
    """Revision of the sources."""
    command: str = ""
    """The command that trained it."""
    seed: int | None = None
    """Random seed."""
    model_sha256: str = ""
    """Digest of the robot model it was trained on."""


class StoredPair(Settings):
    """One input with the output that the network must reproduce when it is loaded."""

    observation: tuple[float, ...] = Field(min_length=N_OBSERVATION, max_length=MAX_HISTORY * N_OBSERVATION)
    action: tuple[float, ...] = Field(min_length=facts.N_JOINTS, max_length=facts.N_JOINTS)
    tolerance: float = Field(default=1e-4, gt=0.0, le=1e-2)


class StatedGait(Settings):
    """The gait at one forward speed, measured in simulation; see :class:`spot_model.robot.gait.Gait`."""

    v_x_m_s: float
    """Commanded."""
    name: str = Field(min_length=1, max_length=40)
    """trot, flying trot, pronk, …"""
    clarity: float = Field(ge=0.0, le=1.0)
    """Share of strides that have this gait."""
    stride_hz: float = Field(ge=0.0)
    """Strides per second."""
    diagonals_agree: float = Field(ge=0.0, le=1.0)
    """Share of time in which both feet of a diagonal are up, or both down; the lower of two."""
    others_agree: float = Field(ge=0.0, le=1.0)
    """The highest such share of the other pairs."""
    flight_share: float = Field(ge=0.0, le=1.0)
    """Share of time with no foot on the ground."""
    v_x_held_m_s: float | None = None
    """Forward speed that it held; None if it fell, or that was not measured."""
    turn_commanded_rad_s: float | None = None
    """A turn that was commanded at this speed, too; None if that was not measured."""
    turn_held_rad_s: float | None = None
    """Yaw rate that it then held; None if it fell."""


class PolicyContract(Settings):
    """All that a runtime must know to run a policy. Per-joint values stand in the order of ``joint_names``."""

    schema_name: Literal["spot-rl/policy/1"] = Field(default="spot-rl/policy/1", alias="schema")
    name: str = Field(min_length=1, max_length=100)
    """The policy's name."""
    joint_names: tuple[str, ...] = facts.JOINT_NAMES
    """Order of the joints in the observation and the action."""
    default_position_rad: tuple[float, ...] = tuple(float(v) for v in facts.DEFAULT_POSITION_RAD)
    """Joint positions at an action of zero. Shape (12,)."""
    action_scale_rad: float = Field(default=facts.ACTION_SCALE_RAD, gt=0.0, le=2.0)
    """Change of a set-point for an action of 1."""
    kp_nm_per_rad: tuple[float, ...] = (facts.POLICY_KP_NM_PER_RAD,) * facts.N_JOINTS
    """Stiffness of the joints' servos. Shape (12,)."""
    kd_nm_s_per_rad: tuple[float, ...] = (facts.POLICY_KD_NM_S_PER_RAD,) * facts.N_JOINTS
    """Damping of the joints' servos. Shape (12,)."""
    rate_hz: float = Field(default=facts.POLICY_RATE_HZ, ge=1.0, le=333.0)
    """Ticks per second."""
    observation_layout: tuple[tuple[str, int], ...] = OBSERVATION_LAYOUT
    """Name and width of each part of the observation, in order."""
    observation_history: int = Field(default=1, ge=1, le=MAX_HISTORY)
    """Number of ticks whose observations the network gets, the newest first."""
    velocity_command_low: tuple[float, float, float]
    """Smallest V_x, V_y (m/s), ω_z (rad/s) that the policy was trained on."""
    velocity_command_high: tuple[float, float, float]
    """The largest ones."""
    training: TrainingRecord = TrainingRecord()
    """Where it came from; below."""
    gait: tuple[StatedGait, ...] = Field(default=(), max_length=100)
    """Its gait by commanded speed, rising; empty if it was not measured."""
    stored_pair: StoredPair
    """An observation with its action, which must be reproduced when the file is loaded."""

    @field_validator("joint_names")
    @classmethod
    def _all_joints_once(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        if sorted(names) != sorted(facts.JOINT_NAMES):
            raise ValueError(f"must name each of {', '.join(facts.JOINT_NAMES)} once")
        return names

    @field_validator("observation_layout")
    @classmethod
    def _known_layout(cls, layout: tuple[tuple[str, int], ...]) -> tuple[tuple[str, int], ...]:
        if layout != OBSERVATION_LAYOUT:
            raise ValueError(f"must be {OBSERVATION_LAYOUT}")
        return layout

    @model_validator(mode="after")
    def _sizes_and_signs(self) -> PolicyContract:
        for field in ("default_position_rad", "kp_nm_per_rad", "kd_nm_s_per_rad"):
            if len(getattr(self, field)) != facts.N_JOINTS:
                raise ValueError(f"{field} has {len(getattr(self, field))} values; 12 are needed")
        if len(self.stored_pair.observation) != self.observation_history * N_OBSERVATION:
            raise ValueError(
                f"stored_pair.observation has {len(self.stored_pair.observation)} values; "
                f"{self.observation_history} ticks of {N_OBSERVATION} are needed"
            )
        for name, kp, kd, angle in zip(
            self.joint_names, self.kp_nm_per_rad, self.kd_nm_s_per_rad, self.default_position_rad, strict=True
        ):
            if not 0.0 < kp <= MAX_KP_NM_PER_RAD:
                raise ValueError(
                    f"kp_nm_per_rad of {name} is {kp:g}; allowed: above 0 (at 0 the joint ignores its set-point), at "
                    f"most {MAX_KP_NM_PER_RAD:g} (the vendor's stand: 936)"
                )
            if not 0.0 <= kd <= MAX_KD_NM_S_PER_RAD:
                raise ValueError(f"kd_nm_s_per_rad of {name} is {kd:g}; allowed: 0 to {MAX_KD_NM_S_PER_RAD:g}")
            joint = facts.JOINT_NAMES.index(name)
            low, high = facts.POSITION_LOW_RAD[joint], facts.POSITION_HIGH_RAD[joint]
            if not low <= angle <= high:
                raise ValueError(
                    f"default_position_rad of {name} is {angle:g}; allowed: {low:g} to {high:g} (radians, not degrees)"
                )
        for low, high in zip(self.velocity_command_low, self.velocity_command_high, strict=True):
            if low > high:
                raise ValueError(
                    f"velocity_command_low must not exceed velocity_command_high: {low:g} exceeds {high:g}"
                )
        return self

    def to_json(self) -> str:
        """JSON at full precision; :meth:`from_json` gives the same contract back."""
        return self.model_dump_json(by_alias=True)

    def is_same_network(self, contract_json: str) -> bool:
        """Whether a log's policy differs from this one in its gains and name alone: the stored pair tells."""
        try:
            other = PolicyContract.from_json(contract_json)
        except ValueError:
            return False
        return other.stored_pair == self.stored_pair and other.joint_names == self.joint_names

    @staticmethod
    def from_json(text: str) -> PolicyContract:
        """Parse and check. Raises pydantic's ``ValidationError``."""
        return PolicyContract.model_validate_json(text)


def sha256_hex(data: bytes) -> str:
    """Digest by which logs name a policy file."""
    return hashlib.sha256(data).hexdigest()


def contract_text(data: bytes, source: str) -> str:
    """The contract as it stands in a file, before native code sees that. Raises PolicyError."""
    try:
        metadata = read_head(data).metadata
    except OnnxHeadError as error:
        raise PolicyError(f"policy {source} is no readable ONNX model: {error}; export it again") from error
    if METADATA_KEY not in metadata:
        raise PolicyError(
            f"policy {source} has no contract (metadata key {METADATA_KEY!r}); export it with 'spot-rl export'"
        )
    return metadata[METADATA_KEY]


def read_contract(text: str, source: str) -> PolicyContract:
    """A contract that holds. Raises PolicyError; ``source`` names the file."""
    try:
        return PolicyContract.from_json(text)
    except ValidationError as error:
        raise PolicyError(f"policy {source}: its contract does not hold:\n{explain(error)}") from error


def gait_sentence(contract: PolicyContract) -> str:
    """What the contract says of the gait, speeds of one name together; a warning where the policy hops."""
    if not contract.gait:
        return (
            f"policy {contract.name} states no gait: nobody measured whether it trots or hops; "
            "spot-rl evaluate measures it; for a file that states it, export the checkpoint or import the policy again"
        )
    spans: list[tuple[str, float, float]] = []
    for stated in contract.gait:
        if spans and spans[-1][0] == stated.name:
            spans[-1] = (stated.name, spans[-1][1], stated.v_x_m_s)
        else:
            spans.append((stated.name, stated.v_x_m_s, stated.v_x_m_s))
    told = ", ".join(f"{name} at {_speeds(low, high)}" for name, low, high in spans)
    doubts = gait_doubts(contract)
    if not doubts:
        return f"policy {contract.name}, measured in simulation: {told}{_turns(contract)}"
    why = _HOP if doubts[0].startswith("hops") else ""
    return f"warning: policy {contract.name} {', '.join(doubts)}; measured in simulation: {told}{why}{_turns(contract)}"


def gait_doubts(contract: PolicyContract) -> list[str]:
    """What speaks against walking a robot with this policy, by its own statement: it hops, falls or stays behind."""
    hops = sorted({stated.name for stated in contract.gait} & HOPS)
    falls = [f"{g.v_x_m_s:g}" for g in contract.gait if g.name == FALL]
    told = {"stand": 0.0}  # of files in which no speed was measured
    held = [(g.v_x_m_s, told.get(g.name) if g.v_x_held_m_s is None else g.v_x_held_m_s) for g in contract.gait]
    slow = [f"{asked:g}" for asked, v in held if v is not None and v < WALKS * asked]
    doubts = [f"hops ({' and '.join(hops)})"] if hops else []
    doubts += [f"falls at {', '.join(falls)} m/s"] if falls else []
    return doubts + ([f"does not walk at {', '.join(slow)} m/s"] if slow else [])


_HOP: Final = (
    ". The feet of a pair leave the ground together, which is hard on a robot's legs and on what it carries; a trot is "
    "what the policies here do"
)
FALL: Final = "fall"
"""In place of a gait: the robot fell on the straight."""
WALKS: Final = 0.5
"""Share of a commanded speed that a policy must hold to be said to walk: nearer to it than to standing."""
TURNS: Final = 0.9
"""Share of a commanded turn that a policy must hold for its turning to go without saying."""


def _turns(contract: PolicyContract) -> str:
    """Where the policy turns less than commanded, or falls; empty where it turns, or nobody measured it."""
    told: dict[float, list[str]] = {}
    for stated in contract.gait:
        asked, held = stated.turn_commanded_rad_s, stated.turn_held_rad_s
        if stated.name != FALL and asked is not None and (held is None or held < TURNS * asked):
            what = "falls" if held is None else f"turns at {held:.2f} rad/s"
            told.setdefault(asked, []).append(f"{what} at {stated.v_x_m_s:g} m/s")
    return "".join(f"; commanded to turn at {asked:g} rad/s, it {', '.join(words)}" for asked, words in told.items())


def _speeds(low: float, high: float) -> str:
    return f"{low:g} m/s" if low == high else f"{low:g} to {high:g} m/s"
