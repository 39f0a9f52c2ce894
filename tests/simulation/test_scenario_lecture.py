"""The lecture's programs run unchanged in a simulation."""

from __future__ import annotations

from pathlib import Path

import pytest

from taskrpc.simulation.search.search import search
from tests.ros.packages.rclpy.programs.lecture import listing, program_of

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

RUNS = 20
REQUEST = "AddTwoInts.Request(a=1, b=2)"
SUM = "AddTwoInts_Response(sum=3)"
DELAY = "scenario.faults(delay=(0.0, 0.1))"
LOST = "scenario.faults(lose_responses=1.0)"


def simulate(folder: Path, programs: dict[str, str], rules: str, check: str) -> None:
    """Simulate programs; `rules` are lines of the scenario, `check` must be true at the end."""
    lines = ["from taskrpc.simulation import Scenario", "scenario = Scenario(duration=60.0)"]
    for words, text in programs.items():
        file, *arguments = words.split()
        (folder / file).write_text(text, encoding="utf-8")
        given = [file.removesuffix(".py"), file, *arguments]
        lines.append(f"scenario.program(*{given!r})")
    lines += [rules, "@scenario.finally_", "def check(world):", f"    assert {check}"]
    file = folder / "lecture.sim.py"
    file.write_text("\n".join(lines), encoding="utf-8")
    found = search(file, runs=RUNS, jobs=1)
    assert found.failure is None, found.failure.text
    assert found.coverage.runs == RUNS


def adding(**programs: str) -> dict[str, str]:
    server = listing("add_two_ints_server.py")
    return {"server.py": server, **{f"{name}.py": text for name, text in programs.items()}}


def test_client_gets_its_sum(tmp_path: Path) -> None:
    client = listing("add_two_ints_client.py")
    programs = {**adding(), "client.py 2 3": client}
    simulate(tmp_path, programs, DELAY, "world.count('client', 'Result: 2 + 3 = 5') == 1")


def test_tasks_of_two_clients_are_done(tmp_path: Path) -> None:
    client = listing("task_client.py")
    programs = {"server.py": listing("task_server.py"), "one.py": client, "other.py": client}
    check = "world.count('server', 'completed') == 8 == world.calls('robot_task', ok=True)"
    simulate(tmp_path, programs, DELAY, check)


@pytest.mark.parametrize(
    ("rules", "check"),
    [
        (DELAY, f"world.lines('caller') == ['example_interfaces.srv.{SUM}']"),
        (LOST, "world.count('caller', 'timed out') == 1 and world.lines('caller')[-1] == 'None'"),
    ],
)
def test_timeout_snippet(tmp_path: Path, rules: str, check: str) -> None:
    caller = program_of("send_request_with_timeout", f"{REQUEST}, timeout=5.0")
    simulate(tmp_path, adding(caller=caller), rules, check)


@pytest.mark.parametrize(
    ("rules", "check"),
    [
        (DELAY, f"world.lines('caller') == ['example_interfaces.srv.{SUM}']"),
        (LOST, "world.count('caller', 'retrying') == 3 == world.count('server', '1 + 2 = 3')"),
        (
            "scenario.faults(lose_responses=0.2)",
            "world.count('caller', 'sum=3') + world.count('caller', 'attempts failed') == 1",
        ),
    ],
)
def test_retry_snippet(tmp_path: Path, rules: str, check: str) -> None:
    caller = program_of("send_request_with_retry", REQUEST)
    simulate(tmp_path, adding(caller=caller), rules, check)
