"""How soon a stop gets through while somebody attacks the operator's service."""

from __future__ import annotations

import json
import statistics
from typing import Annotated

import typer

from proof.attacks.attackers import ATTACKS
from proof.attacks.trial import BOUND_S, LISTENS, Trial, try_attack
from spot_model.errors import BadInputError

EXIT_FAILED = 1
STOPS_OF_A_SLOW_ONE = 1000


def stop(
    json_output: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    only: Annotated[str, typer.Option(help="Only attacks whose name or address contains this.")] = "",
    stops: Annotated[int, typer.Option(min=1, help="Stops of a new client, and as many of a connected one.")] = 20,
) -> None:
    """Attack the operator's service in many ways: no stop may fail, and one in a thousand may take more than 0.5 s."""
    chosen = [(attack, listen) for listen in LISTENS for attack in ATTACKS if only in attack or only == listen]
    if not chosen:
        raise BadInputError(f"no attack holds {only!r}; attacks: {', '.join(ATTACKS)}; listening: {', '.join(LISTENS)}")
    trials: list[Trial] = []
    for number, (attack, listen) in enumerate(chosen, 1):
        trial = try_attack(attack, listen, stops)
        trials.append(trial)
        median_ms, worst_ms = statistics.median(trial.latencies_s) * 1e3, trial.worst_s * 1e3
        typer.echo(
            f"{number}/{len(chosen)} {'BAD' if trial.refusals or trial.slow else 'ok '} {listen:<8} {attack:<18} "
            f"median {median_ms:4.0f} ms, worst {worst_ms:4.0f} ms, {len(trial.refusals)} failed",
            err=json_output,
        )
    count = sum(len(trial.latencies_s) for trial in trials)
    slow, failed = sum(trial.slow for trial in trials), sum(len(trial.refusals) for trial in trials)
    if json_output:
        rows = [
            {
                "listen": trial.listen,
                "attack": trial.attack,
                "median_ms": round(statistics.median(trial.latencies_s) * 1e3, 1),
                "worst_ms": round(trial.worst_s * 1e3, 1),
                "failed": trial.refusals,
            }
            for trial in trials
        ]
        told = {"bound_ms": BOUND_S * 1e3, "attacks": rows, "stops": count, "slow": slow, "failed": failed}
        typer.echo(json.dumps(told, ensure_ascii=False))
    else:
        typer.echo(f"{count} stops, {failed} failed, {slow} took longer than {BOUND_S * 1e3:.0f} ms")
    raise typer.Exit(EXIT_FAILED if failed or slow * STOPS_OF_A_SLOW_ONE > count else 0)
