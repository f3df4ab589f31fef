"""The vendor's RL example: an ONNX file beside one JSON file, a fixed observation, a fixed joint order; in and out.

The example reads gains, default pose and scale from the JSON and nothing else. Its input is ``obs``, and its first
output the action.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from spot_model.errors import BadInputError
from spot_model.policy.contract import PolicyContract
from spot_model.policy.observation import OBSERVATION
from spot_model.robot.facts import BREADTH_FIRST
from trainer.foreign.description import ForeignPolicy, SeenTerm
from trainer.foreign.environment import Environment, for_each_joint, parsed

RATE_HZ = 50.0


def find_environment(policy: Path) -> Path:
    """The one JSON file beside the policy. Raises BadInputError: there is none, or more than one."""
    found = sorted(policy.parent.glob("*.json"))
    if len(found) != 1:
        raise BadInputError(f"{policy.parent} holds {len(found)} JSON files; the example wants one beside the policy")
    return found[0]


def policy_of_example(data: Mapping[str, Any], name: str) -> ForeignPolicy:
    """What the example would do with this file. Raises BadInputError: something is missing; the message names it."""
    joints, environment = BREADTH_FIRST, parsed(Environment, data, "the environment file")
    if "scale" not in environment.action.model_fields_set:
        raise BadInputError("the environment file has no actions.joint_pos.scale; the example needs it")
    usual = "base_velocity" if "base_velocity" in (environment.commands or {}) else None
    low, high, assumed = environment.command_bounds(usual)
    if environment.commands is None:
        assumed = ()
    if environment.rate_hz is None:
        assumed = ("50 Hz: the file names no rate; --rate-hz names another", *assumed)
    return ForeignPolicy(
        name=name,
        terms=tuple(SeenTerm(field.name, joint_names=joints if field.is_of_joints else ()) for field in OBSERVATION),
        joint_names=joints,
        default_position_rad=for_each_joint(environment.pose, joints, "joint_pos"),
        action_scale_rad=for_each_joint(environment.action.scale, joints, "actions.joint_pos.scale"),
        kp_nm_per_rad=environment.gains("stiffness", joints),
        kd_nm_s_per_rad=environment.gains("damping", joints),
        rate_hz=environment.rate_hz or RATE_HZ,
        command_low=low,
        command_high=high,
        assumed=assumed,
    )


def environment_of(contract: PolicyContract) -> dict[str, Any]:
    """The JSON that the example reads for a policy of ours."""
    actuators = {
        name: {"joint_names_expr": [name], "stiffness": kp, "damping": kd}
        for name, kp, kd in zip(contract.joint_names, contract.kp_nm_per_rad, contract.kd_nm_s_per_rad, strict=True)
    }
    pose = dict(zip(contract.joint_names, contract.default_position_rad, strict=True))
    low, high = contract.velocity_command_low, contract.velocity_command_high
    ranges = {key: [low[i], high[i]] for i, key in enumerate(("lin_vel_x", "lin_vel_y", "ang_vel_z"))}
    return {
        "sim": {"dt": 1.0 / contract.rate_hz},
        "decimation": 1,
        "scene": {"robot": {"actuators": actuators, "init_state": {"pos": [0.0, 0.0, 0.5], "joint_pos": pose}}},
        "actions": {"joint_pos": {"scale": contract.action_scale_rad}},
        "commands": {"base_velocity": {"ranges": ranges}},
    }
