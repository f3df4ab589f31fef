"""Which command of the pages is tried by what, where its block is not simply run; and which is not run, and why.

A command that stands in no marked block, is run by no test that says so with :func:`runs` and is in none of these
tables fails ``test_every_command.py``: so does one that stands here and on no page.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

RUN_APART: dict[str, str] = {}
"""Command, and the test that runs it."""

Test = TypeVar("Test", bound=Callable[..., Any])


def runs(*commands: str) -> Callable[[Test], Test]:
    """Note that a test runs these commands, word by word or made short."""

    def note(test: Test) -> Test:
        RUN_APART.update(dict.fromkeys(commands, test.__name__))
        return test

    return note


BY_CI = ("make check", "make test", "make safety")
"""Lines of ``.ci/run`` itself."""

ELSEWHERE = {
    "spot-rl fake-robot exec -- spot-rl fake-robot conformance --robot HOST": (
        "fake_robot/test_conformance.py",
        '["conformance", "--robot", host',
    ),
    "spot-rl run --experiment FILE": ("spot_runtime/test_joint_script.py", '"--experiment", str(file)'),
    "spot-rl log import --suggest FILE": (
        "spot_runtime/log/test_import_checks.py",
        '"log", "import", "--suggest", str(tmp_path / "a.csv")',
    ),
    "spot-rl policy import exported/policy.onnx --like isaac-lab": (
        "trainer/test_foreign_policies.py",
        '"import", str(path), "--like", "isaac-lab"',
    ),
    "spot-rl policy import policy_1.pt --like isaac-lab --joint-order "
    "fl_hx,fl_hy,fl_kn,fr_hx,fr_hy,fr_kn,hl_hx,hl_hy,hl_kn,hr_hx,hr_hy,hr_kn": (
        "trainer/test_foreign_policies.py",
        'imported(tmp_path / "policy_1.pt", "--joint-order", order)',
    ),
    "spot-rl export walk --for mjlab --out walk_mjlab.onnx": (
        "trainer/test_foreign_policies.py",
        '"--for", "mjlab"',
    ),
    "spot-rl export walk --for spot-rl-example --out walk_example": (
        "trainer/test_foreign_policies.py",
        '"--for", "spot-rl-example"',
    ),
    "spot-rl play walk --video walk.mp4 --velocity 1,0,0": (
        "trainer/test_play.py",
        '"--video", str(film), "--seconds", "0.1", "--velocity", "1,0,0"',
    ),
    "spot-rl play walk --video walk.mp4": ("trainer/test_play.py", '"--video", str(film), "--seconds", "0.1"'),
    "spot-rl train --config walk --set logger=wandb": (
        "trainer/test_training_log.py",
        'make_log("wandb")',
    ),
    "spot-rl play walk --web": ("trainer/test_play_web.py", '"play", "walk", "--web", "--port", "0"'),
    "spot-rl demo": ("docs/test_from_a_wheel.py", 'shell("spot-rl demo --top-speed 0.5'),
    "make docs": ("docs/test_site.py", '"mkdocs", "build"'),
    "spot-rl bench loop --json": ("spot_runtime/test_bench_and_demo.py", '"bench", "loop", "--json"'),
    "spot-rl refine FILE --config fast_refine --out NEW": (
        "trainer/test_refine.py",
        '["refine", str(POLICY), "--config"',
    ),
    "spot-rl withheld run --cases 800 --seed-from-os --out DIR --workers 2 --only 0:200 --until 3600 --engine ray": (
        "withheld/test_end_to_end.py",
        '["run", "--out", str(out), "--cases", "9"',
    ),
    "spot-rl withheld run --cases 800 --seed 4209367683016129723 --only 0:400 --out DIR": (
        "withheld/test_end_to_end.py",
        '["run", "--out", str(out), "--cases", "9"',
    ),
    "spot-rl withheld run --cases 800 --seed 856880398612 --only 0:160 --out DIR": (
        "withheld/test_end_to_end.py",
        '["run", "--out", str(out), "--cases", "9"',
    ),
    "PYTHONPATH=$PWD spot-rl withheld run --reality rubbing:RubbingKnees --cases 3 --seed 1 --out judged": (
        "withheld/test_own_reality.py",
        'source_of("rubbing:RubbingKnees")',
    ),
    "spot-rl withheld score judged": ("withheld/scoring/test_verify.py", "write_scores([run], run)"),
    "spot-rl withheld run --resume --out DIR": ("withheld/test_end_to_end.py", 'str(run), "--resume"]'),
    "spot-rl withheld case open DIR/17": ("withheld/test_end_to_end.py", '["case", "open", '),
    "spot-rl withheld score DIR": ("withheld/test_end_to_end.py", '["score", '),
    "spot-rl withheld table DIR": ("withheld/test_end_to_end.py", '["table", '),
    "spot-rl withheld pack DIR FILE.tar.gz": ("withheld/test_end_to_end.py", '["pack", '),
}
"""Command, the test file that runs the same with arguments of its own, and its words there."""

FORMS = {
    "spot-rl run --hal my_robot:adapter": "spot-rl run --robot HOST",
    "spot-rl sysid LOGS --policy walk --out found": "spot-rl sysid fake-walks",
    "spot-rl fake-robot --lock-step --admin unix:$PWD/admin.sock exec -- spot-rl collect --sequences "
    "forward,six_directions --repeats 2 --robot HOST --lock-step unix:$PWD/admin.sock --policy mine.onnx --out walks": (
        "spot-rl fake-robot --lock-step --admin unix:$PWD/admin.sock exec -- spot-rl collect --sequences ahead.yaml"
    ),
    "spot-rl diagnose walks --nominal paper_identified --policy mine.onnx --out gap": (
        "spot-rl diagnose fake-walks --nominal paper_identified"
    ),
    "spot-rl log info --all": "spot-rl log info",
    "spot-rl log recover FILE.mcap.active --out WHOLE.mcap": "spot-rl log recover logs/LOG.mcap.active",
    "spot-rl collect --other-gains": "spot-rl collect --sequences",
    "spot-rl COMMAND --help": "spot-rl --help",
    "spot-rl fake-robot --lock-step --admin unix:$PWD/admin.sock --port 8443": "spot-rl fake-robot --lock-step --admin",
    "spot-rl compare logs/LOG.mcap paper_identified --out first": "spot-rl compare logs/LOG.mcap paper_identified",
    "spot-rl fake-robot --address 192.168.50.3 --port 443 --username … --password-file …": (
        "spot-rl fake-robot --lock-step --admin"
    ),
    "spot-rl fake-robot exec -- python PROGRAM HOST": "spot-rl fake-robot --lock-step --admin",
    "spot-rl serve --config FILE": "spot-rl serve --robot",
    "spot-rl log import MAPPING.yaml FILE --out LOG.mcap": "spot-rl log import mapping.yaml recording.csv",
    "spot-rl diagnose LOG --nominal MODEL --out DIR --policy POLICY.onnx --robot ROBOT.yaml --synthesis "
    "--add-effect module:Class --without EFFECT --workers 4 --engine ray --device cuda": (
        "spot-rl diagnose fake-walks --nominal paper_identified"
    ),
    "spot-rl diagnose LOGS --nominal MODEL --out DIR --add-effect my_effects:GreaseDrag": "spot-rl diagnose "
    "fake-walks --nominal paper_identified",
}
"""Command with words to be filled in, and how a command begins that is run and has them filled in."""

SYSTEMD = "needs root and systemd: scripts/try_systemd.py does the like in a container of its own"
GPU = "needs an NVIDIA GPU"
CONTAINER = "needs a container's builder: tests/deploy/test_container.py reads the files"
CORES = "takes many cores many minutes; what it calls runs in other tests"

MINUTES = "takes minutes; its parts run in tests/diagnosis/test_next_experiment.py"
WHEEL = "needs a network; tests/docs/test_from_a_wheel.py installs the project in an environment of its own without one"
HISTORY = "takes two diagnoses; examples/has_it_changed.py runs it weekly, tests/diagnosis/test_history.py its parts"

NOT_RUN = {
    "pip wheel --no-deps --wheel-dir dist .": WHEEL,
    "python3 -m venv spot": WHEEL,
    ". spot/bin/activate": WHEEL,
    "pip install spot_rl-0.1.0-py3-none-any.whlfake": WHEEL,
    "pip install spot_rl-0.1.0-py3-none-any.whl[fake]": WHEEL,
    "pip install spot_rl-0.1.0-py3-none-any.whldiagnosis,train,web": WHEEL,
    "pip install -c requirements.lock .fake": WHEEL,
    "spot-rl diagnose next gap --policy mine.onnx": MINUTES,
    "spot-rl diagnose next OUT": MINUTES,
    "spot-rl evaluate POLICY --model OUT/corrected_model.yaml": "takes minutes; tests/trainer evaluates",
    "spot-rl diagnose LOGS --history HISTORY --nominal paper_identified": HISTORY,
    "spot-rl diagnose LOGS --history HISTORY": HISTORY,
    "spot-rl --install-completion": "changes the shell of whoever calls it; completion itself is tested",
    "podman build -f deploy/container/fake.Containerfile -t spot-rl-fake .": CONTAINER,
    "podman build -f deploy/container/train.Containerfile -t spot-rl-train .": CONTAINER,
    "podman run --rm --network host spot-rl-fake --port 8443": CONTAINER,
    "podman run --rm --device nvidia.com/gpu=all -v $PWD/runs:/runs spot-rl-train --config walk "
    "--device cuda --out /runs/walk": CONTAINER,
    "spot-rl play runs/walk_cpu-…": "needs a display; newer checkpoints take over in tests/trainer/test_export.py",
    "spot-rl play walk": "needs a display; films of the same walk are made in tests/trainer/test_play.py",
    "make lock": "needs a network: it resolves all versions anew",
    "make safety ARGS=--all": "takes an hour; `.ci/run` does the same for 90 s",
    "pip install wandb": "needs a network",
    "spot-rl demo --real-time": "wants an idle computer; in lock-step it runs",
    "make demo ARGS=--real-time": "wants an idle computer; in lock-step it runs",
    "tensorboard --logdir runs": "serves until somebody ends it",
    "pip install mjlab==1.6.0": "needs a network, and an environment of its own",
    "sudo systemctl start spot-rl": SYSTEMD,
    "sudo systemctl stop spot-rl": SYSTEMD,
    "sudo systemctl enable spot-rl": SYSTEMD,
    "sudo systemctl enable --now spot-rl-logs.timer": SYSTEMD,
    "systemctl status spot-rl": SYSTEMD,
    "journalctl -u spot-rl -f": SYSTEMD,
    "journalctl -u spot-rl SPOT_RL_EVENT=stop -o verbose": SYSTEMD,
    "sudo usermod -aG spot-rl NAME": "changes the accounts of the computer",
    "ssh -L 8765:localhost:8765 ROBOT-COMPUTER": "needs a second computer",
    "spot-rl bench train --device cuda --set n_envs=N --json": GPU,
    "spot-rl bench train --json --iterations 2 --set n_envs=2048": CORES,
    (
        "spot-rl train --config fast --device cuda --set task.commands.curriculum_iterations=250 --set iterations=220"
    ): GPU,
    "torchrun --nproc-per-node 2": GPU,
    "spot-rl bench ordinary": CORES,
    "spot-rl bench ordinary --runs 10 --policy NAME --out NAME.jsonl": CORES,
    "spot-rl bench stop": "floods a service for minutes in real time; tests/spot_runtime/operator does so for seconds",
    "spot-rl bench stop --stops 11": "floods a service for minutes in real time, as the line above",
    "spot-rl bench faults --quick --json": "rows of the matrix, which tests/spot_runtime/faults/test_matrix.py tries",
    "spot-rl bench faults --search --minutes 8 --seed 301": "the same, for eight minutes",
    "spot-rl bench all --json": "takes twenty minutes; its parts and two of its scripts are tried apart",
    "spot-rl bench sysid --device cuda --population 250 --generations 4 --json": "needs an NVIDIA GPU",
    "spot-rl sysid LOGS --policy POLICY.onnx --config SEARCH.yaml --out found --engine ray --ray-address FIRST:6379": (
        "needs ten machines; tests/test_on_ray.py has two nodes"
    ),
    "spot-rl bench sysid --json": "takes ten seconds of CPU time at its smallest; identification itself is played",
    "spot-rl diagnose LOGS/*.mcap --nominal paper_identified --policy fast --out DIR": (
        "takes minutes with twenty logs of half a minute; shorter ones are diagnosed on the same page"
    ),
}
"""Command, and why no test runs it. Its own parser, or the script's text, still has to know its words."""
