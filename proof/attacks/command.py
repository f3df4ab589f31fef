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


def stop(
    json_output: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,
    only: Annotated[str, typer.Option(help="Only attacks whose name or address contains this.")] = "",
    stops: Annotated[int, typer.Option(min=1, help="Stops of a new client, and as many of a connected one.")] = 20,
) -> None:
    """Attack the operator's service in eight ways, and measure the latency of a stop."""
    chosen = [(attack, listen) for listen in LISTENS for attack in ATTACKS if only in attack or only == listen]
    if not chosen:
        raise BadInputError(f"no attack holds {only!r}; attacks: {', '.join(ATTACKS)}; listening: {', '.join(LISTENS)}")
    trials: list[Trial] = []
    for number, (attack, listen) in enumerate(chosen, 1):
        trial = try_attack(attack, listen, stops)
        trials.append(trial)
        median_ms, worst_ms = statistics.median(trial.latencies_s) * 1e3, trial.worst_s * 1e3
        typer.echo(
            f"{number}/{len(chosen)} {'ok ' if trial.is_good else 'BAD'} {listen:<8} {attack:<18} "
            f"median {median_ms:4.0f} ms, worst {worst_ms:4.0f} ms, {len(trial.refusals)} refused",
            err=json_output,
        )
    failed = sum(not trial.is_good for trial in trials)
    if json_output:
        rows = [
            {
                "listen": trial.listen,
                "attack": trial.attack,
                "median_ms": round(statistics.median(trial.latencies_s) * 1e3, 1),
                "worst_ms": round(trial.worst_s * 1e3, 1),
                "refused": trial.refusals,
            }
            for trial in trials
        ]
        typer.echo(json.dumps({"bound_ms": BOUND_S * 1e3, "attacks": rows, "failed": failed}, ensure_ascii=False))
    else:
        typer.echo(f"{len(trials)} attacks, {failed} failed; bound {BOUND_S * 1e3:.0f} ms")
    raise typer.Exit(EXIT_FAILED if failed else 0)
