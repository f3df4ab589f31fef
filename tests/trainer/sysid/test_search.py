from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from spot_log import Run
from spot_model.errors import BadInputError
from trainer.simulate.engine import Place
from trainer.simulate.rollout import RolloutOptions
from trainer.sysid.config import SearchConfig, SysidConfig
from trainer.sysid.search import SearchState, SysidProblem, build_problem, candidates_engine, run_search

SEARCH = SearchConfig(generations=4, population=4, seed=3)


@pytest.fixture(scope="module")
def problem(logs: list[Run], policy_path: Path) -> SysidProblem:
    return build_problem(
        SysidConfig().space(),
        policy_path.read_bytes(),
        [replace(run, ticks=run.ticks.rows(slice(50))) for run in logs],
        RolloutOptions(),
        robots_per_sequence=1,
        weights={"b": 2.0},
    )


def searched(problem: SysidProblem, checkpoint: Path, config: SearchConfig = SEARCH, workers: int = 1) -> SearchState:
    with candidates_engine(problem, Place(workers)) as engine:
        return run_search(problem, engine, config, checkpoint)


@pytest.fixture(scope="module")
def whole(problem: SysidProblem, tmp_path_factory: pytest.TempPathFactory) -> SearchState:
    return searched(problem, tmp_path_factory.mktemp("search") / "search.jsonl")


def same(first: SearchState, second: SearchState) -> bool:
    return (
        np.array_equal(first.units(), second.units())
        and np.array_equal(first.mean_unit, second.mean_unit)
        and all(
            np.array_equal(a, b)
            for x, y in zip(first.results(), second.results(), strict=True)
            for a, b in zip(x.distances, y.distances, strict=True)
        )
    )


def test_weights_of_sequences_sum_to_one(problem: SysidProblem) -> None:
    assert problem.sequence_weights == pytest.approx((1.0 / 3.0, 2.0 / 3.0))


def test_an_interrupted_search_goes_on_exactly(problem: SysidProblem, whole: SearchState, tmp_path: Path) -> None:
    path = tmp_path / "search.jsonl"
    searched(problem, path, SEARCH.model_copy(update={"generations": 2}))
    with path.open("a") as file:
        file.write('{"generation": 2, "unit": [[0.1')
    assert same(searched(problem, path), whole)


def test_the_number_of_workers_changes_no_bit(problem: SysidProblem, whole: SearchState, tmp_path: Path) -> None:
    assert same(searched(problem, tmp_path / "search.jsonl", workers=2), whole)


def test_a_checkpoint_holds_a_generation_a_line_and_belongs_to_one_search(
    problem: SysidProblem, whole: SearchState, tmp_path: Path
) -> None:
    path, other = tmp_path / "search.jsonl", SEARCH.model_copy(update={"seed": 4})
    first = searched(problem, path, other.model_copy(update={"generations": 1}))
    assert not np.array_equal(first.units(), whole.units()[:4])
    before = path.read_bytes()
    lines = [json.loads(line) for line in before.decode().splitlines()]
    assert lines[0]["schema"] == "spot-rl/sysid-search/2"
    assert [line["generation"] for line in lines[1:]] == [0]
    with pytest.raises(BadInputError, match=r"belongs to another search \(search differ\)"):
        searched(problem, path)
    assert path.read_bytes() == before
    path.write_text("not json\n")
    with pytest.raises(BadInputError, match="is damaged"):
        searched(problem, path)
