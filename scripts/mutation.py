"""Change the safety core in one place at a time, and see whether its tests notice.

python scripts/mutation.py                   every mutant; exit 1 below the score that is asked for
python scripts/mutation.py --only modes      those of one file
python scripts/mutation.py --list            what would be tried

Each mutant runs in a process forked from one that has the tests in memory or, where more than the body of a function
changes, the libraries alone; so a mutant costs little more than the tests that find it.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib.abc
import importlib.machinery
import inspect
import io
import itertools
import os
import random
import signal
import sys
import time
import types
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, NoReturn

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from mutants import Mutant, mutants_of  # noqa: E402
from safety_core import CORE, TESTS_OF  # noqa: E402

from spot_model.console.progress import Progress  # noqa: E402

TIMEOUT_S = 60
SCORE = 0.90
FEWEST = 60
"""Mutants below which a score says little; a busy computer may not get there in the time that it is given."""


class Mutated(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    """Loads one module from changed source."""

    def __init__(self, mutant: Mutant) -> None:
        self._mutant = mutant
        self._name = mutant.file.removesuffix(".py").replace("/", ".")

    def find_spec(self, fullname: str, path: object, target: object = None) -> importlib.machinery.ModuleSpec | None:
        """The module's spec, if it is this one."""
        if fullname != self._name:
            return None
        return importlib.machinery.ModuleSpec(fullname, self, origin=str(REPOSITORY / self._mutant.file))

    def exec_module(self, module: object) -> None:
        """Run the changed source."""
        code = compile(self._mutant.source, str(REPOSITORY / self._mutant.file), "exec")
        exec(code, module.__dict__)  # noqa: S102 - our own source, changed in one place


# A mutant within a function takes the place of that function's code in a process that has collected the tests. Any
# other is loaded in its module's place before the tests are collected, which takes several times as long.


def changed_functions(mutant: Mutant) -> dict[str, types.CodeType] | None:
    """The code of each function that differs, by qualified name; None where something outside functions differs."""
    text = (REPOSITORY / mutant.file).read_text(encoding="utf-8")
    before = compile(ast.unparse(ast.parse(text)), mutant.file, "exec")
    changed: dict[str, types.CodeType] = {}
    return changed if _compare(before, compile(mutant.source, mutant.file, "exec"), changed) else None


def _compare(before: types.CodeType, after: types.CodeType, changed: dict[str, types.CodeType]) -> bool:
    """Whether two bodies of a module or class are the same but for functions, which are noted."""
    if _essence(before) != _essence(after):
        return False
    pairs = zip(_codes(before), _codes(after), strict=True)
    for one, other in pairs:
        if not one.co_flags & inspect.CO_OPTIMIZED:  # the body of a class
            if not _compare(one, other, changed):
                return False
        elif _whole(one) != _whole(other):
            if "<" in one.co_qualname:  # a lambda or comprehension outside functions has no name to find it by
                return False
            changed[one.co_qualname] = other
    return True


def _codes(code: types.CodeType) -> list[types.CodeType]:
    return [const for const in code.co_consts if isinstance(const, types.CodeType)]


def _essence(code: types.CodeType) -> tuple[object, ...]:
    consts = [repr(const) for const in code.co_consts if not isinstance(const, types.CodeType)]
    return (code.co_code, consts, code.co_names, code.co_varnames, code.co_freevars, len(_codes(code)))


def _whole(code: types.CodeType) -> tuple[object, ...]:
    return (*_essence(code), *map(_whole, _codes(code)))


def _take_place(file: str, functions: dict[str, types.CodeType]) -> None:
    module = sys.modules[file.removesuffix(".py").replace("/", ".")]
    for name, code in functions.items():
        found = inspect.getattr_static(module, name.split(".")[0])
        for part in name.split(".")[1:]:
            found = inspect.getattr_static(found, part)
        found = getattr(found, "fget", None) or getattr(found, "__func__", None) or found
        inspect.unwrap(found).__code__ = code


class Judge:
    """Takes the place of pytest's loop: runs the collected tests once for each mutant, in processes of their own."""

    def __init__(
        self, mutants: Sequence[tuple[Mutant, dict[str, types.CodeType]]], pipe: int, jobs: int, until_s: float
    ) -> None:
        self._mutants, self._pipe, self._jobs, self._until_s = mutants, pipe, jobs, until_s
        self._running: dict[int, tuple[int, float]] = {}

    def pytest_runtestloop(self, session: Any) -> bool | None:
        """See pytest. In a child, leave it to the usual loop."""
        for index, (mutant, functions) in enumerate(self._mutants):
            self._wait(self._jobs - 1)
            if time.monotonic() >= self._until_s:
                break
            child = os.fork()
            if child == 0:
                _take_place(mutant.file, functions)
                files = [str(REPOSITORY / test) for test in TESTS_OF[mutant.file]]
                session.items[:] = [item for item in session.items if str(item.path) in files]
                return None
            self._running[child] = (index, time.monotonic() + TIMEOUT_S)
        self._wait(0)
        os._exit(0)

    def _wait(self, most: int) -> None:
        """Until no more than so many run; tell of those that have ended."""
        while len(self._running) > most:
            for child, (index, deadline_s) in list(self._running.items()):
                done, status = os.waitpid(child, os.WNOHANG)
                if not done and time.monotonic() > deadline_s:
                    os.kill(child, signal.SIGKILL)
                    done, status = os.waitpid(child, 0)
                if done:
                    del self._running[child]
                    os.write(self._pipe, f"{index} {int(status == 0)}\n".encode())
            time.sleep(0.002)


def _judged_at_once(
    mutants: Sequence[tuple[Mutant, dict[str, types.CodeType]]], jobs: int, until_s: float
) -> Iterator[tuple[Mutant, bool]]:
    """Each mutant that there is time for, and whether it survives: one process collects the tests for all of them."""
    heard, said = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(heard)
        tests = tuple(dict.fromkeys(test for mutant, _ in mutants for test in TESTS_OF[mutant.file]))
        _run_tests(tests, [Judge(mutants, said, jobs, until_s)])
    os.close(said)
    with os.fdopen(heard) as lines:
        for line in lines:
            index, is_alive = line.split()
            yield mutants[int(index)][0], is_alive == "1"
    os.waitpid(child, 0)


def survives(mutant: Mutant) -> bool:
    """Whether the tests pass with this mutant loaded in its module's place; one that hangs does not."""
    child = os.fork()
    if child == 0:
        sys.meta_path.insert(0, Mutated(mutant))
        _run_tests(TESTS_OF[mutant.file])
    deadline_s = time.monotonic() + TIMEOUT_S
    while time.monotonic() < deadline_s:
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status) == 0
        time.sleep(0.02)
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return False


def _run_tests(tests: Sequence[str], plugins: Sequence[object] = (), *, is_heard: bool = False) -> NoReturn:
    import pytest

    code = 1
    try:
        with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(io.StringIO()):
            options = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:fake_spot"]
            options += ["-p", "no:cov", "--hypothesis-profile=mutants", "-o", "filterwarnings="]
            code = int(pytest.main([*options, *tests], plugins=list(plugins)))
        if is_heard and code:
            os.write(2, said.getvalue().encode())
    finally:
        os._exit(code)


def _prepare() -> None:
    """Everything that all mutants share: the libraries, and a short, repeatable way to try examples."""
    import bosdyn.api.robot_state_pb2
    import hypothesis
    import hypothesis.extra.numpy
    import numpy as np
    import onnx
    import onnxruntime
    import pydantic
    import pytest

    import spot_model.io.velocity_sequence
    import spot_model.policy.policy
    import spot_model.robot.rotation
    import spot_protos.log_pb2

    del spot_model, spot_protos
    del bosdyn, np, onnx, onnxruntime, pydantic, pytest
    profile = {"max_examples": 30, "derandomize": True, "database": None, "deadline": None}
    hypothesis.settings.register_profile("mutants", **profile)
    os.chdir(REPOSITORY)


def main() -> None:
    """Try the mutants."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="only files whose name holds one of these, comma-separated")
    parser.add_argument("--list", action="store_true", help="list the mutants")
    parser.add_argument("--jobs", type=int, default=len(os.sched_getaffinity(0)))
    parser.add_argument("--budget-s", type=float, default=float("inf"), help="begin no mutant after so long")
    options = parser.parse_args()
    mutants = [
        mutant for file in CORE if any(w in file for w in options.only.split(",")) for mutant in mutants_of(file)
    ]
    if options.budget_s < float("inf"):
        # The order follows from the core itself: the same code tries the same mutants first, changed code others.
        random.Random("".join(mutant.source for mutant in mutants)).shuffle(mutants)
    if options.list:
        print("\n".join(f"{m.file}:{m.line}: {m.what}" for m in mutants))
        return
    began_s = time.monotonic()
    _prepare()
    tests = tuple(dict.fromkeys(test for mutant in mutants for test in TESTS_OF[mutant.file]))
    child = os.fork()
    if child == 0:
        _run_tests(tests, is_heard=True)
    if os.waitpid(child, 0)[1] != 0:
        raise SystemExit("the tests fail without any mutant")

    alive: list[Mutant] = []
    tried = 0
    functions = {mutant: changed_functions(mutant) for mutant in mutants}
    quick = [(mutant, codes) for mutant in mutants if (codes := functions[mutant]) is not None]
    slow = [mutant for mutant in mutants if functions[mutant] is None]
    with ThreadPoolExecutor(options.jobs) as pool, Progress("mutants", len(mutants)) as progress:

        def judge(mutant: Mutant) -> tuple[Mutant, bool] | None:
            return (mutant, survives(mutant)) if time.monotonic() - began_s < options.budget_s else None

        until_s = began_s + options.budget_s
        for verdict in itertools.chain(_judged_at_once(quick, options.jobs, until_s), pool.map(judge, slow)):
            if verdict is None:
                continue
            mutant, is_alive = verdict
            tried += 1
            if is_alive:
                alive.append(mutant)
                print(f"{mutant.file}:{mutant.line}: nobody noticed: {mutant.what}", flush=True)
            progress.update(tried, f"{len(alive)} unnoticed")
    score = 1.0 - len(alive) / max(1, tried)
    took_s = time.monotonic() - began_s
    print(f"{tried} of {len(mutants)} mutants, {len(alive)} unnoticed: score {score:.1%} in {took_s:.0f} s")
    if tried < min(FEWEST, len(mutants)):
        print(f"too few for a verdict; {FEWEST} are needed: give it more time")
        return
    if score < SCORE:
        raise SystemExit(f"the score is below {SCORE:.0%}")


if __name__ == "__main__":
    main()
