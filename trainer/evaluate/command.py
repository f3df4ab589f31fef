"""``spot-rl evaluate``."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from spot_model.console.command_registry import PolicyArgument
from trainer.simulate.engine import Device, check_device

if TYPE_CHECKING:
    from trainer.evaluate.setting import Setting

FILM_S = 12.0
UNFINISHED = "unfinished.json"
"""The trials of an evaluation that goes on or was interrupted."""


def evaluate(
    policy: PolicyArgument,
    out: Annotated[Path, typer.Option("--out", help="Folder for evaluation.json and evaluation.html.")] = Path(
        "evaluation"
    ),
    model: Annotated[
        str, typer.Option("--model", help="Built-in model, a model file, or a models file.")
    ] = "paper_identified",
    n: Annotated[int, typer.Option("--n", help="Robots in the trials that count falls.", min=1)] = 100,
    each: Annotated[
        int | None,
        typer.Option(
            "--each", help="Robots in each condition of ground, load or push; default: an eighth of --n.", min=1
        ),
    ] = None,
    seed: Annotated[int, typer.Option("--seed", help="Random seed.", min=0)] = 0,
    timestep: Annotated[float, typer.Option("--timestep", help="Physics step, s; must divide 0.02.")] = 0.005,
    integrator: Annotated[str, typer.Option("--integrator", help="Euler, implicitfast, implicit or RK4.")] = "Euler",
    device: Device = "cpu",
    video: Annotated[bool, typer.Option("--video", help="Also write video.mp4 (needs EGL or OSMesa).")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Measure a policy in simulation: tracking, top speed, gait, falls, power, and on which ground it holds."""
    import numpy as np

    from spot_model.errors import BadInputError
    from spot_model.io.models_file import load_models
    from spot_model.io.whole import check_new, whole_folder
    from spot_model.policy.card import holds_by_kind
    from spot_model.policy.policy import load_policy
    from spot_model.robot.mjcf import MjcfOptions

    check_new(out / "evaluation.json", out / "evaluation.html", *([out / "video.mp4"] if video else []))
    loaded = load_policy(policy)
    typer.echo("loading the simulator …", err=True)
    from trainer.evaluate.page import evaluation_page
    from trainer.evaluate.setting import Setting
    from trainer.play.film import check_film, top_speed_ramp, write_film
    from trainer.play.walk import Walk

    if video:
        check_film(out / "video.mp4")
    period = 1.0 / loaded.contract.rate_hz
    if not timestep > 0.0 or abs(period / timestep - round(period / timestep)) > 1e-6:
        raise BadInputError(f"--timestep {timestep}: it must divide the policy's period of {period} s")
    try:
        mjcf = MjcfOptions(timestep_s=timestep, integrator=integrator)  # type: ignore[arg-type]
    except ValueError as error:
        raise BadInputError(str(error)) from error
    check_device(device)
    fitted, *possible = load_models(model)
    setting = Setting(policy=loaded, model=fitted, possible=tuple(possible), mjcf=mjcf, seed=seed, device=device)
    result = _evaluated(setting, n, out / UNFINISHED, each)
    with whole_folder(out) as part:
        (part / "evaluation.html").write_text(evaluation_page(result, policy.name), encoding="utf-8")
        (part / "evaluation.json").write_text(_json(result), encoding="utf-8")
    (out / UNFINISHED).unlink(missing_ok=True)
    if video:
        walk = Walk(loaded, replace(setting, device="cpu").plant(1), np.random.default_rng(seed))
        write_film(walk, top_speed_ramp(loaded, FILM_S), out / "video.mp4", FILM_S)
    if as_json:
        typer.echo(json.dumps(result))
    else:
        for name, figures in result.items():
            for fall in figures.get("fell", ()) if isinstance(figures, dict) else ():
                typer.echo(f"{name}: {fall['why']}")
        for name, text in holds_by_kind(result["holds"]):
            typer.echo(f"{name}, {text}")
        typer.echo(f"wrote {out / 'evaluation.json'} and {out / 'evaluation.html'}")


def _evaluated(setting: Setting, n: int, unfinished: Path, each: int | None = None) -> dict[str, Any]:
    """Run the trials, each kept in ``unfinished`` as soon as it ends; those that it holds are not run again."""
    from spot_model.console.progress import Progress
    from spot_model.errors import BadInputError
    from spot_model.io.whole import write_over
    from trainer.evaluate.trials import about
    from trainer.evaluate.trials import evaluate_setting as run_trials

    same = {**about(setting), "robots": [n, each]}
    try:
        done = json.loads(unfinished.read_text(encoding="utf-8")) if unfinished.exists() else same
    except ValueError as error:
        raise BadInputError(f"{unfinished} cannot be read ({error}); delete it, or name another folder") from error
    if not isinstance(done, dict) or {key: done.get(key) for key in same} != same:
        raise BadInputError(
            f"--out {unfinished.parent} holds an interrupted evaluation of another policy or model, or with another "
            "--n, --each, --seed, --timestep or --integrator: name another folder"
        )
    write_over(unfinished, _json(done))
    try:
        with Progress("trials") as progress:
            result = run_trials(
                setting,
                n=n,
                n_each=each,
                done=done,
                tell=lambda name, share: progress.update(round(100 * share), name.replace("_", " "), is_told=True),
                keep=lambda figures: write_over(unfinished, _json(figures)),
            )
            progress.update(100, "all trials")
    except KeyboardInterrupt:
        typer.echo(f"finished trials are in {unfinished}; the same command continues from there", err=True)
        raise
    del result["robots"]
    return result


def _json(figures: dict[str, Any]) -> str:
    return json.dumps(figures, indent=1) + "\n"
