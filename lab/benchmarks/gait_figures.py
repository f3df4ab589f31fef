"""What a policy's gait is at each speed, on the CPU plant: a line a speed, quick enough to end a training with.

Claim: the gait figures of docs/evidence/training.md.

    python lab/benchmarks/gait_figures.py walk --speeds 0.3,0.5,1,1.5
"""

from __future__ import annotations

import argparse
import json

import numpy as np

from spot_model.io.model_file import load_model
from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import load_policy
from spot_model.robot.mjcf import MjcfOptions
from trainer.evaluate.setting import Setting
from trainer.simulate.walks import record_walks

MASS_TIMES_GRAVITY_N = 31.6 * 9.81


def main() -> None:
    """Print one JSON line a commanded speed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policy", type=policy_file)
    parser.add_argument("--model", default="paper_identified")
    parser.add_argument("--timestep", type=float, default=0.005)
    parser.add_argument("--integrator", default="Euler")
    parser.add_argument("--speeds", default="0.3,0.5,1,1.5,2,3,4,5,5.5")
    args = parser.parse_args()

    mjcf = MjcfOptions(timestep_s=args.timestep, integrator=args.integrator)
    setting = Setting(policy=load_policy(args.policy), model=load_model(args.model), mjcf=mjcf)
    speeds = [float(s) for s in args.speeds.split(",")]
    target = np.array([[v, 0.0, 0.0] for v in speeds] + [[0.5, 0.0, 0.5], [0.0, 0.0, 0.0], [0.0, 0.0, 0.5]])
    rate = setting.policy.contract.rate_hz
    recording = record_walks(
        setting.policy, setting.plant(len(target)), lambda k: target * min(1.0, k / (4.0 * rate)), round(10.0 * rate)
    )
    span = recording.ticks(6.0, 10.0)
    velocity = recording.mean_velocity(span)
    for i, command in enumerate(target):
        figures = recording.gait(span, i)
        power = float(recording.power_w[span, i].mean())
        line = {
            "command": command.tolist(),
            "velocity": np.round(velocity[i], 2).tolist(),
            "fell": not bool(recording.survived[i]),
            **{k: figures[k] for k in ("gait", "clarity", "stride_hz", "flight_share", "diagonals_agree")},
            **{k: figures[k] for k in ("others_agree", "duty_factors", "phases", "touchdown_m_s")},
            "cost_of_transport": round(power / (MASS_TIMES_GRAVITY_N * max(0.05, abs(float(velocity[i, 0])))), 3),
        }
        print(json.dumps(line), flush=True)


if __name__ == "__main__":
    main()
