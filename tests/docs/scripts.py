"""How small each script is run that a page names; and which is not run, and why.

``test_scripts.py`` runs them. What takes more than some seconds of CPU time, or runs in real time, is ``WEEKLY``: it
runs where ``SPOT_RL_WEEKLY`` is set, as ``.ci/weekly`` does.
"""

from __future__ import annotations

import re
from typing import Final

SCRIPT: Final = re.compile(r"(?<![\w./-])(?:benchmarks|deploy|examples|scripts|tests/fuzz)/[\w/]+\.(?:py|sh|ipynb)\b")
"""A script's name in a page or a command."""

SMALL: dict[str, tuple[str, ...]] = {
    "benchmarks/gait_figures.py": ("walk --speeds 0.5",),
    "benchmarks/log_damage.py": ("LOG 5",),
    "benchmarks/solver_options.py": ("--policy walk --rounds 1 --robots 4",),
    "scripts/draw_effects.py": ("",),
}
"""Script, and the words after it in each of its runs; ``LOG`` stands for a log of a short walk."""

WEEKLY: dict[str, tuple[str, ...]] = {
    "benchmarks/start_up.py": ("2",),
    "benchmarks/conformance_errors.py": ("body_velocity_negated",),
    "benchmarks/claims/loop.py": ("--seconds 2 --plain",),
    "benchmarks/claims/fakes.py": ("--seconds 1 --most 2",),
    "benchmarks/calibrate_diagnosis.py": ("robots --seed 1 --to 1 --out clean --workers 1",),
    "benchmarks/check_experiments.py": ("--policy walk --robots 2 --only squat",),
    "benchmarks/claims/identification.py": ("--generations 1 --seconds 6",),
    "benchmarks/claims/training.py": ("--envs 16",),
    "benchmarks/gait_on_robot.py": ("walk --speeds 0.5",),
    "benchmarks/has_it_changed.py": ("robots --seed 71 --to 1 --workers 1 --out changed", "score changed"),
    "benchmarks/identify_fake.py": ("--out found --truth 0 --policy walk --repeats 1 --config short.yaml",),
    "benchmarks/identify_session.sh": (
        "run small --truth 0 --policy walk --sequences ahead.yaml --repeats 1 --config short.yaml",
    ),
    "benchmarks/loop_parts.py": ("--seconds 2",),
    "benchmarks/judge_policy.py": ("walk --n 2 --seeds 2",),
    "benchmarks/next_withheld.py": ("--seed 31 --robots 1 --out next",),
    "benchmarks/substitution.py": ("robots --seed 777301 --to 1 --out parts", "table parts"),
    "benchmarks/withheld_fake.py": ("--work found --policy walk --repeats 1",),
    "examples/record_more.py": ("more",),
    "examples/close_the_loop.py": ("--robot torque_lag --out loop --improved walk --oracle walk",),
    "examples/has_it_changed.py": ("changed --weeks 3 --repeats 1",),
    "examples/hidden_friction.py": ("hidden_friction",),
}

ELSEWHERE: dict[str, tuple[str, str]] = {
    "benchmarks/claims/diagnosis_peers.py": ("diagnosis/test_peers.py", "script.table("),
    "benchmarks/claims/log.py": ("spot_runtime/test_bench_all.py", '("log", "--seconds 0.1 --minutes 0.02")'),
    "benchmarks/claims/pace.py": ("trainer/test_identification_peers.py", "pace.Simulator("),
    "benchmarks/claims/size.py": ("spot_runtime/test_bench_all.py", '("size", "")'),
    "benchmarks/inference_pace.py": ("docs/test_apart.py", "inference_pace.py --seconds 5 --seconds 0.1"),
    "benchmarks/loop_lock_step.py": ("docs/test_apart.py", "loop_lock_step.py 1"),
    "deploy/build_wheelhouse.py": ("docs/test_installing.py", "build_wheelhouse.py --python 3.10"),
    "examples/learn_rsl_rl.py": ("spot_rl/test_environments.py", '("rsl_rl", "rsl_rl")'),
    "examples/learn_sb3.py": ("spot_rl/test_environments.py", '("sb3", "stable_baselines3")'),
    "examples/learn_skrl.py": ("spot_rl/test_environments.py", '("skrl", "skrl")'),
    "examples/oil_drag.py": ("diagnosis/test_chosen_library.py", '"oil_drag:OilDrag"'),
    "examples/tour.ipynb": ("spot_rl/test_tour.py", "tour.ipynb"),
    "scripts/run_notebook.py": ("spot_rl/test_tour.py", '"scripts" / "run_notebook.py"'),
    "tests/fuzz/run.py": ("docs/test_in_a_clone.py", "tests/fuzz/run.py config -runs=10"),
}
"""Script, the test that runs it or what it calls, and its words there."""

BY_CI: dict[str, str] = {
    "scripts/safety_core.py": "make safety",
    "scripts/write_docs.py": "make check",
}
"""Script, and the line of ``.ci/run`` that runs it."""

NOT_RUN: dict[str, str] = {
    "benchmarks/gpu_parity.py": "needs an NVIDIA GPU",
    "benchmarks/mjlab_speed.py": "needs mjlab, in an environment of its own",
    "benchmarks/mujoco_sysid.py": "needs mujoco's extra sysid, which is not among this project's packages",
    "benchmarks/withheld_share.py": "needs a folder of packed wheels, and so a network",
    "deploy/check_wheels.py": "needs a network: it asks the package index",
    "scripts/draw_pictures.py": "needs Chromium, and pages that take commands minutes to write",
    "scripts/try_systemd.py": "needs root, and makes a container",
}
"""Script, and why nothing runs it: what it takes from this project's packages is looked for all the same."""

LEDGER: Final = {**SMALL, **WEEKLY, **ELSEWHERE, **BY_CI, **NOT_RUN}
"""All of them."""
