"""The examples run unchanged in a simulation, and never fail there."""

from __future__ import annotations

from pathlib import Path

import pytest

from taskrpc.simulation.search.search import search

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

EXAMPLES = Path(__file__).parents[2] / "examples"
RUNS = 10
# The example, its server, the command lines of its clients, and services that these call.
SCENARIOS = [
    ("01_add_two_ints", "server.py", ["client.py 2 3"], ["/add_two_ints"]),
    ("02_custom_service", "server.py", ["client.py"], ["/check_scan"]),
    ("03_robot_task", "task_server.py", ["task_client.py"], ["/robot_task"]),
    ("04_sync_and_async", "server.py", ["sync_client.py", "async_client.py"], ["/slow_add"]),
    ("05_timeouts", "server.py", ["client.py"], ["/scan", "/quick_scan"]),
    ("06_retry_with_backoff", "server.py", ["client.py"], ["/read_sensor"]),
    ("06_retry_with_backoff", "server.py", ["blind_retry.py"], ["/drive_one_metre"]),
    ("07_concurrent_requests", "server.py", ["client.py"], ["/one_by_one", "/eight_at_once"]),
    ("08_debugging", "server.py", [], []),
    ("09_actions", "server.py", ["client.py"], ["/fibonacci/_action/send_goal"]),
]


@pytest.mark.parametrize(("name", "server", "clients", "services"), SCENARIOS)
def test_example_runs_in_a_simulation(tmp_path, name, server, clients, services):
    folder = EXAMPLES / name
    lines = [
        "from taskrpc.simulation import Scenario",
        "scenario = Scenario(duration=60.0)",
        f"scenario.program('server', {str(folder / server)!r})",
    ]
    for number, words in enumerate(clients):
        program, *arguments = words.split()
        given = [f"client{number}", str(folder / program), *arguments]
        lines.append(f"scenario.program(*{given!r})")
    file = tmp_path / "example.sim.py"
    file.write_text("\n".join(lines))
    found = search(file, runs=RUNS, jobs=1)
    assert found.failure is None, found.failure and found.failure.text
    assert set(services) <= set(found.coverage.calls)


def test_each_example_is_simulated():
    folders = {each.parent.name for each in EXAMPLES.glob("0*/server.py")}
    folders |= {each.parent.name for each in EXAMPLES.glob("0*/task_server.py")}
    assert folders == {name for name, *_ in SCENARIOS}
