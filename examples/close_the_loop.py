"""The paper's story in one command, on the fake robot: deploy, log, identify, retrain, deploy again.

    python examples/close_the_loop.py --out loop-output                       # retrains on this machine's CPU
    python examples/close_the_loop.py --out loop-output --identified NEW.onnx --oracle ORACLE.onnx
    python examples/close_the_loop.py --out loop-output --truth harsher       # more friction, less torque and speed

1. *baseline* runs the paper's four command sequences, five times each, on fake robots whose truth it does not know.
2. ``spot-rl sysid`` finds the truth's parameters from those logs.
3. A policy is trained on the identified model, and an oracle on the truth itself, by the same config; a policy that is
   given (``--identified``, ``--oracle``) is taken instead, and the table says so.
4. All three run on the fake robot: highest sustained speed, tracking error, knee torque.

Every step leaves its files in ``--out``; a step whose files are there is not done again.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path

import yaml
from collect_on_fakes import collect_on_fakes
from loop_measures import (
    Deployment,
    knee_shortage,
    knee_torque,
    stairs,
    sustained_speed,
    tracking_error,
)
from loop_picture import write_overlay

from fake_robot.scenario.scenario import load_scenario
from fake_robot.start.process import FakeProcess
from spot_log import Run, read_run
from spot_model.io.velocity_sequence import save_sequence
from spot_model.robot import facts
from trainer.collect.collect_run import Collection

HERE = Path(__file__).resolve().parent
TRUTHS = {"paper": HERE / "loop_paper.yaml", "harsher": HERE / "loop_harsher.yaml"}
PAPERS_RATIO = 5.2 / 3.8


def main() -> None:
    """Run the loop and print its table."""
    options = _options()
    options.out.mkdir(parents=True, exist_ok=True)
    scenario = TRUTHS.get(options.truth, Path(options.truth))
    found = options.out / "sysid"
    if not (found / "identified.yaml").exists() and options.identified is None:
        collect(scenario, options.baseline, options.out, options.runs_at_once)
        words = ["sysid", str(options.out / "logs"), "--policy", str(options.baseline), "--out", str(found)]
        _spot_rl([*words, "--workers", "2"] + (["--resume"] if (found / "search.jsonl").exists() else []))
    policies = {
        "baseline": (options.baseline, "given: trained on the paper's initial model"),
        "identified": trained(options, "identified", found / "identified.yaml"),
        "oracle": trained(options, "oracle", write_truth_model(scenario, options.out / "truth_model.yaml")),
    }
    record_all(scenario, {n: p for n, (p, _) in policies.items()}, options.out / "deploy", options.runs_at_once)
    forwards, table = {}, []
    for name, (policy, origin) in policies.items():
        row, forwards[name] = deploy(scenario, name, policy, origin, options.out / "deploy" / name)
        table.append(row)
    write_overlay(forwards, options.out / "overlay.svg", f"Knees at 4 m/s commanded, truth: {options.truth}")
    text = report(table)
    (options.out / "loop.json").write_text(json.dumps([asdict(row) for row in table], indent=1) + "\n")
    (options.out / "loop.txt").write_text(text + "\n", encoding="utf-8")
    print(text)


def collect(scenario: Path, policy: Path, out: Path, at_once: int) -> None:
    """Record the paper's four sequences five times each; what falls is used as far as it goes."""
    collection = Collection.prepare(policy=policy, folder=out / "logs", sequences="all", repeats=5, other_gains=None)
    left = collect_on_fakes(scenario, collection, out / "fakes", at_once=at_once, say=print)
    if left:
        print(f"{len(left)} of {collection.n_planned} runs did not complete; their logs are used as far as they go")


def trained(options: argparse.Namespace, name: str, model: Path) -> tuple[Path, str]:
    """The policy that was given for ``name``, or one trained on ``model`` now."""
    given: Path | None = getattr(options, name)
    if given is not None:
        return given, f"given: {given}"
    policy = options.out / f"{name}.onnx"
    if not policy.exists():
        run = options.out / f"train-{name}"
        words = ["--resume", str(run)] if run.exists() else ["--config", str(options.config), "--out", str(run)]
        settings = [] if run.exists() else ["--set", f"model={model}", "--set", f"name={name}", *_sets(options.set)]
        _spot_rl(["train", *words, *settings, "--device", options.device])
        _spot_rl(["export", str(run), "--out", str(policy)])
    return policy, f"trained on {model.name} with {options.config.name}"


def write_truth_model(scenario: Path, path: Path) -> Path:
    """The scenario's truth as a model file, with its inertia and its delay, for the oracle."""
    data = yaml.safe_load(scenario.read_text(encoding="utf-8"))
    physics = data["physics"]
    effects = [
        *data["model"]["effects"],
        {"effect": "armature", "joints": ["hips"], "inertia_kg_m2": physics["armature_hip_kg_m2"]},
        {"effect": "armature", "joints": ["knees"], "inertia_kg_m2": physics["armature_knee_kg_m2"]},
        {"effect": "command_delay", "delay_s": facts.TRAINING_COMMAND_DELAY_S},
    ]
    model = {"schema": "spot-rl/model/1", "robot": "spot", "effects": effects}
    path.write_text(yaml.safe_dump(model, sort_keys=False), encoding="utf-8")
    return path


def record_all(scenario: Path, policies: dict[str, Path], folder: Path, at_once: int) -> None:
    """Make all runs that :func:`deploy` looks at, several at a time; their logs do not depend on how many."""
    jobs = [(policy, folder / name, label) for name, policy in policies.items() for label in ("stairs", "forward")]
    with ThreadPoolExecutor(at_once) as pool:
        list(pool.map(lambda job: record(scenario, *job), jobs))


def record(scenario: Path, policy: Path, folder: Path, label: str) -> Run:
    """One run, the forward sequence or the stairs of speeds, on a fresh fake robot; read, where it is there."""
    found = sorted(folder.glob(f"*-{label}-r*.mcap"))
    if not found:
        folder.mkdir(parents=True, exist_ok=True)
        sequence = "forward"
        if label == "stairs":
            sequence = str(folder / "stairs.yaml")
            Path(sequence).unlink(missing_ok=True)
            save_sequence(stairs(), Path(sequence))
        with FakeProcess(scenario=str(scenario), is_lock_step=True) as fake:
            words = ["run", "--robot", fake.address.robot, "--policy", str(policy), "--sequence", sequence]
            words += ["--log-dir", str(folder), "--lock-step", fake.address.admin]
            _spot_rl(words, fake.address.environment, may_fail=True)
        found = sorted(folder.glob(f"*-{label}-r*.mcap"))
    return read_run(found[-1])


def deploy(scenario: Path, name: str, policy: Path, origin: str, folder: Path) -> tuple[Deployment, Run]:
    """How one policy does in the forward sequence and up the stairs of speeds."""
    forward, climb = (record(scenario, policy, folder, label) for label in ("forward", "stairs"))
    speed, commanded = sustained_speed(climb)
    truth = {e.name: e for e in load_scenario(scenario).robot_model.effects}
    row = Deployment(
        policy=name,
        origin=origin,
        sustained_m_s=speed,
        commanded_m_s=commanded,
        tracking_error_m_s=tracking_error(forward),
        knee_torque_nm=knee_torque(forward),
        knee_shortage_nm=knee_shortage(forward, truth["torque_speed_curve"], truth["position_torque_limit"]),
        ends=f"forward {forward.outcome}, stairs {climb.outcome}",
    )
    return row, forward


def report(table: Sequence[Deployment]) -> str:
    """The table, the ratio beside the paper's, and how much of the way to the oracle is covered."""
    rows = {row.policy: row for row in table}
    lines = [
        f"{'policy':<11} {'sustained':>9} {'(asked)':>8} {'error':>9} {'knee rms':>9} {'shortage':>9}  ends; origin"
    ]
    lines += [
        f"{r.policy:<11} {r.sustained_m_s:>5.2f} m/s {r.commanded_m_s:>9.1f} {r.tracking_error_m_s:>5.3f} m/s "
        f"{r.knee_torque_nm:>5.1f} N·m {r.knee_shortage_nm:>5.2f} N·m  {r.ends}; {r.origin}"
        for r in table
    ]
    base, found, oracle = rows["baseline"], rows["identified"], rows["oracle"]
    lines.append(f"identified / oracle   {_ratio(found.sustained_m_s, oracle.sustained_m_s)} of its sustained speed")
    lines.append(
        f"identified / baseline {_ratio(found.sustained_m_s, base.sustained_m_s)} "
        f"(the paper: 5.2 / 3.8 = {PAPERS_RATIO:.2f})"
    )
    for label, key in (
        ("speed", "sustained_m_s"),
        ("tracking error", "tracking_error_m_s"),
        ("knee torque", "knee_torque_nm"),
        ("knee shortage", "knee_shortage_nm"),
    ):
        between = getattr(oracle, key) - getattr(base, key)
        covered = getattr(found, key) - getattr(base, key)
        share = "nothing lies between" if abs(between) < 1e-9 else f"{100.0 * covered / between:.0f} %"
        lines.append(f"from baseline to oracle, {label}: {share} covered (the whole way is {between:+.3f})")
    return "\n".join(lines)


def _ratio(over: float, under: float) -> str:
    return f"{over / under:.3f}" if under > 0.0 else "no number (the other never held a step)"


def _spot_rl(arguments: list[str], environment: dict[str, str] | None = None, *, may_fail: bool = False) -> None:
    print("spot-rl", " ".join(arguments), flush=True)
    command = [sys.executable, "-m", "spot_model", *arguments]
    code = subprocess.run(command, env={**os.environ, **(environment or {})}, check=False).returncode  # noqa: S603
    if code != 0 and not may_fail:
        raise SystemExit(f"spot-rl {arguments[0]} ended with exit code {code}; what went wrong stands above")


def _sets(values: list[str] | None) -> list[str]:
    return [word for value in values or [] for word in ("--set", value)]


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, help="folder of all files; finished steps are kept")
    parser.add_argument("--truth", default="paper", help="paper, harsher, or a scenario file")
    parser.add_argument("--baseline", type=Path, default=Path("policies/baseline.onnx"), help="policy to begin with")
    parser.add_argument(
        "--identified", type=Path, help="policy trained on the identified model; identified and trained if not given"
    )
    parser.add_argument("--oracle", type=Path, help="policy trained on the truth; trained now if not given")
    parser.add_argument(
        "--config", type=Path, default=HERE / "loop" / "train_paper_identified.yaml", help="training config"
    )
    parser.add_argument("--runs-at-once", type=int, default=2, help="logs made at a time")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N, for training")
    parser.add_argument("--set", action="append", help="training override, key.path=value; may repeat")
    return parser.parse_args()


if __name__ == "__main__":
    main()
