"""Which policies may run: by digest, by signature, both where both are asked for; before their files are used.

And what a policy that may run says of its gait.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from spot_log.format.events import EventName
from spot_model.policy.contract import PolicyContract, PolicyError
from spot_model.robot.gait import HOPS
from spot_runtime.policy.signature import check_signature
from spot_runtime.service_config import ServiceConfig


def admission(config: ServiceConfig, policy: Path) -> Callable[[str], None]:
    """The check of ``policy``'s digest, for :func:`spot_model.policy.policy.load_policy`."""

    def check(sha256: str) -> None:
        check_allowed(policy, sha256, config.policy_sha256)
        if config.policy_public_key is not None:
            check_signature(policy, sha256, config.policy_public_key)

    return check


def check_allowed(policy: Path, sha256: str, allowed_sha256: tuple[str, ...]) -> None:
    """Refuse a policy whose digest is not on the configuration's list, where there is one.

    Raises:
        PolicyError: It is not; the message names its digest.
    """
    if allowed_sha256 and sha256 not in allowed_sha256:
        raise PolicyError(
            f"policy {policy} has the digest {sha256}, which is not among the {len(allowed_sha256)} of "
            "service.policy_sha256; add it there, or run another"
        )


def gait_sentence(contract: PolicyContract) -> str:
    """What the contract says of the gait, speeds of one name together; a warning where the policy hops."""
    if not contract.gait:
        return (
            f"policy {contract.name} states no gait: nobody measured whether it trots or hops; "
            "spot-rl evaluate measures it, spot-rl export writes it into the file"
        )
    spans: list[tuple[str, float, float]] = []
    for stated in contract.gait:
        if spans and spans[-1][0] == stated.name:
            spans[-1] = (stated.name, spans[-1][1], stated.v_x_m_s)
        else:
            spans.append((stated.name, stated.v_x_m_s, stated.v_x_m_s))
    told = ", ".join(f"{name} at {_speeds(low, high)}" for name, low, high in spans)
    hops = sorted({name for name, *_ in spans} & HOPS)
    if not hops:
        return f"policy {contract.name}, measured in simulation at export: {told}"
    return (
        f"warning: policy {contract.name} hops ({' and '.join(hops)}): {told}. The feet of a pair leave the ground "
        "together, which is hard on a robot's legs and on what it carries; a trot is what the policies here do"
    )


def gait_event(contract: PolicyContract) -> tuple[EventName, str]:
    """What a run tells of the gait before it moves: a warning where the policy hops, falls or states no gait."""
    is_sound = bool(contract.gait) and not {stated.name for stated in contract.gait} & (HOPS | {"fall"})
    return EventName.GAIT if is_sound else EventName.GAIT_DOUBTFUL, gait_sentence(contract)


def _speeds(low: float, high: float) -> str:
    return f"{low:g} m/s" if low == high else f"{low:g} to {high:g} m/s"
