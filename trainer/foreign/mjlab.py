"""mjlab's metadata inside an ONNX file: read, and written.

Lists are comma-separated, with a semicolon inside an entry, and rounded to three decimals. Older files name neither
scale, clip nor history of the observation's terms; they had none.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

from spot_model.errors import BadInputError
from spot_model.policy.contract import PolicyContract
from spot_model.robot import facts
from trainer.foreign.description import (
    ABSOLUTE,
    DEFAULT_COMMANDS,
    JOINT_FIELDS,
    MAX_HISTORY,
    THEIR_NAMES,
    ForeignPolicy,
    SeenTerm,
    canonical_joints,
    field_of,
)
from trainer.foreign.environment import NOT_FLAT, Agent, normaliser_of, parsed

REQUIRED: Final = (
    "joint_names",
    "joint_stiffness",
    "joint_damping",
    "default_joint_pos",
    "observation_names",
    "action_scale",
)
RATE_HZ: Final = 50.0
"""mjlab's velocity tasks step at 50 Hz; the file does not say."""


def policy_of_mjlab(metadata: Mapping[str, str], name: str, *, agent: Mapping[str, Any] | None = None) -> ForeignPolicy:
    """What the metadata say, and the learner's file of its actions' clip.

    Raises:
        BadInputError: A key is missing, or a value cannot be done here; the message names it.
    """
    missing = [key for key in REQUIRED if key not in metadata]
    if missing:
        raise BadInputError(f"the ONNX file has no metadata {', '.join(missing)}; export it with mjlab's runner")
    joints = canonical_joints(metadata["joint_names"].split(","), "joint_names")
    names = metadata["observation_names"].split(",")
    rows = zip(names, *(_entries(metadata, key, default, len(names)) for key, default in _OF_TERMS), strict=True)
    return ForeignPolicy(
        name=name,
        terms=tuple(_term(*row, joints=joints) for row in rows),
        joint_names=joints,
        default_position_rad=_joint_values(metadata, "default_joint_pos"),
        action_scale_rad=_joint_values(metadata, "action_scale"),
        kp_nm_per_rad=_joint_values(metadata, "joint_stiffness"),
        kd_nm_s_per_rad=_joint_values(metadata, "joint_damping"),
        rate_hz=RATE_HZ,
        command_low=DEFAULT_COMMANDS[0],
        command_high=DEFAULT_COMMANDS[1],
        action_clip=parsed(Agent, agent or {}, "agent.yaml").clip_actions or math.inf,
        normaliser=normaliser_of(agent or {}),
        assumed=(
            "50 Hz: mjlab's metadata name no rate; --rate-hz names another",
            "velocity commands within ±1 m/s, ±0.5 m/s, ±1 rad/s: mjlab's metadata name no range; --commands does",
            "gains, pose and scale as rounded to three decimals by mjlab",
        ),
    )


def metadata_of(contract: PolicyContract, run: str) -> dict[str, str]:
    """The metadata by which mjlab's tools know a policy of ours; the observation is ours, term by term."""
    n = len(contract.observation_layout)
    return {
        "run_path": run,
        "joint_names": ",".join(contract.joint_names),
        "joint_stiffness": _csv(contract.kp_nm_per_rad),
        "joint_damping": _csv(contract.kd_nm_s_per_rad),
        "default_joint_pos": _csv(contract.default_position_rad),
        "command_names": "twist",
        "observation_names": ",".join(THEIR_NAMES[field][0] for field, _ in contract.observation_layout),
        "observation_terms_scale": _csv([1.0] * n),
        "observation_terms_flatten_history_dim": ",".join(["True"] * n),
        "observation_terms_history_length": ",".join(["0"] * n),
        "observation_terms_clip": ",".join(["-inf;inf"] * n),
        "action_scale": _csv([contract.action_scale_rad] * facts.N_JOINTS),
    }


_OF_TERMS: Final = (
    ("observation_terms_scale", "1.0"),
    ("observation_terms_clip", "-inf;inf"),
    ("observation_terms_history_length", "0"),
    ("observation_terms_flatten_history_dim", "True"),
)
_FLAGS: Final = {"True": "1", "False": "0"}
"""mjlab 1.6.0 writes all that is no text as a number with three decimals, flags too; a file of ours holds words."""


def _term(name: str, scale: str, clip: str, history: str, flattened: str, *, joints: tuple[str, ...]) -> SeenTerm:
    field = field_of(name.strip(), "observation_names")
    limits = _floats(clip.split(";"), "observation_terms_clip")
    if len(limits) != 2:
        raise BadInputError(f"observation_terms_clip holds {clip!r:.60}; an entry is two numbers, 'low;high'")
    (ticks,) = _floats([history], "observation_terms_history_length")
    if not (ticks.is_integer() and 0 <= ticks <= MAX_HISTORY):
        raise BadInputError(
            f"observation_terms_history_length holds {history!r:.60}; allowed: at most {MAX_HISTORY}, a whole number"
        )
    if ticks and not _floats([_FLAGS.get(flattened, flattened)], "observation_terms_flatten_history_dim")[0]:
        raise BadInputError(NOT_FLAT.format(where=f"observation_terms_flatten_history_dim of {name}"))
    return SeenTerm(
        field,
        joint_names=joints if field in JOINT_FIELDS else (),
        is_absolute=name.strip() == ABSOLUTE,
        scale=_floats(scale.split(";"), "observation_terms_scale"),
        clip=(limits[0], limits[1]),
        ages=tuple(reversed(range(max(1, int(ticks))))),
    )


def _entries(metadata: Mapping[str, str], key: str, default: str, count: int) -> list[str]:
    entries = metadata[key].split(",") if key in metadata else [default] * count
    if len(entries) != count:
        raise BadInputError(f"{key} has {len(entries)} entries for {count} observation terms")
    return entries


def _joint_values(metadata: Mapping[str, str], key: str) -> tuple[float, ...]:
    values = _floats(metadata[key].split(","), key)
    values = values * facts.N_JOINTS if len(values) == 1 else values
    if len(values) != facts.N_JOINTS:
        raise BadInputError(f"{key} has {len(values)} values; {facts.N_JOINTS} are needed, one a joint")
    return values


def _floats(words: list[str], key: str) -> tuple[float, ...]:
    try:
        values = tuple(float(word) for word in words)
    except ValueError as error:
        raise BadInputError(f"{key}: {error}") from error
    if any(math.isnan(value) for value in values):
        raise BadInputError(f"{key} holds a value that is no number")
    return values


def _csv(values: tuple[float, ...] | list[float]) -> str:
    return ",".join(f"{value:.6g}" for value in values)
