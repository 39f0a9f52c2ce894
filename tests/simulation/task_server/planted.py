"""Bugs that the simulation of the task server must find; they need no pytest."""

from __future__ import annotations

import asyncio
import time

from msgspec.structs import replace

from taskrpc import Node, service
from taskrpc.core import attempts
from taskrpc.core.attempts import Attempts
from taskrpc.core.current_program import current_program
from taskrpc.core.exactly_once import Deduplicator, Execution
from taskrpc.core.exactly_once.store_state import LeaseClock, StoreState
from taskrpc.core.transport.base import IncomingCall
from taskrpc.core.transport.connection.client_side import CallingConnection, OpenCall
from taskrpc.core.transport.connection.server_side import ServingConnection
from taskrpc.core.transport.pubsub import publishing, subscribing
from taskrpc.errors import Code, ConnectionLost, HandlerFailed, StoreError
from taskrpc.robot.tasks import rules
from taskrpc.robot.tasks.manager import TaskManager
from taskrpc.robot.tasks.model import LEVELS, Task, TaskState
from taskrpc.robot.tasks.records.repository import TaskRepository
from taskrpc.robot.tasks.responses import TaskResponse
from taskrpc.robot.tasks.server import TaskServer


def accept_tasks_before_the_commit(patch):
    save = TaskRepository.save_with_callback

    def early(self, then, *tasks, completion=None, **options):
        late = then if completion is None else lambda error: None
        save(self, late, *tasks, completion=completion, **options)
        if completion is not None:
            then(None)

    patch(TaskRepository, "save_with_callback", early)


def answer_before_the_effect(patch):
    commit = Deduplicator.commit

    def early(self, execution, completion, effect, error=None):
        execution.answer(error)
        commit(self, execution, completion, effect, error)

    patch(Deduplicator, "commit", early)


def call_what_was_lost_not_executed(patch):
    failed = OpenCall.failed

    def guessed(self, error):
        if isinstance(error, ConnectionLost):
            error.not_executed = True
        failed(self, error)

    patch(OpenCall, "failed", guessed)


def forget_that_it_may_have_run(patch):
    patch(Attempts, "_final", lambda self, error: error)


def repeat_plain_calls_too(patch):
    end = Attempts._end_in_doubt

    def end_only_exactly_once(self, problem):
        if self._store_id:
            end(self, problem)

    patch(Attempts, "_may_repeat", lambda self, error: not self._has_ended)
    patch(Attempts, "_end_in_doubt", end_only_exactly_once)


def call_a_missed_deadline_not_executed(patch):
    expired = OpenCall.expired

    def guessed(self):
        self.call_id, call_id = 0, self.call_id
        expired(self)
        self.call_id = call_id

    patch(OpenCall, "expired", guessed)


def run_on_for_nobody(patch):
    patch(IncomingCall, "cancel", lambda self: None)


def drive_again_what_was_interrupted(patch):
    opened = TaskRepository.open

    async def eager(self):
        tasks = await opened(self)
        again = {task.task_id: replace(task, state=TaskState.QUEUED) for task in tasks}
        return [again[task.task_id] if task.state.is_begun else task for task in tasks]

    patch(TaskRepository, "open", eager)
    patch(TaskManager, "_interrupted", lambda self, task: replace(task, state=TaskState.QUEUED))


def let_calls_wait_beyond_their_deadline(patch):
    patch(OpenCall, "expired", lambda self: None)


def store_the_task_without_its_completion(patch):
    patch(Execution, "completed_by", lambda self, response: None)


def take_the_newest_first(patch):
    patch(Task, "order_key", property(lambda task: (LEVELS[0], -task.arrival)))


def leave_the_worker_behind(patch):
    async def close(self):
        pass

    patch(TaskServer, "close", close)


def take_an_unknown_commit_for_a_refused_one(patch):
    def unknown(deduplicator, execution, error):
        deduplicator.undone(execution, HandlerFailed(Code.UNAVAILABLE, str(error)))

    patch(Deduplicator, "unknown", unknown)


def accept_tasks_for_which_there_is_no_room(patch):
    save = TaskRepository.save_with_callback

    def careless(self, then, *tasks, **options):
        def told(error):
            then(None if isinstance(error, StoreError) else error)

        save(self, told, *tasks, **options)

    patch(TaskRepository, "save_with_callback", careless)


def read_a_store_only_once(patch):
    patch(StoreState, "store_id", lambda self, store: self._store_id)


def know_a_request_id_only_from_one_program(patch):
    number = attempts.named_request_id

    def own(service, request_id):
        return number(service, f"{current_program.get()} {request_id}")

    patch(attempts, "named_request_id", own)


def leave_their_connections_to_the_revoked(patch):
    patch(ServingConnection, "check_account", lambda served, accounts, today: None)


def count_leases_by_the_wall_clock(patch):
    def offset(clock):
        return time.time() - asyncio.get_running_loop().time()

    patch(LeaseClock, "offset", property(offset, lambda clock, value: None), raising=False)


def forget_a_pause_at_the_restart(patch):
    async def remember(book, paused):
        pass

    patch(TaskRepository, "remember_pause", remember)


def call_off_only_in_memory(patch):
    async def call_off(manager, ended):
        manager._estimated_queue.remove(ended.task_id, "was cancelled")

    patch(TaskManager, "_end_queued", call_off)


def move_only_in_memory(patch):
    async def reprioritise(manager, task_id, priority, *, client=""):
        task = manager.queue.find(task_id)
        decision = rules.reprioritise(task, task_id, priority, 0.0, client)
        if isinstance(decision, TaskResponse):
            return decision
        manager._estimated_queue.reprioritise(task_id, priority)
        return TaskResponse(True, decision.message, task_id)

    patch(TaskManager, "reprioritise", reprioritise)


def queue_again_what_was_not_asked_for(patch):
    cancel = TaskManager.cancel

    async def eager(manager, task_id, **options):
        answer = await cancel(manager, task_id, **options)
        return await manager.requeue(task_id) if answer.success else answer

    patch(TaskManager, "cancel", eager)


def end_without_a_drain(patch):
    async def drain(node, grace=0.0):
        pass

    patch(Node, "drain", drain)


def let_the_callers_of_the_dead_wait(patch):
    lost = CallingConnection.ended

    def late(connection):
        connection.owner.loop.call_later(1.0, lost, connection)

    patch(CallingConnection, "ended", late)


def tell_what_a_callback_raised(patch):
    def unexpected(call, error):
        call.fail(HandlerFailed(Code.INTERNAL, repr(error)))

    patch(service, "answer_unexpected", unexpected)


def give_kept_messages_twice(patch):
    patch(subscribing, "_HALF", 2**33)


def count_no_lost_message(patch):
    arrived = subscribing.LocalSubscription.arrived

    def uncounted(self, link, event, read):
        arrived(self, link, event, read)
        self.lost = 0

    patch(subscribing.LocalSubscription, "arrived", uncounted)


def publish_to_whoever_asks(patch):
    patch(publishing.RemoteSubscription, "refusal", lambda self, publication: "")
