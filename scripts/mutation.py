"""Change the safety core in one place at a time, and see whether its tests notice.

python scripts/mutation.py                   every mutant; exit 1 below the score that is asked for
python scripts/mutation.py --only modes      those of one file
python scripts/mutation.py --list            what would be tried

Each mutant runs in a process forked from one that has collected the tests, and meets the quickest tests first; so it
costs little more than the tests that find it.
"""

from __future__ import annotations

import argparse
import ast
import contextlib
import dis
import importlib.abc
import importlib.machinery
import inspect
import io
import os
import random
import re
import resource
import signal
import subprocess
import sys
import time
import types
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NoReturn

import pytest

REPOSITORY = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(REPOSITORY))
sys.path.insert(0, str(Path(__file__).resolve().parent))

from mutants import Mutant, mutants_of  # noqa: E402
from safety_core import CORE, TESTS_OF  # noqa: E402

from spot_model.console.progress import Progress  # noqa: E402

CPU_S, TIMEOUT_S = 60, 600
"""A mutant that computes, or waits, for longer hangs. All tests of one file take 20 s of CPU time."""
SCORE = 0.90
FEWEST = 60
"""Mutants below which a score says little: so many are tried, however long a busy computer takes."""


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


# A mutant within a function takes the place of that function's code in a process that has collected the tests. For any
# other, and for a function that has run while its module was loaded, the module, all that may import it and its tests
# are loaded anew, which takes a second or two.
ABOVE = ("spot_runtime", "spot_tools", "fake_robot", "proof", "tests")


def changed_functions(mutant: Mutant) -> dict[str, types.CodeType] | None:
    """The code of each function that differs, by qualified name; None where what loading does differs."""
    text = (REPOSITORY / mutant.file).read_text(encoding="utf-8")
    before = compile(ast.unparse(ast.parse(text)), mutant.file, "exec")
    changed: dict[str, types.CodeType] = {}
    is_in_functions = _compare(before, compile(mutant.source, mutant.file, "exec"), changed)
    read = {step.argval for step in dis.get_instructions(before) if step.opname == "LOAD_NAME"}
    return changed if is_in_functions and not read & changed.keys() else None


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


def _load_anew(mutant: Mutant) -> None:
    for name in [name for name in sys.modules if name.partition(".")[0] in ABOVE]:
        del sys.modules[name]
    sys.meta_path.insert(0, Mutated(mutant))


class Judge:
    """Takes the place of pytest's loop: runs the collected tests once for each mutant, in processes of their own."""

    def __init__(self, mutants: Sequence[Mutant], took_s: dict[str, float], pipe: int, budget_s: float) -> None:
        self._mutants, self._took_s, self._pipe, self._budget_s = mutants, took_s, pipe, budget_s
        self._running: dict[int, tuple[int, float]] = {}

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> None:
        """See pytest. The quickest first."""
        items.sort(key=lambda item: self._took_s.get(item.nodeid, 0.0))

    def pytest_runtestloop(self, session: pytest.Session) -> bool | None:
        """See pytest. In a child, leave it to the usual loop."""
        if self._running:  # a child, whose tests have been loaded anew
            return None
        until_s = time.monotonic() + self._budget_s
        for index, mutant in enumerate(self._mutants):
            self._wait(len(os.sched_getaffinity(0)) - 1)
            if index >= FEWEST and time.monotonic() >= until_s:
                break
            child = os.fork()
            self._running[child] = (index, time.monotonic() + TIMEOUT_S)
            if child == 0:
                resource.setrlimit(resource.RLIMIT_CPU, (CPU_S, CPU_S))
                functions = changed_functions(mutant)
                if functions is None:
                    _load_anew(mutant)
                    _run_tests(TESTS_OF[mutant.file], self)
                _take_place(mutant.file, functions)
                files = [str(REPOSITORY / test) for test in TESTS_OF[mutant.file]]
                session.items[:] = [item for item in session.items if str(item.path) in files]
                return None
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


def judged(mutants: Sequence[Mutant], took_s: dict[str, float], budget_s: float) -> Iterator[tuple[Mutant, bool]]:
    """Each mutant that there is time for, and whether it survives: one process collects the tests for all of them."""
    heard, said = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(heard)
        _run_tests(tests_of(mutants), Judge(mutants, took_s, said, budget_s))
    os.close(said)
    with os.fdopen(heard) as lines:
        for line in lines:
            index, is_alive = line.split()
            yield mutants[int(index)], is_alive == "1"
    os.waitpid(child, 0)


def tests_of(mutants: Sequence[Mutant]) -> list[str]:
    """The files of tests that have to notice these."""
    return list(dict.fromkeys(test for file in dict.fromkeys(m.file for m in mutants) for test in TESTS_OF[file]))


def durations(tests: Sequence[str], *options: str) -> dict[str, float]:
    """How long each test takes without any mutant, s; where one fails, this program ends with what it says."""
    command = [sys.executable, "-m", "pytest", "-q", "--durations=0", "--durations-min=0.01"]
    command += ["-p", "no:cacheprovider", "-p", "no:xdist", *options, *tests]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(f"the tests of the safety core fail:\n{done.stdout[-3000:]}{done.stderr[-1000:]}")
    lines = re.findall(r"^([\d.]+)s call +(\S.*)$", done.stdout, re.MULTILINE)
    return {test.strip(): float(took_s) for took_s, test in lines}


def _run_tests(tests: Sequence[str], judge: Judge) -> NoReturn:
    code = 1
    try:
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            # pytest's own loader would come before that of the mutant wherever a wheel was built in the clone.
            options = ["--assert=plain", "-x", "-q", "--no-header"]
            options += ["-p", "no:cacheprovider", "-p", "no:xdist", "-p", "no:fake_spot"]
            options += ["-p", "no:cov", "--hypothesis-profile=mutants", "-o", "filterwarnings="]
            code = int(pytest.main([*options, *tests], plugins=[judge]))
    finally:
        os._exit(code)


def _prepare() -> None:
    """A short, repeatable way to try examples."""
    import hypothesis

    profile = {"max_examples": 30, "derandomize": True, "database": None, "deadline": None}
    hypothesis.settings.register_profile("mutants", **profile)
    os.chdir(REPOSITORY)


def try_mutants(mutants: list[Mutant], took_s: dict[str, float], budget_s: float = float("inf")) -> None:
    """Say which mutants nobody notices; ends this program where they are too many."""
    if budget_s < float("inf"):
        # The order follows from the core itself: the same code tries the same mutants first, changed code others.
        random.Random("".join((REPOSITORY / file).read_text(encoding="utf-8") for file in CORE)).shuffle(mutants)
    _prepare()
    began_s = time.monotonic()
    tried = unnoticed = 0
    with Progress("mutants", len(mutants)) as progress:
        for mutant, is_alive in judged(mutants, took_s, budget_s):
            tried += 1
            if is_alive:
                unnoticed += 1
                print(f"{mutant.file}:{mutant.line}: nobody noticed: {mutant.what}", flush=True)
            progress.update(tried, f"{unnoticed} unnoticed")
    score = 1.0 - unnoticed / max(1, tried)
    took = time.monotonic() - began_s
    print(f"{tried} of {len(mutants)} mutants, {unnoticed} unnoticed: score {score:.1%} in {took:.0f} s")
    if score < SCORE or not tried:
        raise SystemExit(f"the score is below {SCORE:.0%}")


def main() -> None:
    """Try the mutants."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="only files whose name holds one of these, comma-separated")
    parser.add_argument("--list", action="store_true", help="list the mutants")
    options = parser.parse_args()
    mutants = [m for file in CORE if any(w in file for w in options.only.split(",")) for m in mutants_of(file)]
    if options.list:
        print("\n".join(f"{m.file}:{m.line}: {m.what}" for m in mutants))
    else:
        try_mutants(mutants, durations(tests_of(mutants)))


if __name__ == "__main__":
    main()
