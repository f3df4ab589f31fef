"""``spot-rl bench all``: every comparison that needs no accelerator, in rounds, so that peers share all conditions."""

from __future__ import annotations

import json
import os
import platform
import shlex
import subprocess
import sys
import time
from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from statistics import median
from typing import Annotated, Any, Final

import typer
from pydantic import ConfigDict, Field, TypeAdapter
from pydantic.dataclasses import dataclass

from proof.result_file import ResultFile
from spot_model.console.command_registry import AsJson
from spot_model.console.progress import Progress
from spot_model.errors import BadInputError, SpotRlError
from spot_model.io.yaml_text import read_yaml
from spot_model.process.child_process import module_command
from spot_model.process.inherited import environment_as_inherited
from spot_model.process.signals import exit_on_termination
from spot_model.version import software_revision

BENCHMARKS: Final = Path("lab/benchmarks")

Parts = dict[tuple[str, int], dict[str, Any]]
"""What each script printed, by claim and repeat."""


Bound = Annotated[str, Field(pattern=r"^(([<>]=) [\d.]+)?$")]
"""``>= 4``, or with ``<=``."""


class ScriptError(SpotRlError):
    """A script of a claim failed; the message holds its last words."""

    exit_code = 92


class RegressionError(SpotRlError):
    """A ratio lies beyond its guard; the message names it."""

    exit_code = 93


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Ratio:
    """Two figures of one run, the first over the second; figures are named by their path in the script's object."""

    over: str
    under: str = ""
    """Empty: the figure by itself."""
    asked: Bound = ""
    """The target; empty: nothing is asked."""
    guard: Bound = ""
    """Beyond this the ratio is a regression, on any computer; empty: it is not guarded."""


@dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class Claim:
    """One script's measurement, as ``lab/benchmarks/claims.yaml`` describes it."""

    script: str
    """Below ``lab/benchmarks``, with its arguments."""
    expected_s: float
    """Expected time of one repeat on two idle cores, s; the time left follows from it."""
    ratios: dict[str, Ratio] = field(default_factory=dict)
    repeats: int = 3

    @property
    def is_guarded(self) -> bool:
        """Whether one of its ratios has a guard."""
        return any(ratio.guard for ratio in self.ratios.values())


def read_claims(folder: Path = BENCHMARKS) -> dict[str, Claim]:
    """The claims of a folder of scripts.

    Raises:
        BadInputError: There is no such folder.
    """
    if not folder.is_dir():
        raise BadInputError(f"there is no folder {folder}: run this in the folder of the project's sources")
    return TypeAdapter(dict[str, Claim]).validate_python(read_yaml(folder / "claims.yaml", "list of claims"))


def all_claims(
    out: Annotated[Path, typer.Option(help="File of the results, a line each; an existing one is continued.")] = Path(
        "bench-all.jsonl"
    ),
    as_json: AsJson = False,
    only: Annotated[list[str] | None, typer.Option(help="Name of a claim, or its beginning; repeatable.")] = None,
    repeats: Annotated[int, typer.Option(min=0, max=100, help="Repeats of each claim; 0: its default.")] = 0,
    guard: Annotated[bool, typer.Option("--guard", help="Guarded claims alone; fail at a regression.")] = False,
) -> None:
    """Measure every claim against its alternatives; run it in the project's folder."""
    claims = read_claims()
    for word in only or []:
        if not any(name.startswith(word) for name in claims):
            raise BadInputError(f"there is no claim {word!r}; there are {', '.join(map(repr, claims))}")
    claims = {
        name: claim
        for name, claim in claims.items()
        if (not only or name.startswith(tuple(only))) and (not guard or claim.is_guarded)
    }
    if not claims:
        raise BadInputError("none of these claims has a guard; leave out --guard, or name others")
    file = ResultFile(out, head())
    parts: Parts = {(part["claim"], part["repeat"]): part["told"] for part in file.earlier}
    # In rounds: each claim once, then each once more.
    wanted = [
        (name, repeat)
        for repeat in range(max(repeats or claim.repeats for claim in claims.values()))
        for name, claim in claims.items()
        if repeat < (repeats or claim.repeats)
    ]
    left = [part for part in wanted if part not in parts]
    total_s = round(sum(claims[name].expected_s for name, _ in wanted))
    failed: dict[str, str] = {}
    done_s = total_s - round(sum(claims[name].expected_s for name, _ in left))
    with exit_on_termination(), Progress("seconds of work", total_s, done=done_s) as progress:
        for name, repeat in left:
            progress.update(done_s, f"{name}, repeat {repeat + 1}", is_told=True)
            done_s += round(claims[name].expected_s)
            begin_s = time.monotonic()
            try:
                told = run_script(claims[name].script)
            except ScriptError as error:
                failed[name] = str(error)
                progress.update(done_s, str(error), is_told=True)
                continue
            parts[name, repeat] = {**told, "script_took_s": round(time.monotonic() - begin_s, 1)}
            file.add({"claim": name, "repeat": repeat, "told": parts[name, repeat]})
    result = {**summary(claims, parts), "failed": failed}
    typer.echo(json.dumps(result, ensure_ascii=False) if as_json else table(result))
    if failed:
        raise ScriptError(f"{', '.join(failed)}: a script failed, see above; the same command measures what is missing")
    broken = broken_guards(result)
    if guard and broken:
        raise RegressionError("; ".join(broken))


def head() -> dict[str, Any]:
    """What was measured, and where."""
    return {
        "revision": software_revision(),
        "python": platform.python_version(),
        "machine": platform.machine(),
        "cpus": len(os.sched_getaffinity(0)),
    }


def run_script(script: str) -> dict[str, Any]:
    """Run one script and take the object that it prints.

    Raises:
        ScriptError: It fails, or prints something else.
    """
    words = shlex.split(script)
    own = [sys.executable, str(BENCHMARKS / words[0]), *words[1:]]
    command = module_command("spot_model", *words[1:]) if words[0] == "spot-rl" else own
    paths = os.pathsep.join((str(Path.cwd()), os.environ.get("PYTHONPATH", "")))
    environment = {**environment_as_inherited(os.environ), "PYTHONPATH": paths}
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=environment)  # noqa: S603
    try:
        if done.returncode == 0:
            told: dict[str, Any] = json.loads(done.stdout)
            return told
    except ValueError:
        pass
    last = "\n".join((done.stdout + done.stderr).splitlines()[-8:])
    raise ScriptError(f"{script} ended with exit code {done.returncode}; run it by itself:\n{last}")


def summary(claims: Mapping[str, Claim], parts: Parts) -> dict[str, Any]:
    """Medians and spread of every figure and ratio over the repeats."""
    told: dict[str, Any] = {**head(), "claims": {}}
    for name, claim in claims.items():
        repeats = [flat(told) for (of, _), told in sorted(parts.items()) if of == name]
        told["claims"][name] = {
            "script": claim.script,
            "repeats": len(repeats),
            "ratios": {label: judge_ratio(ratio, repeats) for label, ratio in claim.ratios.items()},
            "figures": {key: spread([r[key] for r in repeats if key in r]) for key in repeats[0]} if repeats else {},
        }
    return told


def flat(told: Mapping[str, Any], before: str = "") -> dict[str, float]:
    """Numbers of a nested object, by path."""
    found: dict[str, float] = {}
    for key, value in told.items():
        if isinstance(value, Mapping):
            found |= flat(value, f"{before}{key}.")
        elif isinstance(value, (int, float)):
            found[before + key] = float(value)
    return found


def judge_ratio(ratio: Ratio, repeats: list[dict[str, float]]) -> dict[str, Any]:
    """A ratio within each repeat, its median and spread, and whether the median is as asked and keeps its guard."""
    values = [r[ratio.over] / (r[ratio.under] if ratio.under else 1.0) for r in repeats]
    if not values:
        return {}
    found: dict[str, Any] = spread(values)
    for key, bound, verdict in (("asked", ratio.asked, "holds"), ("guard", ratio.guard, "is_guard_kept")):
        if bound:
            found |= {key: bound, verdict: is_within(found["median"], bound)}
    return found


def is_within(value: float, bound: str) -> bool:
    """Whether a value keeps a bound such as ``<= 2``."""
    sign, number = bound.split()
    return value <= float(number) if sign == "<=" else value >= float(number)


def broken_guards(result: Mapping[str, Any]) -> list[str]:
    """Ratios of a summary that lie beyond their guards, in words."""
    return [
        f"{name}: {label} is {found['median']:g}, guarded at {found['guard']}"
        for name, claim in result["claims"].items()
        for label, found in claim["ratios"].items()
        if not found.get("is_guard_kept", True)
    ]


def spread(values: list[float]) -> dict[str, float]:
    """Median, lowest and highest."""
    low, high = min(values), max(values)
    return {name: float(f"{value:.4g}") for name, value in (("median", median(values)), ("low", low), ("high", high))}


def table(result: Mapping[str, Any]) -> str:
    """Ratios for a person, a line each."""
    lines = []
    for name, claim in result["claims"].items():
        lines.append(f"{name}: {claim['script']}, {claim['repeats']} repeats")
        for label, found in claim["ratios"].items():
            if not found:
                continue
            verdict = "" if "asked" not in found else f"  asked {found['asked']}: {'yes' if found['holds'] else 'NO'}"
            lines.append(f"  {label:<48} {found['median']:g} ({found['low']:g} to {found['high']:g}){verdict}")
    return "\n".join(lines)
