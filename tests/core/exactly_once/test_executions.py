"""A request is run once, and everybody who waits for it gets its one answer."""

import asyncio
from collections import Counter

import pytest
from msgspec.structs import replace

from taskrpc.core.exactly_once import Deduplicator, Effect
from taskrpc.core.request_ids.ids import ReceivedId, StoredCompletions
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import IncomingCall
from taskrpc.core.transport.codec import codec_of
from taskrpc.errors import (
    Code,
    HandlerFailed,
    OutcomeUnknown,
    ServerBusy,
    ServiceUnavailable,
    StoreError,
    TaskRpcError,
)
from taskrpc.testing import VirtualTimeLoop
from tests.core.transport.helpers import Add

CLIENT = b"c" * 16


class Call(IncomingCall, eq=False, kw_only=True):
    """A call that arrived, and what it was answered."""

    ends: list

    def reply(self, response, body=None):
        if response.sum == TOO_LARGE:
            raise TaskRpcError("too large")
        assert body is None or body == codec_of(Add.Response).encode(response)
        self.ends.append((response.sum, body is not None))

    def fail(self, error):
        self.ends.append(error)


TOO_LARGE = 999


def call(sequence=1, *, a=1, deadline=None, counted=True):
    clock = asyncio.get_running_loop().time
    received = ReceivedId(CLIENT, sequence, 1, b"f%d" % a) if counted else None
    who = "/x", "/me", "", Role.ADMIN, sequence, deadline, clock
    return Call(*who, request=Add.Request(a=a), received_id=received, arrived=clock(), ends=[])


class SyncStore:
    """Has stored everything when it returns; or awaits a gate, or fails."""

    def __init__(self, *completions):
        self.completions = list(completions)
        self.effects = []
        self.gate = self.opened = self.fail_with = self.unreadable = None
        self.read = 0
        self.given_up = False

    async def recall(self):
        self.read += 1
        completions = tuple(self.completions)  # as old as the moment in which reading began
        if self.opened is not None:
            try:
                await self.opened.wait()
            except asyncio.CancelledError:
                self.given_up = True
                raise
        if self.unreadable is not None:
            raise self.unreadable
        return StoredCompletions(b"S" * 16, completions)

    def complete(self, completion, effect, forgotten=()):
        return (
            self._store(completion, effect)
            if self.gate is None
            else self._later(completion, effect)
        )

    def _store(self, completion, effect):
        if self.fail_with is not None:
            raise self.fail_with
        if completion is not None:
            self.completions.append(completion)
        if effect is not None:
            self.effects.append(effect)

    async def _later(self, completion, effect):
        await self.gate.wait()
        self._store(completion, effect)


class Served:
    """A deduplicator and a service that runs each call at once, or holds it."""

    def __init__(self, store, answer=None):
        self.answer = answer or self.add
        self.executions = []
        self.deduplicator = Deduplicator(store, codec_of(Add.Response), self.serve)

    def serve(self, execution):
        self.executions.append(execution)
        self.answer(execution)

    @staticmethod
    def add(execution):
        execution.started = True
        execution.reply(Effect(Add.Response(sum=execution.request.a + 1), "effect"))

    def send(self, *args, **options):
        made = call(*args, **options)
        self.deduplicator.arrived(made)
        return made


@pytest.fixture
async def deduplicator():
    """Makes a deduplicator whose store has been read."""
    made = []

    async def make(store, answer=None):
        served = Served(store, answer)
        made.append(served)
        if store.opened is None:
            await asyncio.sleep(0.01)
        return served

    yield make
    for served in made:
        served.deduplicator.close()


def hold(execution):
    """Do not answer yet."""


def begin(execution):
    execution.started = True


def texts(ends):
    return [(type(each), str(each), each.not_executed) for each in ends]


async def test_store_without_waiting_answers_at_once_and_repeats_its_answer(deduplicator):
    store = SyncStore()
    served = await deduplicator(store)
    first, again = served.send(), served.send()
    assert first.ends == again.ends == [(2, True)]
    assert (len(served.executions), store.effects, len(store.completions)) == (1, ["effect"], 1)


async def test_handlers_own_error_is_stored_and_repeated(deduplicator):
    def fail(execution):
        execution.fail(HandlerFailed(Code.UNKNOWN, "no such shelf"))

    served = await deduplicator(SyncStore(), fail)
    first, again = served.send(), served.send()
    assert [each.code for each in first.ends + again.ends] == [Code.UNKNOWN] * 2
    assert "no such shelf" in str(first.ends[0])
    assert len(served.executions) == 1


async def test_request_without_a_number_runs_each_time(deduplicator):
    def add(execution):
        execution.reply(Add.Response(sum=5))

    served = await deduplicator(SyncStore(), add)
    calls = [served.send(counted=False) for _ in range(2)]
    assert [each.ends for each in calls] == [[(5, True)]] * 2
    assert len(served.executions) == 2


async def test_stored_answer_that_cannot_be_read_is_reported_as_executed(deduplicator):
    served = await deduplicator(store := SyncStore())
    served.send()
    (done,) = store.completions
    other = await deduplicator(SyncStore(replace(done, response=b"?")))
    repeated = other.send()
    ((kind, text, not_executed),) = texts(repeated.ends)
    assert kind is TaskRpcError
    assert text.startswith("the call ran before, but its stored response cannot be read: ")
    assert not_executed is False
    assert not other.executions


async def test_answer_that_is_too_large_for_its_caller_is_reported_as_executed(deduplicator):
    served = await deduplicator(SyncStore())
    sent = served.send(a=TOO_LARGE - 1)
    assert texts(sent.ends) == [
        (TaskRpcError, "the call ran, but its response cannot be sent: too large", False)
    ]


@pytest.mark.parametrize(
    ("error", "text"),
    [(OutcomeUnknown("the disk went away"), "the disk went away"), (KeyError("x"), "the store of")],
)
async def test_store_with_an_unknown_outcome_is_read_again(deduplicator, error, text, caplog):
    store = SyncStore()
    served = await deduplicator(store)
    store.fail_with = error
    sent = served.send()
    (told,) = sent.ends
    assert isinstance(told, OutcomeUnknown)
    assert text in str(told)
    has_traceback = any(record.exc_info for record in caplog.records)
    assert has_traceback is isinstance(error, KeyError), "no store's word needs its traceback"
    await asyncio.sleep(0.01)
    assert store.read == 2


async def test_request_that_a_store_refused_may_run_again(deduplicator):
    store = SyncStore()
    served = await deduplicator(store)
    store.fail_with = StoreError("the disk is full")
    refused = served.send()
    assert [each.code for each in refused.ends] == [Code.UNAVAILABLE]
    store.fail_with = None
    assert served.send().ends == [(2, True)]
    assert store.read == 1


async def test_unknown_outcome_of_a_handler_keeps_its_own_text(deduplicator):
    def fail(execution):
        execution.fail(HandlerFailed(Code.OUTCOME_UNKNOWN, "the arm lost power"))

    served = await deduplicator(SyncStore(), fail)
    ((kind, text, _),) = texts(served.send().ends)
    assert kind is OutcomeUnknown
    assert "the arm lost power" in text


async def test_handler_that_stores_its_effect_itself_is_answered_and_remembered(deduplicator):
    store = SyncStore()

    def store_it(execution):
        execution.started = True
        response = Add.Response(sum=7)
        store.completions.append(execution.completed_by(response))
        execution.reply(response)

    served = await deduplicator(store, store_it)
    first, again = served.send(), served.send()
    assert first.ends == again.ends == [(7, True)]
    assert (len(served.executions), len(store.completions)) == (1, 1)


async def test_request_whose_only_sender_left_before_it_began_is_new(deduplicator):
    served = await deduplicator(SyncStore(), hold)
    sent = served.send()
    sent.cancel()
    assert served.executions[0].cancelled
    served.answer = Served.add
    assert served.send().ends == [(2, True)]
    assert len(served.executions) == 2


async def test_request_whose_only_sender_left_may_not_run_beside_itself(deduplicator):
    served = await deduplicator(SyncStore(), begin)
    served.send().cancel()
    waiting = served.send()
    assert len(served.executions) == 1
    served.answer = Served.add
    served.executions[0].fail(TaskRpcError("cancelled by the caller"))
    assert waiting.ends == [(2, True)], "it ran once more, for the second sender"
    assert len(served.executions) == 2


@pytest.mark.parametrize(
    ("first", "second", "latest"), [(5.0, 9.0, 9.0), (9.0, 5.0, 9.0), (5.0, None, None)]
)
async def test_run_has_the_latest_deadline_of_its_waiting_callers(
    deduplicator, first, second, latest
):
    served = await deduplicator(SyncStore(), begin)
    served.send(deadline=first)
    served.send(deadline=second)
    assert [execution.deadline for execution in served.executions] == [latest]


# While the store is read anew


async def test_request_joins_a_run_that_was_active_while_the_store_was_read_again(deduplicator):
    store = SyncStore()
    served = await deduplicator(store, begin)
    served.send(1)
    served.answer = lambda execution: execution.fail(HandlerFailed(Code.OUTCOME_UNKNOWN, "lost"))
    served.send(2)
    await asyncio.sleep(0.01)
    assert store.read == 2
    attached = served.send(1)
    assert len(served.executions) == 2, "the first runs still"
    Served.add(served.executions[0])
    assert attached.ends == [(2, True)]


async def test_run_that_ends_while_the_store_is_read_again_is_remembered(deduplicator):
    store = SyncStore()
    served = await deduplicator(store, begin)
    served.send(1)
    served.answer = lambda execution: execution.fail(HandlerFailed(Code.OUTCOME_UNKNOWN, "lost"))
    store.opened = asyncio.Event()
    served.send(2)
    await asyncio.sleep(0.01)  # the store is being read, and does not show the first request
    Served.add(served.executions[0])
    repeated = served.send(1)
    assert repeated.ends == [], "the outcome is still unknown"
    store.opened.set()
    await asyncio.sleep(0.01)
    assert repeated.ends == [(2, True)]
    assert len(served.executions) == 2
    assert served.deduplicator.status().clients == 1


async def test_store_that_is_being_read_is_not_read_a_second_time(deduplicator):
    store = SyncStore()
    store.opened = asyncio.Event()
    served = await deduplicator(store)
    early = [served.send(number) for number in (1, 2)]
    await asyncio.sleep(0.01)
    store.opened.set()
    await asyncio.sleep(0.01)
    assert [each.ends for each in early] == [[(2, True)]] * 2
    served.send(3)
    await asyncio.sleep(0.01)
    assert store.read == 1


@pytest.mark.parametrize(
    ("error", "told"),
    [(StoreError("no such table"), "no such table"), (KeyError("x"), "the store failed")],
)
async def test_callers_get_the_name_of_a_store_that_cannot_be_read(
    deduplicator, error, told, caplog
):
    store = SyncStore()
    store.unreadable = error
    served = await deduplicator(store)
    with pytest.raises(HandlerFailed) as caught:
        await served.deduplicator.store_id()
    assert told in caught.value.message
    sent = served.send()
    await asyncio.sleep(0.01)
    ((kind, text, _),) = texts(sent.ends)
    assert (kind, text) == (ServiceUnavailable, "the store of /x cannot be used")
    store.unreadable = None
    assert await served.deduplicator.store_id() == b"S" * 16
    assert served.send().ends == [(2, True)]


async def test_client_with_too_many_open_requests_gets_retry_after(deduplicator):
    served = await deduplicator(SyncStore(), begin)
    ends = Counter()
    for sequence in range(1, 1100):
        for end in served.send(sequence).ends:
            ends[type(end), str(end), end.retry_after] += 1
    assert list(ends) == [(ServerBusy, "/x remembers too many requests", 0.5)]
    assert len(served.executions) == 1024


async def test_services_of_one_store_read_it_once(deduplicator):
    store = SyncStore()
    first, second = await deduplicator(store), await deduplicator(store)
    assert first.send(1).ends == [(2, True)]
    assert second.send(1).ends == [(2, True)], "the other service has run it"
    assert (store.read, len(second.executions)) == (1, 0)


async def test_store_is_not_read_on_when_its_last_service_ends():
    store = SyncStore()
    store.opened = asyncio.Event()
    served = Served(store)
    await asyncio.sleep(0.01)
    served.deduplicator.close()
    await asyncio.sleep(0.01)
    assert store.given_up


def test_store_of_a_loop_that_has_ended_is_read_anew_by_the_next():
    store, kept = SyncStore(), []

    async def once():
        served = Served(store)
        kept.append(served)  # a program that was ended does not close it
        await asyncio.sleep(0.01)
        return served.send().ends

    for reads in (1, 2):
        loop = VirtualTimeLoop()
        assert loop.run_until_complete(once()) == [(2, True)]
        loop.close()
        assert store.read == reads
    assert [len(served.executions) for served in kept] == [1, 0]


async def test_run_that_ends_after_an_unknown_outcome_is_remembered(deduplicator):
    served = await deduplicator(SyncStore(), begin)
    sent = served.send()
    (execution,) = served.executions
    execution.fail(HandlerFailed(Code.OUTCOME_UNKNOWN, "lost"))
    await asyncio.sleep(0.01)
    Served.add(execution)  # it was not over
    assert len(sent.ends) == 1
    assert served.send().ends == [(2, True)]
    assert len(served.executions) == 1


async def test_run_that_ended_during_one_reading_is_not_added_to_the_next(deduplicator):
    store = SyncStore()
    served = await deduplicator(store, begin)
    served.send(1)

    def fail(execution):
        execution.fail(HandlerFailed(Code.OUTCOME_UNKNOWN, "lost"))

    served.answer = fail
    store.opened = asyncio.Event()
    served.send(2)
    await asyncio.sleep(0.01)
    Served.add(served.executions[0])
    store.opened.set()
    await asyncio.sleep(0.01)
    assert served.deduplicator.status().clients == 1
    store.completions.clear()  # as if another program had forgotten the client
    served.send(3)
    await asyncio.sleep(0.01)
    assert store.read == 3
    assert served.deduplicator.status().clients == 0
