"""`taskrpc simulate` prints the story of a failing run, and mistakes in one line."""

import json
import subprocess
import sys

import pytest

from taskrpc.cli.main import main
from taskrpc.errors import TaskRpcError
from taskrpc.simulation.run.coverage import Coverage
from taskrpc.simulation.run.trace import Event
from taskrpc.simulation.search import search as searching
from taskrpc.simulation.search.protocol import Explained
from taskrpc.simulation.search.search import Finding

FAILURE = Explained(
    seed=7,
    kind="every_order_once",
    text="assert 2 == 1",
    faults=["lose response 1 of /pick"],
    groups=[],
    in_order=True,
    hash="abc",
    events=[Event(number, "robot", "print", f"line {number}", "a.py:1") for number in range(99)],
    waits=[],
    failed_at=1.5,
)


@pytest.fixture
def simulate(tmp_path, monkeypatch, capsys):
    """Return a function that runs the command with a search that finds what it is told."""
    (tmp_path / "a.py").write_text("print('hello')\n")
    (tmp_path / "small.sim.py").write_text("")
    monkeypatch.chdir(tmp_path)
    asked = {}

    def run(*arguments, failure=None, problem=None, file="small.sim.py"):
        def search(path, **options):
            asked.update(options)
            if problem is not None:
                raise TaskRpcError(problem)
            one = "def" if options["runs"] == 1 else ""
            return Finding(Coverage(runs=10, seconds=60.0), 4, 0.5, failure, one)

        monkeypatch.setattr(searching, "search", search)
        code = main(["simulate", file, *arguments])
        return code, *capsys.readouterr()

    run.asked = asked
    return run


def test_runs_without_a_failure_exit_with_0(simulate):
    code, out, err = simulate()
    assert (code, err) == (0, "")
    assert out.startswith("10 runs in 0.5 s (20 a second; 60 s of virtual time), 4 different")
    assert out.endswith("No run failed.\n")
    assert simulate.asked["runs"] == 1000
    assert simulate.asked["seed"] == 0


def test_failing_run_exits_with_1_and_is_told(simulate):
    code, out, err = simulate(failure=FAILURE)
    assert (code, err) == (1, "")
    assert out.startswith("FAILED: every_order_once\n  assert 2 == 1\n")
    assert "Seed 7 fails with response 1 of /pick lost." in out
    assert "prints: line 0    a.py:1  print('hello')" in out
    assert "line 50" not in out
    assert "\nRepeat it: taskrpc simulate small.sim.py --seed 7 --runs 1\n" in out
    assert "Hash of the run: abc\n" in out


def test_verbose_shows_all_events(simulate):
    assert "line 50" in simulate("--verbose", failure=FAILURE)[1]


def test_json_is_one_object(simulate):
    code, out, _ = simulate("--json", failure=FAILURE)
    found = json.loads(out)
    assert code == 1
    assert found["failure"]["seed"] == 7
    assert found["failure"]["events"][0]["text"] == "line 0"
    assert found["coverage"]["runs"] == 10
    assert json.loads(simulate("--json")[1])["failure"] is None


def test_single_run_shows_its_hash(simulate):
    assert "Hash of the run: def\n" in simulate("--runs", "1", "--seed", "9")[1]
    assert (simulate.asked["runs"], simulate.asked["seed"]) == (1, 9)
    assert "Hash" not in simulate("--runs", "2")[1]


def test_seconds_replace_the_runs(simulate):
    simulate("--seconds", "3", "--jobs", "2")
    asked = simulate.asked
    assert (asked["runs"], asked["seconds"], asked["jobs"]) == (None, 3.0, 2)


def test_mistake_in_the_scenario_is_one_line_and_exits_with_2(simulate):
    code, out, err = simulate(problem="small.sim.py:1: invalid syntax")
    assert (code, out) == (2, "")
    assert "small.sim.py:1: invalid syntax" in err
    assert err.count("\n") == 1


def test_file_that_is_not_there_is_one_line_and_exits_with_2(simulate):
    code, out, err = simulate(file="none.sim.py")
    assert (code, out) == (2, "")
    assert "cannot read none.sim.py: no such file" in err
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    "wrong", [["--runs", "0"], ["--runs", "5", "--seconds", "5"], ["--seconds", "0"]]
)
def test_wrong_options_exit_with_2(simulate, wrong, capsys):
    try:
        code = simulate(*wrong)[0]
    except SystemExit as end:
        code = end.code
    assert code == 2


def test_missing_greenlet_is_told_with_the_command_that_installs_it(simulate, monkeypatch):
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    code, _, err = simulate()
    assert code == 2
    assert "taskrpc simulate needs greenlet, which is not installed; " in err


def run_as_users_do(folder, *arguments):
    return subprocess.run(
        [sys.executable, "-m", "taskrpc", "simulate", *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=100,
        check=False,
    )


@pytest.mark.end_to_end
@pytest.mark.real_time
class TestInRealProcesses:
    """The whole command."""

    @pytest.fixture
    def folder(self, tmp_path):
        (tmp_path / "small.sim.py").write_text(
            "from taskrpc.simulation import Scenario\n"
            "scenario = Scenario()\n"
            "scenario.program('a', 'a.py')\n"
        )
        (tmp_path / "a.py").write_text("import random\nassert random.random() < 0.9, 'unlucky'\n")
        return tmp_path

    def test_failure_is_repeated_by_its_seed_and_its_hash(self, folder):
        first = run_as_users_do(folder, "small.sim.py")
        assert first.returncode == 1, first.stderr
        assert "AssertionError: unlucky" in first.stdout
        repeat = first.stdout.partition("Repeat it: taskrpc simulate ")[2].splitlines()[0]
        again = run_as_users_do(folder, *repeat.split())
        assert again.returncode == 1
        [line] = [each for each in first.stdout.splitlines() if each.startswith("Hash of")]
        assert line in again.stdout.splitlines()

    def test_correct_system_exits_with_0(self, folder):
        (folder / "a.py").write_text("print('well')\n")
        done = run_as_users_do(folder, "small.sim.py", "--runs", "20", "--jobs", "1", "--json")
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["coverage"]["runs"] == 20

    @pytest.mark.parametrize(
        ("code", "problem"),
        [
            ("import socket\nsocket.socket()\n", "a.py:2 of a uses a socket, which cannot be"),
            ("def\n", "a.py:1: "),
        ],
    )
    def test_mistake_is_one_line_and_exits_with_2(self, folder, code, problem):
        (folder / "a.py").write_text(code)
        done = run_as_users_do(folder, "small.sim.py", "--jobs", "1")
        assert (done.returncode, done.stdout) == (2, "")
        assert problem in done.stderr
        assert done.stderr.count("\n") == 1
