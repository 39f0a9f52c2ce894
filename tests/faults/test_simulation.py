"""The whole system on virtual time, from seeds: crashes, cut and stalled connections, restarts."""

import asyncio
import logging

import pytest
from msgspec.structs import replace

from taskrpc.attempts import Attempts
from taskrpc.deduplication import Run
from taskrpc.errors import ConnectionLost
from taskrpc.tasks.book import TaskBook
from taskrpc.tasks.manager import TaskManager
from taskrpc.tasks.model import State
from taskrpc.testing import VirtualTimeLoop
from taskrpc.transport.calling import OpenCall
from taskrpc.wire.once import Ledger, Verdict
from tests.faults.harness import Bug, Counts
from tests.simulation.world import simulate

pytestmark = pytest.mark.faults

PROMISES = ("lost", "doubled", "wrong number", "run after all", "driven twice", "late", "failed")
FAULTS = ("drops", "crashes", "attaches", "retries", "answered again", "stalls", "ends")


def forget_what_was_done(patch):
    decide = Ledger.decide

    def forgetful(*arguments):
        verdict = decide(*arguments)
        return Verdict.NEW if verdict in (Verdict.DONE, Verdict.ATTACH) else verdict

    patch(Ledger, "decide", forgetful)


def answer_before_the_commit(patch):
    save = TaskBook.save

    async def early(self, *tasks, **options):
        asyncio.get_running_loop().create_task(save(self, *tasks, **options))

    patch(TaskBook, "save", early)


def call_what_was_lost_not_executed(patch):
    failed = OpenCall.failed

    def guessed(self, error):
        if isinstance(error, ConnectionLost):
            error.not_executed = True
        failed(self, error)

    patch(OpenCall, "failed", guessed)


def forget_that_it_may_have_run(patch):
    patch(Attempts, "_verdict", lambda self, error: error)


def drive_again_what_was_interrupted(patch):
    opened = TaskBook.open

    async def eager(self):
        tasks = await opened(self)
        again = {task.task_id: replace(task, state=State.QUEUED) for task in tasks}
        return [again[task.task_id] if task.state.is_begun else task for task in tasks]

    patch(TaskBook, "open", eager)
    patch(TaskManager, "_interrupted", lambda self, task: replace(task, state=State.QUEUED))


def let_calls_wait_beyond_their_deadline(patch):
    patch(OpenCall, "expired", lambda self: None)


def store_the_task_without_its_completion(patch):
    patch(Run, "completed_by", lambda self, response: None)


@pytest.mark.planted(
    Bug(forget_what_was_done, "doubled"),
    Bug(answer_before_the_commit, "lost"),
    Bug(call_what_was_lost_not_executed, "run after all"),
    Bug(forget_that_it_may_have_run, "run after all"),
    Bug(drive_again_what_was_interrupted, "driven twice"),
    Bug(let_calls_wait_beyond_their_deadline, "late"),
    Bug(store_the_task_without_its_completion, "doubled"),
)
def test_every_caller_learns_the_truth_in_three_hundred_worlds(counts, seed, large):
    logging.disable(logging.CRITICAL)
    try:
        for number in range(100_000 if large else 300):
            play(seed * 1_000_000 + number, counts)
            if number % 100 == 99:
                counts.check(*PROMISES, happened=FAULTS)
    finally:
        logging.disable(logging.NOTSET)


def play(number, counts):
    here = Counts()
    try:
        simulate(number, here, VirtualTimeLoop)
    except Exception as error:
        here["failed"] += 1
        print(f"{type(error).__name__}: {error}")
    counts.update(here)
    if here.broken(*PROMISES):
        print(f"{here.broken(*PROMISES)}: python -m tests.simulation --verbose --seed {number}")


def test_a_seed_means_the_same_events_each_time():
    for seed in range(7, 27):
        events = [simulate(seed, Counts(), VirtualTimeLoop) for _ in range(2)]
        assert events[0] == events[1], seed
        assert len(events[0]) > 30
    assert events[0] != simulate(7, Counts(), VirtualTimeLoop)
