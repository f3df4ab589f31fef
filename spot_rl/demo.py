"""Walk a fake Spot, log it, and show the result."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from spot_model.console.command_registry import PolicyFile, ScenarioName
from spot_model.errors import BadInputError, SpotRlError
from spot_model.policy.built_in import WALK
from spot_model.process.child_process import module_command
from spot_model.process.signals import run_in_foreground

if TYPE_CHECKING:
    from fake_robot.start.process import FakeAddress


class DemoError(SpotRlError):
    """The demo's run did not complete."""

    exit_code = 93


def demo(
    policy: PolicyFile = WALK,
    out: Annotated[Path, typer.Option(help="Folder of the log and the page.")] = Path("demo-output"),
    scenario: ScenarioName = "default",
    top_speed: Annotated[
        float, typer.Option(min=0.0, max=5.0, help="Top speed of the sequence, m/s; 0: the policy's own.")
    ] = 0.0,
    real_time: Annotated[
        bool, typer.Option("--real-time", help="Run in real time instead of lock-step; needs an idle computer.")
    ] = False,
) -> None:
    """Walk a fake Spot through the forward sequence; write a log, a summary and a page of plots."""
    from fake_robot.start.process import FakeProcess
    from spot_log import read_run
    from spot_log.page.page import write_page
    from spot_log.page.summary import summarise
    from spot_model.io.velocity_sequence import forward_sequence, save_sequence
    from spot_model.policy.policy import load_policy

    began_s = time.monotonic()
    contract = load_policy(policy).contract
    speed_m_s = min(contract.velocity_command_high[0], top_speed or float("inf"))
    if speed_m_s <= 0.0:
        raise BadInputError(f"policy {policy} takes no forward speed (its highest is {speed_m_s} m/s); give another")
    folder = out / time.strftime("%Y%m%d-%H%M%S")
    folder.mkdir(parents=True, exist_ok=False)
    sequence = folder / "sequence.yaml"
    save_sequence(forward_sequence(speed_m_s).model_copy(update={"name": f"forward_{speed_m_s:g}"}), sequence)
    _say(began_s, f"starting a fake Spot (scenario {scenario}) in a process of its own")
    pace = "in real time (30 s)" if real_time else "in lock-step (25 s of robot time, as fast as this computer can)"
    with FakeProcess(scenario=scenario, is_lock_step=not real_time, fifo_priority=30 if real_time else 0) as fake:
        _say(began_s, f"walking forward up to {speed_m_s:g} m/s, {pace}")
        _walk(fake.address, policy, sequence, folder, [] if real_time else ["--lock-step", fake.address.admin])
    (log,) = folder.glob("*.mcap")
    _say(began_s, "reading the log")
    run = read_run(log)
    typer.echo("\n" + summarise(run) + "\n")
    _say(began_s, "drawing the page")
    page = folder / "report.html"
    write_page(run, page)
    _say(began_s, "done")
    typer.echo(f"log   {log}\npage  {page}")


def _walk(address: FakeAddress, policy: Path, sequence: Path, folder: Path, more: list[str]) -> None:
    words = ["run", "--robot", address.robot, "--policy", str(policy), "--sequence", str(sequence)]
    words += ["--log-dir", str(folder), "--label", "purpose=demo", *more]
    command = module_command("spot_model", *words)
    code, is_interrupted = run_in_foreground(command, {**os.environ, **address.environment})
    if is_interrupted:
        raise KeyboardInterrupt
    if code != 0:
        slow = "" if more else "; on a slow or busy computer, leave out --real-time"
        raise DemoError(f"the run ended with exit code {code}, for the reason above; its log is in {folder}{slow}")


def _say(began_s: float, text: str) -> None:
    typer.echo(f"[{time.monotonic() - began_s:5.1f} s] {text}", err=True)
