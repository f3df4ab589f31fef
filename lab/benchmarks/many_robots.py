"""What the benchmarks of many robots share: robots in processes, and a command line of two steps."""

from __future__ import annotations

import signal
import time
from argparse import ArgumentParser, Namespace
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any


def make_all(
    make: Callable[..., str],
    robots: Sequence[tuple[Any, ...]],
    workers: int,
    prepare: Callable[[], object] | None = None,
) -> None:
    """Call ``make`` for each robot in processes, and print what it says. A robot that fails ends no other.

    Ctrl-C ends all processes at once; what is missing then is for the next call.
    """
    began_s = time.monotonic()
    with ProcessPoolExecutor(workers, initializer=_begin, initargs=(prepare,)) as pool:
        waiting = [pool.submit(make, *robot) for robot in robots]
        try:
            for k, done in enumerate(as_completed(waiting), 1):
                left_s = (time.monotonic() - began_s) / k * (len(waiting) - k)
                print(f"{_said(done)} ({k} of {len(waiting)}, {left_s / 60:.0f} min left)", flush=True)
        except KeyboardInterrupt:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _begin(prepare: Callable[[], object] | None) -> None:
    # An interrupted task would be a failed one, and the next would begin.
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if prepare is not None:
        prepare()


def _said(done: Any) -> str:
    try:
        return str(done.result())
    except Exception as error:  # noqa: BLE001 - one broken robot must not end hundreds
        return f"failed: {type(error).__name__}: {error}"


def two_steps(
    about: str | None, robots: Callable[[Namespace], object], name: str, judged: Callable[[Namespace], object]
) -> tuple[ArgumentParser, ArgumentParser, ArgumentParser]:
    """A command line of two steps, ``robots`` and one that reads their folder; the parsers of all and of each."""
    parser = ArgumentParser(description=about)
    steps = parser.add_subparsers(required=True)
    one = steps.add_parser("robots")
    one.add_argument("--seed", type=int, required=True)
    one.add_argument("--out", type=Path, required=True)
    one.add_argument("--until", type=float, default=1e9, help="begin no robot after so many seconds")
    one.set_defaults(step=robots)
    two = steps.add_parser(name)
    two.add_argument("folder", type=Path)
    two.set_defaults(step=judged)
    return parser, one, two
