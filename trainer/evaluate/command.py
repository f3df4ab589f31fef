"""``spot-rl evaluate``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

FILM_S = 12.0


def evaluate(
    policy: Annotated[Path, typer.Argument(help="ONNX policy.")],
    out: Annotated[Path, typer.Option("--out", help="Folder for evaluation.json and evaluation.html.")] = Path(
        "evaluation"
    ),
    model: Annotated[str, typer.Option("--model", help="Built-in model, or a model file.")] = "paper_identified",
    n: Annotated[int, typer.Option("--n", help="Robots in the trials that count falls.", min=1)] = 100,
    seed: Annotated[int, typer.Option("--seed", help="Of everything drawn.", min=0)] = 0,
    timestep: Annotated[float, typer.Option("--timestep", help="Physics step, s; must divide 0.02.")] = 0.005,
    integrator: Annotated[str, typer.Option("--integrator", help="Euler or implicitfast.")] = "Euler",
    video: Annotated[bool, typer.Option("--video", help="Also write video.mp4 (needs EGL or OSMesa).")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the figures as JSON.")] = False,
) -> None:
    """Measure a policy in simulation: tracking, top speed, gait, falls, pushes, a slippery patch, power."""
    import numpy as np

    from spot_model.errors import BadInputError
    from spot_model.io.model_file import load_model
    from spot_model.policy.policy import load_policy
    from spot_model.robot.mjcf import MjcfOptions
    from trainer.evaluate.page import evaluation_page
    from trainer.evaluate.report import evaluate as run_trials
    from trainer.evaluate.setting import Setting
    from trainer.play.film import check_film, top_speed_ramp, write_film
    from trainer.play.walk import Walk

    if (out / "evaluation.json").exists():
        raise BadInputError(f"--out {out} holds an evaluation; nothing is overwritten: name another folder")
    if video:
        check_film(out / "video.mp4")
    loaded = load_policy(policy)
    period = 1.0 / loaded.contract.rate_hz
    if timestep <= 0.0 or abs(period / timestep - round(period / timestep)) > 1e-6:
        raise BadInputError(f"--timestep {timestep}: it must divide the policy's period of {period} s")
    try:
        mjcf = MjcfOptions(timestep_s=timestep, integrator=integrator)  # type: ignore[arg-type]
    except ValueError as error:
        raise BadInputError(str(error)) from error
    setting = Setting(policy=loaded, model=load_model(model), mjcf=mjcf, seed=seed)
    result = run_trials(setting, n=n, tell=lambda name: typer.echo(f"trial {name}", err=True))
    out.mkdir(parents=True, exist_ok=True)
    (out / "evaluation.json").write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    (out / "evaluation.html").write_text(evaluation_page(result), encoding="utf-8")
    if video:
        walk = Walk(loaded, setting.plant(1), np.random.default_rng(seed))
        write_film(walk, top_speed_ramp(loaded, FILM_S), out / "video.mp4", FILM_S)
    if as_json:
        typer.echo(json.dumps(result))
    else:
        for name, figures in result.items():
            for fall in figures.get("fell", ()) if isinstance(figures, dict) else ():
                typer.echo(f"{name}: {fall['why']}")
        typer.echo(f"wrote {out / 'evaluation.json'} and {out / 'evaluation.html'}")
