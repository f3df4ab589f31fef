"""The trials of a policy, one JSON line each as it is done, then falls over more seeds; needs no plotting library.

Claim: the figures of policies/README.md, and how far they depend on the seed.

    python lab/benchmarks/judge_policy.py fast --seeds 10
"""

from __future__ import annotations

import argparse
import dataclasses
import json

from spot_model.policy.built_in import policy_file
from spot_model.policy.policy import load_policy
from trainer.evaluate import trials
from trainer.evaluate.setting import Setting
from trainer.evaluate.trials import evaluate_setting


def main() -> None:
    """Print every trial, and the falls of each seed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("policy", type=policy_file)
    parser.add_argument("--n", type=int, default=100, help="robots a trial")
    parser.add_argument("--seeds", type=int, default=10, help="seeds of the randomised episodes")
    args = parser.parse_args()

    setting = Setting(policy=load_policy(args.policy))
    for name, figures in evaluate_setting(setting, n=args.n).items():
        print(json.dumps({name: figures}), flush=True)
    high = setting.policy.contract.velocity_command_high[0]
    for seed in range(1, args.seeds):
        other = dataclasses.replace(setting, seed=seed)
        slow = trials.episodes(other, args.n, bottom_m_s=0.0, top_m_s=3.0)
        falls = {"seed": seed, "slow": slow["falls"]}
        if high > 3.0:
            falls["fast"] = trials.episodes(other, args.n, bottom_m_s=3.0, top_m_s=trials.PAPER.v_x_m_s[1])["falls"]
        print(json.dumps(falls), flush=True)


if __name__ == "__main__":
    main()
