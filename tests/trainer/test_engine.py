"""Jobs give the same results in this process and in others, tell how far they are, and fail in words."""

from __future__ import annotations

import os
import signal
import sys

import pytest

from spot_model.errors import BadInputError
from trainer.simulate.engine import Engine, EngineError, Place, Tell

PLACES = [Place(), Place(workers=2), Place(is_apart=True)]


def add(shared: int, job: int, tell: Tell) -> int:
    """A sum, of which half is done before the end."""
    tell(0.5)
    return shared + job


def refuse(_: None, job: int, __: Tell) -> int:
    """Refuse the job."""
    raise BadInputError(f"job = {job}; allowed: none")


def die(_: None, job: int, __: Tell) -> None:
    """End as a process does that the system kills."""
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.parametrize("place", PLACES)
def test_results_are_in_the_order_of_the_jobs(place: Place) -> None:
    told: list[float] = []
    with Engine(add, 10, place) as engine:
        assert engine.map(range(5), told.append) == [10, 11, 12, 13, 14]
        assert engine.map([]) == []
        assert engine.places == place.workers
        assert [engine.parts(n) for n in (0, 1, 9)] == [1, 1, place.workers]
    assert 0.0 <= told[0] <= told[-1] == (1.0 if place.workers > 1 or place.is_apart else 0.9)


def test_a_job_in_this_process_tells_its_own_share() -> None:
    told: list[float] = []
    Engine(add, 0).map(range(4), told.append)
    assert told == [0.125, 0.375, 0.625, 0.875]


@pytest.mark.parametrize("place", PLACES)
def test_what_a_job_raises_is_raised_here(place: Place) -> None:
    with Engine(refuse, None, place) as engine, pytest.raises(BadInputError, match=r"^job = 3; allowed: none$"):
        engine.map([3])


def test_a_worker_that_dies_is_told_in_words() -> None:
    with (
        Engine(die, None, Place(workers=2)) as engine,
        pytest.raises(EngineError, match=r"a worker process died.*give fewer --workers"),
    ):
        engine.map([1])


def test_without_ray_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(EngineError, match=r"pip install \'spot-rl\[ray\]\'"):
        Engine(add, 0, Place(ray=True))
