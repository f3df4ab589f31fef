"""The paper's story in one command, on the fake robot: deploy, log, identify, retrain, deploy again.

    python examples/close_the_loop.py --out loop-output                       # retrains on this machine's CPU
    python examples/close_the_loop.py --out loop-output --identified NEW.onnx --oracle ORACLE.onnx
    python examples/close_the_loop.py --out loop-output --truth harsher       # more friction, less torque and speed

1. *baseline* runs the paper's four command sequences, five times each, on a fake robot whose truth it does not know.
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
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from plotly.subplots import make_subplots

from spot_model import facts
from spot_model.velocity_sequence import VelocitySequence, Waypoint, save_sequence
from spot_runtime.fake_process import FakeProcess
from spot_runtime.log import Run, read_run

HERE = Path(__file__).resolve().parent
TRUTHS = {"paper": HERE / "loop_paper.yaml", "harsher": HERE / "loop_harsher.yaml"}
SPEEDS_M_S = (3.0, 3.5, 4.0, 4.5, 5.0, 5.5, 6.0, 6.5, 7.0)
HOLD_S = 10.0
MEAN_OVER_S = 5.0


@dataclass(frozen=True)
class Deployment:
    """How one policy did on the fake robot."""

    policy: str
    origin: str
    sustained_m_s: float
    """Highest mean speed over the last 5 s of a ramp held for 10 s, without a fall."""
    tracking_error_m_s: float
    """Mean absolute error of the forward speed over the paper's forward sequence."""
    knee_torque_nm: float
    """Root mean square of the measured knee torques over the forward sequence."""
    falls: int


def main() -> None:
    """Run the loop and print its table."""
    options = _options()
    options.out.mkdir(parents=True, exist_ok=True)
    scenario = TRUTHS.get(options.truth, Path(options.truth))
    logs, found = options.out / "logs", options.out / "sysid"
    if not (found / "identified.yaml").exists():
        collect(scenario, options.baseline, logs)
        _spot_rl(
            ["sysid", str(logs), "--policy", str(options.baseline), "--out", str(found), "--workers", "2"]
            + (["--resume"] if (found / "search.jsonl").exists() else [])
        )
    policies = {
        "baseline": (options.baseline, "given: trained on the paper's initial model"),
        "identified": trained(options, "identified", found / "identified.yaml"),
        "oracle": trained(options, "oracle", write_truth_model(scenario, options.out / "truth_model.yaml")),
    }
    table = [deploy(scenario, name, *policies[name], options.out / "deploy" / name) for name in policies]
    (options.out / "loop.json").write_text(json.dumps([asdict(row) for row in table], indent=1) + "\n")
    write_overlay(options.out / "deploy", options.out / "overlay.html")
    print(report(table))


def collect(scenario: Path, policy: Path, folder: Path) -> None:
    """Record the paper's four sequences five times each."""
    with FakeProcess(scenario=str(scenario), is_lock_step=True) as fake:
        words = ["collect", "--robot", fake.address.robot, "--policy", str(policy), "--out", str(folder)]
        _spot_rl([*words, "--lock-step", fake.address.admin], fake.address.environment)


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


def deploy(scenario: Path, name: str, policy: Path, origin: str, folder: Path) -> Deployment:
    """Run one policy through the forward sequence and through ramps to rising speeds, until it falls or stalls."""
    folder.mkdir(parents=True, exist_ok=True)
    best, falls = 0.0, 0
    with FakeProcess(scenario=str(scenario), is_lock_step=True) as fake:

        def run(sequence: str, label: str) -> Run:
            found = sorted(folder.glob(f"*-{label}-r*.mcap"))
            if not found:
                words = ["run", "--robot", fake.address.robot, "--policy", str(policy), "--sequence", sequence]
                words += ["--log-dir", str(folder), "--lock-step", fake.address.admin]
                _spot_rl(words, fake.address.environment, may_fail=True)
                found = sorted(folder.glob(f"*-{label}-r*.mcap"))
            return read_run(found[-1])

        forward = run("forward", "forward")
        for speed in SPEEDS_M_S:
            label = f"ramp_{speed:g}"
            path = folder / f"{label}.yaml"
            if not path.exists():
                save_sequence(ramp(speed, label), path)
            log = run(str(path), label)
            if log.outcome != "completed":
                falls += 1
                break
            reached = sustained_speed(log)
            if reached < best + 0.02:
                break
            best = reached
    return Deployment(
        policy=name,
        origin=origin,
        sustained_m_s=best,
        tracking_error_m_s=tracking_error(forward),
        knee_torque_nm=knee_torque(forward),
        falls=falls,
    )


def ramp(speed_m_s: float, name: str) -> VelocitySequence:
    """From a standstill at 1 m/s² to a speed, held for ten seconds, and to a stop."""
    top_s = 1.0 + speed_m_s
    points = (
        Waypoint(time_s=0.0),
        Waypoint(time_s=1.0),
        Waypoint(time_s=top_s, v_x_m_s=speed_m_s, ramp=True),
        Waypoint(time_s=top_s + HOLD_S, v_x_m_s=speed_m_s, ramp=True),
        Waypoint(time_s=top_s + HOLD_S + speed_m_s / 2.0, ramp=True),
    )
    return VelocitySequence(name=name, duration_s=points[-1].time_s + 0.5, waypoints=points)


def sustained_speed(run: Run) -> float:
    """Mean forward speed over the last five seconds at the top command."""
    command, speed, time_s = _active(run)
    at_top = np.flatnonzero(command[:, 0] >= command[:, 0].max() - 1e-6)
    end_s = time_s[at_top[-1]]
    return float(speed[(time_s > end_s - MEAN_OVER_S) & (time_s <= end_s)].mean())


def tracking_error(run: Run) -> float:
    """Mean absolute error of the forward speed."""
    command, speed, _ = _active(run)
    return float(np.abs(speed - command[:, 0]).mean())


def knee_torque(run: Run) -> float:
    """Root mean square over the four knees while the policy was active."""
    stamps = run.ticks.robot_stamp_ns[run.ticks.mode == "active"]
    rows = (run.states.robot_stamp_ns >= stamps[0]) & (run.states.robot_stamp_ns <= stamps[-1])
    return float(np.sqrt(np.mean(run.states.load_nm[rows][:, 2::3] ** 2)))


def report(table: Sequence[Deployment]) -> str:
    """The table, the ratio beside the paper's, and how much of the way to the oracle is covered."""
    rows = {row.policy: row for row in table}
    lines = [f"{'policy':<11} {'sustained':>10} {'error':>7} {'knee torque':>12} {'falls':>6}  origin"]
    lines += [
        f"{r.policy:<11} {r.sustained_m_s:>6.2f} m/s {r.tracking_error_m_s:>7.3f} {r.knee_torque_nm:>8.1f} N·m "
        f"{r.falls:>6}  {r.origin}"
        for r in table
    ]
    base, found, oracle = rows["baseline"], rows["identified"], rows["oracle"]
    lines.append(f"identified / oracle   {found.sustained_m_s / oracle.sustained_m_s:.3f} of its sustained speed")
    lines.append(f"identified / baseline {found.sustained_m_s / base.sustained_m_s:.2f} (the paper: 5.2 / 3.8 = 1.37)")
    for label, key in (
        ("speed", "sustained_m_s"),
        ("tracking error", "tracking_error_m_s"),
        ("torque", "knee_torque_nm"),
    ):
        between = getattr(oracle, key) - getattr(base, key)
        covered = getattr(found, key) - getattr(base, key)
        share = "nothing lies between" if abs(between) < 1e-9 else f"{100.0 * covered / between:.0f} %"
        lines.append(f"from baseline to oracle, {label}: {share} covered (the whole way is {between:+.3f})")
    return "\n".join(lines)


def write_overlay(folder: Path, path: Path) -> None:
    """Knee actions and torques of the three policies at the top of the forward sequence, as in the paper's figure."""
    joints = ("fr_kn", "hr_kn")
    titles = [f"{joint} {kind}" for kind in ("action", "torque, N·m") for joint in joints]
    figure = make_subplots(rows=2, cols=2, subplot_titles=titles, shared_xaxes=True)
    for name, colour in (("baseline", "#c06a3d"), ("identified", "#2f7f9e"), ("oracle", "#1c2430")):
        run = read_run(max((folder / name).glob("*-forward-r*.mcap")))
        stamps = run.ticks.robot_stamp_ns[run.ticks.mode == "active"]
        begin = int(stamps[0]) + 12_000_000_000
        for row, (stamp_ns, values) in enumerate(
            ((run.ticks.robot_stamp_ns, run.ticks.action), (run.states.robot_stamp_ns, run.states.load_nm)), start=1
        ):
            shown = (stamp_ns >= begin) & (stamp_ns < begin + 1_500_000_000)
            for column, joint in enumerate(joints, start=1):
                figure.add_scatter(
                    x=(stamp_ns[shown] - begin) * 1e-9,
                    y=values[shown, facts.JOINT_NAMES.index(joint)],
                    name=name,
                    legendgroup=name,
                    showlegend=row == column == 1,
                    line={"color": colour},
                    row=row,
                    col=column,
                )
    figure.update_layout(title="Front and hind right knee at the top of the forward sequence", height=640)
    figure.write_html(path, include_plotlyjs=True)


def _active(run: Run) -> tuple[Any, Any, Any]:
    rows = run.ticks.mode == "active"
    stamps = run.ticks.robot_stamp_ns[rows]
    return run.ticks.velocity_command[rows], run.ticks.observation[rows, 0], (stamps - stamps[0]) * 1e-9


def _spot_rl(arguments: list[str], environment: dict[str, str] | None = None, *, may_fail: bool = False) -> None:
    print("spot-rl", " ".join(arguments), flush=True)
    command = [sys.executable, "-c", "from spot_model.command_line import main; main()", *arguments]
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
        "--identified", type=Path, help="policy trained on the identified model; trained now if not given"
    )
    parser.add_argument("--oracle", type=Path, help="policy trained on the truth; trained now if not given")
    parser.add_argument("--config", type=Path, default=Path("policies/fast.yaml"), help="training config")
    parser.add_argument("--device", default="cpu", help="cpu, cuda or cuda:N, for training")
    parser.add_argument("--set", action="append", help="training override, key.path=value; may repeat")
    return parser.parse_args()


if __name__ == "__main__":
    main()
