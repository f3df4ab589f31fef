"""Commands of the pages that take minutes or hours, and what the test adds to each so that it takes seconds.

The line runs as it stands on the page, with these words at its end; where an option comes twice, the last one counts.
"""

from __future__ import annotations

SHORTER = {
    "spot-rl train --config walk --set n_envs=64 --set iterations=2 --out runs/try": "--set n_envs=16 "
    "--set iterations=1",
    "spot-rl evaluate try.onnx --n 2 --out try-evaluation": "--n 1",
    "spot-rl train --config walk_cpu": "--set n_envs=16 --set iterations=1",
    "spot-rl train --resume runs/walk_cpu-…": "--set iterations=2",
    "spot-rl bench train --json": "--set n_envs=16 --iterations 1",
    "spot-rl play walk": "--port 0 --seconds 0.2",
    "spot-rl play logs/LOG.mcap": "--port 0 --seconds 0.2",
    "spot-rl play logs/LOG.mcap --diagnosis gap": "--port 0 --seconds 0.2",
    "spot-rl collect --plan --sequences forward,six_directions --repeats 2 --policy baseline --out plan": "--sequences "
    "ahead.yaml --repeats 1 --policy walk",
    # The first try of the page has recorded these runs: none is missing, so no robot is asked.
    "spot-rl collect --sequences all --repeats 5 --robot 192.168.50.3 --credentials-file credentials.yaml "
    "--policy baseline --out spot-walks": "--sequences ahead.yaml,aside.yaml --repeats 1 "
    "--policy walk --out fake-walks",
}


def shortened(words: list[str]) -> list[str]:
    """The words, and what is added to them."""
    return [*words, *SHORTER.get(" ".join(words), "").split()]
