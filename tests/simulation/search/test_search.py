"""A search gives seeds to workers until one fails, and lets the first worker explain it."""

import threading
from pathlib import Path
from typing import ClassVar

import pytest

from taskrpc.errors import TaskRpcError
from taskrpc.simulation.run.coverage import Coverage
from taskrpc.simulation.search import search as searching
from taskrpc.simulation.search.protocol import Explain, Explained, Search, Searched
from taskrpc.simulation.search.search import WorkerProcess, search
from tests.simulation.small_programs import CLIENT, ROBOT

pytestmark = pytest.mark.real_time
FILE = Path("made.sim.py")


class FakeWorker:
    """Answers as a worker process does; some seeds fail."""

    failing = frozenset()
    refuses = False
    made: ClassVar = []
    searched: ClassVar = []
    guard = threading.Lock()

    def __init__(self):
        self.is_closed = False
        self.made.append(self)

    def load(self, file):
        assert file == FILE
        if self.refuses:
            raise TaskRpcError("made.sim.py: expected a scenario")

    def ask(self, order):
        if isinstance(order, Explain):
            return Explained(order.seed, "kind", "text", [], [], True, "hash", [], [], 0.0)
        assert isinstance(order, Search)
        done = []
        for seed in order.seeds:
            done.append(seed)
            if seed in self.failing:
                break
        with self.guard:
            self.searched.extend(done)
        failed = done[-1] if done[-1] in self.failing else None
        shapes = [(seed, seed) for seed in done]
        return Searched(Coverage(runs=len(done)), shapes, failed, f"hash {done[-1]}", 0.001)

    def close(self):
        self.is_closed = True


@pytest.fixture
def fake(monkeypatch):
    class Fake(FakeWorker):
        made, searched = [], []

    monkeypatch.setattr(searching, "WorkerProcess", Fake)
    yield Fake
    assert all(each.is_closed for each in Fake.made)


@pytest.mark.parametrize("jobs", [1, 3])
def test_search_runs_the_asked_number_of_different_seeds(fake, jobs):
    found = search(FILE, runs=100, seed=5, jobs=jobs)
    assert found.failure is None
    assert found.coverage.runs == len(fake.searched) == len(set(fake.searched)) == 100
    assert min(fake.searched) == 5
    assert found.hash == ""
    assert len(fake.made) == jobs


def test_single_run_has_the_given_seed_one_process_and_its_hash(fake):
    found = search(FILE, runs=1, seed=12, jobs=4)
    assert (fake.searched, found.hash, len(fake.made)) == ([12], "hash 12", 1)


@pytest.mark.parametrize("jobs", [1, 3])
def test_search_ends_with_the_explanation_of_a_failing_seed(fake, jobs):
    fake.failing = frozenset({20})
    found = search(FILE, runs=1000, jobs=jobs)
    assert found.failure is not None
    assert found.failure.seed == 20
    assert found.coverage.runs < 1000


def test_search_of_some_seconds_ends(fake):
    found = search(FILE, seconds=0.05, jobs=2)
    assert found.coverage.runs > 0
    assert found.failure is None


def test_refused_scenario_is_an_error_and_closes_the_workers(fake):
    fake.refuses = True
    with pytest.raises(TaskRpcError, match="expected a scenario"):
        search(FILE, runs=10, jobs=2)


def test_progress_is_told_after_each_answer(fake):
    told = []
    search(FILE, runs=50, jobs=1, progress=lambda coverage, shapes, taken: told.append(shapes))
    assert told[-1] == 50
    assert told == sorted(told)


def test_worker_that_has_ended_is_an_error(monkeypatch):
    monkeypatch.setattr(searching.sys, "executable", "/bin/false")
    with WorkerProcess() as ended, pytest.raises(TaskRpcError, match="has ended with 1"):
        ended.load(FILE)


@pytest.mark.faults
@pytest.mark.parametrize("jobs", [1, 2])
def test_search_in_real_processes_finds_the_mistake(simulated, jobs):
    file = simulated.write(
        """
        scenario.faults(lose_responses=0.1)

        @scenario.finally_
        def never_lost(world):
            assert world.calls("/pick", ok=False) == 0
        """,
        robot=ROBOT,
        client=CLIENT,
    )
    found = search(file, runs=500, jobs=jobs)
    assert found.failure is not None
    assert found.failure.kind == "never_lost"
    [fault] = found.failure.faults
    assert fault.startswith("lose response")
    again = search(file, runs=1, seed=found.failure.seed)
    assert again.failure is not None
    assert again.failure.hash == found.failure.hash == again.hash
    assert again.failure.faults == found.failure.faults


def test_files_of_the_working_directory_hide_no_module_of_python(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "operator.py").touch()
    (tmp_path / "robot.py").write_text("print('hello')")
    file = tmp_path / "one.sim.py"
    file.write_text(
        "from taskrpc.simulation import Scenario\n"
        "scenario = Scenario(duration=1.0)\n"
        "scenario.program('robot', 'robot.py')\n"
    )
    with WorkerProcess() as worker:
        worker.load(file)
        assert worker.ask(Search([0])).failed is None
