"""A policy's card: what it was measured to do, beside what its contract promises.

``walk.card.yaml`` lies beside ``walk.onnx`` and names the digest that it speaks of, so that a card cannot outlive its
policy unseen. ``spot-rl policy card`` writes one from an evaluation; ``spot-rl policy show`` prints it.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import yaml
from pydantic import Field, ValidationError

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings, explain
from spot_model.io.whole import write_new
from spot_model.io.yaml_text import read_yaml
from spot_model.policy.policy import Policy

SCHEMA: Final = "spot-rl/policy-card/1"
EVALUATION_SCHEMA: Final = "spot-rl/evaluation/1"
SUFFIX: Final = ".card.yaml"
WIDTH: Final = 22


class PolicyCard(Settings):
    """The card's keys."""

    schema_name: Literal["spot-rl/policy-card/1"] = Field(default=SCHEMA, alias="schema")
    policy_sha256: str
    """Digest of the policy's file, so that a card of another file is noticed."""
    about: str = ""
    """What the policy is, in a sentence."""
    gait: str = ""
    """Its gait, in a sentence."""
    figures: dict[str, str] = Field(default_factory=dict)
    """What was measured in simulation, by name."""
    tried_on: tuple[str, ...] = ()
    """What it was tried on."""
    not_tried_on: tuple[str, ...] = ()
    """What it was not tried on."""


def card_path(policy: Path) -> Path:
    """Where the card of a policy's file lies."""
    return policy.with_suffix(SUFFIX)


def load_card(policy: Path) -> PolicyCard | None:
    """The card beside a policy; None if there is none. Raises BadInputError: it is not valid."""
    path = card_path(policy)
    if not path.is_file():
        return None
    try:
        return PolicyCard.model_validate(read_yaml(path, "policy card"))
    except ValidationError as error:
        raise BadInputError(f"policy card {path}:\n{explain(error, PolicyCard)}") from error


def write_card(policy: Path, card: PolicyCard) -> Path:
    """Write a card beside its policy. Raises OutputExistsError: there is one."""
    path = card_path(policy)
    data = card.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    text = yaml.safe_dump({"schema": SCHEMA, **data}, sort_keys=False, allow_unicode=True, width=110)
    write_new(path, text)
    return path


def card_of(
    policy: Policy,
    evaluation: Path,
    *,
    about: str = "",
    gait: str = "",
    tried_on: Sequence[str] = (),
    not_tried_on: Sequence[str] = (),
) -> PolicyCard:
    """A card with the figures of an ``evaluation.json``.

    Raises:
        BadInputError: It is not an evaluation, or belongs to another policy.
    """
    try:
        told = json.loads(evaluation.read_text(encoding="utf-8"))
    except OSError as error:
        raise BadInputError(
            f"evaluation {evaluation} cannot be read: {error.strerror}; give an evaluation.json"
        ) from error
    except ValueError as error:
        raise BadInputError(
            f"evaluation {evaluation} is no JSON ({error}); give the evaluation.json of 'spot-rl evaluate'"
        ) from error
    if not isinstance(told, dict) or told.get("schema") != EVALUATION_SCHEMA:
        raise BadInputError(f"{evaluation} is no evaluation; give the evaluation.json of 'spot-rl evaluate'")
    if told.get("policy_sha256") != policy.sha256:
        raise BadInputError(
            f"{evaluation} is of a policy with SHA-256 {str(told.get('policy_sha256'))[:12]}…, not of "
            f"{policy.contract.name} ({policy.sha256[:12]}…); evaluate this file"
        )
    return PolicyCard(
        policy_sha256=policy.sha256,
        about=about,
        gait=gait or str(told.get("top_speed", {}).get("gait", "")),
        figures=dict(_figures(told)),
        tried_on=tuple(tried_on),
        not_tried_on=tuple(not_tried_on),
    )


def card_lines(policy: Policy, card: PolicyCard | None) -> Iterator[str]:
    """A policy's contract and card as lines for a terminal."""
    contract, training = policy.contract, policy.contract.training
    low, high = contract.velocity_command_low, contract.velocity_command_high
    yield f"{contract.name}: {card.about}" if card is not None and card.about else contract.name
    for name, text in (
        ("file", f"SHA-256 {policy.sha256}"),
        ("forward", f"{low[0]:g} to {high[0]:g} m/s"),
        ("left", f"{low[1]:g} to {high[1]:g} m/s"),
        ("turning", f"{low[2]:g} to {high[2]:g} rad/s"),
        ("rate", f"{contract.rate_hz:g} Hz"),
        ("gains", f"kp {_range(contract.kp_nm_per_rad)} N·m/rad, kd {_range(contract.kd_nm_s_per_rad)} N·m·s/rad"),
        ("action", f"default pose ± {contract.action_scale_rad:g} rad a unit"),
        ("trained by", training.command or "not recorded"),
        ("revision", training.revision or "not recorded"),
    ):
        yield _line(name, text)
    if card is None:
        yield _line("card", "no card file; 'spot-rl policy card' writes one from an evaluation")
        return
    if card.policy_sha256 != policy.sha256:
        yield _line("card", f"of another file (SHA-256 {card.policy_sha256[:12]}…), not shown; write a new one")
        return
    if card.gait:
        yield _line("gait", card.gait)
    yield from (_line(name, text) for name, text in card.figures.items())
    yield from (_line("tried on", text) for text in card.tried_on)
    yield from (_line("not tried on", text) for text in card.not_tried_on)


def _line(name: str, text: str) -> str:
    return f"  {name:<{WIDTH}}{text}"


def _range(values: Sequence[float]) -> str:
    low, high = min(values), max(values)
    return f"{low:g}" if low == high else f"{low:g} to {high:g}"


def _figures(told: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """An evaluation's figures in words; what it does not have is left out."""
    top, tracking = told.get("top_speed", {}), told.get("tracking", {})
    if top.get("sustained_m_s") is not None:
        yield "highest speed held", f"{top['sustained_m_s']:.2f} m/s"
    if "flight_share" in top:
        yield (
            "at that speed",
            f"{top['stride_hz']:.1f} strides/s, no foot down {100 * top['flight_share']:.0f} % of the time",
        )
    for name, words, unit in (
        ("mean_forward_error_m_s", "forward error", "m/s"),
        ("mean_lateral_error_m_s", "sideways error", "m/s"),
        ("mean_yaw_error_rad_s", "turning error", "rad/s"),
    ):
        if tracking.get(name) is not None:
            yield words, f"{tracking[name]:.3f} {unit} on average"
    for point in tracking.get("points", ()):
        v_x, v_y, yaw = point["command"]
        if v_x != 0.0 and v_y == 0.0 and yaw != 0.0:
            yield f"turning at {v_x:g} m/s", f"{point['velocity'][2]:.2f} rad/s where {yaw:g} is commanded"
    for name, words in (
        ("episodes_slow", "falls, slow"),
        ("episodes_fast", "falls, fast"),
        ("episodes_beyond", "falls, fastest"),
    ):
        if name in told:
            bounds = told[name].get("v_x_m_s")
            at = f", {bounds[0]:g} to {bounds[1]:g} m/s" if bounds else ""
            yield words, f"{told[name]['falls']} of {told[name]['episodes']} randomised episodes of 20 s{at}"
    for name, words in (("pushes", "pushes of 1 m/s"), ("slippery_patch", "a patch of μ 0.3")):
        if name in told:
            yield words, f"{told[name]['survived']} of {told[name]['trials']} walk on"
    yield from holds_by_kind(told.get("holds", {}))


def holds_by_kind(holds: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """How many robots held in each condition of an evaluation, one pair of texts for each kind of condition."""
    by_group: dict[str, list[str]] = {}
    for c in holds.get("conditions", ()):
        by_group.setdefault(c["group"], []).append(f"{c['name']} {c['held']}")
    for group, words in by_group.items():
        robots = holds["conditions"][0]["robots"]
        yield f"holds, {group}", f"of {robots}: {'; '.join(words)}"
