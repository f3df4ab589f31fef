"""What one inference costs at the pace at which it is needed: docs/evidence/loop.md has it.

    python lab/benchmarks/inference_pace.py [--policy walk] [--seconds 10] [--provider CPUExecutionProvider]

Claim: at 50 Hz the policy takes well under a hundredth of its period on one CPU thread.
"""

from __future__ import annotations

import argparse
import json
import os
import time

import numpy as np
import onnxruntime

from spot_model.policy.built_in import policy_file
from spot_model.policy.contract import INPUT_NAME, OUTPUT_NAME
from spot_model.policy.observation import N_OBSERVATION

PERIOD_S = 0.02


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--policy", type=policy_file, default="walk")
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--provider", default="CPUExecutionProvider")
    parser.add_argument("--fifo", type=int, default=0, help="SCHED_FIFO priority; 0: none")
    chosen = parser.parse_args()
    if chosen.provider not in onnxruntime.get_available_providers():
        raise SystemExit(f"{chosen.provider} is not here; there are {onnxruntime.get_available_providers()}")
    if chosen.fifo:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(chosen.fifo))
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(str(chosen.policy), options, providers=[chosen.provider])
    rng = np.random.default_rng(1)
    batches = rng.normal(size=(64, 1, N_OBSERVATION)).astype(np.float32)

    def run(i: int) -> float:
        begin_s = time.perf_counter()
        session.run([OUTPUT_NAME], {INPUT_NAME: batches[i % len(batches)]})
        return time.perf_counter() - begin_s

    hot_s = [run(i) for i in range(2000)][500:]
    paced_s = []
    begin_s = time.monotonic()
    for i in range(round(chosen.seconds / PERIOD_S)):
        time.sleep(max(0.0, begin_s + i * PERIOD_S - time.monotonic()))
        paced_s.append(run(i))
    figures = {
        name: dict(zip(("p50_us", "p99_us"), (np.percentile(values, (50, 99)) * 1e6).round(1).tolist(), strict=True))
        for name, values in (("hot", hot_s), ("at_50_hz", paced_s))
    }
    print(json.dumps({"provider": chosen.provider, **figures}))


if __name__ == "__main__":
    main()
