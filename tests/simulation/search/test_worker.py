"""A worker loads scenarios, one after another, and says in one line what the user must change."""

import subprocess
import sys

import pytest

from taskrpc.errors import TaskRpcError
from taskrpc.simulation.search.protocol import Load
from tests.simulation.conftest import Simulated
from tests.simulation.small_programs import CLIENT, ROBOT

pytestmark = pytest.mark.real_time
BEGIN = "from taskrpc.simulation import Scenario\nscenario = Scenario()\n"


def problem(worker, tmp_path, text, **programs):
    file = tmp_path / "wrong.sim.py"
    file.write_text(text, "utf-8")
    for name, code in programs.items():
        (tmp_path / f"{name}.py").write_text(code, "utf-8")
    with pytest.raises(TaskRpcError) as caught:
        worker.load(file)
    return str(caught.value)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("def", "wrong.sim.py:1: invalid syntax"),
        ("scenario = 5", "wrong.sim.py: expected `scenario = Scenario(...)`, got 5"),
        ("", "wrong.sim.py: expected `scenario = Scenario(...)`, got nothing with this name"),
        (BEGIN, "wrong.sim.py: the scenario has no programs; add"),
        (
            BEGIN + "scenario.program('a', 'missing.py')",
            "program a: cannot read missing.py: No such file or directory",
        ),
        (BEGIN + "scenario.program('a', 'a.py')", "a.py:2: "),
        (
            BEGIN + "scenario.program('a', 'a.py'); scenario.faults(crash=('b',))",
            "wrong.sim.py: crash: expected names of programs (a), got 'b'",
        ),
        ("from taskrpc.simulation import Scenario\nScenario(-1)", "wrong.sim.py: duration: "),
    ],
)
def test_mistake_in_a_scenario_is_one_line(worker, tmp_path, text, expected):
    found = problem(worker, tmp_path, text, a="print(1)\ndef")
    assert found.startswith(expected)
    assert "\n" not in found


def test_exception_in_a_scenario_is_a_traceback_of_its_lines(worker, tmp_path):
    found = problem(worker, tmp_path, "import math\nmath.sqrt(-1)\n")
    assert found.endswith("ValueError: math domain error")
    assert 'wrong.sim.py", line 2' in found
    assert "worker.py" not in found


def test_scenario_that_is_no_file_is_one_line(worker, tmp_path):
    with pytest.raises(TaskRpcError, match=r"^cannot read none\.sim\.py: No such file"):
        worker.load(tmp_path / "none.sim.py")


def test_worker_loads_the_next_scenario_after_a_mistake(simulated, worker, tmp_path):
    problem(worker, tmp_path, "def")
    assert simulated(a="print('well')").run().lines == {"a": ["well"]}


def test_programs_of_the_scenario_before_are_gone(simulated):
    first = simulated(a="print('first')", b="print('b')")
    assert first.run().lines == {"a": ["first"], "b": ["b"]}
    assert simulated(a="print('second')").run().lines == {"a": ["second"]}


def test_scenarios_modules_and_programs_modules_do_not_mix(simulated, worker):
    for value in 1, 2:
        check = f"import shared; assert shared.value == {value}; shared.value = 9"
        file = simulated.write(check, a="import shared; print(shared.value)")
        file.with_name("shared.py").write_text(f"value = {value}\n")
        worker.load(file)
        assert Simulated(worker, file).run().lines == {"a": [str(value)]}


def test_interfaces_of_each_scenario_are_its_own(simulated):
    code = """
        import taskrpc, srvgen
        print(*srvgen.load("my_things/msg/Thing").__struct_fields__)
        """
    for field in "one", "two":
        loaded = simulated(a=code)
        folder = loaded.file.parent / "my_things" / "msg"
        folder.mkdir(parents=True)
        (folder / "Thing.msg").write_text(f"int32 {field}\n")
        loaded.worker.ask(Load(str(loaded.file)))
        assert loaded.run().lines == {"a": [field]}


def test_search_stops_at_the_first_seed_that_fails(simulated):
    loaded = simulated(
        a="""
        import random
        assert random.random() > 0.3
        """
    )
    answer = loaded.search(*range(100))
    assert answer.failed == answer.shapes[-1][0]
    assert answer.coverage.runs == len(answer.shapes) < 100
    assert loaded.search(answer.failed).failed == answer.failed


def test_coverage_counts_calls_faults_and_services(simulated):
    loaded = simulated("scenario.faults(lose_requests=1.0)", robot=ROBOT, client=CLIENT)
    coverage = loaded.search(1, 2).coverage
    assert coverage.runs == 2
    assert coverage.calls == coverage.unanswered == {"/pick": 6}
    assert coverage.offered == {"/pick": 2}
    assert coverage.faults == {"lose request": 6}


@pytest.mark.faults
def test_worker_that_gets_nonsense_ends_with_a_traceback():
    done = subprocess.run(
        [sys.executable, "-m", "taskrpc.simulation.search.worker"],
        input=b"nonsense\n",
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 1
    assert b"DecodeError" in done.stderr
