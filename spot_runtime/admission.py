"""Which policies may run: by digest, by signature, both where both are asked for; before their files are used.

And what a policy that may run says of its gait.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from spot_log.format.events import EventName
from spot_model.policy.contract import PolicyContract, PolicyError, gait_doubts, gait_sentence
from spot_model.policy.signature import check_signature
from spot_runtime.config import ServiceConfig


def admission(config: ServiceConfig, policy: Path) -> Callable[[str], None]:
    """The check of ``policy``'s digest, for :func:`spot_model.policy.policy.load_policy`."""

    def check(sha256: str) -> None:
        check_allowed(policy, sha256, config.policy_sha256)
        if config.policy_public_key is not None:
            check_signature(policy, sha256, config.policy_public_key)

    return check


def check_allowed(policy: Path, sha256: str, allowed_sha256: tuple[str, ...]) -> None:
    """Refuse a policy whose digest is not on the configuration's list, where there is one. Raises PolicyError."""
    if allowed_sha256 and sha256 not in allowed_sha256:
        raise PolicyError(
            f"policy {policy} has the digest {sha256}, which is not among the {len(allowed_sha256)} of "
            "service.policy_sha256; add it there, or run another"
        )


def check_scripts_allowed(config: ServiceConfig) -> None:
    """Refuse joint experiments where the configuration says which policies may run: an experiment is none of them.

    Raises:
        PolicyError: It does.
    """
    if config.policy_sha256 or config.policy_public_key is not None:
        raise PolicyError(
            "this configuration admits chosen or signed policies alone (service.policy_sha256, "
            "service.policy_public_key), and a joint experiment is none; use a configuration without these keys"
        )


def gait_event(contract: PolicyContract) -> tuple[EventName, str]:
    """What a run tells of the gait before it moves: a warning where it hops, falls, stays behind or is not stated."""
    is_sound = bool(contract.gait) and not gait_doubts(contract)
    return EventName.GAIT if is_sound else EventName.GAIT_DOUBTFUL, gait_sentence(contract).removeprefix("warning: ")
