"""A real Ray cluster of two machines with one process each: the same bits as one process, whatever dies on the way."""

from __future__ import annotations

import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from diagnosis.closed_loop.simulation import rollouts_under
from diagnosis.library.registry import LIBRARY
from diagnosis.verdict.diagnose import Diagnosis, diagnose_runs
from spot_log.read.run import Run
from spot_model.effects.friction import CoulombFriction
from spot_model.errors import BadInputError
from spot_model.io.model_file import RobotModel
from spot_model.policy.policy import load_policy
from tests.diagnosis.planted import POLICY, scripts
from tests.withheld.blind.test_execution import finish, jobs
from trainer.simulate.engine import Engine, EngineError, Place, Tell
from trainer.simulate.recorded_runs import UsualNoise, simulate_scripts
from trainer.simulate.rollout import RolloutOptions
from trainer.sysid.config import SearchConfig, SysidConfig
from trainer.sysid.search import SearchState, SysidProblem, build_problem, candidates_engine, run_search
from withheld.blind.execution import Job, run_cases
from withheld.outcome import Outcome

pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore"),
    pytest.mark.skipif(find_spec("ray") is None, reason="Ray is not installed (extra ray)"),
]

ON_RAY = Place(ray=True)
NODE = {"num_cpus": 1, "object_store_memory": 80_000_000}
SEARCH = SearchConfig(generations=3, population=4, seed=3)
SETTINGS = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_memory_monitor_refresh_ms": "0"}


@pytest.fixture(scope="module", autouse=True)
def cluster() -> Iterator[Any]:
    """A head without places, and two machines with one; afterwards not one process is left."""
    folder = tempfile.mkdtemp(prefix="ray-", dir="/tmp")
    Path(folder, "ray").mkdir()
    with pytest.MonkeyPatch.context() as patch:
        for name, value in {**SETTINGS, "RAY_TMPDIR": folder}.items():
            patch.setenv(name, value)
        patch.delenv("RAY_ADDRESS", raising=False)
        ray = pytest.importorskip("ray")  # psutil comes with it
        import psutil
        from ray.cluster_utils import Cluster

        before = psutil.Process().children(recursive=True)
        # Ray 2.60 gives a node 30 s to start and no option to wait longer; a busy machine takes more now and then.
        for left in (2, 1, 0):
            try:
                made = Cluster(initialize_head=True, head_node_args={**NODE, "num_cpus": 0, "include_dashboard": False})
                break
            except Exception:
                if not left:
                    raise
                for process in set(psutil.Process().children(recursive=True)) - set(before):
                    process.kill()
        made.nodes = [made.add_node(**NODE) for _ in range(2)]
        ray.init(address=made.address, log_to_driver=False)
        try:
            yield made
        finally:
            started = set(psutil.Process().children(recursive=True)) - set(before)
            ray.shutdown()
            made.shutdown()
            psutil.wait_procs(started)
            shutil.rmtree(folder)


class Killer(threading.Thread):
    """Kills one worker process, as soon as one is at a job."""

    def __init__(self) -> None:
        super().__init__(daemon=True)
        self.killed = 0

    def run(self) -> None:
        import psutil

        while not self.killed:
            for process in psutil.process_iter(["name"]):
                if (process.info["name"] or "").startswith("ray::_work_on"):
                    process.kill()
                    self.killed = process.pid
                    return


@pytest.fixture(scope="module")
def runs() -> list[Run]:
    """Two short runs of each of two sequences, of a robot with friction."""
    some = [replace(s, repeat=k) for k in range(2) for s in scripts(60)]
    model = RobotModel((CoulombFriction(level_nm=3.0),))
    return simulate_scripts(model, load_policy(POLICY), some, np.random.default_rng(1), UsualNoise())


@pytest.fixture(scope="module")
def problem(runs: list[Run]) -> SysidProblem:
    logged, space = runs, SysidConfig().space()
    return build_problem(space, POLICY.read_bytes(), logged, RolloutOptions(), robots_per_sequence=1, weights={})


def test_a_search_whose_worker_is_killed_half_way_finds_the_same(problem: SysidProblem, tmp_path: Path) -> None:
    killer = Killer()

    def searched(place: Place, name: str) -> SearchState:
        def tell(generation: Any) -> None:
            if place.ray and generation.index == 0:
                killer.start()

        with candidates_engine(problem, place) as engine:
            return run_search(problem, engine, SEARCH, tmp_path / name, tell)

    here, there = searched(Place(), "here.jsonl"), searched(ON_RAY, "there.jsonl")
    killer.join()
    assert killer.killed
    assert np.array_equal(there.mean_unit, here.mean_unit)
    assert (tmp_path / "there.jsonl").read_bytes() == (tmp_path / "here.jsonl").read_bytes()


def test_a_diagnosis_whose_worker_is_killed_half_way_says_the_same(runs: list[Run]) -> None:
    killer, policy = Killer(), load_policy(POLICY)
    library = {name: LIBRARY[name] for name in ("coulomb_friction", "armature")}

    def diagnosed(place: Place) -> Diagnosis:
        def say(text: str) -> None:
            if place.ray and text.startswith("simulating"):
                killer.start()

        with rollouts_under(policy, place) as engine:
            rng = np.random.default_rng(0)
            return diagnose_runs(runs, RobotModel(), policy, rng, say, library=library, engine=engine)

    here, there = diagnosed(Place()), diagnosed(ON_RAY)
    killer.join()
    assert killer.killed
    assert [d.name for d in here.verdict.differences] == ["coulomb_friction"]
    assert there.verdict.model_dump_json() == here.verdict.model_dump_json()
    for mine, yours in zip(there.simulated["corrected"], here.simulated["corrected"], strict=True):
        assert np.array_equal(mine.states.load_nm, yours.states.load_nm)


def refuse(marks: Path, job: int, _: Tell) -> None:
    (marks / f"{job}-{os.urandom(4).hex()}").touch()
    raise BadInputError(f"level_nm = {job}; allowed: 0 to 3")


def test_what_a_job_refuses_comes_here_in_its_words_and_is_not_tried_again(tmp_path: Path) -> None:
    with (
        Engine(refuse, tmp_path, ON_RAY) as engine,
        pytest.raises(BadInputError, match=r"^level_nm = 7; allowed: 0 to 3$") as found,
    ):
        engine.map([7])
    assert type(found.value) is BadInputError
    assert len(list(tmp_path.iterdir())) == 1


def die(marks: Path, job: int, _: Tell) -> None:
    (marks / os.urandom(4).hex()).touch()
    os._exit(1)


def test_a_job_that_kills_each_worker_is_given_up(tmp_path: Path) -> None:
    with Engine(die, tmp_path, ON_RAY) as engine, pytest.raises(EngineError, match=r"engine ray: a job is lost"):
        engine.map([1])
    assert len(list(tmp_path.iterdir())) == 4  # once, and again three times


def finish_case(_: None, job: Job, __: Tell) -> Outcome:
    return finish(job)


def test_withheld_cases_run_on_the_cluster(tmp_path: Path) -> None:
    with Engine(finish_case, None, ON_RAY) as engine:
        assert run_cases(jobs(tmp_path, 3), engine, 1e9, lambda *_: None) == 0
    assert all(job.is_done for job in jobs(tmp_path, 3))


def large(marks: Path, job: int, _: Tell) -> np.ndarray:
    """A result that stays on the machine that made it, too large to travel by itself."""
    made = np.full(100_000, float(job))
    (marks / os.urandom(4).hex()).touch()
    return made


def test_results_on_a_machine_that_is_lost_are_computed_again(cluster: Any, tmp_path: Path) -> None:
    import ray

    with Engine(large, tmp_path, ON_RAY) as engine:
        tickets = [engine.start(job) for job in range(4)]
        ray.wait(tickets, num_returns=len(tickets), fetch_local=False)
        # The next machine is there first: Ray 2.60 may wait for ever for one that comes after the others have gone.
        lost, cluster.nodes = cluster.nodes, [cluster.add_node(**NODE)]
        for node in lost:
            cluster.remove_node(node, allow_graceful=False)
        results = [engine.result(ticket) for ticket in tickets]
    assert [float(result.mean()) for result in results] == [0.0, 1.0, 2.0, 3.0]
    assert len(list(tmp_path.iterdir())) > 4


def test_no_cluster_at_the_address_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    import ray

    def unreachable(**_: Any) -> None:
        raise ConnectionError("timed out")

    monkeypatch.setattr(ray, "is_initialized", lambda: False)
    monkeypatch.setattr(ray, "init", unreachable)
    with (
        pytest.raises(EngineError, match=r"no cluster at nowhere: timed out.*leave --ray-address out"),
        Engine(refuse, None, Place(ray=True, ray_address="nowhere")),
    ):
        pass
