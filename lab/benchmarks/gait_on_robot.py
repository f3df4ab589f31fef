"""Walk the default fake robot at each speed through `spot-rl run`, and read the gait back from the log's contacts.

Claim: the table of policies/README.md. The arithmetic here shares nothing with spot_model.robot.gait: it looks at
contacts alone, foot by foot.

    python lab/benchmarks/gait_on_robot.py fast --speeds 0.3,0.5,1,1.5,2,3,4,5,5.5
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from spot_log import Run, read_run
from spot_model.io.velocity_sequence import VelocitySequence, Waypoint, save_sequence
from spot_model.policy.built_in import policy_file
from spot_model.robot.rotation import rotate_inverse_wxyz

Times = NDArray[np.float64]
Contact = NDArray[np.bool_]

PROGRAM = str(Path(sys.executable).with_name("spot-rl"))
HOLD_S, MEASURED_S, RAMP_M_S2 = 8.0, 5.0, 1.0
VOTERS = 7
DIAGONALS, OTHERS = ((0, 3), (1, 2)), ((0, 1), (2, 3), (0, 2), (1, 3))
"""Pairs of feet in the order fl, fr, hl, hr."""


def main() -> None:
    """Print one JSON line a commanded velocity."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policy", type=policy_file)
    parser.add_argument("--speeds", default="0.3,0.5,1,1.5,2,3,4,5,5.5", help="forward, m/s")
    parser.add_argument("--log-dir", type=Path, help="keep the log here")
    parser.add_argument("--log", type=Path, help="measure this log of such a run, make none")
    args = parser.parse_args()

    commands = [(0.0, 0.0, 0.0), (0.0, 0.0, 0.5), (0.5, 0.0, 0.5)]
    commands += [(float(v), 0.0, 0.0) for v in args.speeds.split(",")]
    with tempfile.TemporaryDirectory() as folder:
        run = read_run(args.log or record(args.policy, staircase(commands), Path(folder), args.log_dir))
    for command in commands:
        print(json.dumps(measured(run, command)), flush=True)


def staircase(commands: list[tuple[float, float, float]]) -> VelocitySequence:
    """Each command held, reached by a ramp."""
    at, before, waypoints = 0.0, (0.0, 0.0, 0.0), []
    for command in commands:
        if waypoints:
            at += max(1.0, abs(command[0] - before[0]) / RAMP_M_S2)
        for time_s, ramp in ((at, bool(waypoints)), (at + HOLD_S, False)):
            v_x, v_y, yaw = command
            waypoints.append(Waypoint(time_s=time_s, v_x_m_s=v_x, v_y_m_s=v_y, yaw_rate_rad_s=yaw, ramp=ramp))
        at, before = at + HOLD_S, command
    return VelocitySequence(name="gaits", duration_s=at, waypoints=tuple(waypoints))


def record(policy: Path, sequence: VelocitySequence, folder: Path, log_dir: Path | None) -> Path:
    """One run in lock-step; the path of its log."""
    logs, admin = log_dir or folder / "logs", f"unix:{folder}/admin.sock"
    save_sequence(sequence, folder / "gaits.yaml")
    run = [PROGRAM, "run", "--robot", "HOST", "--lock-step", admin, "--policy", str(policy)]
    run += ["--sequence", str(folder / "gaits.yaml"), "--duration", str(sequence.duration_s), "--log-dir", str(logs)]
    subprocess.run(  # noqa: S603 - our own words
        [PROGRAM, "fake-robot", "--lock-step", "--admin", admin, "exec", "--", *run],
        check=True,
        stdout=sys.stderr,
    )
    return max(logs.glob("*.mcap"), key=lambda path: path.stat().st_mtime)


def measured(run: Run, command: tuple[float, float, float]) -> dict[str, object]:
    """Figures of the last seconds in which a command was held."""
    held = np.flatnonzero(
        (np.abs(run.ticks.velocity_command - command).max(axis=-1) < 1e-6) & (run.ticks.mode == "active")
    )
    if len(held) < 50:
        return {"command": command, "gait": "not reached: the run had ended"}
    end = run.ticks.robot_stamp_ns[held[-1]]
    states = run.states.rows((run.states.robot_stamp_ns > end - MEASURED_S * 1e9) & (run.states.robot_stamp_ns <= end))
    down, time_s = states.foot_contact, 1e-9 * (states.robot_stamp_ns - states.robot_stamp_ns[0])
    velocity = rotate_inverse_wxyz(states.odom_from_body_wxyz, states.linear_vel_of_body_in_odom_m_s).mean(axis=0)
    landings = [landing_times(time_s, down[:, foot]) for foot in range(4)]
    strides = np.concatenate([np.diff(times) for times in landings])
    figures: dict[str, object] = {
        "command": command,
        "velocity": [
            round(float(v), 3) for v in (*velocity[:2], states.angular_vel_of_body_in_odom_rad_s[:, 2].mean())
        ],
        "flight": round(float((~down).all(axis=-1).mean()), 3),
        "diagonals": round(min(agreement(down, pair) for pair in DIAGONALS), 3),
        "others": round(max(agreement(down, pair) for pair in OTHERS), 3),
        "duty": [round(float(share), 2) for share in down.mean(axis=0)],
    }
    if len(strides):
        stride_s = float(np.median(strides))
        within = [abs(lag(landings[a], landings[b], stride_s)) for a, b in DIAGONALS]
        figures |= {"strides_per_s": round(1.0 / stride_s, 2), "within_a_diagonal": round(max(within), 3)}
        figures |= {"between_diagonals": round(lag(landings[0], landings[1], stride_s) % 1.0, 3)}
    return figures


def agreement(down: Contact, pair: tuple[int, int]) -> float:
    """Share of time in which two feet are both up or both down."""
    return float((down[:, pair[0]] == down[:, pair[1]]).mean())


def landing_times(time_s: Times, down: Contact) -> Times:
    """When a foot touches down, by the majority of the 21 ms around each state: scuffs and bounces are no landings."""
    votes = np.convolve(down.astype(int), np.ones(VOTERS, dtype=int), mode="same")
    stands = votes > VOTERS // 2
    return time_s[1:][~stands[:-1] & stands[1:]]


def lag(first: Times, second: Times, stride_s: float) -> float:
    """How far the second foot lands after the first, in strides, -0.5 to 0.5: the circular mean."""
    behind = [second[np.abs(second - time).argmin()] - time for time in first if len(second)]
    angle = 2j * np.pi * np.array(behind) / stride_s
    return float(np.angle(np.exp(angle).mean()) / (2 * np.pi)) if behind else float("nan")


if __name__ == "__main__":
    main()
