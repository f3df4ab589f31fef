"""``spot-rl refine``."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Annotated, Any

import typer

from spot_model.console.command_registry import PolicyArgument, TrainingConfig


def refine(
    policy: PolicyArgument,
    out: Annotated[Path, typer.Option("--out", help="ONNX file to write.")] = Path("refined.onnx"),
    config: TrainingConfig = None,
    folder: Annotated[
        Path | None,
        typer.Option(
            "--folder", help="Folder of checkpoint and figures; an existing one is continued. [OUT's name + .refine]"
        ),
    ] = None,
    jobs: Annotated[int, typer.Option("--jobs", help="Processes; 0: one per CPU.", min=0)] = 0,
    generations: Annotated[
        int | None, typer.Option("--generations", help="Number of generations, in place of the config's.", min=1)
    ] = None,
) -> None:
    """Optimise a trained policy's gains over whole runs: even gait, safe starts, top speed."""
    from spot_model.console.progress import Progress
    from spot_model.errors import BadInputError
    from spot_model.io.whole import check_new, whole_file, write_over
    from spot_model.policy.contract import TrainingRecord, sha256_hex
    from spot_model.policy.policy import load_policy
    from spot_model.version import software_revision

    check_new(out)
    typer.echo("loading torch …", err=True)
    from trainer.ppo.checkpoint import command_line
    from trainer.ppo.checkpoint_policy import policy_of_layers, read_layers
    from trainer.refine.config import load_refine_config
    from trainer.refine.gains import gains_in, gains_of
    from trainer.refine.search import RefineProblem, compare_candidates, in_words, search_gains
    from trainer.simulate.engine import Place

    settings = load_refine_config(config)
    if generations is not None:
        settings = settings.model_copy(update={"generations": generations})
    loaded = load_policy(policy)
    contract, data = loaded.contract, loaded.file_bytes
    layers, gains = read_layers(data, str(policy)), gains_of(contract.joint_names)
    for robot in settings.robots:
        robot.robots()
    folder = folder or out.with_suffix(".refine")
    folder.mkdir(parents=True, exist_ok=True)

    problem = RefineProblem(data, settings)
    place = Place(workers=jobs or len(os.sched_getaffinity(0)))
    with Progress("generations", settings.generations) as progress:
        values = search_gains(
            problem,
            folder / "generations.jsonl",
            place=place,
            tell=lambda g: progress.update(g.index + 1, f"best {min(g.results):.3f}"),
        )
    before, after = compare_candidates(problem, values, place=place)
    figures: dict[str, Any] = {"policy": in_words(before, settings), "refined": in_words(after, settings)}
    command, revision = command_line(), software_revision()
    result = {
        "schema": "spot-rl/refinement/1",
        "command": command,
        "revision": revision,
        "config": settings.model_dump(mode="json", by_alias=True),
        "policy_sha256": sha256_hex(data),
        "gains": {g.name: round(float(v * g.scale), 6) for g, v in zip(gains, values, strict=True)},
        "figures": figures,
    }
    write_over(folder / "refinement.json", json.dumps(result, indent=1) + "\n")
    for name, row in figures.items():
        typer.echo(f"{name}: " + "  ".join(f"{key} {value}" for key, value in row.items()))
    if not figures["refined"]["score"] < figures["policy"]["score"]:
        raise BadInputError(
            f"the refined gains score {figures['refined']['score']} on fresh starts, the policy itself "
            f"{figures['policy']['score']}; nothing was written; search for more generations"
        )
    record = TrainingRecord(
        run=f"refined from {contract.name} {sha256_hex(data)[:12]}; {contract.training.run}",
        revision=revision,
        command=command,
        seed=settings.seed,
        model_sha256=contract.training.model_sha256,
    )
    made = policy_of_layers(gains_in(layers, gains, values), contract.model_copy(update={"training": record}))
    with whole_file(out) as part:
        part.write_bytes(made.file_bytes)
    typer.echo(f"policy {out} ({out.stat().st_size} bytes)")
