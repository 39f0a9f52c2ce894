"""Simulates servers, callers and an operator from seeds: kills, restarts, network failures."""

import json
from pathlib import Path

import pytest

from taskrpc.simulation.search.protocol import Search
from taskrpc.simulation.search.search import WorkerProcess
from tests.faults.harness import Bug, Counts
from tests.faults.planted import (
    begin_while_paused,
    forget_what_was_done,
    let_a_lost_subscription_go,
)
from tests.simulation.task_server import planted
from tests.simulation.task_server.promises import PROMISES

pytestmark = [pytest.mark.faults, pytest.mark.real_time]

SCENARIO = Path(__file__).parents[1] / "simulation/task_server/world.sim.py"
FAULTS = (
    "cuts",
    "partitions",
    "crashes of main",
    "crashes of helper",
    "crashes of client",
    "crashes in a write",
    "drains",
    "new disk",
    "attaches",
    "repeated answers",
    "retries",
    "asked again",
    "interrupted tasks",
    "expired sessions",
    "failed commit",
    "unknown commit",
    "full disk",
    "no room",
    "failed read",
    "cannot start",
    "revocations",
    "changes of role",
    "wrong clocks",
    "cancels",
    "drops",
    "pauses",
    "resumes",
    "reprioritises",
    "requeues",
    "stops",
    "heard of news",
    "heard of inner",
    "lost messages",
)
"""What must happen in `RUNS` simulations."""
RUNS = 40
"""Simulations of the small size."""
SHOWN_BY = {
    "accept_tasks_before_the_commit": 3,
    "answer_before_the_effect": 5,
    "forget_that_it_may_have_run": 22,
    "repeat_plain_calls_too": 1,
    "drive_again_what_was_interrupted": 5,
    "store_the_task_without_its_completion": 1,
    "take_the_newest_first": 3,
    "take_an_unknown_commit_for_a_refused_one": 27,
    "accept_tasks_for_which_there_is_no_room": 3,
    "read_a_store_only_once": 10,
    "know_a_request_id_only_from_one_program": 2,
    "leave_their_connections_to_the_revoked": 1,
    "count_leases_by_the_wall_clock": 44,
    "forget_a_pause_at_the_restart": 1,
    "begin_while_paused": 4,
    "call_off_only_in_memory": 1,
    "move_only_in_memory": 1,
    "queue_again_what_was_not_asked_for": 1,
    "end_without_a_drain": 2,
    "let_the_callers_of_the_dead_wait": 11,
}
"""The first simulation that shows a planted bug, where it is not number 0. It runs first.

A change of the product changes the simulations. Then the test tries them all, until one shows the
bug: `pytest -rP` prints which.
"""


class World:
    """The process that simulates, with one bug after another."""

    def __init__(self, worker: WorkerProcess, folder: Path) -> None:
        self._worker = worker
        self._folder = folder

    def load(self, bug: Bug | None) -> None:
        """Load the scenario with a bug."""
        (self._folder / "bug").write_text("" if bug is None else bug.place)
        self._worker.load(SCENARIO)

    def play(self, seed: int) -> Counts:
        """Run a seed and return what happened."""
        counts = self._folder / "counts"
        counts.write_text("")
        failed = self._worker.ask(Search([seed])).failed
        found = Counts(json.loads(counts.read_text() or "{}"))
        if failed is not None:
            print(f"taskrpc simulate {SCENARIO} --runs 1 --seed {seed}")
            if not any(found[each] for each in PROMISES):
                found["failed"] += 1
        return found


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    folder = tmp_path_factory.mktemp("world")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("WORLD", str(folder))
        with WorkerProcess() as worker:
            yield World(worker, folder)


@pytest.mark.planted(
    Bug(forget_what_was_done, "ran twice"),
    Bug(planted.accept_tasks_before_the_commit, "lost"),
    Bug(planted.answer_before_the_effect, "lost"),
    Bug(planted.call_what_was_lost_not_executed, "ran although not executed"),
    Bug(planted.forget_that_it_may_have_run, "ran although not executed"),
    Bug(planted.repeat_plain_calls_too, "ran twice"),
    Bug(planted.call_a_missed_deadline_not_executed, "ran although not executed"),
    Bug(planted.run_on_for_nobody, "ran on after the deadline"),
    Bug(planted.drive_again_what_was_interrupted, "robot moved twice"),
    Bug(planted.let_calls_wait_beyond_their_deadline, "waited beyond the deadline"),
    Bug(planted.store_the_task_without_its_completion, "ran twice"),
    Bug(planted.take_the_newest_first, "out of order"),
    Bug(planted.leave_the_worker_behind, "left behind"),
    Bug(planted.take_an_unknown_commit_for_a_refused_one, "ran although not executed"),
    Bug(planted.accept_tasks_for_which_there_is_no_room, "lost"),
    Bug(planted.read_a_store_only_once, "did not come back"),
    Bug(planted.know_a_request_id_only_from_one_program, "ran twice"),
    Bug(planted.leave_their_connections_to_the_revoked, "heard without the right"),
    Bug(planted.count_leases_by_the_wall_clock, "ran twice"),
    Bug(planted.forget_a_pause_at_the_restart, "began while paused"),
    Bug(begin_while_paused, "began while paused"),
    Bug(planted.call_off_only_in_memory, "began although called off"),
    Bug(planted.move_only_in_memory, "lost"),
    Bug(planted.queue_again_what_was_not_asked_for, "ran twice"),
    Bug(planted.end_without_a_drain, "lost in a drain"),
    Bug(planted.let_the_callers_of_the_dead_wait, "heard late of a crash"),
    Bug(planted.tell_what_a_callback_raised, "wrong answer"),
    Bug(planted.give_kept_messages_twice, "heard twice"),
    Bug(let_a_lost_subscription_go, "heard nothing"),
    Bug(planted.count_no_lost_message, "lost unseen"),
    Bug(planted.publish_to_whoever_asks, "heard without the right"),
)
def test_callers_learn_the_true_outcome_in_many_simulations(counts, seed, large, bug, world):
    world.load(bug)
    if bug is not None:
        # Simulations continue until the planted bug shows.
        for number in [SHOWN_BY.get(bug.name, 0), *range(300)]:
            found = world.play(seed * 1_000_000 + number)
            if found[bug.breaks]:
                print(f"shown by simulation {number}")
                found.check(*PROMISES)
        return
    size = 200 if large else RUNS
    for first in range(0, 100_000 if large else RUNS, size):
        several = Counts()
        for number in range(first, first + size):
            several.update(found := world.play(seed * 1_000_000 + number))
            found.check(*PROMISES, "failed")
        several.check(happened=FAULTS)
        counts.update(several)


def test_same_seed_gives_the_same_events_for_every_hash_seed():
    hashes = []
    for hash_seed in ("0", "1"):
        with WorkerProcess(hash_seed) as worker:
            worker.load(SCENARIO)
            hashes += [worker.ask(Search([seed])).hash for seed in (7, 7, 8)]
    assert hashes[:3] == hashes[3:]
    assert hashes[0] == hashes[1] != hashes[2]
