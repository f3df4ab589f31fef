"""One attack on one service: attackers in processes of their own, and an operator who stops the robot meanwhile."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Literal

from proof.attacks.certificates import LOOPBACK, Authority, role
from spot_model.errors import SpotRlError
from spot_model.io.child_process import HEARD, ChildProcess
from spot_protos import operator_pb2
from spot_tools.client.client import OperatorClient

Listen = Literal["unix", "loopback", "tls"]
LISTENS: Final[tuple[Listen, ...]] = ("unix", "loopback", "tls")
BOUND_S: Final = 0.5
PAUSE_S: Final = 0.1
TIMEOUT_S: Final = 10.0


@dataclass
class Trial:
    """What came of one attack."""

    attack: str
    listen: Listen
    latencies_s: list[float] = field(default_factory=list)
    """From the call to its answer: from a new client and from one that was connected before, in turn."""
    refusals: list[str] = field(default_factory=list)

    @property
    def worst_s(self) -> float:
        """The longest that a stop took."""
        return max(self.latencies_s, default=float("inf"))

    @property
    def slow(self) -> int:
        """Stops that took longer than the bound."""
        return sum(latency_s > BOUND_S for latency_s in self.latencies_s)


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
