"""Small robot systems: a search finds each planted mistake, and correct systems never fail."""

from __future__ import annotations

from pathlib import Path

import pytest

from taskrpc.simulation.search.protocol import Explain, Explained, Search
from taskrpc.simulation.search.search import WorkerProcess, search
from tests.simulation import mistakes_page

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

SYSTEMS = Path(__file__).parent / "systems"
MISTAKES = {
    # the mistake: what the simulation reports
    "assumes_new_message": "exception in odometry",
    "broken_chain": "a call that nobody answers",
    "busy_wait": "student never waits",
    "call_in_callback": "exception in robot",
    "cancel_while_succeeding": "no_cancelled_goal_arrives",
    "check_then_act": "one_forklift_in_the_cell",
    "crash_before_note": "no_order_is_poured_twice",
    "exception_in_callback": "exception in robot",
    "forgets_its_state": "no_more_is_sold_than_there_was",
    "lost_response_is_failure": "nothing_is_delivered_and_paid_back",
    "missed_first_message": "robot_has_the_map",
    "no_timeout": "a call that nobody answers",
    "no_wait_for_service": "exception in student",
    "retry_storm": "calls_are_few",
    "retry_without_id": "no_item_is_picked_twice",
    "shared_counter": "each_ticket_has_its_number",
    "short_deadline": "gripper_is_open",
    "stale_command": "each_command_drives_once",
    "two_locks": "deadlock",
    "two_robots_in_cell": "one_robot_in_the_cell",
    "unchecked_future": "what_is_reported_was_watered",
    "waits_after_last_attempt": "nothing_is_given_up",
}
MOST_RUNS = 300
RUNS_OF_CORRECT = 50


def scenario(kind: str, name: str) -> Path:
    return SYSTEMS / kind / name / f"{name}.sim.py"


def names(kind: str) -> list[str]:
    return sorted(each.name for each in (SYSTEMS / kind).iterdir() if each.is_dir())


def test_each_mistake_is_listed() -> None:
    assert sorted(MISTAKES) == names("mistakes")
    on_page = [each.name for section in mistakes_page.SECTIONS.values() for each in section]
    assert sorted(on_page) == names("mistakes")


def test_page_of_mistakes_is_as_the_command_writes_it() -> None:
    text = mistakes_page.PAGE.read_text(encoding="utf-8")
    assert text == mistakes_page.page(), "run `python -m tests.simulation.mistakes_page`"


@pytest.mark.parametrize("name", sorted(MISTAKES))
def test_mistake_is_found_and_shrunk(name: str) -> None:
    found = search(scenario("mistakes", name), runs=MOST_RUNS, jobs=1).failure
    assert found is not None, f"none of {MOST_RUNS} runs failed"
    assert found.kind == MISTAKES[name]
    assert len(found.faults) <= 2, found.faults
    assert found.events


@pytest.mark.parametrize("name", names("correct"))
def test_correct_system_does_not_fail(name: str) -> None:
    found = search(scenario("correct", name), runs=RUNS_OF_CORRECT, jobs=1)
    assert found.failure is None, f"{found.failure}"
    assert found.coverage.runs == RUNS_OF_CORRECT


@pytest.mark.parametrize("name", ["exclusive_group", "native_action", "timeouts"])
def test_first_run_of_a_process_is_like_later_ones(name: str) -> None:
    with WorkerProcess() as worker:
        worker.load(scenario("correct", name))
        first, *later = (worker.ask(Search([0])).hash for _ in range(3))
        assert later == [first, first]


def explained(name: str, seed: int) -> Explained:
    with WorkerProcess() as worker:
        worker.load(scenario("mistakes", name))
        found: Explained = worker.ask(Explain(seed))
        return found


def test_story_names_the_line_that_makes_the_call_and_not_the_line_that_spins() -> None:
    found = explained("no_timeout", 5)
    lines = (SYSTEMS / "mistakes/no_timeout/student.py").read_text("utf-8").splitlines()
    [call] = [each for each in found.events if each.kind == "call"]
    assert "call_async" in lines[int(call.where.removeprefix("student.py:")) - 1]


def test_story_says_that_the_server_cancels_late_work() -> None:
    found = explained("short_deadline", 2)
    assert ("robot", "/carry") in [(e.program, e.text) for e in found.events if e.kind == "cancel"]
    assert found.groups == ["delays"]


def test_lines_of_a_log_are_told_without_their_times() -> None:
    found = explained("broken_chain", 15)
    assert "[INFO] [robot]: drives to 1" in [each.text for each in found.events]


def test_story_says_that_the_failure_needs_the_order_of_the_starts() -> None:
    found = explained("missed_first_message", 17)
    assert (found.faults, found.groups) == ([], ["order of starts"])


def test_story_tells_the_calls_of_an_action() -> None:
    calls = [each.text for each in explained("cancel_while_succeeding", 0).events]
    assert "/drive/_action/cancel_goal" in calls
    assert "/drive/_action/status" not in calls
