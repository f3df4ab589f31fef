"""``spot-rl policy import``."""

from __future__ import annotations

import enum
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from spot_model.errors import BadInputError

if TYPE_CHECKING:
    from trainer.foreign.description import ForeignPolicy

BESIDE: Final = (
    "env.yaml",
    "params/env.yaml",
    "../params/env.yaml",
    "../../params/env.yaml",
    "env.json",
    "env_cfg.json",
)
"""Where Isaac Lab's tools leave the environment, seen from the exported policy."""


class Framework(str, enum.Enum):
    """Framework whose conventions a policy follows."""

    ISAAC_LAB = "isaac-lab"
    MJLAB = "mjlab"
    SPOT_RL_EXAMPLE = "spot-rl-example"


def import_policy(
    policy: Annotated[Path, typer.Argument(help="ONNX file, or a TorchScript file (.pt, .jit).")],
    like: Annotated[Framework, typer.Option(help="Framework whose conventions the policy follows.")],
    env: Annotated[
        Path | None, typer.Option(help="The run's env.yaml or JSON; looked for beside the policy if not given.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(help="File to write; NAME.spot.onnx beside the policy if not given.")
    ] = None,
    name: Annotated[str | None, typer.Option(help="Name in the contract; the file's if not given.")] = None,
    joint_order: Annotated[str, typer.Option(help="The robot's joints in training, comma-separated.")] = "",
    rate_hz: Annotated[
        float | None, typer.Option(min=1.0, max=333.0, help="Rate of the policy, Hz, if no file names it.")
    ] = None,
    commands: Annotated[
        str, typer.Option(help="Lower and upper limits of V_x,V_y,ω_z as 'a,b,c:d,e,f', if no file names them.")
    ] = "",
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask for confirmation.")] = False,
) -> None:
    """Import a policy of another framework, and check that its network gives the same actions."""
    from spot_model.io.model_file import load_model
    from spot_model.io.whole import check_new
    from spot_model.policy.contract import gait_sentence
    from trainer.foreign.description import checked
    from trainer.foreign.network import ours_from, read_network
    from trainer.simulate.stated_gait import write_with_gait

    target = out or policy.with_name(f"{policy.stem}.spot.onnx")
    check_new(target)
    order = tuple(word for word in joint_order.split(",") if word)
    described = describe_file(policy, like.value, env, name or (out or policy).stem, order)
    described = checked(_with_options(described, rate_hz, commands))
    typer.echo(text_of(described))
    if not yes and not typer.confirm("Is this what the policy was trained with?"):
        raise BadInputError("nothing was written; correct the side file, or name it with --env")
    network = read_network(policy, described.width)
    made = ours_from(network, described, revision=f"{like.value}/{policy.name}")
    typer.echo("measuring gait and turning at each speed", err=True)
    made = write_with_gait(made, load_model("paper_identified"), target)
    typer.echo(gait_sentence(made.contract))
    told = ", if the training did what is assumed above" if described.assumed else ""
    typer.echo(f"policy {target}: SHA-256 {made.sha256}; the network's actions are the same{told}")


def text_of(policy: ForeignPolicy) -> str:
    """What was read, for a person to confirm."""
    lines = [f"{policy.name}: {policy.rate_hz:g} Hz, {policy.width} numbers in, 12 joints out", "", "observation"]
    for term in policy.terms:
        parts = [f"  {term.field} ({term.width})"]
        parts += [f"ticks before the newest: {' '.join(map(str, term.ages))}"] if term.ages != (0,) else []
        parts += ["absolute"] if term.is_absolute else []
        parts += [f"× {', '.join(f'{v:g}' for v in term.scale)}"] if set(term.scale) != {1.0} else []
        parts += [f"clipped to {term.clip[0]:g} … {term.clip[1]:g}"] if term.clip != type(term).clip else []
        lines.append(", ".join(parts))
    lines += ["", "joint  default rad  scale rad  k_p N·m/rad  k_d N·m·s/rad"]
    rows = zip(
        policy.joint_names,
        policy.default_position_rad,
        policy.action_scale_rad,
        policy.kp_nm_per_rad,
        policy.kd_nm_s_per_rad,
        strict=True,
    )
    lines += [f"{joint:6} {q:11.4g} {s:10.4g} {kp:12.4g} {kd:14.4g}" for joint, q, s, kp, kd in rows]
    low, high = policy.command_low, policy.command_high
    lines += ["", f"actions clipped to ±{policy.action_clip:g}"] if math.isfinite(policy.action_clip) else []
    lines += ["", f"velocity commands {low} to {high} m/s, m/s, rad/s"]
    lines += [f"assumed: {what}" for what in policy.assumed]
    return "\n".join(lines)


def describe_file(policy: Path, like: str, env: Path | None, name: str, joint_order: tuple[str, ...]) -> ForeignPolicy:
    """What a policy's side files, or its own metadata, say.

    Raises:
        BadInputError: A file is missing, or says something that cannot be done here.
    """
    from spot_model.policy.onnx_head import OnnxHeadError, read_head
    from trainer.foreign import isaac_lab, mjlab, spot_rl_example
    from trainer.foreign.environment import read_agent, read_data
    from trainer.foreign.network import policy_bytes

    if not policy.is_file():
        raise BadInputError(f"policy {policy} is no file; give an ONNX or a TorchScript file")
    if like == "mjlab":
        if env is not None or joint_order:
            raise BadInputError("mjlab's policies say all in their own metadata; leave out --env and --joint-order")
        try:
            metadata = read_head(policy_bytes(policy)).metadata
        except OnnxHeadError as error:
            raise BadInputError(f"policy {policy} is no readable ONNX model: {error}") from error
        return mjlab.policy_of_mjlab(metadata, name, agent=read_agent(policy.parent / "params" / "env.yaml"))
    if like == "spot-rl-example":
        if joint_order:
            raise BadInputError("the example has a joint order of its own; leave out --joint-order")
        return spot_rl_example.policy_of_example(read_data(env or spot_rl_example.find_environment(policy)), name)
    found = env or next((policy.parent / at for at in BESIDE if (policy.parent / at).is_file()), None)
    if found is None:
        raise BadInputError(f"no env.yaml beside {policy}; name the training run's with --env")
    return isaac_lab.policy_of_isaac_lab(read_data(found), name, agent=read_agent(found), joint_order=joint_order)


def _with_options(policy: ForeignPolicy, rate_hz: float | None, commands: str) -> ForeignPolicy:
    if rate_hz is not None:
        assumed = tuple(what for what in policy.assumed if "--rate-hz" not in what)
        policy = replace(policy, rate_hz=rate_hz, assumed=assumed)
    if commands:
        try:
            low, high = (tuple(float(v) for v in part.split(",")) for part in commands.split(":"))
            (a, b, c), (d, e, f) = low, high
        except ValueError as error:
            raise BadInputError(f"--commands {commands!r}; give it as -1,-0.5,-1:1,0.5,1") from error
        assumed = tuple(what for what in policy.assumed if not what.startswith("velocity commands"))
        policy = replace(policy, command_low=(a, b, c), command_high=(d, e, f), assumed=assumed)
    return policy
