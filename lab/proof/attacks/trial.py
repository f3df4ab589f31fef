"""How soon a stop gets through while clients in processes of their own attack the operator's service."""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Final, Literal

import typer

from proof.attacks.attackers import ATTACKS
from proof.attacks.certificates import LOOPBACK, Authority, role
from spot_model.console.command_registry import AsJson
from spot_model.errors import BadInputError, SpotRlError
from spot_model.process.child_process import HEARD, ChildProcess
from spot_protos import operator_pb2
from spot_tools.client import OperatorClient

Listen = Literal["unix", "loopback", "tls"]
LISTENS: Final[tuple[Listen, ...]] = ("unix", "loopback", "tls")
BOUND_S: Final = 0.5
PAUSE_S: Final = 0.1
TIMEOUT_S: Final = 10.0
EXIT_FAILED: Final = 1
STOPS_OF_A_SLOW_ONE: Final = 1000


@dataclass
class Trial:
    """What came of one attack."""

    attack: str
    listen: Listen
    latencies_s: list[float] = field(default_factory=list)
    """From the call to its answer: from a new client and from one that was connected before, in turn."""
    refusals: list[str] = field(default_factory=list)

    @property
    def slow(self) -> int:
        """Stops that took longer than the bound."""
        return sum(latency_s > BOUND_S for latency_s in self.latencies_s)

    def figures(self) -> dict[str, Any]:
        """The figures as JSON values."""
        median_s, worst_s = statistics.median(self.latencies_s), max(self.latencies_s)
        times = {"median_ms": round(median_s * 1e3, 1), "worst_ms": round(worst_s * 1e3, 1)}
        return {"listen": self.listen, "attack": self.attack, **times, "failed": self.refusals}


def stop(
    as_json: AsJson = False,
    only: Annotated[str, typer.Option(help="Only attacks whose name or address contains this.")] = "",
    stops: Annotated[int, typer.Option(min=1, help="Stops of a new client, and as many of a connected one.")] = 20,
) -> None:
    """Attack the operator's service in many ways: no stop may fail, and one in a thousand may take more than 0.5 s."""
    chosen = [(attack, listen) for listen in LISTENS for attack in ATTACKS if only in attack or only == listen]
    if not chosen:
        raise BadInputError(f"no attack holds {only!r}; attacks: {', '.join(ATTACKS)}; listening: {', '.join(LISTENS)}")
    trials: list[Trial] = []
    for number, (attack, listen) in enumerate(chosen, 1):
        trials.append(trial := try_attack(attack, listen, stops))
        told = trial.figures()
        typer.echo(
            f"{number}/{len(chosen)} {'BAD' if trial.refusals or trial.slow else 'ok '} {listen:<8} {attack:<18} "
            f"median {told['median_ms']:4.0f} ms, worst {told['worst_ms']:4.0f} ms, {len(trial.refusals)} failed",
            err=as_json,
        )
    count = sum(len(trial.latencies_s) for trial in trials)
    slow, failed = sum(trial.slow for trial in trials), sum(len(trial.refusals) for trial in trials)
    if as_json:
        attacks = [trial.figures() for trial in trials]
        told = {"bound_ms": BOUND_S * 1e3, "attacks": attacks, "stops": count, "slow": slow, "failed": failed}
        typer.echo(json.dumps(told, ensure_ascii=False))
    else:
        typer.echo(f"{count} stops, {failed} failed, {slow} took longer than {BOUND_S * 1e3:.0f} ms")
    raise typer.Exit(EXIT_FAILED if failed or slow * STOPS_OF_A_SLOW_ONE > count else 0)


@dataclass
class _Service:
    address: str
    operator: dict[str, Path]
    attackers: list[list[str]]
    """What each is given: over TLS a certificate without a role, and one of somebody who may only look."""


def try_attack(attack: str, listen: Listen, stops: int) -> Trial:
    """Stop ``2 * stops`` times under an attack."""
    trial = Trial(attack, listen)
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="spot-rl-attack-")))
        service = stack.enter_context(_serving(listen, folder))
        kept = stack.enter_context(OperatorClient(service.address, **service.operator))
        kept.call("Stop", operator_pb2.StopRequest(), TIMEOUT_S)
        for attacker in service.attackers:
            stack.enter_context(_child("proof.attacks.attackers", attack, service.address, *attacker))
        for _ in range(stops):
            with OperatorClient(service.address, **service.operator) as new:
                _stop(new, trial)
            _stop(kept, trial)
            time.sleep(PAUSE_S)
    return trial


def _stop(client: OperatorClient, trial: Trial) -> None:
    began_s = time.monotonic()
    try:
        client.call("Stop", operator_pb2.StopRequest(), TIMEOUT_S)
    except SpotRlError as error:
        trial.refusals.append(str(error))
    trial.latencies_s.append(time.monotonic() - began_s)


@contextmanager
def _serving(listen: Listen, folder: Path) -> Iterator[_Service]:
    words = [f"unix:{folder}/operator.sock" if listen == "unix" else "127.0.0.1:0"]
    operator: dict[str, Path] = {}
    attackers: list[list[str]] = [[], []]
    if listen == "tls":
        authority = Authority(folder, "authority")
        words += [str(path) for path in authority.sign("robot", LOOPBACK)] + [str(authority.file)]
        certificate, key = authority.sign("otto", role("observe"))
        operator = {"ca": authority.file, "certificate": certificate, "key": key}
        pairs = (authority.sign("mallory"), authority.sign("eve", role("observe")))
        attackers = [[str(path) for path in (authority.file, *pair)] for pair in pairs]
    with _child("proof.attacks.target", *words) as address:
        yield _Service(address, operator, attackers)


@contextmanager
def _child(module: str, *words: str) -> Iterator[str]:
    """A process while it is needed. Yields its first line."""
    process = ChildProcess.start(module, *words, output=HEARD)
    try:
        yield process.output.readline().decode().strip()
    finally:
        process.end(0.0)
